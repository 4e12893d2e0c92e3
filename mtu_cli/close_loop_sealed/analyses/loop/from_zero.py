"""Effects that passed the gate and yet are not told from 0 by their own estimate.

The gate judges an effect by the scatter of the strata that it lies in, its interval by all that
makes it uncertain. Where the two disagree, a name would be a fact with an interval that holds 0.
"""

from __future__ import annotations

import numpy as np
from scipy.special import stdtrit

from mtu_cli.close_loop_sealed.analyses.loop.added import Added
from mtu_cli.close_loop_sealed.analyses.loop.search import Search


def not_told_from_zero(effects: Added, found: Search) -> frozenset[int]:
    """The candidates that were found alone in their class, none of whose own parameters (levels
    left out) has a 95 % interval by Student's t (JCGM 100:2008, G.3) that is without 0.
    """
    held: set[int] = set()
    if effects.fit is None:
        return frozenset()
    fit = effects.fit
    u = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    sure = np.abs(fit.beta) > stdtrit(np.maximum(fit.dof, 1.0), 0.975) * u
    first = 0
    for step in (s for s in found.steps if s.member >= 0):
        own = slice(first, first + len(effects.prepared.members[step.member].columns))
        first = own.stop
        if len(step.credible) == 1 and not sure[own].any():
            held.add(step.index)
    return frozenset(held)
