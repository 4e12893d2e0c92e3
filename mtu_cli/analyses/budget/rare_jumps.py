"""Does an equation jump where few trials of its budget go, or none?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import NormalDist

import numpy as np

from mtu_cli.analyses.budget.first_order import FirstOrder
from mtu_cli.analyses.budget.quantities import InputQuantity
from mtu_cli.analyses.budget.sources import Source
from mtu_cli.language import Node, evaluate, names
from mtu_cli.stats.copula import bounded_quantile
from mtu_cli.stats.distributions import NORMAL_DOF, Distribution
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.rare_jumps import NEAR, RADII, RareJump, largest_jump, matters

MOST = 200
"""Sources that are gone along, those of the largest contributions."""
RADIAL = np.concatenate([NEAR, RADII])
Steps = list[tuple[int, Distribution, float]]
"""A direction: rows of inputs, their distributions, and their shares of the way."""


def rare_jumps(
    trees: Mapping[str, Node],
    inputs: Sequence[InputQuantity],
    sources: Sequence[Source],
    first: Sequence[FirstOrder],
    u: FloatArray,
    trials: int,
    digits: int,
) -> list[RareJump]:
    """Jumps that `trials` of the outputs with `u` (n,) need not have met, one an output at most.

    Along each independent source of an input, and along the gradient of each output, both ways:
    r standard deviations of a normal z out, where the source is at its quantile of Phi(r) (a
    normal one at r u, a rectangle just inside its end). Left out are correlated inputs, and
    Student's t, of which more than the normal's few trials are far out.
    """
    found = []
    for i, tree in enumerate(trees.values()):
        if not (np.isfinite(u[i]) and u[i] > 0.0):
            continue
        ways = _directions(tree, inputs, sources, first[i])
        if not ways:
            continue
        # Squares of very large or small outputs leave the range of numbers.
        scale = first[i].scale
        own = float(u[i]) / scale
        values = np.array([_along(tree, inputs, steps) for _, steps in ways]) / scale
        jump = largest_jump(i, values, [along for along, _ in ways], own, float(trials))
        if matters(jump, own, digits):
            found.append(replace(jump, change=scale * jump.change, u=scale * jump.u))
    return found


def _directions(
    tree: Node, inputs: Sequence[InputQuantity], sources: Sequence[Source], first: FirstOrder
) -> list[tuple[str, Steps]]:
    held = names(tree)
    with np.errstate(invalid="ignore", over="ignore"):
        slopes = np.nan_to_num(first.sensitivity / first.scale, posinf=0.0, neginf=0.0)
    alone = [
        (source.rows[0], source.members[0], float(slopes[source.rows[0]]))
        for source in sources
        if source.how == "alone" and inputs[source.rows[0]].name in held
    ]
    alone = [(row, item, c * item.u) for row, item, c in alone if _is_known(item)]
    alone = sorted(alone, key=lambda entry: -abs(entry[2]))[:MOST]
    ways = [(inputs[row].name, [(row, item, 1.0)]) for row, item, _ in alone]
    size = float(np.linalg.norm([share for *_, share in alone])) if alone else 0.0
    if len(alone) > 1 and 0.0 < size < np.inf:
        ways.append(("all its inputs", [(row, item, share / size) for row, item, share in alone]))
    back = [(name, [(row, item, -share) for row, item, share in steps]) for name, steps in ways]
    return ways + back


def _is_known(item: Distribution) -> bool:
    return item.bounded or item.dof >= NORMAL_DOF


def _along(tree: Node, inputs: Sequence[InputQuantity], steps: Steps) -> FloatArray:
    """The output (3 + radii,) at `NEAR` and `RADII` of a direction."""
    moved: dict[int, FloatArray] = {}
    for row, item, share in steps:
        moved[row] = moved.get(row, np.zeros(len(RADIAL))) + _deviation(item, share * RADIAL)
    held = names(tree)
    values = {
        item.name: np.full(len(RADIAL), item.value) + moved.get(row, 0.0)
        for row, item in enumerate(inputs)
        if item.name in held
    }
    with np.errstate(all="ignore"):
        return np.broadcast_to(evaluate(tree, values), RADIAL.shape).astype(np.float64)


def _deviation(item: Distribution, z: FloatArray) -> FloatArray:
    """Quantiles of Phi(z): of a contribution about 0."""
    if not item.bounded:
        return item.u * z
    normal = NormalDist()
    return bounded_quantile(item, np.array([normal.cdf(float(value)) for value in z]))
