"""Repeats that scatter far more than those of the other features: one is likely mistyped."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.settings import Warned
from mtu_cli.model.visits import operations_of
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import GROSS

SLIP_RATE = 1e-3
"""Chance of any warning over all tables of a clean study."""
SHOWN = 6


class Apart(NamedTuple):
    """The part (index) with the repeat that is farthest off, of each table told, and a warning."""

    parts: tuple[int, ...]
    warnings: list[Warned]


def swollen(tables: MeasuredTables) -> tuple[FloatArray, FloatArray]:
    """(s, others), mm, each (tables,): the standard deviation of repeats within their part, and
    that of the other tables of the operation and axis. s is 0 where it is no more than theirs.

    By Fisher's F at SLIP_RATE over all tables (Bonferroni), and GROSS times theirs at least, so
    that features that a CMM measures worse are none. Others that are themselves so far beyond
    the median hide nothing.
    """
    from scipy.special import fdtrc

    cells = tables.cells
    df = np.asarray(cells.n.sum(axis=1) - cells.present.sum(axis=1), np.float64)
    ms = np.divide(cells.within, df, out=np.zeros(len(df)), where=df > 0)
    found, beside = np.zeros(len(df)), np.zeros(len(df))
    groups: dict[tuple[str, str], list[int]] = {}
    for i, (operation, _, axis) in enumerate(tables.labels):
        if df[i] > 0:
            groups.setdefault((operation, axis), []).append(i)
    for rows in groups.values():
        own = np.array(rows)
        usual = ms[own] <= GROSS**2 * np.median(ms[own])
        dof = df[own[usual]].sum() - usual * df[own]
        squares = cells.within[own[usual]].sum() - usual * cells.within[own]
        rest = np.divide(squares, dof, out=np.zeros(len(own)), where=dof > 0)
        ratio = np.divide(ms[own], rest, out=np.zeros(len(own)), where=rest > 0)
        p = fdtrc(df[own], np.maximum(dof, 1.0), ratio) * len(df)
        found[own] = np.where((ratio > GROSS**2) & (p <= SLIP_RATE), np.sqrt(ms[own]), 0.0)
        beside[own] = np.sqrt(np.maximum(rest, 0.0))
    return found, beside


def repeats_apart(tables: MeasuredTables, points: Points, told: set[int]) -> Apart:
    """One warning of the tables with `swollen` repeats but for those already `told`."""
    s, others = swollen(tables)
    doubted = [int(i) for i in np.argsort(-s) if s[i] > 0 and int(i) not in told]
    if not doubted:
        return Apart((), [])
    found = [_text(tables, points, i, 1e3 * float(s[i]), 1e3 * float(others[i])) for i in doubted]
    more = f"; and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    text = (
        f"{'; '.join(text for _, text in found[:SHOWN])}{more}: what scatters so hides what the "
        "parts do, look whether a reading is mistyped"
    )
    warning = Warned(code="repeats-scatter", message=text)
    return Apart(tuple(dict.fromkeys(part for part, _ in found)), [warning])


def _text(
    tables: MeasuredTables, points: Points, table: int, s: float, others: float
) -> tuple[int, str]:
    """The part of the repeat that is farthest from its part's mean, and what to say of it."""
    operation, feature, axis = tables.labels[table]
    k = AXES.index(axis)
    names, code = operations_of(points)
    rows = np.flatnonzero(
        (code == names.index(operation)) & (points.feature == points.features.index(feature))
    )
    errors = points.measured[rows, k] - points.nominal[rows, k]
    part = points.part[rows]
    size = np.bincount(part)
    away = np.abs(errors - (np.bincount(part, errors) / np.maximum(size, 1))[part])
    # Of two repeats both are as far from their mean: the one farther from all others is meant.
    likely = np.isclose(away, away.max()) * np.abs(errors - np.median(errors))
    row = int(rows[np.argmax(likely)])
    of = f" ({operation})" if operation else ""
    own = int(points.part[row])
    return own, (
        f"{points.sources[points.file_index[row]].shown}, row {points.row[row]}: part "
        f"{tables.parts[own]!r}, feature {feature!r}{of}, {axis}_mm is "
        f"{points.measured[row, k]:.7g}; repeats scatter there by {float(f'{s:.3g}'):g} um, at "
        f"other features by {float(f'{others:.2g}'):g} um"
    )
