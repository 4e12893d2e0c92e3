"""The report of anova: one entry an operation, feature and axis, a length, a right angle.

A figure is null where the data cannot give it (no repeats, one part, no variance), and a warning
says so. With --method paper `var_part` is MS_between, and u_mean and u_future have the repeat
scatter alone (Gilsinn & Ling 2004, eqs. (31)-(34)). Limits of `var_part_interval95` below 0 are 0;
where both were, `var_part_limits_below_zero` says so, and [0, 0] bounds nothing: the means of the
parts scatter less than the repeats alone make them in 39 of 40 studies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mtu_cli.analyses.anova import Analysed, AnovaResult
from mtu_cli.analyses.anova.capability import Trend
from mtu_cli.analyses.anova.outliers import FAMILY_RATE
from mtu_cli.analyses.anova.tables import Kind
from mtu_cli.findings import listed
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Field, Fields, Group, RowOf, count, read, record, root, rows_of
from mtu_cli.reports.numbers import MISSING

SHOWN = 24
"""Tables of a kind that are listed in full; of more the worst are shown."""
WORST = 10
MEAN = "mean of all readings: a part counts by its repeats"
TITLES = {"feature": "Features", "length": "Lengths", "angle": "Right angles"}


def place(label: str, name: str = "id") -> Fields:
    """What a figure is of, by its label (operation, name, axis)."""

    def word(index: int) -> Callable[[Any], str | None]:
        return lambda item: read(item, label)[index] or None

    title = name.replace("id", "item")
    return (
        Field("operation", word(0), "null: not stated", head="operation", show="text"),
        Field(name, word(1), "its name; null: all together", head=title, show="text"),
        Field("axis", word(2), "of outliers length or angle, too", head="axis", show="text"),
    )


def entry(kind: Kind) -> Fields:
    """The figures of a feature along an axis, of a length or of a right angle."""
    unit = "arcsec" if kind == "angle" else "um"
    all_of, limits = "adjusted for all of the kind (Holm)", "its 95 % interval"
    return (
        *place("tables.labels", "feature" if kind == "feature" else "id"),
        Field("parts", count("one_way.parts"), "number of parts"),
        Field("n", count("one_way.N"), "number of readings", head="n", show="count"),
        Field(f"mean_error_{unit}", "one_way.mean", MEAN, head="mean", u=_rounding),
        *_squares(unit),
        Field(f"var_part_{unit}2", "components.part", "variance from part to part"),
        Field("", root("components.part"), head="s_part", unit=unit),
        Field("", root("both"), head="s_part+repeat", unit=unit),
        Field(
            f"var_part_estimate_{unit}2",
            "components.part_estimate",
            "the same, not set to 0 where it is below",
        ),
        Field(f"var_repeat_{unit}2", "components.repeat", "variance of repeated measurement"),
        Field(
            f"var_part_interval95_{unit}2",
            "interval",
            limits,
            csv=f"var_part_{{}}95_{unit}2",
            head="s_part^2 95 %",
            show="interval",
            u="components.repeat",
            detail=True,
        ),
        Field("method", meaning="of the components: paper, anova or reml"),
        Field(f"s_pooled_{unit}", root("one_way.ms_within"), "root of ms_within", head="s_repeat"),
        Field(f"u_mean_{unit}", "u_mean", "standard uncertainty of the mean", head="u", u="u_mean"),
        Field(f"u_future_{unit}", "u_future", "standard uncertainty of a future part"),
        Field(
            f"U_future_{unit}",
            lambda x: x.coverage_factor * x.u_future,
            "k u_future",
            head="U future",
        ),
        Field("unusual_parts", "unusual", "outlying parts", head="outlying\nparts", show=_names),
        Field("", lambda item: item.tables.labels[1], "name of feature, length or angle", csv="id"),
        Field("p_familywise", "p_parts", f"p of F, {all_of}", head="p (Holm)", show="p"),
        Field(f"var_both_{unit}2", "both", "variance of parts and CMM, without repeats"),
        Field(
            f"var_both_interval95_{unit}2",
            "both_interval",
            limits,
            csv=f"var_both_{{}}95_{unit}2",
            show="interval",
        ),
        Field(
            f"interval95_future_{unit}",
            "interval_future",
            "interval that holds the error of 95 of 100 future parts (Student's t)",
            csv=f"future_{{}}95_{unit}",
            head="95 % future",
            show="interval",
            u="u_future",
        ),
        Field("dof_mean", meaning="degrees of freedom of u_mean"),
        Field("dof_future", meaning="degrees of freedom of u_future"),
        Field("p_mean_familywise", "p_mean", f"p of a mean of zero (t test), {all_of}"),
        Field(
            "var_part_limits_below_zero",
            _below_zero,
            "whether both limits of var_part were below 0: its interval is then [0, 0]",
        ),
    )


def _squares(unit: str) -> Iterator[Field]:
    """The table of the analysis of variance."""
    for name, of in (("between", "parts"), ("within", "repeats")):
        value, head = f"one_way.ms_{name}", f"MS {name}"
        yield Field(f"ms_{name}_{unit}2", value, f"mean square of {of}", head=head, detail=True)
    for name in ("df_between", "df_within"):
        df, head = count(f"one_way.{name}"), name.replace("_", "\n")
        yield Field(name, df, "degrees of freedom", head=head, show="count", detail=True)
    yield Field("F", "one_way.F", "ms_between/ms_within", head="F", detail=True)
    yield Field("F_critical_95", "one_way.F_critical_95", "F at 5 %", head="F 95 %", detail=True)
    yield Field("p", "one_way.p", "p of F: the parts do not differ")
    yield Field("n0", "one_way.n0", "E ms_between = var_repeat + n0 var_part")


def _rounding(item: Any) -> float:
    """What a mean is rounded to: its u, of one part the scatter of its repeats."""
    return float(item.u_mean if item.u_mean > 0 else np.sqrt(item.one_way.ms_within))


def _below_zero(item: Any) -> bool:
    """Whether both limits for the part variance were below 0: [0, 0] is no bound on it."""
    return bool(item.one_way.ms_within > 0 and (item.interval == 0).all())


def _names(names: Sequence[str], u: None, digits: int) -> str:
    return " ".join(names)


def _of_unit(field: Field, unit: str) -> Field:
    """The field, of items of that unit alone where it has one."""
    if not field.unit_name:
        return field
    return replace(
        field, value=lambda item: read(item, field.source) if _unit(item) == unit else None
    )


def _in_units(fields: Callable[[str], Iterable[Field]], *units: str) -> Iterator[Field]:
    """Fields of lengths and of angles, or in these `units`, each of its own items."""
    for unit in units or ("um", "arcsec"):
        yield from (_of_unit(field, unit) for field in fields(unit))


def _unit(item: Any) -> str:
    """Of the figures of an outlying part or of a table."""
    kind = item.where[2] if hasattr(item, "where") else item.kind
    return "arcsec" if kind == "angle" else "um"


def listing() -> Fields:
    """The CSV: angles in the columns of arcsec and all else in those of um."""
    kinds = {"feature": "feature", "length": "length", "angle": "orthogonality"}
    um, arcsec = (
        [field for field in entry(kind) if isinstance(field, Field)]
        for kind in ("feature", "angle")
    )
    name = replace(um[1], value=lambda x: x.tables.labels[1] if x.kind == "feature" else None)
    return (
        Field("", lambda item: kinds[item.kind], "feature, length or orthogonality", csv="kind"),
        um[0],
        name,
        *(_of_unit(field, "um") for field in um[2:]),
        *(_of_unit(field, "arcsec") for field in arcsec if field.unit_name),
    )


def _deviation(unit: str) -> Iterator[Field]:
    text = "distance from the mean of the others"
    yield Field(f"deviation_{unit}", "deviation", text, head="deviation", u="typical")
    yield Field(f"typical_{unit}", "typical", "root mean square of the others", head="others rms")


OPERATION = Field(
    "operation",
    lambda item: item.operation or None,
    "null: not stated",
    head="operation",
    show="text",
)
TOTAL: Fields = (
    OPERATION,
    Field("axis", meaning="x, y or z", head="axis", show="text"),
    Field("features", meaning="number of features", head="features", show="count"),
    Field("mean_error_um", "mean", "mean of the mean errors", head="mean error", u="rounding"),
    Field("s_mean_errors_um", "spread", "their standard deviation", head="feature s"),
    Field("largest_mean_error_um", "largest", "the largest", head="largest", u="rounding"),
    Field("largest_at", "worst", "of which feature", head="at", show="text"),
    Field("mean_var_part_um2", "part", "mean variance from part to part"),
    Field("mean_var_repeat_um2", "repeat", "mean variance of repeated measurement"),
    Field("mean_var_both_um2", "both", "mean variance of both, without repeats"),
    Field("", root("part"), head="s_part", unit="um"),
    Field("", root("both"), head="s_part+repeat", unit="um"),
    Field("", root("repeat"), head="s_repeat", unit="um"),
    Field(
        "repeat_share",
        meaning="share of the CMM in the variance of one measured point (REML)",
        head="CMM\n% of s^2",
        show="percent",
        detail=True,
    ),
    Field("F_above_critical", "significant", "features with F above F_critical_95"),
    Field("F_tested", "tested", "features with an F"),
    Field(
        "parts_differ",
        "differ",
        "features in which parts differ, 5 % over all (Holm)",
        head="parts\ndiffer",
        u="tested",
        show=lambda value, u, digits: f"{value} of {u}" if u else "",
    ),
    Field("mean_not_zero", "off", "features whose mean is not zero, 5 % over all (Holm)"),
)
UNUSUAL_FEATURE: Fields = (
    *place("where"),
    Field("p_familywise", "p", "p among all features (Grubbs, Bonferroni)", head="p", show="p"),
    *_deviation("um"),
)


def _slope(unit: str) -> Iterator[Field]:
    text = "change from part to part in the sequence"
    yield Field(f"slope_{unit}", "slope", text, head="slope", u="u")
    yield Field(f"u_slope_{unit}", "u", "its standard uncertainty")


TREND: Fields = (
    *place("where"),
    *_in_units(_slope),
    Field("p_familywise", "p", "p that the sequence changes nothing", head="p", show="p"),
)


def _interval(name: str, meaning: str) -> Field:
    return Field(
        f"{name}_interval95", f"{name}_interval", meaning, head="95 %", show="interval", u=name
    )


def _index(name: str, meaning: str) -> Field:
    def shown(value: float, u: None, digits: int) -> str:
        return MISSING if np.isnan(value) else f"{value:.2f}"

    return Field(name, meaning=meaning, head=name, show=shown)


def _limits(unit: str) -> Iterator[Field]:
    for name, meaning, head in (
        ("low", "lower limit", "low"),
        ("high", "upper limit; of a position half the diameter of its zone", "high"),
        ("mean", "mean error; of a position the mean radial error", "mean"),
        ("s", "standard deviation of the parts, repeats averaged", "s"),
        ("s_moving", "mean moving range over the sequence, over 1.128", ""),
    ):
        yield Field(f"{name}_{unit}", name, meaning, head=head)


CAPABILITY: Fields = (
    Field("kind", meaning="position, length or angle", head="of", show="text"),
    OPERATION,
    Field("id", meaning="of the feature, length or angle", head="item", show="text"),
    Field("parts", lambda x: len(x.values), "number of parts", head="parts", show="count"),
    *_in_units(_limits),
    _index("pp", "(high - low)/(6 s)"),
    _interval("pp", "its 95 % interval (chi-squared)"),
    _index("ppk", "nearer limit less mean over 3 s; of a position high/(99.73 % quantile)"),
    _interval("ppk", "its 95 % interval (noncentral t)"),
    _index("cp", "pp with s_moving for s"),
    _index("cpk", "ppk with s_moving for s"),
)


def unusual_part(*units: str) -> Fields:
    """The figures of an outlying part, with its largest deviation in these units."""
    return (
        Field("part", meaning="its name", head="part", show="text"),
        Group("where", place(""), csv=False),
        *_in_units(_deviation, *units),
        Field("p_familywise", "p", "p over all parts and tables", head="p", show="p"),
        Field("why", meaning="of what: mean or distance (rms) of a group, a single table"),
        Group("singles", place(""), many=True),
    )


def _unusual(result: AnovaResult) -> list[dict[str, Any]] | None:
    if result.unusual is None:
        return None
    return [record(unusual_part(_unit(item)), item) for item in result.unusual]


def _rows(kind: Kind) -> Callable[[AnovaResult], list[RowOf]]:
    def rows(result: AnovaResult) -> list[RowOf]:
        return [
            row
            for found in result.kinds
            if found.kind == kind
            for row in rows_of(found, len(found.tables.labels))
        ]

    return rows


UNUSUAL = (
    "outlying parts: part, where, deviation and typical (rms of the others) in um or arcsec, "
    "p_familywise, why (mean or distance of a group, or a single table), singles; null: too few"
)
RESULTS: Fields = (
    Field("method", meaning="of the components of variance"),
    Field("datum", meaning="best-fit alignment removed from each part"),
    Group("features", entry("feature"), _rows("feature"), many=True),
    Group("lengths", entry("length"), _rows("length"), many=True),
    Group("orthogonality", entry("angle"), _rows("angle"), many=True),
    Group("totals", TOTAL, many=True),
    Field("unusual_parts", _unusual, UNUSUAL),
    Group("unusual_features", UNUSUAL_FEATURE, many=True),
    Field(
        "family_wise_rate",
        lambda _: FAMILY_RATE,
        "false alarm rate of outlying parts, outlying features and trends together",
    ),
    Group("trends", TREND, many=True),
    Group("capability", CAPABILITY, "capabilities", many=True),
)
ROW = listing()


def document(result: AnovaResult, digits: int = 2) -> Document:
    """A row an operation and axis; then outliers, lengths, angles and features."""
    from mtu_cli.reports import part_figures

    return Document(
        title="Measured parts",
        results=(RESULTS, result),
        tables=list(_tables(result)),
        figure=lambda: part_figures.anova(result),
        verdict=_verdict(result),
        digits=digits,
    )


def _tables(result: AnovaResult) -> Iterator[Table]:
    rows = {found.kind: _rows(found.kind)(result) for found in result.kinds}
    yield Table(title="", fields=ROW, items=[row for own in rows.values() for row in own], shown=())
    datum = "" if result.datum == "none" else f", less {result.datum.replace(',', ' and ')}"
    yield Table(
        title=f"Features by operation and axis{datum}",
        fields=TOTAL,
        items=result.totals,
        footer="s: standard deviations of the features' mean errors, from part to part, of "
        "repeated measurement (CMM); parts differ: F test, 5 % over all (Holm)",
    )
    yield Table(
        title="Outlying parts",
        fields=unusual_part("um", "arcsec"),
        items=result.unusual or (),
        footer="deviation from the mean of the other parts; false alarms in "
        f"{100 * FAMILY_RATE:g} % of studies",
    )
    yield Table(
        title="Outlying features",
        fields=UNUSUAL_FEATURE,
        items=result.unusual_features,
        footer="deviation from the mean error of the other features of the operation and axis",
    )
    yield Table(
        title="Trends over the sequence",
        fields=TREND,
        items=_significant(result),
        footer="change from part to part, p over all tables (Holm)",
    )
    yield Table(
        title="Capability",
        fields=CAPABILITY,
        items=result.capabilities,
        footer="pp, ppk: overall s of the parts; cp, cpk: s of neighbours in the sequence",
    )
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
        if found.method == "paper":
            footer += ", of the repeats alone (Gilsinn & Ling 2004, eq. (34))"
        footer += "; p of the F test"
    return Table(title=title, fields=entry(found.kind), items=rows, shown=chosen, footer=footer)


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
    if result.unusual_features:
        names = listed(" ".join(filter(None, item.where)) for item in result.unusual_features)
        said.append(f"Outlying features: {names}.")
    if trending := _significant(result):
        names = listed(" ".join(filter(None, item.where)) for item in trending)
        said.append(f"Trend over the sequence: {names}.")
    return " ".join(said) or "Too few parts or repeats for the F test and for outliers."


def _significant(result: AnovaResult) -> list[Trend]:
    return [item for item in result.trends if item.p <= FAMILY_RATE]
