"""The report of compare: predicted beside measured, item by item, and the sum of it.

`measured.u_um` is of a future part from components of variance; `measured.paper_u_um` takes
MS_between for the part variance, as Gilsinn & Ling 2004 do. Range widths are 2 (|mean| + k u), as
in their Table 10.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from mtu_cli.analyses.compare import Compared, CompareResult, Side, Verdict
from mtu_cli.model.settings import Warned
from mtu_cli.reports import figures
from mtu_cli.reports.document import finite, listed, um, um2
from mtu_cli.reports.numbers import p_value, plus_minus, significant
from mtu_cli.reports.tables import Column, Sheet
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = 40
"""Items drawn on one sheet, and rows of the table before it is summed up."""


def document(result: CompareResult) -> dict[str, Any]:
    """`results` of the report."""
    k = result.coverage_factor
    lengths = [] if result.lengths is None else list(_items(result.lengths, k))
    features = list(_items(result.features, k))
    return {
        "datum": result.datum,
        "features": features,
        "lengths": lengths,
        "summary": {
            "features": _summary(result.features, k),
            "lengths": None if result.lengths is None else _summary(result.lengths, k),
        },
    }


def _items(found: Compared, k: float) -> Iterator[dict[str, Any]]:
    predicted, measured = _width(found.predicted, k), _width(found.measured, k)
    independent, paper = _width(found.independent, k), _width(found.measured_paper, k)
    table = found.one_way
    for i, (operation, name, axis) in enumerate(found.labels):
        yield {
            "id": name,
            "axis": axis or None,
            "operation": operation or None,
            "predicted": {
                "mean_um": um(found.predicted.mean[i]),
                "u_um": um(found.predicted.u[i]),
                "U_um": um(k * found.predicted.u[i]),
                "independent_u_um": um(found.independent.u[i]),
                "independent_U_um": um(k * found.independent.u[i]),
            },
            "measured": {
                "mean_um": um(table.mean[i]),
                "u_um": um(found.measured.u[i]),
                "U_um": um(k * found.measured.u[i]),
                "parts": int(table.parts[i]),
                "n": int(table.N[i]),
                "ms_between_um2": um2(table.ms_between[i]),
                "paper_u_um": um(found.measured_paper.u[i]),
            },
            "bias_um": um(found.bias[i]),
            "u_bias_um": um(found.u_difference[i]),
            "E_n": finite(found.E_n[i]),
            "p_bias_familywise": finite(found.p_bias[i]),
            "ratio_u": finite(found.measured.u[i] / found.predicted.u[i]),
            "ratio_ms_between": finite(found.scatter_ratio[i]),
            "p_scatter_familywise": finite(found.p_scatter[i]),
            "range_width_um": {"predicted": um(predicted[i]), "measured": um(measured[i])},
            "ratio_range": finite(measured[i] / predicted[i]),
            "paper": {
                "range_width_um": {"predicted": um(independent[i]), "measured": um(paper[i])},
                "ratio_range": finite(paper[i] / independent[i]),
                "ratio_u": finite(found.measured_paper.u[i] / found.independent.u[i]),
            },
            "verdict": found.verdicts[i],
        }


def _width(side: Side, k: float) -> np.ndarray:
    return 2 * (np.abs(side.mean) + k * side.u)


def _summary(found: Compared, k: float) -> list[dict[str, Any]]:
    """One entry an operation: verdicts counted, ratios from the least to the largest."""
    items = list(_items(found, k))
    entries = []
    for operation in dict.fromkeys(item["operation"] for item in items):
        own = [item for item in items if item["operation"] == operation]
        counts = Counter(item["verdict"] for item in own)
        entries.append(
            {
                "operation": operation,
                "items": len(own),
                "verdicts": {name: counts.get(name, 0) for name in get_args(Verdict)},
                "ratio_u": _range_of(item["ratio_u"] for item in own),
                "ratio_range": _range_of(item["ratio_range"] for item in own),
                "paper_ratio_u": _range_of(item["paper"]["ratio_u"] for item in own),
                "paper_ratio_range": _range_of(item["paper"]["ratio_range"] for item in own),
                "median_bias_um": float(np.median([item["bias_um"] for item in own])),
            }
        )
    return entries


def _range_of(values: Iterable[float | None]) -> list[float] | None:
    known = [value for value in values if value is not None]
    return [min(known), max(known)] if known else None


def warnings(result: CompareResult) -> list[Warned]:
    """What cannot be compared, and why."""
    found = result.features
    exact = [name for (_, name, _), u in zip(found.labels, found.predicted.u, strict=True) if not u]
    if not exact:
        return []
    return [
        Warned(
            code="no-predicted-uncertainty",
            message=f"no uncertainty is predicted for {listed(dict.fromkeys(exact))}: "
            "ratios cannot be had there",
        )
    ]


def table(result: CompareResult) -> list[Sheet]:
    """The summary first, then lengths, then features where they are few."""
    k = result.coverage_factor
    sheets = [_summary_sheet(result)]
    if result.lengths is not None:
        sheets.append(_sheet("Lengths", result.lengths, k))
    if len(result.features.labels) <= SHOWN:
        sheets.append(_sheet("Features", result.features, k))
    return sheets


def _summary_sheet(result: CompareResult) -> Sheet:
    k = result.coverage_factor
    rows = []
    kinds = [("features", result.features), ("lengths", result.lengths)]
    for kind, found in kinds:
        if found is None:
            continue
        for entry in _summary(found, k):
            counts = entry["verdicts"]
            rows.append(
                [
                    " ".join(word for word in (entry["operation"], kind) if word),
                    *(str(counts[name]) for name in get_args(Verdict)),
                    _shown_range(entry["ratio_u"]),
                    _shown_range(entry["ratio_range"]),
                    _shown_range(entry["paper_ratio_range"]),
                ]
            )
    columns = [
        Column(title="measured\n", text=True, folds=True),
        Column(title="con-\nsistent"),
        Column(title="\nbiased"),
        Column(title="under-\npredicted"),
        Column(title="over-\npredicted"),
        Column(title="u ratio\n"),
        Column(title="range ratio\n"),
        Column(title="as in the\npaper"),
    ]
    notes = [
        "ratios: measured over predicted, least to largest; range: 2 (|mean| + k u); as in the "
        "paper: MS_between taken for the part variance, over independent predictions; verdicts at "
        "5 % over all items (Holm)"
    ]
    return Sheet(title="Predicted against measured", columns=columns, rows=rows, notes=notes)


def _shown_range(values: list[float] | None) -> str:
    return "-" if values is None else f"{significant(values[0])} to {significant(values[1])}"


def _sheet(title: str, found: Compared, k: float) -> Sheet:
    columns = [
        Column(title="item\n", text=True, folds=True),
        Column(title="predicted\num"),
        Column(title="measured\num"),
        Column(title="bias\num"),
        Column(title="E_n\n"),
        Column(title="u ratio\n"),
        Column(title="p scatter\n"),
        Column(title="verdict\n", text=True),
    ]
    rows = [_row(found, i, k) for i in range(len(found.labels))]
    note = (
        "predicted, measured: mean ± u of one part; bias ± its u; E_n = bias/(k u of the bias); "
        "p scatter: that the prediction allows such scatter (Holm)"
    )
    return Sheet(title=title, columns=columns, rows=rows, notes=[note])


def _row(found: Compared, i: int, k: float) -> list[str]:
    ratio = found.measured.u[i] / found.predicted.u[i] if found.predicted.u[i] else float("nan")
    return [
        " ".join(word for word in found.labels[i] if word),
        plus_minus(found.predicted.mean[i] / UM, found.predicted.u[i] / UM),
        plus_minus(found.measured.mean[i] / UM, found.measured.u[i] / UM),
        plus_minus(found.bias[i] / UM, found.u_difference[i] / UM),
        significant(found.E_n[i]),
        significant(ratio),
        p_value(float(found.p_scatter[i])),
        found.verdicts[i],
    ]


def csv_rows(result: CompareResult) -> tuple[list[str], Iterable[list[object]]]:
    """Every item with the fields of the report side by side."""
    kinds = [("feature", result.features), ("length", result.lengths)]
    rows = [
        {"kind": kind, **_flat(item)}
        for kind, found in kinds
        if found is not None
        for item in _items(found, result.coverage_factor)
    ]
    header = list(rows[0])
    return header, ([row[name] for name in header] for row in rows)


def _flat(item: dict[str, Any], prefix: str = "") -> dict[str, object]:
    flat: dict[str, object] = {}
    for key, value in item.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}_")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


@figures.styled
def figure(result: CompareResult) -> Figure:
    """Predicted and measured means with U, one line an item: lengths, or features without."""
    found = result.features if result.lengths is None else result.lengths
    shown = min(SHOWN, len(found.labels))
    page = figures.blank(8.0, max(3.0, 1.6 + 0.42 * shown))
    panel = page.subplots()
    panel.axvline(0.0, color=figures.GREY, linewidth=0.9)
    k = result.coverage_factor
    _bars(panel, found.predicted, shown, k, -0.14, figures.BLUE, "predicted")
    _bars(panel, found.measured, shown, k, 0.14, figures.ORANGE, "measured")
    names = [" ".join(word for word in label if word) for label in found.labels[:shown]]
    panel.set_yticks(range(shown), names)
    panel.set_ylim(shown - 0.4, -0.6)
    more = f" (first {shown} of {len(found.labels)})" if shown < len(found.labels) else ""
    panel.set_title(f"Predicted against measured: mean ± {k:g} u of one part{more}")
    panel.set_xlabel("actual minus nominal, um")
    panel.grid(axis="y", visible=False)
    page.legend(loc="outside lower center", ncols=2)
    return page


def _bars(
    panel: Axes, side: Side, shown: int, k: float, offset: float, colour: str, label: str
) -> None:
    panel.errorbar(
        side.mean[:shown] / UM,
        np.arange(shown) + offset,
        xerr=k * side.u[:shown] / UM,
        fmt="o",
        color=colour,
        elinewidth=2.0,
        capsize=3.0,
        markersize=4.5,
        label=label,
    )
