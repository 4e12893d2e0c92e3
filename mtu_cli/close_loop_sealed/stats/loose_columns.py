"""Columns whose entries scatter from part to part by more than those of all others."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from mtu_cli.stats.least_squares import FloatArray

TINY = 1e-9
"""Of the largest square of directions: those with less do not differ from the others."""


def beside_lines_and_columns(
    values: FloatArray, there: NDArray[np.bool_], smooth: FloatArray
) -> tuple[FloatArray, FloatArray, int]:
    """Residuals (P, H, A) of `values` (P, H, A), zero where they are not `there` (P, H); the share
    (P, H) of a cell's variance that its part's line leaves; and the degrees of freedom of each of
    the A tables.

    Least squares on `smooth` (H, k), by every part for itself, and on a free mean of every column.
    With Q_p the projector on what the part's own cells have beside its line, the means c solve
    (sum Q_p) c = sum Q_p y_p, and the residuals Q_p (y_p - c) have sum rank(Q_p) - rank(sum Q_p)
    degrees of freedom. Cells of parts that hold no more than a line tell nothing, and have none.
    """
    basis = line_bases(there, smooth)
    y = np.where(there[:, :, None], values, 0.0)
    flat = basis.transpose(1, 0, 2).reshape(basis.shape[1], -1)
    total = np.diag(there.sum(axis=0).astype(float)) - flat @ flat.T
    square, turn = np.linalg.eigh(total)
    kept = square > TINY * max(float(square[-1]), 1.0)
    wanted = _projected(y, basis).sum(axis=0)
    means = (turn[:, kept] / square[kept]) @ (turn[:, kept].T @ wanted)
    left = _projected(np.where(there[:, :, None], y - means, 0.0), basis)
    dof = int(there.sum()) - int((basis**2).sum().round()) - int(kept.sum())
    share = np.where(there, np.maximum(1.0 - (basis**2).sum(axis=2), 0.0), 0.0)
    return np.where(there[:, :, None], left, 0.0), share, dof


def line_bases(there: NDArray[np.bool_], smooth: FloatArray) -> FloatArray:
    """(P, H, k): orthonormal columns over each part's cells, zero where these have fewer."""
    own = smooth * there[:, :, None]
    square, turn = np.linalg.eigh(np.einsum("phi,phj->pij", own, own))
    # Cells in a row have fewer directions than the part.
    kept = square > TINY * np.maximum(square[:, -1:], 1e-300)
    scale = np.where(kept, 1.0 / np.sqrt(np.where(kept, square, 1.0)), 0.0)
    found: FloatArray = own @ turn * scale[:, None, :]
    return found


def _projected(y: FloatArray, basis: FloatArray) -> FloatArray:
    """Q_p y_p (P, H, A) of every part."""
    return y - basis @ (basis.transpose(0, 2, 1) @ y)


RATE = 1e-3
"""Chance that any column of a table without loose ones is told."""
TWICE = 2.0
"""Times the others' standard deviation: what is less need not be looked for."""
TYPICAL = 1.5
"""Times the others' median deviation, likewise."""
CLEAR = 0.5
"""Ratio of variances that another column may have of the clearest: of five places two may be all
that tells a part's line from a loose one."""
FEWEST_PARTS = 5
FEWEST_COLUMNS = 4
LEAST = 1e-3
"""Of an entry's variance beside its part's line, below which nothing is told of it."""
MOST = 1 / 3
"""Share of the columns beyond which they are not single ones."""


class Loose(NamedTuple):
    """A column, by its place, and an axis along which it is loose: its standard deviation from part
    to part, that of all others, and p over all columns and axes.
    """

    column: int
    axis: int
    s: float
    others: float
    p: float


def loose_columns(values: FloatArray, there: NDArray[np.bool_], smooth: FloatArray) -> list[Loose]:
    """Of a table (P, H, A), complete where it is `there` (P, H); `smooth` (H, k) holds a constant
    and the slopes of a line that every part may have for itself. The loosest first.

    Lines of few places hide which of them is loose: without them first, which holds of what is
    more than those of the others make of it.

    What a column has beside the line of a part's others has, over what a line leaves of it
    (1 - leverage), the variance of the others, if it is one of them: the deletion formula of
    outlying observations (Cook & Weisberg 1982, 2.2), by columns. F of P - 1 degrees of freedom,
    the test that heavy tails widen (`log_variance_u`), and the medians must all agree. A loose
    column is taken out before others are judged.
    """
    plain = _found(values, there, smooth[:, :1])
    if smooth.shape[1] == 1:
        return plain
    if plain and _beyond_turns(plain, values, there, smooth):
        return plain
    return _found(values, there, smooth)


