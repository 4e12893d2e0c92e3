"""The report of anova: one entry an operation, feature and axis, a length, a right angle.

With --method paper `var_part` is MS_between (Gilsinn & Ling 2004, eqs. (31)-(34)).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from mtu_cli.analyses.anova import Analysed, AnovaResult
from mtu_cli.analyses.anova.parts import Trend
from mtu_cli.analyses.anova.tables import Kind
from mtu_cli.findings import listed
from mtu_cli.reports import part_figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Field, Fields, RowOf, declare, read, rows_of
from mtu_cli.reports.numbers import MISSING
from mtu_cli.stats.family import FAMILY_RATE

SHOWN = 24
"""Tables of a kind that are listed in full; of more the worst are shown."""
WORST = 10
TITLES = {"feature": "Features", "length": "Lengths", "angle": "Right angles"}
KINDS = {"feature": "feature", "length": "length", "angle": "orthogonality"}
PLACE = """
    operation | stated(LABEL.0) | null: not stated | operation, text
    NAME | stated(LABEL.1) | its name; null: all together | TITLE, text
    axis | stated(LABEL.2) | of outliers length or angle, too | axis, text
"""
"""What a figure is of, by its label (operation, name, axis)."""
ENTRY = """
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
    var_both_interval95_UNIT2 | both_interval | its 95 % interval \
        | -, interval, csv=var_both_{}95_UNIT2
    interval95_future_UNIT | interval_future | interval that holds the error of 95 of 100 future \
        parts (Student's t) | 95 % future, interval, u=u_future, csv=future_{}95_UNIT
    dof_mean | | degrees of freedom of u_mean
    dof_future | | degrees of freedom of u_future
    p_mean_familywise | p_mean | p of a mean of zero (t test), adjusted for all of the kind (Holm)
    var_part_limits_below_zero | below_zero() | whether both limits of var_part were below 0: its \
        interval is then [0, 0]
"""


def place(label: str, name: str = "id") -> Fields:
    """The figures that name what others are of."""
    text = PLACE.replace("LABEL", label).replace("NAME", name)
    return declare(text.replace("TITLE", name.replace("id", "item")))


def entry(kind: Kind) -> Fields:
    """The figures of a feature along an axis, of a length or of a right angle."""
    fields = declare(
        ENTRY.replace("UNIT", "arcsec" if kind == "angle" else "um"),
        rounding=_rounding,
        # Both limits for the part variance were below 0: [0, 0] is no bound on it.
        below_zero=lambda x: bool(x.one_way.ms_within > 0 and (x.interval == 0).all()),
        U_future=lambda x: x.coverage_factor * x.u_future,
        joined=lambda names, u, digits: " ".join(names),
    )
    return (*place("tables.labels", "feature" if kind == "feature" else "id"), *fields)


def _rounding(item: Any) -> float:
    """What a mean is rounded to: its u, of one part the scatter of its repeats."""
    return float(item.u_mean if item.u_mean > 0 else np.sqrt(item.one_way.ms_within))


def _of_unit(field: Field, unit: str) -> Field:
    """The field, of items of that unit alone where it has one."""
    if not field.unit_name:
        return field
    return replace(
        field, value=lambda item: read(item, field.value) if _unit(item) == unit else None
    )


def _in_units(text: str) -> list[Field]:
    """Fields of lengths and of angles, each of its own items."""
    return [
        _of_unit(field, unit)
        for unit in ("um", "arcsec")
        for field in declare(text.replace("UNIT", unit))
        if isinstance(field, Field)
    ]


def _unit(item: Any) -> str:
    """Of the figures of an outlying part or of a table."""
    kind = item.where[2] if hasattr(item, "where") else item.kind
    return "arcsec" if kind == "angle" else "um"


def listing() -> Fields:
    """The CSV: angles in the columns of arcsec and all else in those of um."""
    um, arcsec = (
        [field for field in entry(kind) if isinstance(field, Field)]
        for kind in ("feature", "angle")
    )
    name = replace(um[1], value=lambda x: x.tables.labels[1] if x.kind == "feature" else None)
    meaning = "feature, length or orthogonality"
    return (
        Field("", lambda item: KINDS[item.kind], meaning, csv="kind"),
        um[0],
        name,
        *(_of_unit(field, "um") for field in um[2:]),
        *(_of_unit(field, "arcsec") for field in arcsec if field.unit_name),
    )


DEVIATION = """
    deviation_UNIT | deviation | distance from the mean of the others | deviation, u=typical
    typical_UNIT | typical | root mean square of the others | others rms
"""
TOTAL = declare(
    """
    operation | stated(operation) | null: not stated | operation, text
    axis | | x, y or z | axis, text
    features | | number of features | features, count
    mean_error_um | mean | mean of the mean errors | mean error, u=rounding
    s_mean_errors_um | spread | their standard deviation | feature s
    largest_mean_error_um | largest | the largest | largest, u=rounding
    largest_at | worst | of which feature | at, text
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
SLOPE = """
    slope_UNIT | slope | change from part to part in the sequence | slope, u=u
    u_slope_UNIT | u | its standard uncertainty
"""
TREND: Fields = (
    *place("where"),
    *_in_units(SLOPE),
    *declare("p_familywise | p | p that the sequence changes nothing | p, p"),
)
LIMITS = """
    low_UNIT | low | lower limit | low
    high_UNIT | high | upper limit; of a position half the diameter of its zone | high
    mean_UNIT | mean | mean error; of a position the mean radial error | mean
    s_UNIT | s | standard deviation of the parts, repeats averaged | s
    s_moving_UNIT | s_moving | mean moving range over the sequence, over 1.128
"""
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
    limits=_in_units(LIMITS),
    # Two decimals as the indices have, at two digits of u.
    hundredth=lambda item: 0.1,
    index=lambda value, u, digits: MISSING if np.isnan(value) else f"{value:.2f}",
)


