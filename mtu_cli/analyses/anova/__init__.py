"""What did the machine really do: part-to-part and repeat scatter of measured parts."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, assert_never

import numpy as np

from mtu_cli.analyses.anova.parts import (
    FEWEST_PARTS,
    Kind,
    Label,
    UnusualPart,
    axis_scatter,
    full_labels,
    part_limits,
    parts_table,
    side_by_side,
    unusual_parts,
)
from mtu_cli.analyses.anova.totals import Total, totals_of
from mtu_cli.analyses.anova.warnings import anova_warnings, missing_entries
from mtu_cli.files.points import Points
from mtu_cli.model.measured import (
    MeasuredTables,
    angle_tables,
    feature_tables,
    length_tables,
    only_features,
    visits_of,
)
from mtu_cli.model.measured_checks import check_measured
from mtu_cli.model.settings import Settings, Warned
from mtu_cli.stats.anova import Components, OneWay, moments, one_way, paper, part_interval
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.reml import reml
from mtu_cli.stats.swap import SwapTest

if TYPE_CHECKING:
    from mtu_cli.files.part import LoadedPart

Method = Literal["paper", "anova", "reml"]
METHODS: tuple[Method, ...] = ("paper", "anova", "reml")


@dataclass(frozen=True, slots=True, kw_only=True)
class Analysed:
    """Tables of one kind with their analysis; arrays (tables,) in mm or rad, squared.

    `components` by the chosen method, `reml` those that scale the part means; `interval`
    (tables, 2) for the part variance. `u_mean` of the grand mean and `u_future` of a future
    part; by the paper's method eqs. (32)-(33), which have the repeat scatter alone. `unusual`
    are the parts that stand out of each table by itself.
    """

    kind: Kind
    method: Method
    tables: MeasuredTables
    one_way: OneWay
    components: Components
    reml: Components
    interval: FloatArray
    u_mean: FloatArray
    u_future: FloatArray
    unusual: tuple[tuple[str, ...], ...]

    def limits(self) -> FloatArray:
        """Half widths (tables, parts) of the family-wise limits of part means."""
        return part_limits(self.tables, self.one_way, self.reml)


@dataclass(frozen=True, slots=True, kw_only=True)
class AnovaResult:
    """The analysis of all measured parts.

    `unusual` is None where there are too few parts to tell; `axis_scatter` has one test an
    operation, y over x; `shown` are the features in the order of their interest.
    """

    method: Method
    features: Analysed
    lengths: Analysed | None
    angles: Analysed | None
    unusual: tuple[UnusualPart, ...] | None
    axis_scatter: tuple[tuple[str, SwapTest], ...]
    totals: tuple[Total, ...]
    shown: tuple[str, ...]
    coverage_factor: float
    warnings: tuple[Warned, ...]


def analyse_variance(
    points: Points, part: LoadedPart | None, method: Method, settings: Settings
) -> AnovaResult:
    """Gilsinn & Ling 2004, section 4: one table a feature and axis, a length, an angle.

    Raises InputError for values that cannot be what they claim to be (see `check_measured`)
    and for a feature that stands twice in one repeat of one part.
    """
    with ThreadPoolExecutor(1) as pool:
        # Both go through every point and need nothing of each other.
        checked = pool.submit(check_measured, points)
        kinds: dict[Kind, MeasuredTables | None] = {"feature": feature_tables(points)}
        warnings = checked.result()
    if part is not None:
        kinds |= _of_part(points, part)
        warnings += missing_entries(part, kinds["length"], kinds["angle"])
    bases = {k: _Base(k, tables) for k, tables in kinds.items() if tables is not None}
    family = side_by_side(
        *(parts_table(base.tables, kind, base.one_way, base.reml) for kind, base in bases.items())
    )
    outstanding, unusual = unusual_parts(family, settings.seed)
    singles: dict[Label, list[str]] = {}
    for item in unusual:
        for label in item.singles:
            singles.setdefault(label, []).append(item.part)
    found = {kind: _analysed(base, method, singles) for kind, base in bases.items()}
    features = found["feature"]
    return AnovaResult(
        method=method,
        features=features,
        lengths=found.get("length"),
        angles=found.get("angle"),
        unusual=None if outstanding is None else tuple(unusual),
        axis_scatter=axis_scatter(features.tables, settings.seed),
        totals=totals_of(features.tables, features.one_way, features.reml),
        shown=_shown(part, points),
        coverage_factor=settings.coverage_factor,
        warnings=(
            *warnings,
            *anova_warnings(
                features.tables, features.one_way, features.components, method, FEWEST_PARTS
            ),
        ),
    )


class _Base:
    """What every method needs of the tables of one kind."""

    def __init__(self, kind: Kind, tables: MeasuredTables) -> None:
        self.kind = kind
        self.tables = tables
        self.one_way = one_way(tables.cells)
        self.reml = reml(tables.cells)


def _of_part(points: Points, part: LoadedPart) -> dict[Kind, MeasuredTables | None]:
    """Tables of the part file's lengths and angles."""
    lengths, angles = part.part.lengths, part.part.orthogonality
    names = [name for item in lengths for name in (item.from_, item.to)]
    names += [name for item in angles for name in (*item.row, *item.column)]
    needed = only_features(points, names)
    if not len(needed):
        return {"length": None, "angle": None}
    visits = visits_of(needed)
    return {
        "length": length_tables(needed, visits, part),
        "angle": angle_tables(needed, visits, part),
    }


def _shown(part: LoadedPart | None, points: Points) -> tuple[str, ...]:
    """Features that a picture shows first: the ends of lengths."""
    lengths = [] if part is None else part.part.lengths
    ends = [name for item in lengths for name in (item.from_, item.to)]
    measured = set(points.features)
    return tuple(dict.fromkeys(name for name in (*ends, *points.features) if name in measured))


def _components(base: _Base, method: Method) -> Components:
    match method:
        case "paper":
            return paper(base.one_way)
        case "anova":
            return moments(base.one_way)
        case "reml":
            return base.reml
        case _:
            assert_never(method)


def _analysed(base: _Base, method: Method, singles: dict[Label, list[str]]) -> Analysed:
    table, components = base.one_way, _components(base, method)
    u_mean, u_future = _uncertainties(base, components, method)
    return Analysed(
        kind=base.kind,
        method=method,
        tables=base.tables,
        one_way=table,
        components=components,
        reml=base.reml,
        interval=part_interval(base.tables.cells, table),
        u_mean=u_mean,
        u_future=u_future,
        unusual=tuple(
            tuple(singles.get(label, ())) for label in full_labels(base.tables, base.kind)
        ),
    )


def _uncertainties(
    base: _Base, components: Components, method: Method
) -> tuple[FloatArray, FloatArray]:
    """u of the grand mean and of a future part, (tables,) each.

    u^2(mean) = s_part^2 sum n_i^2/N^2 + s_repeat^2/N; a future part adds s_part^2. Without
    repeats MS_between, the sum of both components, serves for both.
    """
    table, n = base.one_way, base.tables.cells.n
    if method == "paper":
        s2 = table.ms_within
        return np.sqrt(s2 / table.N), np.sqrt(s2 * (1 + 1 / table.N))
    total = np.where(table.df_between > 0, table.ms_between, np.nan)
    apart = np.isfinite(components.part)
    variance = components.part * (n**2).sum(axis=1) / table.N**2 + components.repeat / table.N
    variance = np.where(apart, variance, total / table.N)
    return np.sqrt(variance), np.sqrt(np.where(apart, components.part, total) + variance)
