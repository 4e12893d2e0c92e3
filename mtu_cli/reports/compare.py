"""The report of compare: predicted against measured, item by item, and by operation.

Range widths are 2 (|mean| + k u), as in Gilsinn & Ling 2004, Table 10.
"""

from __future__ import annotations

import numpy as np

from mtu_cli.analyses.compare import Compared, CompareResult, Summary
from mtu_cli.reports import figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import RowOf, declare, rows_of
from mtu_cli.reports.numbers import MISSING, p_value, significant, span, words
from mtu_cli.units import UM

SHOWN, DRAWN = 40, 18
"""Features listed, and items of a kind drawn, one by one; of more the most interesting."""
ROW = declare(
    """
    - | kind() | of item | -, csv=kind
    - | words(labels) | | item, text
    - | outcome | | verdict, text
    id | labels.1 | name of the feature or length
    axis | stated(labels.2) | null: a length
    operation | stated(labels.0) | null: not stated
    predicted.mean_um | predicted.mean | mean error, actual minus nominal \
        | predicted, plus-minus, u=predicted.u
    predicted.u_um | predicted.u | standard uncertainty of one future part
    predicted.U_um | predicted.U | k u | U / predicted, detail
    predicted.independent_u_um | independent.u | components and points independent
    predicted.independent_U_um | independent.U | k times it
    measured.mean_um | measured.mean | mean error, actual minus nominal \
        | measured, plus-minus, u=measured.u
    measured.u_um | measured.u | standard uncertainty of one future part
    measured.U_um | measured.U | k u | U / measured, detail
    measured.parts | int(one_way.parts) | number of parts
    measured.n | int(one_way.N) | number of readings
    measured.n0 | one_way.n0 | E ms_between = s_repeat^2 + n0 s_part^2
    measured.s_part_um | s_part | standard deviation from part to part
    measured.ms_between_um2 | one_way.ms_between | mean square between parts
    measured.sqrt_ms_between_over_s_part | ms_share | the paper's scatter over s_part
    measured.paper_u_um | measured_paper.u | u with ms_between as the part variance
    bias_um | bias | measured minus predicted mean | bias, plus-minus, u=u_difference
    u_bias_um | u_difference | its standard uncertainty
    E_n | | bias/(k u_bias) | E_n
    p_bias_familywise | p_bias | p of the bias, adjusted for all tests (Holm) | p / bias, p
    ratio_u | | of u of one future part | u / ratio, detail
    ratio_scatter | | of scatter from part to part | scatter / ratio
    ratio_ms_between | ratio_ms | of ms_between and its expectation
    p_scatter_familywise | p_scatter | p of the scatter from part to part, adjusted for all tests \
        of the study (Holm) | p / scatter, p
    range_width_um.predicted | predicted.width | 2 (|mean| + k u) | -, unit=um
    range_width_um.measured | measured.width | 2 (|mean| + k u) | -, unit=um
    ratio_range | | of the range widths | range / ratio, detail
    paper.range_width_um.predicted | independent.width | independent | -, unit=um
    paper.range_width_um.measured | measured_paper.width | by paper_u | -, unit=um
    paper.ratio_range | paper_ratio_range | of the paper's range widths
    paper.ratio_u | paper_ratio_u | of paper_u and independent_u
    biased | | whether the mean is off; null: not tested
    under_predicted | | whether the scatter is larger than predicted
    over_predicted | | whether the scatter is smaller than predicted
    verdict | verdicts | the gravest fault, or consistent; null: not tested
    """,
    kind=lambda x: "feature" if x.labels[2] else "length",
)
SUMMARY = declare(
    """
    operation | stated(operation) | null: not stated
    - | name() | | measured, text
    items | | number of items
    verdicts | | number of items by gravest fault
    - | verdicts.consistent | | con- / sistent, some()
    biased | faults.biased.0 | items with that fault | biased, some()
    under_predicted | faults.under-predicted.0 | items with that fault | under- / predicted, some()
    over_predicted | faults.over-predicted.0 | items with that fault | over- / predicted, some()
    all_at_once. | pooled
        items | | items whose scatter is pooled
        ratio_scatter | ratio | their scatter, measured over predicted
        p_scatter_familywise | p | p of it, adjusted for all tests (Holm) | p / pooled, p
        verdict | pooled_verdict() | what the test shows
    """,
    name=lambda x: f"{x.operation} {x.kind}".strip(),
    some=lambda value, u, digits: str(value) if value else MISSING,
    pooled_verdict=lambda x: x.verdict or "consistent",
)