UNUSUAL = declare(
    """
    part | | its name | part, text
    where. | where | *place | json
    *deviation
    p_familywise | p | p over all parts and tables | p, p
    singles[] | singles | *place
    """,
    place=place(""),
    deviation=_in_units(DEVIATION),
)


def _rows(kind: Kind) -> Callable[[AnovaResult], list[RowOf]]:
    return lambda result: [
        row
        for found in result.kinds
        if found.kind == kind
        for row in rows_of(found, len(found.tables.labels))
    ]


RESULTS = declare(
    """
    method | | of the components of variance
    datum | | best-fit alignment removed from each part
    features[] | features() | *feature
    lengths[] | lengths() | *length
    orthogonality[] | angles() | *angle
    totals[] | totals | *total
    unusual_parts[] | unusual | *unusual
    trends[] | trends | *trend
    capability[] | capabilities | *capability
    """,
    features=_rows("feature"),
    lengths=_rows("length"),
    angles=_rows("angle"),
    feature=entry("feature"),
    length=entry("length"),
    angle=entry("angle"),
    total=TOTAL,
    unusual=UNUSUAL,
    trend=TREND,
    capability=CAPABILITY,
)
ROW = listing()


def document(result: AnovaResult, digits: int = 2) -> Document:
    """A row an operation and axis; then outliers, lengths, angles and features."""
    figure, tables = partial(part_figures.anova, result), list(_tables(result))
    verdict = _verdict(result)
    return Document("Measured parts", (RESULTS, result), tables, figure, verdict, digits)


def _tables(result: AnovaResult) -> Iterator[Table]:
    rows = {found.kind: _rows(found.kind)(result) for found in result.kinds}
    yield Table("", ROW, [row for of_kind in rows.values() for row in of_kind], shown=())
    datum = "" if result.datum == "none" else f", less {result.datum.replace(',', ' and ')}"
    footer = (
        "s: standard deviations of the features' mean errors, from part to part, of repeated "
        "measurement (CMM); parts differ: F test, 5 % over all (Holm)"
    )
    yield Table(f"Features by operation and axis{datum}", TOTAL, result.totals, footer)
    footer = f"mean of the other parts; false alarms in {100 * FAMILY_RATE:g} % of studies"
    yield Table("Outlying parts", UNUSUAL, result.unusual or (), f"deviation from the {footer}")
    footer = "change from part to part, p over all tables (Holm)"
    yield Table("Trends over the sequence", TREND, _significant(result), footer)
    footer = "pp, ppk: overall s of the parts; cp, cpk: s of neighbours in the sequence"
    yield Table("Capability", CAPABILITY, result.capabilities, footer)
    for found in (*result.kinds[1:], result.features):
        yield _listed(found, rows[found.kind])


def _listed(found: Analysed, rows: Sequence[RowOf]) -> Table:
    """All tables of a kind where they are few, else those of the largest errors."""
    title, footer, chosen = TITLES[found.kind], "", rows
    if len(rows) > SHOWN:
        chosen = [rows[i] for i in found.order[:WORST]]
        title += f": the {WORST} of {len(rows)} with the largest errors"
    if found.kind == "feature":
        footer = f"mean and its u; U future = {found.coverage_factor:g} u of a future part"
        papers = ", of the repeats alone (Gilsinn & Ling 2004, eq. (34))"
        footer += papers * (found.method == "paper") + "; p of the F test"
    return Table(title, entry(found.kind), rows, footer, shown=chosen)


def _verdict(result: AnovaResult) -> str:
    """Whether parts differ, which are outliers, and what changes over the sequence."""
    tested = sum(item.tested for item in result.totals)
    differ = sum(item.differ for item in result.totals)
    said = []
    if tested:
        said.append(
            f"F test: parts differ significantly in {differ} of {tested} features and axes."
        )
    if result.unusual is not None:
        names = listed(item.part for item in result.unusual)
        said.append(f"Outlying parts: {names}." if names else "No part is an outlier.")
    if trending := _significant(result):
        names = listed(" ".join(filter(None, item.where)) for item in trending)
        said.append(f"Trend over the sequence: {names}.")
    return " ".join(said) or "Too few parts or repeats for the F test and for outliers."


def _significant(result: AnovaResult) -> list[Trend]:
    return [item for item in result.trends if item.p <= FAMILY_RATE]
