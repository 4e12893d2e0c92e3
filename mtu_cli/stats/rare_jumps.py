"""Does a model leave far out what its trials have seen? Few of them ever go there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from mtu_cli.stats.coverage import numerical_tolerance
from mtu_cli.stats.least_squares import FloatArray

STEP = 0.25
RADII = np.arange(3.0, 6.51, STEP)
"""Standard deviations out, along one direction: a chance of 1 in 700 to 1 in 2e10."""
CHANCES = np.array([NormalDist().cdf(-float(item)) for item in RADII])
NEAR = np.array([0.0, 1.0, -1.0])
UNSEEN = 3.0
"""Trials expected beyond, below which there may be none: e^-3 is 1 in 20."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RareJump:
    """`output` (its number) is `change` off all that its values near the nominal foretell, in its
    own unit, `radius` standard deviations out `along` a place; a `chance` to be beyond. Its u
    were `u` if it were so everywhere beyond.
    """

    output: int
    along: str
    radius: float
    chance: float
    change: float
    u: float


def largest_jump(
    output: int, values: FloatArray, names: Sequence[str], u: float, trials: float
) -> RareJump:
    """What makes u the largest of all that was seen along some directions, be it nothing.

    `values` (directions, 3 + radii) of an output at `NEAR` and `RADII` standard deviations out.
    With a chance Q to be beyond r and a change D there, u^2 grows by Q (1 - Q) D^2 at least, all
    else being unrelated. Where `UNSEEN` trials or more are expected beyond they have seen it.
    """
    seen = int(np.count_nonzero(CHANCES * trials >= UNSEEN))
    change = _change(values, max(2, seen))
    grown = np.sqrt(u**2 + CHANCES * (1.0 - CHANCES) * change**2)
    d, k = np.unravel_index(int(np.argmax(grown)), grown.shape)
    return RareJump(
        output=output,
        along=names[int(d)],
        radius=float(RADII[k]),
        chance=float(CHANCES[k]),
        change=float(change[d, k]),
        u=float(grown[d, k]),
    )


def _change(values: FloatArray, seen: int) -> FloatArray:
    """How far off an output is at `RADII` (directions, radii); 0 where it is not finite.

    `values` (directions, 3 + radii) at `NEAR` and `RADII`, of which trials reach the first `seen`:
    there it is 0. Beyond it is the least difference to the parabola through `NEAR`, to the line
    through the last two that were reached, and to the last: a step that the trials have seen
    leaves one of them right.
    """
    nominal, up, down, before, last = values.T[[0, 1, 2, 1 + seen, 2 + seen], :, None]
    beyond = values[:, len(NEAR) :]
    foretold = [
        nominal + 0.5 * (up - down) * RADII + 0.5 * (up + down - 2.0 * nominal) * RADII**2,
        last + (last - before) / STEP * (RADII - RADII[seen - 1]),
        last,
    ]
    with np.errstate(invalid="ignore", over="ignore"):
        change = np.min([np.abs(beyond - item) for item in foretold], axis=0)
    change[:, :seen] = 0.0
    return np.where(np.isfinite(change), change, 0.0)


def matters(jump: RareJump, u: float, digits: int) -> bool:
    """Whether it changes u by more than the numerical tolerance of its `digits` (JCGM 101:2008,
    7.9.2).
    """
    return jump.u - u > numerical_tolerance(u, digits) > 0.0
