"""Does a graph leave far out what its trials have seen? Few of them ever go there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mtu_cli.model.graph.first_order import FirstOrder
from mtu_cli.model.graph.measurement_graph import Evaluation
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.rare_jumps import NEAR, RADII, UNSEEN, RareJump, largest_jump, matters

__all__ = ["NEAR", "RADII", "UNSEEN", "RareJump", "rare_jumps"]

MOST = 200
"""Inputs, and gradients, that are gone along."""
AT_ONCE = 128
"""Directions of one evaluation: it holds k x directions x radii numbers."""


def rare_jumps(
    whole: Evaluation, linear: FirstOrder, u: FloatArray, trials: FloatArray, digits: int
) -> list[RareJump]:
    """Jumps that `trials` (n,) of an output with `u` (n,) need not have met, one an output at most.

    Along each normal input and along the gradient of each output that has a u, both ways, the
    outputs are evaluated at `RADII`; along no more than `MOST` inputs, those with the largest
    shares of an output's first-order variance, and no more than `MOST` gradients, the first ones.
    With a chance Q to be beyond r and a change D there, u^2 grows by Q (1 - Q) D^2 at least, all
    else being unrelated: told where that changes u by more than the numerical tolerance of its
    `digits` (JCGM 101:2008, 7.9.2) and fewer than `UNSEEN` trials are expected beyond. A jump that
    takes several inputs at once, not along a gradient, is not seen.
    """
    if not np.any(u > 0.0):
        return []
    along, names = _directions(whole, linear, u > 0.0)
    found: dict[int, RareJump] = {}
    for first in range(0, len(names), AT_ONCE):
        chunk = slice(first, first + AT_ONCE)
        values = _values(whole, along[:, chunk])
        for i in np.flatnonzero(u > 0.0).tolist():
            jump = largest_jump(i, values[i], names[chunk], float(u[i]), float(trials[i]))
            if i not in found or jump.u > found[i].u:
                found[i] = jump
    return [jump for i, jump in found.items() if matters(jump, float(u[i]), digits)]


def _values(whole: Evaluation, along: FloatArray) -> FloatArray:
    """Outputs (n, directions, 3 + radii) at `NEAR` and `RADII` along directions (k, directions)."""
    r = np.concatenate([NEAR, RADII])
    z = (along[:, :, None] * r).reshape(len(along), -1)
    with np.errstate(all="ignore"):
        values = whole.run(whole.inputs.scaled(z))
    return values.reshape(len(whole.outputs), along.shape[1], len(r))


def _directions(
    whole: Evaluation, linear: FirstOrder, judged: NDArray[np.bool_]
) -> tuple[FloatArray, list[str]]:
    """Unit vectors (k, directions) of the independent normal inputs z, and the place of each.

    What is rectangular or triangular has an end that the trials reach, and stays at its mean.
    """
    inputs = whole.inputs
    places = [", ".join(item.places) for item in inputs.noises for _ in range(item.size)]
    normal = sum(item.size for item in inputs.noises if item.distribution == "normal")
    gradient = (linear.gradient[judged] @ inputs.factor)[:, :normal]
    size = np.linalg.norm(gradient, axis=1)
    gradient = gradient[size > 0.0] / size[size > 0.0, None]
    shares = np.max(gradient**2, axis=0, initial=0.0)
    inner = np.sort(np.argsort(-shares, kind="stable")[:MOST])
    gradient = gradient[:MOST]
    along = np.zeros((inputs.k, len(inner) + len(gradient)))
    along[inner, np.arange(len(inner))] = 1.0
    along[:normal, len(inner) :] = gradient.T
    names = [places[i] for i in inner] + ["all its inputs"] * len(gradient)
    return np.hstack([along, -along]), names * 2