def verdict_text(item: Summary) -> str:
    """Such as "drilled features: under-predicted (48 of 48: scatter 3.1 to 4.7 times predicted)",
    every fault with its size.
    """
    faults = []
    for name, (number, ends) in item.faults.items():
        scale, text = 1.0, "scatter {} times predicted"
        if name == "biased":
            scale, text = UM, "mean off by {} um"
        size = ends and f": {text.format(span(*(significant(end / scale) for end in ends)))}"
        if number:
            faults.append(f"{name} ({number} of {item.items}{size or ''})")
    if item.pooled is not None and item.pooled_fault:
        times, p = significant(item.pooled.ratio), p_value(item.pooled.p)
        faults.append(f"{item.pooled_fault} (pooled scatter {times} times predicted, p {p})")
    default = "consistent" if any(item.verdicts.values()) else "not tested"
    return f"{item.operation} {item.kind}: ".lstrip() + ("; ".join(faults) or default)


def _rows(group: Compared | None) -> list[RowOf]:
    return [] if group is None else rows_of(group, len(group.labels))


RESULTS = declare(
    """
    datum | | best-fit alignment removed from each part
    features[] | rows(features) | *row
    lengths[] | lengths() | *row
    summary.features[] | features.summaries | *summary
    summary.lengths[] | lengths.summaries | *of_lengths
    """,
    rows=_rows,
    lengths=lambda x: _rows(x.lengths),
    row=ROW,
    summary=SUMMARY,
    # Lengths are made of features, whose scatter is pooled.
    of_lengths=[each for each in SUMMARY if each.path != "all_at_once"],
)


def document(result: CompareResult, digits: int = 2) -> Document:
    """A row an operation and kind, then a row an item, lengths first."""
    features, lengths = _rows(result.features), _rows(result.lengths)
    selection, title = features, "Lengths and features" if lengths else "Features"
    if len(features) > SHOWN:
        selection = [features[i] for i in result.features.by_interest[:SHOWN]]
        title += f": faults first, {SHOWN} of {len(features)} features"
    summaries = [*result.features.summaries, *(result.lengths.summaries if result.lengths else ())]
    faults = "items with each fault (5 % over the study); consistent: no fault is proven"
    footer = f"± u, of means that of one future part; E_n = bias/({result.coverage_factor:g} u); "
    footer += "ratio: measured over predicted; p: Holm"
    tables = [
        Table("", ROW, [*features, *lengths], selection=()),
        Table("Verdicts", SUMMARY, summaries, faults),
        Table(title, ROW, [*lengths, *selection], footer),
    ]
    verdict = "\n".join(f"{verdict_text(x)}." for x in summaries)
    name = "Predicted against measured"
    return Document(name, (RESULTS, result), tables, figure, verdict, digits)


def figure(result: CompareResult) -> figures.Figure:
    """Measured minus predicted means with U, faults and the largest E_n first."""
    k = result.coverage_factor
    groups = [x for x in (result.lengths, result.features) if x is not None]
    items = [RowOf(x, i) for x in groups for i in sorted(x.by_interest[:DRAWN])]
    zero, intervals = np.array([x.predicted.mean for x in items]), []
    sides = ("predicted", figures.BLUE, -0.14), ("measured", figures.ORANGE, 0.14)
    for name, colour, shift in sides:
        each = [(getattr(x, name).mean, getattr(x, name).u) for x in items]
        mean, u = np.reshape(each, (-1, 2)).T
        intervals.append((name, colour, (mean - zero) / UM, k * np.nan_to_num(u) / UM, shift))
    names, total = [words(*x.labels) for x in items], sum(len(x.labels) for x in groups)
    title = f"Mean errors predicted and measured ± {k:g} u of one part"
    title += f" ({len(names)} of {total})" * (len(names) < total)
    label = "minus the predicted mean, um"
    return figures.listing(title, names, intervals, label, texts=[x.outcome for x in items])
