"""The report of anova: one entry an operation, feature and axis, a length, a right angle.

With --method paper `var_part` is MS_between (Gilsinn & Ling 2004, eqs. (31)-(34)).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from mtu_cli.analyses.anova import AnovaResult
from mtu_cli.analyses.anova.tables import Kind
from mtu_cli.findings import listed
from mtu_cli.reports import figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Field, Fields, Group, RowOf, declare, read, rows_of
from mtu_cli.reports.numbers import MISSING, cut, words
from mtu_cli.stats.coverage import FAMILY_RATE
from mtu_cli.units import ARCSEC, UM

SHOWN, WORST = 24, 10
"""Tables of a kind that are listed without ``--detail``; of more those of the largest errors."""
DRAWN, RUNS = 6, 4
"""Features whose parts are drawn, and charts of what has a tolerance."""
KINDS: dict[Kind, str] = {"feature": "feature", "length": "length", "angle": "orthogonality"}
TITLES = {"feature": "Features", "length": "Lengths", "angle": "Right angles"}
PLACE = """
    operation | stated(LABEL.0) | null: not stated | operation, text
    NAME | stated(LABEL.1) | its name; null: all together | item, text
    axis | stated(LABEL.2) | of outliers length or angle, too | axis, text
"""
"""What a figure is of, by its label (operation, name, axis)."""
ENTRY = """
    *place
    parts | int(one_way.parts) | number of parts
    n | int(one_way.N) | number of readings | n, count
    mean_error_UNIT | one_way.mean | mean of all readings: a part counts by its repeats \
        | mean, u=rounding()
    ms_between_UNIT2 | one_way.ms_between | mean square of parts | MS between, detail
    ms_within_UNIT2 | one_way.ms_within | mean square of repeats | MS within, detail
    df_between | int(one_way.df_between) | degrees of freedom | df / between, count, detail
    df_within | int(one_way.df_within) | degrees of freedom | df / within, count, detail
    F | one_way.F | ms_between/ms_within | F, detail
    F_critical_95 | one_way.F_critical_95 | F at 5 % | F 95 %, detail
    p | one_way.p | p of F: the parts do not differ
    n0 | one_way.n0 | E ms_between = var_repeat + n0 var_part
    var_part_UNIT2 | components.part | variance from part to part
    - | root(components.part) | | s_part, unit=UNIT
    - | root(both) | | s_part+repeat, unit=UNIT
    var_part_estimate_UNIT2 | components.part_estimate | the same, not set to 0 where it is below
    var_repeat_UNIT2 | components.repeat | variance of repeated measurement
    var_part_interval95_UNIT2 | interval | its 95 % interval | s_part^2 95 %, interval, \
        u=components.repeat, detail, csv=var_part_{}95_UNIT2
    method | | of the components: paper, anova or reml
    s_pooled_UNIT | root(one_way.ms_within) | root of ms_within | s_repeat
    u_mean_UNIT | u_mean | standard uncertainty of the mean | u, u=u_mean
    u_future_UNIT | u_future | standard uncertainty of a future part
    U_future_UNIT | U_future() | k u_future | U future
    unusual_parts | unusual | outlying parts | outlying / parts, joined()
    - | tables.labels.1 | name of feature, length or angle | -, csv=id
    p_familywise | p_parts | p of F, adjusted for all of the kind (Holm) | p (Holm), p
    var_both_UNIT2 | both | variance of parts and CMM, without repeats
    var_both_interval95_UNIT2 | both_interval | 95 % interval | -, interval, csv=var_both_{}95_UNIT2
    interval95_future_UNIT | interval_future | interval that holds the error of 95 of 100 future \
        parts (Student's t) | 95 % future, interval, u=u_future, csv=future_{}95_UNIT
    dof_mean | | degrees of freedom of u_mean
    dof_future | | degrees of freedom of u_future
    p_mean_familywise | p_mean | p of a mean of zero (t test), adjusted for all of the kind (Holm)
    var_part_limits_below_zero | below_zero() | whether both limits of var_part were below 0: its \
        interval is then [0, 0]
"""


def entry(kind: Kind) -> list[Field | Group]:
    """The figures of a feature along an axis, of a length or of a right angle."""
    return declare(
        ENTRY,
        place=PLACE,
        LABEL="tables.labels",
        NAME="feature" if kind == "feature" else "id",
        UNIT="arcsec" if kind == "angle" else "um",
        # Of one part the scatter of its repeats.
        rounding=lambda x: x.u_mean if x.u_mean > 0 else np.sqrt(x.one_way.ms_within),
        # Both limits of the part variance were below 0: [0, 0] is no bound on it.
        below_zero=lambda x: bool(x.one_way.ms_within > 0 and (x.interval == 0).all()),
        U_future=lambda x: x.coverage_factor * x.u_future,
        joined=lambda names, u, digits: " ".join(names),
    )


def _unit_fields(unit: str, fields: Fields) -> list[Field]:
    """The fields, those with a unit of items of that unit alone."""

    def of_unit(item: Any) -> Any:
        kind = item.where[2] if hasattr(item, "where") else item.kind
        return item if (kind == "angle") == (unit == "arcsec") else None

    columns = [each for each in fields if isinstance(each, Field)]
    return [replace(each, within=(of_unit,)) if each.unit_name else each for each in columns]


def _in_units(text: str) -> list[Field]:
    """Fields of lengths and of angles, each for items of its unit."""
    return [x for unit in ("um", "arcsec") for x in _unit_fields(unit, declare(text, UNIT=unit))]


def _row() -> Fields:
    """The CSV: angles in the columns of arcsec and all else in those of um."""
    operation, feature, *um = _unit_fields("um", entry("feature"))
    label = feature.value
    name = "feature, length or orthogonality"
    return (
        Field("", lambda item: KINDS[item.kind], name, csv="kind"),
        operation,
        replace(feature, value=lambda item: read(item, label) if item.kind == "feature" else None),
        *um,
        *(field for field in _unit_fields("arcsec", entry("angle")) if field.unit_name),
    )


TOTAL = declare(
    """
    operation | stated(operation) | null: not stated | operation, text
    axis | | x, y or z | axis, text
    features | | number of features | features, count
    mean_error_um | mean | mean of the mean errors | mean error, u=spread
    s_mean_errors_um | spread | their standard deviation | feature s
    mean_var_part_um2 | part | mean variance from part to part
    mean_var_repeat_um2 | repeat | mean variance of repeated measurement
    mean_var_both_um2 | both | mean variance of both, without repeats
    - | root(part) | | s_part, unit=um
    - | root(both) | | s_part+repeat, unit=um
    - | root(repeat) | | s_repeat, unit=um
    parts_differ | differ | features in which parts differ, 5 % over all (Holm) \
        | parts / differ, of_tested(), u=tested
    """,
    of_tested=lambda value, u, digits: f"{value} of {u}" if u else "",
)
TREND = declare(
    """
    *place
    *slope
    p_familywise | p | p that the sequence changes nothing | p, p
    """,
    place=PLACE,
    LABEL="where",
    NAME="id",
    slope=_in_units("""
        slope_UNIT | slope | change as `sequence` rises by 1 | slope, u=u
        u_slope_UNIT | u | its standard uncertainty
    """),
)
CAPABILITY = declare(
    """
    kind | | position, length or angle | of, text
    operation | stated(operation) | null: not stated | operation, text
    id | | of the feature, length or angle | item, text
    parts | len(values) | number of parts | parts, count
    *limits
    pp | | (high - low)/(6 s) | pp, index()
    pp_interval95 | pp_interval | its 95 % interval (chi-squared) | 95 %, interval, u=hundredth()
    ppk | | nearer limit less mean over 3 s; of a position high/(99.73 % quantile) | ppk, index()
    ppk_interval95 | ppk_interval | its 95 % interval (noncentral t) | 95 %, interval, u=hundredth()
    cp | | pp with s_moving for s | cp, index()
    cpk | | ppk with s_moving for s | cpk, index()
    """,
    limits=_in_units("""
        low_UNIT | low | lower limit | low, plain
        high_UNIT | high | upper limit; of a position half the diameter of its zone | high, plain
        mean_UNIT | mean | mean error; of a position the mean radial error | mean
        s_UNIT | s | standard deviation of the parts, repeats averaged | s
        s_moving_UNIT | s_moving | mean moving range over the sequence, over 1.128
    """),
    # Two decimals as the indices have, at two digits of u.
    hundredth=lambda item: 0.1,
    index=lambda value, u, digits: MISSING if np.isnan(value) else f"{value:.2f}",
)
UNUSUAL = declare(
    """
    part | | its name | part, text
    where. | where | *place
    *deviation
    p_familywise | p | p over all parts and tables | p, p
    """,
    place=PLACE,
    LABEL="",
    NAME="id",
    deviation=_in_units("""
        deviation_UNIT | deviation | distance from the mean of the others | deviation, u=typical
        typical_UNIT | typical | root mean square of the others | others rms
    """),
)


def _rows(result: AnovaResult, kind: Kind) -> list[RowOf]:
    groups = [group for group in result.kinds if group.kind == kind]
    return [row for group in groups for row in rows_of(group, len(group.tables.labels))]


RESULTS = declare(
    """
    method | | of the components of variance
    datum | | best-fit alignment removed from each part
    for NAME KIND in kinds
        NAME[] | of_KIND() | *KIND
    totals[] | totals | *total
    unusual_parts[] | unusual | *unusual
    trends[] | trends | *trend
    capability[] | capabilities | *capability
    """,
    kinds=(("features", "feature"), ("lengths", "length"), ("orthogonality", "angle")),
    **{f"of_{kind}": partial(_rows, kind=kind) for kind in KINDS},
    **{kind: entry(kind) for kind in KINDS},
    total=TOTAL,
    unusual=UNUSUAL,
    trend=TREND,
    capability=CAPABILITY,
)
ROW = _row()


def document(result: AnovaResult, digits: int = 2) -> Document:
    """A row an operation and axis; then outliers, trends, capability, lengths, angles, features."""
    rows = {kind: _rows(result, kind) for kind in KINDS}
    trends = [item for item in result.trends if item.p <= FAMILY_RATE]
    datum = "" if result.datum == "none" else f", less {result.datum.replace(',', ' and ')}"
    of_totals = "feature s: of the features' mean errors; parts differ: F test, 5 % over all (Holm)"
    rate = f"{100 * FAMILY_RATE:g} % of studies"
    of_unusual = f"deviation from the mean of the other parts; false alarms in {rate}"
    of_trends = "change as sequence rises by 1, p over all tables (Holm)"
    of_capability = "pp, ppk: overall s of the parts; cp, cpk: s of neighbours in the sequence"
    papers = ", of the repeats alone (Gilsinn & Ling 2004, eq. (34))" * (result.method == "paper")
    k = result.features.coverage_factor
    of_features = f"mean and its u; U future = {k:g} u of a future part{papers}; p of the F test"
    tables = [
        Table("", ROW, [row for of_kind in rows.values() for row in of_kind], selection=()),
        Table(f"Features by operation and axis{datum}", TOTAL, result.totals, of_totals),
        Table("Outlying parts", UNUSUAL, result.unusual or (), of_unusual),
        Table("Trends over the sequence", TREND, trends, of_trends),
        Table("Capability", CAPABILITY, result.capabilities, of_capability),
    ]
    for group in (*result.kinds[1:], result.features):
        title, items = TITLES[group.kind], rows[group.kind]
        selection, footer = items, of_features if group.kind == "feature" else ""
        if len(items) > SHOWN:
            selection = [items[i] for i in group.order[:WORST]]
            title += f": the {WORST} of {len(items)} with the largest errors"
        tables.append(Table(title, entry(group.kind), items, footer, selection=selection))
    tests = sum(item.tested for item in result.totals)
    count = sum(item.differ for item in result.totals)
    sentences = [f"F test: parts differ significantly in {count} of {tests} features and axes."]
    sentences = sentences if tests else []
    if result.unusual is not None:
        names = listed(item.part for item in result.unusual)
        sentences.append(f"Outlying parts: {names}." if names else "No part is an outlier.")
    if trends:
        sentences.append(f"Trend over the sequence: {listed(words(*x.where) for x in trends)}.")
    verdict = " ".join(sentences) or "Too few parts or repeats for the F test and for outliers."
    return Document("Measured parts", (RESULTS, result), tables, figure, verdict, digits)


def figure(result: AnovaResult) -> figures.Figure:
    """Run charts: mean errors by part (Gilsinn & Ling 2004, Fig. 5), and toleranced features."""
    charts = list(_charts(result))
    columns = min(len(charts), 2)
    page = figures.blank(8.5, 1.45 * math.ceil(len(charts) / columns) + 1.0)
    panels = figures.panels_of(page, len(charts), columns)
    for panel, (title, unit, sequence, values, half, limits, outliers) in zip(
        panels, charts, strict=False
    ):
        order = np.argsort(sequence, kind="stable")
        panel.errorbar(
            sequence[order], values[order], None if half is None else half[order], fmt="o-",
            color=figures.INK, ms=3, lw=0.5, elinewidth=1.0, label="mean of a part ± k s_repeat/√n",
        )  # fmt: skip
        for limit in limits:
            panel.axhline(limit, color=figures.RED, lw=1.0, ls="--", label="tolerance")
        for i, name in outliers.items():
            place = sequence[i], values[i]
            panel.plot(*place, "D", color=figures.RED, ms=5, label="outlier among the parts")
            panel.annotate(cut(name, 14), place, (5, 3), textcoords="offset points", fontsize=7)
        panel.set(title=cut(title, 44), ylabel=unit)
        panel.locator_params(axis="x", integer=True)
    for panel in page.axes[-columns:]:
        panel.set_xlabel("sequence of the parts")
    figures.legend(page, 2)
    count = len({label[:2] for label in result.features.labels})
    some = f"; {DRAWN} of {count} features" * (count > DRAWN)
    figures.title(page, f"Mean errors by part, actual minus nominal{some}")
    return page


def _charts(result: AnovaResult) -> Iterator[tuple[Any, ...]]:
    """Title, unit, sequence, means of parts with scatter, limits and outliers: of features, clear
    trends, outliers and the largest errors first; then of what has a tolerance, the worst first.
    """
    group, k = result.features, result.features.coverage_factor
    clear = [x.where for x in result.trends if x.p <= FAMILY_RATE and x.where in group.labels]
    outliers = [x for x, parts in zip(group.labels, group.unusual, strict=True) if parts]
    ranking = [*clear, *outliers, *(group.labels[i] for i in group.order)]
    for key in list(dict.fromkeys(label[:2] for label in ranking))[:DRAWN]:
        for i in (i for i, label in enumerate(group.labels) if label[:2] == key):
            mean, u = (each / UM for each in group.part_means(i))
            out = {p: name for p, name in enumerate(group.tables.parts) if name in group.unusual[i]}
            text = words(*group.labels[i])
            yield text, "um", result.sequence[key[0]], mean, k * u, (), out
    by_merit = sorted(result.capabilities, key=lambda x: np.nanmin([x.ppk, x.cpk, np.inf]))
    for item in by_merit[:RUNS]:
        unit, size = ("arcsec", ARCSEC) if item.kind == "angle" else ("um", UM)
        limits = [item.high] if item.kind == "position" else [item.low, item.high]
        title = f"{words(item.operation, item.id)} {item.kind}: ppk {item.ppk:.2f}"
        ends = [limit / size for limit in limits]
        yield title, unit, item.sequence, item.values / size, None, ends, {}
