"""The tables of compare: what it says in words, its sum, lengths, and features where few."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.text import Text

from mtu_cli.analyses.compare import Compared, CompareResult, Range, Summary
from mtu_cli.reports.compare_words import (
    cause_text,
    paper_scatter,
    set_up_text,
    verdict,
    verdict_text,
)
from mtu_cli.reports.numbers import MISSING, p_value, plus_minus, significant, span, with_u
from mtu_cli.reports.tables import Column, Sheet
from mtu_cli.units import UM

SHOWN = 40
"""Features listed one by one; of more those that are not consistent, the clearest first."""


def table(result: CompareResult, digits: int = 2) -> list[object]:
    """The verdicts in words and the summary first, then lengths, then features where few."""
    sheets: list[object] = [_words(result), _summary_sheet(result)]
    if result.lengths is not None:
        sheets.append(_sheet("Lengths", result.lengths, digits))
    few = len(result.features.labels) <= SHOWN
    sheets += [_sheet("Features", result.features, digits)] if few else _odd(result, digits)
    return sheets


def _odd(result: CompareResult, digits: int) -> list[object]:
    """Of many features those with a fault; nothing where there is none."""
    found = result.features
    faults = np.array(
        [found.verdicts[i] not in (None, "consistent") for i in range(len(found.labels))]
    )
    p = np.fmin(found.p_bias, found.p_scatter)
    order = [int(i) for i in np.argsort(p, kind="stable") if faults[i]]
    if not order:
        return []
    shown, beyond = order[:SHOWN], len(order) - SHOWN
    more = f"; {beyond} more such" if beyond > 0 else ""
    told = f"those that are not consistent, the clearest first{more}: all are in the report (-o)"
    return [_sheet("Features", found, digits, (shown, told))]


def _kinds(result: CompareResult) -> list[tuple[str, Summary]]:
    return [
        *(("features", item) for item in result.feature_summaries),
        *(("lengths", item) for item in result.length_summaries),
    ]


def _words(result: CompareResult) -> Text:
    """A sentence for each operation and kind."""
    sentences = [verdict_text(item, kind) for kind, item in _kinds(result)]
    sentences += [text for text in (set_up_text(result), cause_text(result)) if text]
    text = Text("Predicted against measured\n", style="bold")
    return text.append("\n".join([*sentences, ""]), style="not bold")


def _summary_sheet(result: CompareResult) -> Sheet:
    rows = [
        [
            " ".join(word for word in (item.operation, kind) if word),
            str(item.verdicts["consistent"]),
            str(item.biased),
            str(item.under_predicted),
            str(item.over_predicted),
            *([str(item.inconsistent)] if _few(result) else []),
            _shown(item.ratio_u),
            _shown(item.ratio_range),
            _shown(item.paper_ratio_range),
        ]
        for kind, item in _kinds(result)
    ]
    columns = [
        Column(title="measured\n", text=True, folds=True),
        Column(title="con-\nsistent"),
        Column(title="\nbiased"),
        Column(title="under-\npredicted"),
        Column(title="over-\npredicted"),
        *([Column(title="incon-\nsistent")] if _few(result) else []),
        Column(title="u ratio\n"),
        Column(title="range ratio\n"),
        Column(title="as in the\npaper"),
    ]
    notes = [
        "items with each verdict, twice where biased and under-predicted; at 5 % over the whole "
        "study (Holm)",
        "ratios: measured over predicted, least to largest; u: of one future part, its scatter and "
        "what is not known of the mean; range: 2 (|mean| + k u); as in the paper: MS_between taken "
        "for the part variance, over independent predictions",
        *_paper(result),
    ]
    return Sheet(title="Verdicts and ratios", columns=columns, rows=rows, notes=notes)


def _few(result: CompareResult) -> bool:
    return any(item.inconsistent for _, item in _kinds(result))


def _paper(result: CompareResult) -> list[str]:
    found = []
    for item in result.feature_summaries:
        text = paper_scatter(item)
        if text is not None:
            found.append(f"{item.operation}: {text}" if item.operation else text)
    return found


def _shown(found: Range | None) -> str:
    if found is None:
        return MISSING
    return span(significant(found.least), significant(found.largest))


def _sheet(
    title: str, found: Compared, digits: int, only: tuple[list[int], str] | None = None
) -> Sheet:
    """All items, or `only` these, with a note on them."""
    items, told = only or (list(range(len(found.labels))), "")
    columns = [
        Column(title="item\n", text=True, folds=True),
        Column(title="predicted\num"),
        Column(title="measured\num"),
        Column(title="bias\num"),
        Column(title="E_n\n"),
        Column(title="p of\nbias"),
        Column(title="scatter\nratio"),
        Column(title="p of\nscatter"),
        Column(title="verdict\n", text=True, folds=True),
    ]
    rows = [_row(found, i, digits) for i in items]
    notes = [told] if told else []
    notes += [
        "predicted, measured: mean ± u of one future part (in anova ± is the u of the mean)",
        "bias ± its u; E_n = bias/(k u of the bias); scatter ratio: from part to part, measured "
        "over predicted; p: how often chance alone gives such a bias, or scatter, somewhere among "
        "all items (Holm)",
    ]
    return Sheet(title=title, columns=columns, rows=rows, notes=notes)


def _row(found: Compared, i: int, digits: int) -> Sequence[str]:
    return [
        " ".join(word for word in found.labels[i] if word),
        plus_minus(found.predicted.mean[i] / UM, found.predicted.u[i] / UM, digits),
        _measured(found, i, digits),
        plus_minus(found.bias[i] / UM, found.u_difference[i] / UM, digits),
        significant(found.E_n[i]),
        p_value(float(found.p_bias[i])),
        significant(found.ratio_scatter[i]),
        p_value(float(found.p_scatter[i])),
        verdict(found, i),
    ]


def _measured(found: Compared, i: int, digits: int) -> str:
    """Mean and u of a future part; of one part, of which no u is known, with the digits of the
    predicted one.
    """
    mean, u = found.measured.mean[i] / UM, found.measured.u[i] / UM
    if np.isfinite(u):
        return plus_minus(mean, u, digits)
    return with_u(mean, found.predicted.u[i] / UM, digits)[0]
