"""The report of anova: one entry an operation, feature and axis, a length, a right angle.

`axis` is null for lengths and angles, `operation` where the data do not tell one. A figure is
null where the data cannot give it (no repeats, one part, no variance), and a warning says so.
`mean_error` is that of all readings, so that a part counts by its repeats, and `u_mean` its
uncertainty. `interval95_future` is mean -+ t u_future at `dof_future`. `var_both` is the variance
of parts and CMM together, where nothing was measured twice. `p_familywise` of F and
`p_mean_familywise` of a mean of zero hold their error rate over all tables of the kind (Holm).
With --method paper `var_part` is MS_between and u_mean, u_future have the repeat scatter alone
(Gilsinn & Ling 2004, eqs. (31)-(34)). `var_part_estimate` may be negative with --method anova.
Limits of `var_part_interval95` below 0 are 0; where both were, `var_part_limits_below_zero` says
so, and [0, 0] bounds nothing: the parts' means scatter less than the repeats alone make them in
39 of 40 studies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from mtu_cli.analyses.anova import Analysed, AnovaResult
from mtu_cli.analyses.anova.parts import FAMILY_RATE, Label, UnusualPart
from mtu_cli.analyses.anova.totals import Total
from mtu_cli.reports.document import arcsec, finite, um, um2
from mtu_cli.units import ARCSEC

Number = Callable[[float | None], float | None]


def arcsec2(value: float | None) -> float | None:
    """rad^2 to arcsec^2."""
    return None if value is None else finite(value / ARCSEC**2)


UNITS: tuple[tuple[str, Number, Number], ...] = (("um", um, um2), ("arcsec", arcsec, arcsec2))


def document(result: AnovaResult) -> dict[str, Any]:
    """`results` of the report."""
    k = result.coverage_factor
    return {
        "method": result.method,
        "datum": result.datum,
        "features": list(entries(result.features, k)),
        "lengths": list(entries(result.lengths, k)) if result.lengths else [],
        "orthogonality": list(entries(result.angles, k)) if result.angles else [],
        "totals": [_total(item) for item in result.totals],
        "unusual_parts": None
        if result.unusual is None
        else [_unusual(item) for item in result.unusual],
        "unusual_features": [
            {
                **_place(item.where),
                "p_familywise": item.p,
                "deviation_um": um(item.deviation),
                "typical_um": um(item.typical),
            }
            for item in result.unusual_features
        ],
        "family_wise_rate": FAMILY_RATE,
        "axis_scatter": [
            {
                "operation": item.operation or None,
                "parts": item.test.rows,
                "variance_ratio_y_to_x": finite(item.test.ratio),
                "variance_ratio_interval95": [finite(end) for end in item.interval],
                "of": "parts" if item.apart else "part means, CMM included",
                "p": finite(item.test.p),
                "p_familywise": finite(item.test.p_familywise),
            }
            for item in result.axis_scatter
        ],
    }


def entries(found: Analysed, k: float) -> Iterator[dict[str, Any]]:
    """One entry a table; values in um or arcsec, and its square."""
    unit, value, square = UNITS[found.kind == "angle"]
    table, components = found.one_way, found.components
    name = "feature" if found.kind == "feature" else "id"
    for i, (operation, label, axis) in enumerate(found.tables.labels):
        yield {
            "operation": operation or None,
            name: label,
            "axis": axis or None,
            "parts": int(table.parts[i]),
            "n": int(table.N[i]),
            f"mean_error_{unit}": value(table.mean[i]),
            f"ms_between_{unit}2": square(table.ms_between[i]),
            f"ms_within_{unit}2": square(table.ms_within[i]),
            "df_between": int(table.df_between[i]),
            "df_within": int(table.df_within[i]),
            "F": finite(table.F[i]),
            "F_critical_95": finite(table.F_critical_95[i]),
            "p": finite(table.p[i]),
            "p_familywise": finite(found.p_parts[i]),
            "n0": finite(table.n0[i]),
            f"var_part_{unit}2": square(components.part[i]),
            f"var_part_estimate_{unit}2": square(components.part_estimate[i]),
            f"var_repeat_{unit}2": square(components.repeat[i]),
            f"var_part_interval95_{unit}2": _interval(square, found.interval[i]),
            "var_part_limits_below_zero": bool(found.below_zero[i]),
            f"var_both_{unit}2": square(found.both[i]),
            f"var_both_interval95_{unit}2": _interval(square, found.both_interval[i]),
            "method": found.method,
            f"s_pooled_{unit}": value(math.sqrt(table.ms_within[i])),
            f"u_mean_{unit}": value(found.u_mean[i]),
            f"u_future_{unit}": value(found.u_future[i]),
            f"U_future_{unit}": value(k * found.u_future[i]),
            f"interval95_future_{unit}": _interval(value, found.interval_future[i]),
            "dof_mean": finite(found.dof_mean[i]),
            "dof_future": finite(found.dof_future[i]),
            "p_mean_familywise": finite(found.p_mean[i]),
            "unusual_parts": list(found.unusual[i]),
        }


def _interval(square: Number, ends: Iterable[float]) -> list[float | None] | None:
    found = [square(float(end)) for end in ends]
    return None if None in found else found


def _total(item: Total) -> dict[str, Any]:
    return {
        "operation": item.operation or None,
        "axis": item.axis,
        "features": item.features,
        "mean_error_um": um(item.mean),
        "s_mean_errors_um": um(item.spread),
        "largest_mean_error_um": um(item.largest),
        "largest_at": item.worst,
        "mean_var_part_um2": um2(item.part),
        "mean_var_repeat_um2": um2(item.repeat),
        "mean_var_both_um2": um2(item.both),
        "repeat_share": finite(item.repeat_share),
        "F_above_critical": item.significant,
        "F_tested": item.tested,
        "parts_differ": item.differ,
        "mean_not_zero": item.off,
    }


def _unusual(item: UnusualPart) -> dict[str, Any]:
    unit, value, _ = UNITS[item.where[2] == "angle"]
    return {
        "part": item.part,
        "p_familywise": finite(item.p),
        "why": item.why,
        "where": _place(item.where),
        f"deviation_{unit}": value(item.deviation),
        f"typical_{unit}": value(item.typical),
        "singles": [_place(label) for label in item.singles],
    }


def _place(label: Label) -> dict[str, str | None]:
    """`axis` is x, y, z, "length" or "angle"; `id` is null for all of the operation's together."""
    operation, name, axis = label
    return {"operation": operation or None, "id": name or None, "axis": axis}


