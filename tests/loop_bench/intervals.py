"""Whether the 95 % interval of a right name's parameter holds the true value."""

from __future__ import annotations

import numpy as np
from scipy.special import stdtrit
from shop_day import Truth
from shop_day.day import Floats

from loop_bench.folds import LIBRARY
from loop_bench.judge import Diagnosis
from mtu_cli.close_loop_sealed.analyses.loop.added import NO_OWNERS, Added, added
from mtu_cli.close_loop_sealed.analyses.loop.describe import Described
from mtu_cli.close_loop_sealed.analyses.loop.refined import searched_members, with_refined
from mtu_cli.close_loop_sealed.model.effect_candidate import Member

SHAPED = frozenset({"cyclic", "curvature", "straightness", "warm-up"})
"""Families whose parameters depend on what was searched: judged by what they say on the cells."""
SAME_COVARIATE = frozenset({"wear-approach", "thermal-growth"})
"""Families whose members differ by another effect, not by what the parameter means."""
SAME = 0.99
"""R^2 of the true effect with the found columns, from which on they share their parameter."""
UM = 1e-3


def covers(diagnosis: Diagnosis, truth: Truth) -> bool | None:
    """None where the parameter found is not one that the truth has (another sensor, another
    part): there is no true value then.
    """
    if truth.name not in diagnosis.names or not len(truth.columns):
        return None
    place, step = 0, diagnosis.found.steps[diagnosis.names.index(truth.name)]
    if step.member < 0:
        return None
    for other in diagnosis.found.steps:
        if other is step:
            break
        place += other.member >= 0
    told = _refined(diagnosis)
    effects, member = told.effects, told.prepared.members[step.member]
    columns = _centred(member, truth.errors.shape)
    if truth.family in SHAPED:
        return _shape_covered(effects, place, columns, truth)
    true, r2 = _coefficients(columns, truth.errors * UM)
    same = r2 > SAME
    if truth.family in SAME_COVARIATE:
        same = member.covariate == truth.covariate
    if not same:
        return None
    return _inside(effects, place, true, np.eye(len(true)))


def _refined(diagnosis: Diagnosis) -> Described:
    """A periodic error at the pitch that is told, which lies between those searched."""
    prepared, found = diagnosis.prepared, diagnosis.found
    values = searched_members(prepared, found, LIBRARY)
    effects = added(prepared, found, values=values)
    told = Described(prepared=prepared, found=found, effects=effects, chosen=())
    return with_refined(told, LIBRARY, 1, NO_OWNERS)


def _shape_covered(effects: Added, place: int, columns: Floats, truth: Truth) -> bool:
    """Of the projection of what was found on the true shape, which is 1 in truth."""
    shape = (truth.errors * UM).ravel()
    gradient = columns.reshape(len(columns), -1) @ shape / (shape @ shape)
    return _inside(effects, place, np.ones(1), gradient[None])


def _inside(effects: Added, place: int, true: Floats, turn: Floats) -> bool:
    """The first parameter's interval; `turn` (m, k) makes m parameters of the k of the fit."""
    fit = effects.fit
    if fit is None:
        msg = "an effect with columns was found but not fitted"
        raise ValueError(msg)
    # Behind the parameters may stand the mean error that completes the equation.
    own = np.array(effects.coefficients(place))[: turn.shape[1]]
    value = float(turn[0] @ fit.beta[own])
    u = float(np.sqrt(turn[0] @ fit.covariance[np.ix_(own, own)] @ turn[0]))
    dof = max(float(np.min(fit.dof[own])), 1.0)
    return bool(abs(value - true[0]) <= u * stdtrit(dof, 0.975))


def _centred(member: Member, shape: tuple[int, ...]) -> Floats:
    """Columns (k, P, H, A) less their means along each axis."""
    found = np.zeros((len(member.columns), *shape))
    for j, column in enumerate(member.columns):
        for axis, lever in column.items():
            found[j, :, :, axis] = lever
    centred: Floats = found - found.mean(axis=(1, 2), keepdims=True)
    return centred


def _coefficients(columns: Floats, errors: Floats) -> tuple[Floats, float]:
    """Least squares of errors on columns, and R^2."""
    X, y = columns.reshape(len(columns), -1).T, errors.ravel()
    found = np.linalg.lstsq(X / np.abs(X).max(), y, rcond=None)[0]
    left = y - X / np.abs(X).max() @ found
    beta: Floats = found / np.abs(X).max()
    return beta, 1 - float(left @ left) / float(y @ y)
