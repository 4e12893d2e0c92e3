"""What did the machine really do: part-to-part and repeat scatter of measured parts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, assert_never

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.model.measured import (
    MeasuredTables,
    angle_tables,
    feature_tables,
    length_tables,
    visits_of,
)
from mtu_cli.model.measured_checks import check_measured
from mtu_cli.model.settings import Settings, Warned
from mtu_cli.stats.anova import (
    Components,
    OneWay,
    moments,
    one_way,
    paper,
    part_interval,
)
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.reml import reml
from mtu_cli.stats.rotation import Outstanding, outstanding_rows
from mtu_cli.stats.swap import SwapTest, swap_test

Method = Literal["paper", "anova", "reml"]
FAMILY_RATE = 0.05
FEWEST_PARTS = 4
"""Fewer parts than this say nothing about which of them stands out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Analysed:
    """Tables of one kind with their analysis; arrays (tables,) in mm or rad, squared.

    `components` by the chosen method; `interval` (tables, 2) for the part variance. `u_mean` of
    the grand mean and `u_future` of a future part; by the paper's method eqs. (32)-(33), which
    have the repeat scatter alone.
    """

    tables: MeasuredTables
    one_way: OneWay
    components: Components
    interval: FloatArray
    u_mean: FloatArray
    u_future: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class UnusualPart:
    """A part that stands out at the family-wise rate; `features` where single features do."""

    part: str
    p: float
    what: Literal["distance", "mean", "feature"]
    features: tuple[tuple[str, str, str], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class AnovaResult:
    """The analysis of all measured parts."""

    method: Method
    features: Analysed
    lengths: Analysed | None
    angles: Analysed | None
    unusual: tuple[UnusualPart, ...]
    outstanding: Outstanding | None
    axis_scatter: tuple[tuple[str, SwapTest], ...]
    coverage_factor: float
    warnings: tuple[Warned, ...]


def analyse_variance(
    points: Points, part: LoadedPart | None, method: Method, settings: Settings
) -> AnovaResult:
    """Gilsinn & Ling 2004, section 4: one table a feature and axis, a length, an angle.

    Raises InputError for values that cannot be what they claim to be (see `check_measured`).
    """
    warnings = check_measured(points)
    features = analysed(feature_tables(points), method)
    lengths = angles = None
    if part is not None and (part.part.lengths or part.part.orthogonality):
        visits = visits_of(points)
        found = length_tables(points, visits, part)
        lengths = None if found is None else analysed(found, method)
        found = angle_tables(points, visits, part)
        angles = None if found is None else analysed(found, method)
    outstanding, unusual = _unusual(features, settings.seed)
    return AnovaResult(
        method=method,
        features=features,
        lengths=lengths,
        angles=angles,
        unusual=unusual,
        outstanding=outstanding,
        axis_scatter=_axis_scatter(features, settings.seed),
        coverage_factor=settings.coverage_factor,
        warnings=(*warnings, *_warnings(features, method)),
    )


def analysed(tables: MeasuredTables, method: Method) -> Analysed:
    """The analysis of tables of one kind by one method."""
    table = one_way(tables.cells)
    match method:
        case "paper":
            components = paper(table)
        case "anova":
            components = moments(table)
        case "reml":
            components = reml(tables.cells)
        case _:
            assert_never(method)
    n = tables.cells.n
    if method == "paper":
        s2 = table.ms_within
        u_mean = np.sqrt(s2 / table.N)
        u_future = np.sqrt(s2 * (1 + 1 / table.N))
    else:
        # Without repeats only the sum of both components is known; it serves as well.
        total = np.where(table.df_between > 0, table.ms_between, np.nan)
        apart = np.isfinite(components.part)
        variance = components.part * (n**2).sum(axis=1) / table.N**2
        variance = variance + components.repeat / table.N
        variance = np.where(apart, variance, total / table.N)
        u_mean = np.sqrt(variance)
        u_future = np.sqrt(np.where(apart, components.part, total) + variance)
    return Analysed(
        tables=tables,
        one_way=table,
        components=components,
        interval=part_interval(tables.cells, table),
        u_mean=u_mean,
        u_future=u_future,
    )


def part_means(found: Analysed) -> FloatArray:
    """(parts, tables) deviations of the part means, scaled to equal variance.

    The variance of a part's mean is s_part^2 + s_repeat^2/n_i; nan where a part is missing.
    """
    cells = found.tables.cells
    grand = (found.one_way.mean - cells.origin)[:, None]
    components = reml(cells)
    part = np.where(np.isfinite(components.part), components.part, 0.0)[:, None]
    repeat = np.where(np.isfinite(components.repeat), components.repeat, 0.0)[:, None]
    n = np.where(cells.present, cells.n, 1.0)
    variance = part + repeat / n
    scale = np.sqrt(np.where(variance > 0, variance, 1.0))
    return np.where(cells.present, (cells.mean - grand) / scale, np.nan).T


def _unusual(found: Analysed, seed: int) -> tuple[Outstanding | None, tuple[UnusualPart, ...]]:
    labels = found.tables.labels
    if len(found.tables.parts) < FEWEST_PARTS:
        return None, ()
    kinds = list(dict.fromkeys((operation, axis) for operation, _, axis in labels))
    groups = np.array([kinds.index((operation, axis)) for operation, _, axis in labels])
    outstanding = outstanding_rows(part_means(found), groups, seed)
    unusual = []
    for i, part in enumerate(found.tables.parts):
        cells = np.flatnonzero(outstanding.by_cell[i] <= FAMILY_RATE)
        p_row, p_cell = float(outstanding.by_row[i]), float(outstanding.by_cell[i].min())
        if min(p_row, p_cell) > FAMILY_RATE:
            continue
        row_kind: Literal["distance", "mean"] = "mean" if outstanding.row_kind[i] else "distance"
        unusual.append(
            UnusualPart(
                part=part,
                p=min(p_row, p_cell),
                what=row_kind if p_row <= p_cell else "feature",
                features=tuple(labels[j] for j in cells),
            )
        )
    return outstanding, tuple(unusual)


def _axis_scatter(found: Analysed, seed: int) -> tuple[tuple[str, SwapTest], ...]:
    """Does Y scatter more from part to part than X? One test an operation."""
    labels = found.tables.labels
    means = found.tables.cells
    values = np.where(means.present, means.mean, np.nan)
    tests = []
    for operation in dict.fromkeys(label[0] for label in labels):
        sides = []
        for axis in ("x", "y"):
            rows = [
                i for i, label in enumerate(labels) if label[0] == operation and label[2] == axis
            ]
            sides.append(values[rows].T)
        if sides[0].shape == sides[1].shape and sides[0].shape[0] >= FEWEST_PARTS:
            tests.append((operation, swap_test(sides[0], sides[1], seed)))
    return tuple(tests)


def _warnings(found: Analysed, method: Method) -> list[Warned]:
    table = found.one_way
    warnings = []
    if not (table.df_within > 0).any():
        warnings.append(
            Warned(
                code="no-repeats",
                message="no part was measured twice: part-to-part scatter and the CMM's cannot be "
                "told apart, and what scatters is their sum",
            )
        )
    if (table.df_between < 1).all():
        warnings.append(
            Warned(code="one-part", message="there is one part only: parts cannot be compared")
        )
    exact = (table.df_within > 0) & (table.ms_within == 0)
    if exact.any():
        warnings.append(
            Warned(
                code="zero-variance",
                message=f"the repeats of {int(exact.sum())} of {len(exact)} tables are all equal: "
                "F and p cannot be had there",
            )
        )
    negative = found.components.part_estimate < 0
    if method == "anova" and negative.any():
        warnings.append(
            Warned(
                code="negative-variance",
                message=f"{int(negative.sum())} of {len(negative)} part-to-part variances are "
                "estimated below zero; 0 is used",
            )
        )
    return warnings
