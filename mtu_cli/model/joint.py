"""Covariance between components that were read in the same passes.

Drift moves all components together; Gilsinn & Ling 2004 close by asking for the
cross-correlation of the components. Where passes are shared it can be measured: the
deviations of the passes' own lines, taken over all components at once, have a mean square
that is unbiased for every linear function of them, with the passes' degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mtu_cli.model.estimates import JointPasses, from_centre
from mtu_cli.model.estimation import ComponentFit, InstrumentFit
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.pass_pairs import covariance_in_runs
from mtu_cli.stats.positive_part import as_covariance


def shared_passes(fits: Mapping[str, ComponentFit]) -> tuple[JointPasses, ...]:
    """The groups of components that share passes, with their joint covariances.

    Two components share passes if one instrument read both in the same (pass, direction)
    pairs and the same runs there and back and, with a `setup` column, in the same set-ups, or,
    with times, in passes that overlap. Without either, passes of one ball-bar file are shared;
    those of two files are not, nor those of a laser, which reads one component a set-up.
    """
    groups: list[list[ComponentFit]] = []
    for fit in fits.values():
        if len(fit.instruments) != 1 or not fit.instruments[0].fit.separated:
            continue
        for group in groups:
            if _share(group[0].instruments[0], fit.instruments[0]):
                group.append(fit)
                break
        else:
            groups.append([fit])
    return tuple(_joint(group) for group in groups if len(group) > 1)


def _share(first: InstrumentFit, second: InstrumentFit) -> bool:
    a, b = first.passes, second.passes
    if first.role != second.role or a is None or b is None:
        return False
    if [key[1:] for key in a.keys] != [key[1:] for key in b.keys]:
        return False
    if not np.array_equal(first.fit.pairs, second.fit.pairs):
        return False
    if any(a.setups) or any(b.setups):
        return a.setups == b.setups
    if a.timed_each and b.timed_each:
        overlap = (a.starts <= b.ends) & (b.starts <= a.ends)
        return bool(overlap.all())
    return first.role == "lbb" and a.keys == b.keys


def _joint(group: Sequence[ComponentFit]) -> JointPasses:
    fits = [item.instruments[0].fit for item in group]
    widths = tuple(len(fit.plain.coefficients) for fit in fits)
    T = _block([from_centre(f.center, w, len(f.D)) for f, w in zip(fits, widths, strict=True)])
    deviations = np.column_stack([fit.deviations for fit in fits])
    n = fits[0].n_passes
    S = deviations.T @ deviations / fits[0].divisor
    inside = _block([np.ones_like(fit.D) for fit in fits]) > 0
    off = np.where(inside, 0.0, S)
    D = _block([fit.D_moment for fit in fits]) + off
    # All were read in the same passes: their runs are the same, too.
    pairs = fits[0].pairs
    K = 2 * len(pairs) / n * covariance_in_runs(deviations, pairs, S)
    off_runs = np.where(inside, 0.0, K)
    C = _block([item.estimate.covariance for item in group]) + (T @ (off + off_runs) @ T.T) / n
    own = [fit.half_differences for fit in fits if fit.half_differences is not None]
    halves = _block(own) + (off - off_runs) / 2 if own else None
    return JointPasses(
        components=tuple(item.name for item in group),
        widths=widths,
        covariance=as_covariance(C),
        pass_covariance=_symmetric(T @ D @ T.T),
        pass_dof=float(fits[0].pass_dof),
        n_passes=n,
        half_differences=None if halves is None else as_covariance(T @ halves @ T.T),
    )


def _symmetric(M: FloatArray) -> FloatArray:
    return (M + M.T) / 2


def _block(parts: Sequence[FloatArray]) -> FloatArray:
    """Block-diagonal matrix of the parts."""
    rows = sum(part.shape[0] for part in parts)
    columns = sum(part.shape[1] for part in parts)
    whole = np.zeros((rows, columns))
    row = column = 0
    for part in parts:
        whole[row : row + part.shape[0], column : column + part.shape[1]] = part
        row += part.shape[0]
        column += part.shape[1]
    return whole
