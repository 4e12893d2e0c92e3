"""Effects that a search found and that nothing is left of beside those found after them.

A trend may pass first where a drift and a step are there; beside both of them it is not told. The
same of a step at one part, found before that at the next.
"""

from __future__ import annotations

from collections.abc import Sequence

from mtu_cli.close_loop_sealed.analyses.loop.jointly import jointly
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.stats.none_of_all import p_of_none


def needless(prepared: Prepared, steps: Sequence[Step], alpha: float) -> Step | None:
    """The effect with columns whose p (F, beside all the others) is the largest, where that is
    not below `alpha`; None of one effect alone. What was searched is taken as it was found: beside
    its derivative by the pitch a wave of few cycles is not told.
    """
    own = [step for step in steps if step.member >= 0]
    if len(own) < 2:
        return None
    columns = prepared.whole([step.member for step in own])
    _, fit = jointly(prepared, columns)
    worst, largest, start = None, alpha, 0
    for step, member in zip(own, columns, strict=True):
        place = slice(start, start + len(member))
        start += len(member)
        dof = float(fit.dof[place].min())
        p = p_of_none(fit.beta[place], fit.covariance[place, place], dof)
        if p is not None and p >= largest:
            worst, largest = step, p
    return worst