def _beyond_turns(
    plain: list[Loose], values: FloatArray, there: NDArray[np.bool_], smooth: FloatArray
) -> bool:
    """Whether columns scatter by more than the others' own lines make of them, from part to part:
    F of as many degrees of freedom as there are parts, less one, on both sides.
    """
    from scipy.special import fdtrc

    columns = {own.column for own in plain}
    kept = np.array([h not in columns for h in range(values.shape[1])])
    whole = there[:, kept].all(axis=1)
    parts, middle = int(whole.sum()), smooth[kept].mean(axis=0)
    if parts < FEWEST_PARTS:
        return False
    X = smooth[kept] - middle
    square, turn = np.linalg.eigh(X.T @ X)
    known = square > TINY * square[-1]
    inverse = (turn[:, known] / square[known]) @ turn[:, known].T
    of_others = values[whole][:, kept]
    slopes = np.einsum("ik,hk,pha->pia", inverse, X, of_others - of_others.mean(axis=0))
    tests = values.shape[1] * values.shape[2]
    for own in plain:
        away = smooth[own.column] - middle
        line = slopes[..., own.axis] @ away
        turned = float(line @ line) / (parts - 1)
        # Across what the others lie in a part may turn as much as it does along that.
        across = float(np.sum((away @ turn[:, ~known]) ** 2))
        turned += across * float((slopes[..., own.axis] ** 2).sum(axis=0).max()) / (parts - 1)
        ratio = own.s**2 / (own.others**2 + turned)
        if ratio < TWICE**2 or tests * float(fdtrc(parts - 1, parts - 1, ratio)) > RATE:
            return False
    return True


def _found(values: FloatArray, there: NDArray[np.bool_], smooth: FloatArray) -> list[Loose]:
    P, H, A = values.shape
    kept = np.full(H, True)
    found: list[Loose] = []
    while len(found) < MOST * H * A and kept.sum() >= FEWEST_COLUMNS and P >= FEWEST_PARTS:
        worst = _worst(values[:, kept], there[:, kept], smooth[kept], H * A)
        if worst is None:
            break
        column = int(np.flatnonzero(kept)[worst[0].column])
        found += [own._replace(column=column) for own in worst]
        kept[column] = False
    return [] if int((~kept).sum()) > MOST * H else found


class _Ratios(NamedTuple):
    """What is left of a table beside lines and columns: entries, the share that a line leaves of
    them, whether they tell anything; the ratio (H, A) of each column's mean square to that of all
    others, and p (H, A) of that.
    """

    left: FloatArray
    share: FloatArray
    told: NDArray[np.bool_]
    ratio: FloatArray
    p: FloatArray


def _ratios(values: FloatArray, there: NDArray[np.bool_], smooth: FloatArray) -> _Ratios:
    from scipy.special import fdtrc

    left, share, dof = beside_lines_and_columns(values, there, smooth)
    told = there & (share > LEAST)
    own_dof = np.maximum(told.sum(axis=0) - 1, 0)[:, None]
    rest_dof = dof - own_dof
    squares = np.where(told[:, :, None], left**2 / np.where(told, share, 1.0)[:, :, None], 0.0)
    mine = squares.sum(axis=0)
    rest = np.maximum((left**2).sum(axis=(0, 1)) - mine, 0.0)
    able = (own_dof >= FEWEST_PARTS - 1) & (rest_dof > 0) & (rest > 0)
    divisor = np.where(able, rest / np.maximum(rest_dof, 1), 1.0)
    ratio = np.where(able, mine / np.maximum(own_dof, 1) / divisor, 0.0)
    p = np.where(able, fdtrc(np.maximum(own_dof, 1), np.maximum(rest_dof, 1), ratio), 1.0)
    return _Ratios(left, share, told, ratio, p)


