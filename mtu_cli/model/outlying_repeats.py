"""Repeats that scatter far more than those of the other features: one is likely mistyped, or the
feature is measured far worse.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mtu_cli.errors import Warned
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.visits import IntArray, operations_of
from mtu_cli.stats.anova import Cells
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import GROSS, BoolArray

SLIP_RATE = 1e-3
"""Chance of any warning of a kind over all features, axes and parts of a clean study."""
OWN_RATE = 0.02
"""Chance, in a feature that is measured worse, of any part that passes for a slip of its own."""
FEW = 20
"""Parts, of more than which the means tell."""
SHOWN = 6


class Apart(NamedTuple):
    """The table and part (indices) with the repeat that is farthest off, of each table told, what
    is said of them, and warnings.
    """

    cells: tuple[tuple[int, int], ...]
    warnings: list[Finding]
    texts: tuple[str, ...]


class Swollen(NamedTuple):
    """Each (tables,): the standard deviation `s`, mm, of repeats within their part, 0 where it is
    no more than that of the `others` of the operation and axis; whether most parts have it.
    """

    s: FloatArray
    others: FloatArray
    of_most: np.ndarray

    @property
    def by_slips(self) -> FloatArray:
        """The s (tables,) that few parts have made, 0 elsewhere."""
        return np.where(self.of_most, 0.0, self.s)


def swollen(tables: MeasuredTables) -> Swollen:
    """The tables whose repeats are apart: as a whole by `_beyond`, or those of one of its parts by
    `lone_repeats`.
    """
    cells = tables.cells
    df = np.asarray(cells.n.sum(axis=1) - cells.present.sum(axis=1), np.float64)
    ms = np.divide(cells.within, df, out=np.zeros(len(df)), where=df > 0)
    found, beside = np.zeros(len(df)), np.zeros(len(df))
    for rows in _groups(tables):
        own = rows[df[rows] > 0]
        if not len(own):
            continue
        beyond, beside[own] = _beyond(cells.within[own], df[own], len(df))
        found[own] = np.where(beyond, np.sqrt(ms[own]), 0.0)
    found = np.where(lone_repeats(tables), np.sqrt(ms), found)
    return Swollen(found, beside, (found > 0) & (_of_middle(cells) > GROSS * beside**2))


def _groups(tables: MeasuredTables) -> list[IntArray]:
    """The tables of each operation and axis, which are measured alike."""
    groups: dict[tuple[str, str], list[int]] = {}
    for i, (operation, _, axis) in enumerate(tables.labels):
        groups.setdefault((operation, axis), []).append(i)
    return [np.array(rows) for rows in groups.values()]


def _beyond(squares: FloatArray, df: FloatArray, tests: int) -> tuple[BoolArray, FloatArray]:
    """Which sums of `squares` (n,) of `df` degrees of freedom are beyond the others', and the
    standard deviation of these (n,).

    By Fisher's F at SLIP_RATE over all `tests` (Bonferroni), and GROSS times theirs at least, so
    that features that a CMM measures somewhat worse are none. Others that are themselves so far
    beyond the median hide nothing.
    """
    from scipy.special import fdtrc

    ms = squares / df
    usual = ms <= GROSS**2 * np.median(ms)
    dof = df[usual].sum() - usual * df
    left = squares[usual].sum() - usual * squares
    rest = np.divide(left, dof, out=np.zeros(len(df)), where=dof > 0)
    ratio = np.divide(ms, rest, out=np.zeros(len(df)), where=rest > 0)
    p = fdtrc(df, np.maximum(dof, 1.0), ratio) * tests
    return (ratio > GROSS**2) & (p <= SLIP_RATE), np.sqrt(np.maximum(rest, 0.0))


def lone_repeats(tables: MeasuredTables) -> BoolArray:
    """Which tables (tables,) of features have one part whose repeats are `_beyond` those of all
    other parts and features, and beyond those of the other parts at the feature by Fisher's F at
    OWN_RATE over the parts: a feature that is measured worse is so on each part.

    A table as a whole hides one slip among its parts: it takes sqrt(parts) times as much. Of a
    part that stands out in most features its set-up moved: that is no slip.
    """
    from scipy.special import fdtrc

    found = np.zeros(len(tables.labels), bool)
    cells, parts = tables.cells, len(tables.parts)
    if not 1 < parts <= FEW or not all(label[2] for label in tables.labels):
        return found
    for rows in _groups(tables):
        S, df = cells.within_part[rows], np.maximum(cells.n[rows] - 1, 0.0)
        known = df > 0
        if not known.any():
            continue
        beyond = np.zeros(S.shape, bool)
        tests = int((cells.n > 1).sum())
        beyond[known], _ = _beyond(S[known], df[known], tests)
        rest_df = df.sum(axis=1, keepdims=True) - df
        rest = np.maximum(S.sum(axis=1, keepdims=True) - S, 0.0)
        without = np.where(S > 0, np.inf, 0.0)
        ratio = np.divide(S * rest_df, rest * df, out=without, where=rest * df > 0)
        own = fdtrc(np.maximum(df, 1.0), np.maximum(rest_df, 1.0), ratio) * parts
        lone = beyond & (own <= OWN_RATE) & (rest_df > 0)
        lone &= 2 * beyond.sum(axis=0) <= known.sum(axis=0)
        found[rows] = lone.any(axis=1)
    return found


def _of_middle(cells: Cells) -> FloatArray:
    """Mean square (tables,) of the repeats of the part that has the middle one, the lesser of two:
    a slip leaves it as it is. 0 of one part alone, of which nothing tells a slip from all others.
    """
    several = cells.n > 1
    square = np.divide(
        cells.within_part, cells.n - 1, out=np.full(cells.n.shape, np.inf), where=several
    )
    place = np.maximum(several.sum(axis=1) - 1, 0) // 2
    middle: FloatArray = np.take_along_axis(np.sort(square, axis=1), place[:, None], 1)[:, 0]
    return np.where(several.sum(axis=1) > 1, middle, 0.0)


def repeats_apart(tables: MeasuredTables, points: Points, told: set[int]) -> Apart:
    """The warnings of tables with `swollen` repeats but for those already `told`: of single
    repeats, and of features whose repeats are apart in most parts.
    """
    found = swollen(tables)
    order = [int(i) for i in np.argsort(-found.s) if found.s[i] > 0 and int(i) not in told]
    doubted = [i for i in order if not found.of_most[i]]
    slips = [_slip(tables, points, i, found) for i in doubted]
    texts = [text for _, text in slips]
    rough = [_rough(tables, i, found) for i in order if found.of_most[i]]
    warnings = []
    if slips:
        text = (
            f"{_first(texts)}: what scatters so hides what the parts do, "
            "look whether a reading is mistyped"
        )
        warnings.append(Warned(code="repeats-scatter", message=text))
    if rough:
        text = (
            f"{_first(rough)}, in most parts: no single reading makes that, look how the feature "
            "is measured"
        )
        warnings.append(Warned(code="feature-scatters", message=text))
    cells = tuple((table, part) for table, (part, _) in zip(doubted, slips, strict=True))
    return Apart(cells, warnings, tuple(texts[:SHOWN]))


def _first(texts: list[str]) -> str:
    more = f"; and {len(texts) - SHOWN} more" if len(texts) > SHOWN else ""
    return f"{'; '.join(texts[:SHOWN])}{more}"


def _rough(tables: MeasuredTables, table: int, found: Swollen) -> str:
    operation, feature, axis = tables.labels[table]
    return f"feature {feature!r}{of_operation(operation)}, {axis}_mm: {_scatter(found, table)}"


def of_operation(name: str) -> str:
    """What is said of the operation beside a feature: nothing where there is one alone."""
    return f" ({name})" if name else ""


def rows_at(points: Points, operation: str, feature: str) -> IntArray:
    """The measurements of a feature in an operation."""
    names, code = operations_of(points)
    here = (code == names.index(operation)) & (points.feature == points.features.index(feature))
    return np.flatnonzero(here)


def _scatter(found: Swollen, table: int) -> str:
    s, others = 1e3 * float(found.s[table]), 1e3 * float(found.others[table])
    return (
        f"repeats scatter there by {float(f'{s:.3g}'):g} um, at other features by "
        f"{float(f'{others:.2g}'):g} um"
    )


def _slip(tables: MeasuredTables, points: Points, table: int, found: Swollen) -> tuple[int, str]:
    """The part of the repeat that is farthest from its part's mean, and what to say of it."""
    operation, feature, axis = tables.labels[table]
    k = AXES.index(axis)
    rows = rows_at(points, operation, feature)
    errors = points.measured[rows, k] - points.nominal[rows, k]
    part = points.part[rows]
    size = np.bincount(part)
    away = np.abs(errors - (np.bincount(part, errors) / np.maximum(size, 1))[part])
    # Of two repeats both are as far from their mean: the one farther from all others is meant.
    likely = np.isclose(away, away.max()) * np.abs(errors - np.median(errors))
    worst = int(np.argmax(likely))
    row, own = int(rows[worst]), int(part[worst])
    return own, (
        f"{points.sources[points.file_index[row]].shown}, row {points.row[row]}: part "
        f"{tables.parts[own]!r}, feature {feature!r}{of_operation(operation)}, {axis}_mm is "
        f"{points.measured[row, k]:.7g}{_other(points, rows, part, errors, worst)}; "
        f"{_scatter(found, table)}"
    )


def _other(points: Points, rows: IntArray, part: IntArray, errors: FloatArray, worst: int) -> str:
    """How far the `worst` of the readings (n,) of a feature is off its part's other one; which of
    two is wrong, only other parts tell.
    """
    same = np.flatnonzero((part == part[worst]) & (np.arange(len(rows)) != worst))
    if len(same) != 1:
        return ""
    apart = float(errors[worst] - errors[same[0]])
    text = (
        f", {float(f'{1e3 * apart:.3g}'):g} um off the part's other reading (row "
        f"{points.row[rows[same[0]]]})"
    )
    beside = errors[part != part[worst]]
    if len(beside):
        off, less = (abs(errors[i] - np.median(beside)) for i in (worst, int(same[0])))
        if off - less > abs(apart) / 2:
            return text
    return f"{text}, and which of them is wrong is not known"
