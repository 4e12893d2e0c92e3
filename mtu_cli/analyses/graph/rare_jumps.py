"""Does a graph leave far out what its trials have seen? Few of them ever go there."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from mtu_cli.model.graph.first_order import FirstOrder
from mtu_cli.model.graph.measurement_graph import Evaluation
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


def rare_jumps(
    whole: Evaluation, linear: FirstOrder, u: FloatArray, trials: FloatArray, digits: int
) -> list[RareJump]:
    """Jumps that `trials` (n,) of an output with `u` (n,) need not have met, one an output at most.

    Along each normal input and along the gradient of each output, both ways, the outputs are
    evaluated at `RADII`. With a chance Q to be beyond r and a change D there, u^2 grows by
    Q (1 - Q) D^2 at least, all else being unrelated: told where that changes u by more than the
    numerical tolerance of its `digits` (JCGM 101:2008, 7.9.2) and fewer than `UNSEEN` trials are
    expected beyond. A jump that takes several inputs at once, not along a gradient, is not seen.
    """
    directions, names = _directions(whole, linear)
    if not names:
        return []
    r = np.concatenate([NEAR, RADII])
    z = (directions[:, :, None] * r).reshape(len(directions), -1)
    with np.errstate(all="ignore"):
        values = whole.run(whole.inputs.scaled(z)).reshape(len(whole.outputs), len(names), len(r))
    found = []
    for i, own in enumerate(values):
        change = _change(own, max(2, int(np.count_nonzero(CHANCES * trials[i] >= UNSEEN))))
        grown = np.sqrt(u[i] ** 2 + CHANCES * (1.0 - CHANCES) * change**2)
        d, k = np.unravel_index(int(np.argmax(grown)), grown.shape)
        if grown[d, k] - u[i] > numerical_tolerance(float(u[i]), digits) > 0.0:
            found.append(
                RareJump(
                    output=i,
                    along=names[d],
                    radius=float(RADII[k]),
                    chance=float(CHANCES[k]),
                    change=float(change[d, k]),
                    u=float(grown[d, k]),
                )
            )
    return found


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


def _directions(whole: Evaluation, linear: FirstOrder) -> tuple[FloatArray, list[str]]:
    """Unit vectors (k, directions) of the independent normal inputs z, and the place of each.

    What is rectangular or triangular has an end that the trials reach, and stays at its mean.
    """
    inputs = whole.inputs
    places = [", ".join(item.places) for item in inputs.noises for _ in range(item.size)]
    normal = sum(item.size for item in inputs.noises if item.distribution == "normal")
    gradient = (linear.gradient @ inputs.factor)[:, :normal]
    size = np.linalg.norm(gradient, axis=1)
    kept = size > 0.0
    along = np.zeros((inputs.k, normal + int(kept.sum())))
    along[:normal, :normal] = np.eye(normal)
    along[:normal, normal:] = (gradient[kept] / size[kept, None]).T
    names = places[:normal] + ["all its inputs"] * int(kept.sum())
    return np.hstack([along, -along]), names * 2