CSV_COLUMNS = [
    "kind", "operation", "feature", "axis", "parts", "n", "mean_error_um", "ms_between_um2",
    "ms_within_um2", "df_between", "df_within", "F", "F_critical_95", "p", "n0", "var_part_um2",
    "var_part_estimate_um2", "var_repeat_um2", "var_part_low95_um2", "var_part_high95_um2",
    "method", "s_pooled_um", "u_mean_um", "u_future_um", "U_future_um", "unusual_parts", "id",
    "p_familywise", "var_both_um2", "var_both_low95_um2", "var_both_high95_um2",
    "future_low95_um", "future_high95_um", "dof_mean", "dof_future", "p_mean_familywise",
    "var_part_limits_below_zero",
]  # fmt: skip
CSV_COLUMNS += [name.replace("_um", "_arcsec") for name in CSV_COLUMNS if "_um" in name]


def csv_rows(result: AnovaResult) -> tuple[list[str], Iterable[list[object]]]:
    """One row a table, the fields of the report side by side: features, lengths, right angles.

    `kind` is feature, length or orthogonality, `id` the name of either; `feature` and `axis`
    are those of features alone. Angles are in the columns of arcsec and all else in those of
    um; the other ones are empty.
    """
    kinds = {
        "feature": result.features,
        "length": result.lengths,
        "orthogonality": result.angles,
    }
    rows = (
        _flat(kind, found, UNITS[tables.kind == "angle"][0])
        for kind, tables in kinds.items()
        if tables is not None
        for found in entries(tables, result.coverage_factor)
    )
    return CSV_COLUMNS, rows


def _flat(kind: str, found: dict[str, Any], unit: str) -> list[object]:
    row = found | {
        "kind": kind,
        "id": found.get("id", found.get("feature")),
        "unusual_parts": " ".join(found["unusual_parts"]),
    }
    for name, interval in (
        (f"var_part_{{}}95_{unit}2", f"var_part_interval95_{unit}2"),
        (f"var_both_{{}}95_{unit}2", f"var_both_interval95_{unit}2"),
        (f"future_{{}}95_{unit}", f"interval95_future_{unit}"),
    ):
        low, high = found[interval] or (None, None)
        row |= {name.format("low"): low, name.format("high"): high}
    return [row.get(name) for name in CSV_COLUMNS]