def _worst(
    values: FloatArray, there: NDArray[np.bool_], smooth: FloatArray, tests: int
) -> list[Loose] | None:
    """The column without which least is left, along every axis that it is loose along; None where
    another one may be it.
    """
    found = _ratios(values, there, smooth)
    most = found.ratio.max(axis=1)
    # What looks loose as well would be heavy tails of the others.
    calm = tests * found.p.min(axis=1) >= RATE
    for h in np.argsort(-most, kind="stable").tolist():
        along = np.flatnonzero(tests * found.p[h] < RATE)
        if not len(along):
            return None
        leaves, told = found.share[:, h], found.told[:, h]
        scaled = found.left[:, h] / np.sqrt(np.where(told, leaves, 1.0))[:, None]
        others = calm if calm.sum() >= FEWEST_COLUMNS else np.arange(len(calm)) != h
        of_column = _of_column(scaled, leaves, told, _others(values, there, smooth, others))
        own = [x for a in along if (x := of_column(int(a), h, tests)) is not None]
        if own:
            return own if _is_it(values, there, smooth, most, h, tests) else None
    return None


def _is_it(
    values: FloatArray,
    there: NDArray[np.bool_],
    smooth: FloatArray,
    most: FloatArray,
    h: int,
    tests: int,
) -> bool:
    """Whether the columns that look nearly as loose as `h` do so without it, too: one that does not
    may be the loose one, and h look so beside it.
    """
    rivals = [r for r in np.flatnonzero(most >= CLEAR * most[h]).tolist() if r != h]
    if not rivals:
        return True
    keep = np.arange(len(most)) != h
    without = _ratios(values[:, keep], there[:, keep], smooth[keep])
    still = tests * without.p.min(axis=1) < RATE
    return all(bool(still[r - (r > h)]) for r in rivals)


class _Others(NamedTuple):
    """What is left of all other columns: entries (n, A), each over what its line leaves of it, the
    variances (A,) of these, and their degrees of freedom.
    """

    entries: FloatArray
    variance: FloatArray
    dof: int


def _others(
    values: FloatArray, there: NDArray[np.bool_], smooth: FloatArray, keep: NDArray[np.bool_]
) -> _Others:
    left, share, dof = beside_lines_and_columns(values[:, keep], there[:, keep], smooth[keep])
    seen, dof = share > LEAST, max(dof, 1)
    variance = (left**2).sum(axis=(0, 1)) / dof
    return _Others(left[seen] / np.sqrt(share[seen])[:, None], variance, dof)


def _of_column(
    scaled: FloatArray, share: FloatArray, told: NDArray[np.bool_], others: _Others
) -> Callable[[int, int, int], Loose | None]:
    """How a column is judged along an axis; None where it is as the others are."""
    leaves, dof = float(share[told].mean()), int(told.sum()) - 1

    def judged(axis: int, column: int, tests: int) -> Loose | None:
        mine, rest = scaled[told, axis], others.entries[:, axis]
        square, noise = float(np.sum(mine**2)) / dof, float(others.variance[axis])
        variance = (square - (1 - leaves) * noise) / leaves
        if not noise > 0 or variance <= TWICE**2 * noise:
            return None
        # Heavy tails, of both together, make variances differ by chance; a single entry does.
        square = float(np.sum(mine**2) - np.max(mine**2)) / (dof - 1)
        if square <= noise:
            return None
        z = np.concatenate([own / np.sqrt(np.mean(own**2)) for own in (mine, rest)])
        mine_u, rest_u = (log_variance_u(z, own / len(z)) for own in (dof, others.dof))
        p = tests * 2 * float(ndtr(-np.log(square / noise) / np.hypot(mine_u, rest_u)))
        if p > RATE or np.median(np.abs(mine)) < TYPICAL * np.median(np.abs(rest)):
            return None
        return Loose(column, axis, float(np.sqrt(variance)), float(np.sqrt(noise)), p)

    return judged


def log_variance_u(a: FloatArray, share: float) -> float:
    """u of ln s^2 of zero-mean residuals a with `share` degrees of freedom an entry; infinite
    where they say nothing.

    The variance of ln s^2 is (2 + excess kurtosis)/n (Box, Biometrika 40 (1953) 318): heavy tails
    make variances differ by chance.
    """
    variance = float(np.mean(a**2))
    if share <= 0 or variance <= 0:
        return np.inf
    return float(np.sqrt(scaled_log_variance(a / np.sqrt(variance)) / (share * a.size)))


def scaled_log_variance(z: FloatArray) -> float:
    """n times the variance of ln s^2 of entries z of variance 1."""
    return 2 + max(float(np.mean(z**4)) - 3.0, 0.0)
