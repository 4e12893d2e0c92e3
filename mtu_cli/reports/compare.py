"""The report of compare: predicted against measured, item by item, and by operation.

`measured.u_um` is of a future part from components of variance; `measured.paper_u_um` takes
MS_between for the part variance, as Gilsinn & Ling 2004 do. Range widths are 2 (|mean| + k u), as
in their Table 10. Ratios are measured over predicted.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from mtu_cli.analyses.compare import CompareResult, Summary
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Field, Fields, Group, count, rows_of
from mtu_cli.reports.numbers import MISSING, p_value, significant, span
from mtu_cli.units import UM

SHOWN = 40
"""Features listed one by one; of more the most interesting."""
HOLM = "adjusted for all tests of the study (Holm)"


def _mean(side: str) -> Iterator[Field]:
    """Mean, u and U of the predicted or the measured side."""
    yield Field(
        f"{side}.mean_um",
        f"{side}.mean",
        "mean error, actual minus nominal",
        head=side,
        u=f"{side}.u",
        show="plus-minus",
    )
    yield Field(f"{side}.u_um", f"{side}.u", "standard uncertainty of one future part")
    yield Field(f"{side}.U_um", f"{side}.U", "k u", head=f"U\n{side}", detail=True)


def _test(name: str, meaning: str) -> Field:
    text = f"p of the {meaning}, {HOLM}"
    return Field(f"p_{name}_familywise", f"p_{name}", text, head=f"p\n{name}", show="p")


def _ratio(path: str, value: str, meaning: str, head: str = "") -> Field:
    return Field(path, value, meaning, head=head and f"{head}\nratio", detail=head != "scatter")


ROW: Fields = (
    Field("", lambda x: "feature" if x.labels[2] else "length", "of item", csv="kind"),
    Field("", lambda x: " ".join(filter(None, x.labels)), head="item", show="text"),
    Field("", lambda x: x.table.stated(x.index), head="verdict", show="text"),
    Field("id", "labels.1", "name of the feature or length"),
    Field("axis", lambda x: x.labels[2] or None, "null: a length"),
    Field("operation", lambda x: x.labels[0] or None, "null: not stated"),
    *_mean("predicted"),
    Field("predicted.independent_u_um", "independent.u", "components and points independent"),
    Field("predicted.independent_U_um", "independent.U", "k times it"),
    *_mean("measured"),
    Field("measured.parts", count("one_way.parts"), "number of parts"),
    Field("measured.n", count("one_way.N"), "number of readings"),
    Field("measured.n0", "one_way.n0", "E ms_between = s_repeat^2 + n0 s_part^2"),
    Field("measured.s_part_um", "s_part", "standard deviation from part to part"),
    Field("measured.ms_between_um2", "one_way.ms_between", "mean square between parts"),
    Field("measured.sqrt_ms_between_over_s_part", "ms_share", "the paper's scatter over s_part"),
    Field("measured.paper_u_um", "measured_paper.u", "u with ms_between as the part variance"),
    Field(
        "bias_um",
        "bias",
        "measured minus predicted mean",
        head="bias",
        u="u_difference",
        show="plus-minus",
    ),
    Field("u_bias_um", "u_difference", "its standard uncertainty"),
    Field("E_n", meaning="bias/(k u_bias)", head="E_n"),
    _test("bias", "bias"),
    _ratio("ratio_u", "ratio_u", "of u of one future part", "u"),
    _ratio("ratio_scatter", "ratio_scatter", "of scatter from part to part", "scatter"),
    _ratio("ratio_ms_between", "ratio_ms", "of ms_between and its expectation"),
    _test("scatter", "scatter from part to part"),
    Field("range_width_um.predicted", "predicted.width", "2 (|mean| + k u)", unit="um"),
    Field("range_width_um.measured", "measured.width", "2 (|mean| + k u)", unit="um"),
    _ratio("ratio_range", "ratio_range", "of the range widths", "range"),
    Field("paper.range_width_um.predicted", "independent.width", "independent", unit="um"),
    Field("paper.range_width_um.measured", "measured_paper.width", "by paper_u", unit="um"),
    _ratio("paper.ratio_range", "paper_ratio_range", "of the paper's range widths"),
    _ratio("paper.ratio_u", "paper_ratio_u", "of paper_u and independent_u"),
    Field("biased", meaning="whether the mean is off; null: not tested"),
    Field("under_predicted", meaning="whether the scatter is larger than predicted"),
    Field("over_predicted", meaning="whether the scatter is smaller than predicted"),
    Field("verdict", "verdicts", "the gravest fault, or consistent; null: not tested"),
)


def verdict_text(item: Summary) -> str:
    """Such as "drilled features: under-predicted (48 of 48: scatter 3.1 to 4.7 times predicted)",
    every fault with its size.
    """
    faults = (
        ("under-predicted", item.under_predicted, "under_factor", "scatter {} times predicted"),
        ("biased", item.biased, "bias_size", "mean off by {} um"),
        ("over-predicted", item.over_predicted, "over_factor", "scatter {} times predicted"),
    )
    said = [
        f"{name} ({number} of {item.items}{_size(item, size, text)})"
        for name, number, size, text in faults
        if number
    ]
    if item.pooled is not None and item.pooled_fault:
        times, p = significant(item.pooled.ratio), p_value(item.pooled.p)
        said.append(f"{item.pooled_fault} (pooled scatter {times} times predicted, p {p})")
    if item.not_tested == item.items:
        said = ["not tested"]
    else:
        said = said or ["consistent"]
        tested = {"scatter": item.scatter_tested, "bias": item.bias_tested}
        said += [f"{name} not tested" for name, number in tested.items() if not number]
    return f"{item.operation} {item.kind}: ".lstrip() + "; ".join(said)


def _size(item: Summary, name: str, text: str) -> str:
    if name not in item.ranges:
        return ""
    scale = UM if "um" in text else 1.0
    ends = (significant(end / scale) for end in item.ranges[name].ends)
    return f": {text.format(span(*ends))}"


def _ends(name: str, meaning: str, head: str = "") -> Field:
    return Field(name, f"ranges.{name}.ends", f"least and largest {meaning}", head=head, show=_span)


def _span(ends: tuple[float, float], u: None, digits: int) -> str:
    return span(*(significant(end, digits) for end in ends))


def _some(value: int, u: None, digits: int) -> str:
    return str(value) if value else MISSING


def _median(name: str, value: str, meaning: str) -> Field:
    return Field(name, f"ranges.{value}.median", f"median {meaning}")


def summary(kind: str) -> Fields:
    """The figures of an operation; the pooled test is of features."""
    pooled = Group(
        "all_at_once",
        (
            Field("items", meaning="items whose scatter is pooled"),
            Field("ratio_scatter", "ratio", "their scatter, measured over predicted"),
            Field("p_scatter_familywise", "p", f"p of it, {HOLM}", head="p\npooled", show="p"),
            Field("verdict", lambda x: x.verdict or "consistent", "what the test shows"),
        ),
        "pooled",
    )
    return (
        Field("operation", lambda x: x.operation or None, "null: not stated"),
        Field("", lambda x: f"{x.operation} {x.kind}".strip(), head="measured", show="text"),
        Field("verdict_text", verdict_text, "the verdict in words"),
        Field("items", meaning="number of items"),
        Field("verdicts", meaning="number of items by gravest fault"),
        Field("not_tested", meaning="items that could not be tested"),
        Field("tested.bias", "bias_tested", "items tested for bias"),
        Field("tested.scatter", "scatter_tested", "items tested for scatter"),
        Field("", lambda x: x.verdicts["consistent"], head="con-\nsistent", show=_some),
        *(
            Field(name, meaning="items with that fault", head=name.replace("_", "-\n"), show=_some)
            for name in ("biased", "under_predicted", "over_predicted")
        ),
        Field(
            "under_predicted_factor",
            lambda x: x.ranges["under_factor"].ends if "under_factor" in x.ranges else [],
            "least and largest scatter ratio of the under-predicted",
        ),
        *([pooled] if kind == "features" else []),
        _ends("ratio_u", "ratio of u", "u ratio"),
        _ends("ratio_scatter", "ratio of scatter from part to part", "scatter ratio"),
        _ends("ratio_range", "ratio of range widths", "range ratio"),
        _median("median_ratio_u", "ratio_u", "ratio of u"),
        _median("median_ratio_range", "ratio_range", "ratio of range widths"),
        _ends("paper_ratio_u", "ratio of u as in the paper"),
        _ends("paper_ratio_range", "ratio of range widths as in the paper"),
        _median("median_bias_um", "bias", "bias"),
        _median("n0", "n0", "n0"),
        Field(
            "sqrt_ms_between_over_s_part",
            "ranges.ms_share.ends",
            "least and largest of the items' figure",
        ),
    )


def _lengths(result: CompareResult) -> list[Any]:
    return [] if result.lengths is None else rows_of(result.lengths, len(result.lengths.labels))


RESULTS: Fields = (
    Field("datum", meaning="best-fit alignment removed from each part"),
    Group("features", ROW, lambda x: rows_of(x.features, len(x.features.labels)), many=True),
    Group("lengths", ROW, _lengths, many=True),
    Group("summary.features", summary("features"), "feature_summaries", many=True),
    Group(
        "summary.lengths",
        summary("lengths"),
        lambda x: None if x.lengths is None else x.length_summaries,
        many=True,
    ),
)


def document(result: CompareResult, digits: int = 2) -> Document:
    """A row an operation and kind, then a row an item, lengths first."""
    from mtu_cli.reports import part_figures

    features = rows_of(result.features, len(result.features.labels))
    lengths, chosen, title = _lengths(result), features, "Lengths and features"
    if len(features) > SHOWN:
        chosen = [features[i] for i in result.features.by_interest()[:SHOWN]]
        title += f": faults first, {SHOWN} of {len(features)} features"
    summaries = [*result.feature_summaries, *result.length_summaries]
    return Document(
        title="Predicted against measured",
        results=(RESULTS, result),
        tables=[
            Table(title="", fields=ROW, items=[*features, *lengths], shown=()),
            Table(
                title="Verdicts and ratios",
                fields=summary("features"),
                items=summaries,
                footer="items with each fault (5 % over the study); ratios: measured over "
                "predicted, least to largest",
            ),
            Table(
                title=title if lengths else title.replace("Lengths and f", "F"),
                fields=ROW,
                items=[*lengths, *chosen],
                footer="± u, of mean errors that of one future part; E_n = bias/"
                f"({result.coverage_factor:g} u); p: of all items together (Holm)",
            ),
        ],
        figure=lambda: part_figures.compare(result),
        verdict="\n".join(f"{verdict_text(item)}." for item in summaries),
        digits=digits,
    )
