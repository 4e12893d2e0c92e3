"""Groups of columns that lie elsewhere, as a whole, on every part."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.stats.loose_columns import beside_lines_and_columns, line_bases
from mtu_cli.stats.least_squares import FloatArray

BoolArray = NDArray[np.bool_]

RATE = 1e-3
"""Chance that any group of a table without such shifts is told."""
NOTABLE, SINGLE = 0.5, 0.01
"""Times the standard deviation of single entries, and p of an axis by itself: what is less, or
more, is not told of that axis."""
FEWEST_PARTS = 8
FEWEST_COLUMNS = 2
"""Of a group, and of all others: of a single one that is its own scatter."""
LEAST = 0.05
"""Share of a group's squares beside the lines of parts, below which nothing is told of it."""
ROUNDING = 1e-12
"""Of the mean square of an axis: entries that scatter less do not."""
LEAST_DOF, OWN_DOF = 20, 3.0
"""Degrees of freedom of all entries that tell their variance, half as many of a group's, and of a
column's for its own."""


class GroupShift(NamedTuple):
    """A group's standard deviations (A,) from part to part, 0 where there is none, with their u
    (A,); and p over all groups, axes and axes together.
    """

    group: int
    s: FloatArray
    u: FloatArray
    p: float


def group_shift(
    values: FloatArray, there: BoolArray, smooth: FloatArray, groups: NDArray[np.int64]
) -> GroupShift | None:
    """The group (codes `groups` (H,) of the columns) that most clearly shifts from part to part
    against all others; None where none does.

    Of a table (P, H, A), complete where it is `there` (P, H); `smooth` (H, k) holds a constant and
    the slopes of a line that every part may have for itself. A part's shift is what its entries
    have along w = Q 1_g, Q the projector beside its line: d_p = w'y / w'w, of the variance
    sum (w_h sigma_h)^2 / (w'w)^2, sigma_h that of the column's own entries beside the lines and
    means of its group alone: one of which a column is loose, or all scatter more, does not shift.
    Against these variances Cochran's Q has F of P - 1 degrees of freedom; s^2 is the estimate of
    moments (DerSimonian & Laird, Controlled Clinical Trials 7 (1986) 177, eq. 8).
    """
    codes = [int(c) for c in np.unique(groups) if _tells(groups == c)]
    # Of two groups one against the other says it all.
    tested = codes[:1] if len(np.unique(groups)) == 2 else codes
    found = [own for code in tested if (own := _shift(values, there, smooth, groups, code))]
    if not found:
        return None
    best = min(found, key=lambda own: own.p)
    p = min(1.0, len(found) * best.p)
    return best._replace(p=p) if p <= RATE and best.s.any() else None


def _tells(member: BoolArray) -> bool:
    return bool(member.sum() >= FEWEST_COLUMNS and (~member).sum() >= FEWEST_COLUMNS)


def _shift(
    values: FloatArray, there: BoolArray, smooth: FloatArray, groups: NDArray[np.int64], code: int
) -> GroupShift | None:
    member = groups == code
    of_columns = _of_columns(values, there, np.column_stack([smooth, member]))
    if of_columns is None:
        return None
    variance, dof = of_columns
    for own in (groups == c for c in np.unique(groups)):
        # Beside lines of all columns the scatter of a small group is mixed with that of others,
        # by itself that of its columns with one another: the larger is taken.
        few = own.sum() <= smooth.shape[1]
        ways = [smooth[own, :1]] if few else [smooth[own], smooth[own, :1]]
        each = (_of_columns(values[:, own], there[:, own], way, LEAST_DOF / 2) for way in ways)
        alone = next((found for found in each if found is not None), None)
        if alone is not None:
            variance[own] = np.maximum(variance[own], alone[0])
            dof[own] = np.minimum(dof[own], alone[1])
        elif own.sum() > 1:
            return None
    rough = variance.mean(axis=0) > ROUNDING * (values**2).mean(axis=(0, 1))
    if not rough.all():
        one = _shift(values[..., rough], there, smooth, groups, code) if rough.any() else None
        return None if one is None else _on_all_axes(one, rough)
    d, squares = _of_parts(values, there, smooth, member)
    if len(d) < FEWEST_PARTS:
        return None
    terms = squares[:, :, None] * variance
    of_entries = terms.sum(axis=1)
    # Satterthwaite: of entries of several variances, each of its own degrees of freedom.
    nu = of_entries.sum(axis=0) ** 2 / (terms.sum(axis=0) ** 2 / dof[:, None]).sum(axis=0)
    return _judged(d, 1.0 / of_entries, nu, variance.mean(axis=0), code)


