"""The report of compare: predicted beside measured, item by item, and the sum of it.

`measured.u_um` is of a future part from components of variance; `measured.paper_u_um` takes
MS_between for the part variance, as Gilsinn & Ling 2004 do. Range widths are 2 (|mean| + k u), as
in their Table 10.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from mtu_cli.analyses.compare import AllAtOnce, Compared, CompareResult, Range, Summary, Undecided
from mtu_cli.reports.compare_figure import figure
from mtu_cli.reports.compare_table import table
from mtu_cli.reports.compare_words import (
    paper_scatter,
    verdict_text,
)
from mtu_cli.reports.document import finite, um, um2
from mtu_cli.units import UM

__all__ = ["csv_rows", "document", "figure", "table"]


def document(result: CompareResult) -> dict[str, Any]:
    """`results` of the report."""
    k = result.coverage_factor
    return {
        "datum": result.datum,
        "features": list(_items(result.features, k)),
        "lengths": [] if result.lengths is None else list(_items(result.lengths, k)),
        "summary": {
            "features": [_summary(item, "features") for item in result.feature_summaries],
            "lengths": None
            if result.lengths is None
            else [_summary(item, "lengths") for item in result.length_summaries],
        },
    }


def _items(found: Compared, k: float) -> Iterator[dict[str, Any]]:
    for i, (operation, name, axis) in enumerate(found.labels):
        yield {
            "id": name,
            "axis": axis or None,
            "operation": operation or None,
            "predicted": _predicted(found, i, k),
            "measured": _measured(found, i, k),
            "bias_um": um(found.bias[i]),
            "u_bias_um": um(found.u_difference[i]),
            "E_n": finite(found.E_n[i]),
            "p_bias_familywise": finite(found.p_bias[i]),
            "ratio_u": finite(found.ratio_u[i]),
            "ratio_scatter": finite(found.ratio_scatter[i]),
            "ratio_ms_between": finite(found.ratio_ms[i]),
            "p_scatter_familywise": finite(found.p_scatter[i]),
            "range_width_um": {
                "predicted": um(found.predicted.width[i]),
                "measured": um(found.measured.width[i]),
            },
            "ratio_range": finite(found.ratio_range[i]),
            "paper": _paper(found, i),
            "biased": found.biased[i],
            "under_predicted": found.under_predicted[i],
            "over_predicted": found.over_predicted[i],
            "inconsistent": found.inconsistent[i] is True,
            "verdict": found.verdicts[i],
        }


def _predicted(found: Compared, i: int, k: float) -> dict[str, Any]:
    u, independent = found.predicted.u[i], found.independent.u[i]
    return {
        "mean_um": um(found.predicted.mean[i]),
        "u_um": um(u),
        "U_um": um(k * u),
        "independent_u_um": um(independent),
        "independent_U_um": um(k * independent),
    }


def _measured(found: Compared, i: int, k: float) -> dict[str, Any]:
    table = found.one_way
    return {
        "mean_um": um(table.mean[i]),
        "u_um": um(found.measured.u[i]),
        "U_um": um(k * found.measured.u[i]),
        "parts": int(table.parts[i]),
        "n": int(table.N[i]),
        "n0": finite(table.n0[i]),
        "s_part_um": um(found.s_part[i]),
        "ms_between_um2": um2(table.ms_between[i]),
        "sqrt_ms_between_over_s_part": finite(found.ms_share[i]),
        "paper_u_um": um(found.measured_paper.u[i]),
    }


def _paper(found: Compared, i: int) -> dict[str, Any]:
    return {
        "range_width_um": {
            "predicted": um(found.independent.width[i]),
            "measured": um(found.measured_paper.width[i]),
        },
        "ratio_range": finite(found.paper_ratio_range[i]),
        "ratio_u": finite(found.paper_ratio_u[i]),
    }


def _summary(item: Summary, kind: str) -> dict[str, Any]:
    """One entry an operation: verdicts and faults counted, ratios from least to largest."""
    return {
        "operation": item.operation or None,
        "verdict_text": verdict_text(item, kind),
        "items": item.items,
        "verdicts": item.verdicts,
        "not_tested": item.not_tested,
        "tested": {"bias": item.bias_tested, "scatter": item.scatter_tested},
        "biased": item.biased,
        "under_predicted": item.under_predicted,
        "over_predicted": item.over_predicted,
        "inconsistent": item.inconsistent,
        "under_predicted_factor": _ends(item.under_factor) or [],
        "scatter_undecided": _undecided(item.undecided),
        **({"all_at_once": _all_at_once(item.at_once)} if kind == "features" else {}),
        "ratio_u": _ends(item.ratio_u),
        "ratio_scatter": _ends(item.ratio_scatter),
        "ratio_range": _ends(item.ratio_range),
        "median_ratio_u": _median(item.ratio_u),
        "median_ratio_range": _median(item.ratio_range),
        "paper_ratio_u": _ends(item.paper_ratio_u),
        "paper_ratio_range": _ends(item.paper_ratio_range),
        "median_bias_um": None if item.bias is None else item.bias.median / UM,
        "n0": _median(item.n0),
        "sqrt_ms_between_over_s_part": _ends(item.ms_share),
        "paper_scatter_text": paper_scatter(item),
    }


def _undecided(found: Undecided | None) -> dict[str, Any]:
    if found is None:
        return {"items": 0, "factor": []}
    _, name, axis = found.largest
    return {
        "items": found.items,
        "factor": _ends(found.factor),
        "largest": {"id": name, "axis": axis or None},
        "p_familywise": found.p,
    }


def _all_at_once(found: AllAtOnce | None) -> dict[str, Any] | None:
    """The scatter of all items together, null where it was not tested."""
    if found is None:
        return None
    others = found.others
    return {
        "items": found.items,
        "ratio_scatter": found.ratio,
        "p_scatter_familywise": found.p,
        "verdict": found.verdict or "consistent",
        "others": {"items": 0}
        if others is None
        else {
            "items": others.items,
            "ratio_scatter": others.ratio,
            "p_scatter_familywise": others.p,
        },
    }


def _ends(found: Range | None) -> list[float] | None:
    return None if found is None else [found.least, found.largest]


def _median(found: Range | None) -> float | None:
    return None if found is None else found.median


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
