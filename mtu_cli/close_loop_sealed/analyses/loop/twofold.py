"""Effects that were found twice over: two forms of one effect make a shape that is neither."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.describe import Described
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.stats.least_squares import FloatArray

CANCELS = 0.2
"""Share of two effects' squares that their sum keeps where they all but cancel."""


def twofold(told: Described) -> tuple[str, ...]:
    """Names of candidates found twice where no one cause is both.

    Members that differ by nothing that was searched or chosen are other ways to write one cause
    (from the middle of the data, or from its beginning): their sum is a shape that the library
    has under no name, such as that of an excluded one. Others are causes of their own, such as
    two steps; where they all but cancel (`CANCELS`), they are the difference of two levers, too.
    Where another name explains one of them as well, that is told as a class.
    """
    prepared, found = told.prepared, []
    steps = [step for step in told.found.steps if step.member >= 0]
    for (i, a), (j, b) in combinations(enumerate(steps), 2):
        if a.index != b.index or _other_names(prepared, a) or _other_names(prepared, b):
            continue
        if _same_cause(told, a, b) or _cancel(_act(told, a, i), _act(told, b, j)):
            found.append(prepared.candidates[a.index].name)
    return tuple(dict.fromkeys(found))


def _other_names(prepared: Prepared, step: Step) -> bool:
    """Whether a candidate of another name is in the step's class."""
    return any(step.index != index < len(prepared.candidates) for index in step.credible)


def _same_cause(told: Described, a: Step, b: Step) -> bool:
    """Whether two members are ways to write one cause."""
    one, other = (told.prepared.members[step.member] for step in (a, b))
    apart = (one.searched, other.searched, one.chosen, other.chosen)
    return (
        not any(apart) and one.covariate == other.covariate and one.parameters == other.parameters
    )


def _act(told: Described, step: Step, place: int) -> FloatArray:
    """What an effect says of the cells that are there, about its mean, all axes end to end."""
    table, effects = told.prepared.table, told.effects
    total = np.zeros(table.errors.shape)
    if effects.fit is not None:
        beta = effects.fit.beta[effects.coefficients(place)]
        for value, column in zip(beta, told.prepared.members[step.member].columns, strict=False):
            for axis, lever in column.items():
                total[:, :, axis] += value * lever
    own = total[table.there]
    found: FloatArray = (own - own.mean(axis=0)).ravel()
    return found


def _cancel(a: FloatArray, b: FloatArray) -> bool:
    both = a + b
    return bool(both @ both < CANCELS * (a @ a + b @ b))