def _of_parts(
    values: FloatArray, there: BoolArray, smooth: FloatArray, member: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Shifts (p, A) of the parts that tell them, and (w_h/w'w)^2 (p, H)."""
    own = there & member
    basis = line_bases(there, smooth)
    w = own - np.einsum("phi,pi->ph", basis, np.einsum("phi,ph->pi", basis, own.astype(float)))
    size = (w**2).sum(axis=1)
    # Of a part whose line holds the group's place, or that has no entry of it, nothing is known.
    told = size > LEAST * np.maximum(own.sum(axis=1), 1)
    left, _, _ = beside_lines_and_columns(values, there, smooth)
    d = np.einsum("ph,pha->pa", own[told].astype(float), left[told]) / size[told, None]
    return d, (w[told] / size[told, None]) ** 2


def _judged(
    d: FloatArray, weight: FloatArray, nu: FloatArray, level: FloatArray, code: int
) -> GroupShift:
    """Of shifts `d` (p, A) with their `weight` (one over variance) by entries of `nu` degrees of
    freedom (A,) and the variance `level` (A,).
    """
    from scipy.special import fdtrc

    (parts, A), n = d.shape, len(d) - 1
    mean = (weight * d).sum(axis=0) / weight.sum(axis=0)
    Q = (weight * (d - mean) ** 2).sum(axis=0)
    each = fdtrc(n, nu, Q / n)
    together = fdtrc(A * n, nu.sum(), Q.mean() / n)
    p = min(1.0, float((A + (A > 1)) * min(each.min(), together)))
    spared = weight.sum(axis=0) - (weight**2).sum(axis=0) / weight.sum(axis=0)
    square = np.maximum((Q - n) / spared, 0.0)
    notable = (square > NOTABLE**2 * level) & (each <= SINGLE)
    s = np.sqrt(np.where(notable, square, 0.0))
    of_square = np.sqrt(2 / n) * (square + parts / weight.sum(axis=0))
    u = np.where(s > 0, of_square / (2 * np.where(s > 0, s, 1.0)), 0.0)
    return GroupShift(code, s, u, p)


def _on_all_axes(found: GroupShift, rough: BoolArray) -> GroupShift:
    s, u = np.zeros(len(rough)), np.zeros(len(rough))
    s[rough], u[rough] = found.s, found.u
    return found._replace(s=s, u=u)


def _of_columns(
    values: FloatArray, there: BoolArray, smooth: FloatArray, least: float = LEAST_DOF
) -> tuple[FloatArray, FloatArray] | None:
    """Variances (H, A) of the columns' entries beside lines and shifts, and their degrees of
    freedom (H,): those of all columns for one that tells too little; None where all do.
    """
    left, share, dof = beside_lines_and_columns(values, there, smooth)
    if dof < least:
        return None
    own = share.sum(axis=0) * dof / share.sum()
    known = own >= OWN_DOF
    squares = (left**2).sum(axis=0)
    found = np.where(known[:, None], squares / np.where(known, own, 1.0)[:, None], 0.0)
    found = np.where(known[:, None], found, squares.sum(axis=0) / dof)
    return found, np.where(known, own, float(dof))
