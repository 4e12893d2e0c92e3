"""The report of correct: points, diameters and lengths before and after.

`correction_um` is what is added to the measured coordinates, minus the modelled error (JCGM 200,
2.53); null along an axis that is not corrected. Of a size, `u_um` and `interval95_mm` are of the
corrected size; `u_error_um`, `interval95_um` and `E_n` of its error after, the calibration's
uncertainty included. `u_um` of a mean over repeats is that of one part, which repeats share.
`summary` has one entry for each size with a reference, over all parts (and operations). `ovals` are
the calibrated rings that stay oval, with the effect that the model may lack (null: none is told).
`point_scatter` is the scatter of the measured points beyond the machine's model: part of
`u_corrected_um` and of the sizes' u, not of `u_correction_um`, which the machine alone makes.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mtu_cli.analyses.correct.quantity import Size
from mtu_cli.analyses.correct.result import CorrectResult
from mtu_cli.findings import Finding, finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports.correct_errors import errors_after
from mtu_cli.reports.correct_figure import figure
from mtu_cli.reports.correct_leaning import heights_differ
from mtu_cli.reports.correct_ovals import document_of, ovals_left
from mtu_cli.reports.correct_table import table
from mtu_cli.reports.document import finite, um
from mtu_cli.stats.least_squares import FloatArray

__all__ = ["csv_rows", "document", "figure", "table", "warnings"]


def document(result: CorrectResult) -> dict[str, Any]:
    """`results` of the report."""
    k = result.coverage_factor
    return {
        "axes": list(result.axes),
        "point_scatter": _scatter(result),
        "points": [_point(result, i) for i in range(len(result.points))],
        "circles": [_round(item, k) for item in result.of_kind("circle")],
        "spheres": [_round(item, k) for item in result.of_kind("sphere")],
        "lengths": [_length(item, k) for item in result.of_kind("length")],
        "summary": [
            {
                "kind": item.kind,
                "id": item.id,
                "n_parts": item.parts,
                "mean_error_um": _sides(*item.mean, um),
                "rms_error_um": _sides(*item.rms, um),
            }
            for item in result.by_size()
        ],
        "ovals": [document_of(own) for own in result.ovals],
    }


def _scatter(result: CorrectResult) -> dict[str, Any]:
    found = result.scatter
    if found is None:
        return {"s_um": None, "dof": None, "from": None}
    return {"s_um": um(found.s), "dof": finite(found.dof), "from": found.origin}


def _point(result: CorrectResult, i: int) -> dict[str, Any]:
    points = result.points
    u, dof = result.of_corrected(i)
    return {
        **_labels(result, i),
        "measured": _place(points.measured[i]),
        "correction_um": _by_axis(-result.error[i]),
        "u_correction_um": _by_axis(result.u[i]),
        "dof_effective": {a: finite(result.dof[i, k]) for k, a in enumerate(AXES)},
        "corrected": _place(result.corrected[i]),
        "u_corrected_um": _by_axis(u),
        "dof_corrected": {a: finite(dof[k]) for k, a in enumerate(AXES)},
    }


def _labels(result: CorrectResult, i: int) -> dict[str, Any]:
    points = result.points
    repeat, operation = int(points.repeat[i]), int(points.operation[i])
    return {
        "part": points.parts[points.part[i]],
        "feature": points.features[points.feature[i]],
        "repeat": repeat if repeat >= 0 else None,
        "operation": points.operations[operation] if operation >= 0 else None,
    }


def _place(place: FloatArray) -> dict[str, float | None]:
    return {f"{axis}_mm": finite(place[k]) for k, axis in enumerate(AXES)}


def _by_axis(values: FloatArray) -> dict[str, float | None]:
    # Minus nothing is nothing: no report says -0.
    return {axis: um(values[k] + 0.0) for k, axis in enumerate(AXES)}


def _round(item: Size, k: float) -> dict[str, Any]:
    return {
        **_head(item),
        "temperature_degC": finite(item.temperature),
        "diameter_mm": _sides(item.size[0], item.size[1], finite),
        "calibrated_mm": finite(item.reference),
        **_errors(item, k),
        "form_um": _sides(*item.form, um),
        "U_calibrated_um": um(item.U_reference),
        "repeats": [
            {
                "repeat": one.repeat,
                "temperature_degC": finite(one.temperature),
                "diameter_mm": _sides(*one.size, finite),
                "calibrated_mm": finite(one.reference),
                "error_um": _sides(*one.error, um),
                "u_um": um(one.u),
                "form_um": _sides(*one.form, um),
            }
            for one in item.repeats
        ],
    }


def _length(item: Size, k: float) -> dict[str, Any]:
    return {
        **_head(item),
        "length_mm": _sides(*item.size, finite),
        "nominal_mm": finite(item.reference),
        **_errors(item, k),
        "repeats": [
            {
                "repeat": one.repeat,
                "length_mm": _sides(*one.size, finite),
                "error_um": _sides(*one.error, um),
                "u_um": um(one.u),
            }
            for one in item.repeats
        ],
    }


def _head(item: Size) -> dict[str, Any]:
    return {
        "id": item.id,
        "part": item.part,
        "operation": item.operation or None,
        "n_repeats": len(item.repeats),
    }


def _errors(item: Size, k: float) -> dict[str, Any]:
    return {
        "error_um": _sides(*item.error, um),
        "reduction_percent": finite(item.reduction_percent),
        "u_um": um(item.u),
        "U_um": um(item.U(k)),
        "dof_effective": finite(item.dof),
        "interval95_mm": [finite(end) for end in item.interval95],
        "u_error_um": um(item.u_error),
        "interval95_um": [um(end) for end in item.error_interval95],
        "E_n": finite(item.E_n(k)),
        "s_repeats_um": um(item.s_repeats),
    }


def _sides(before: float, after: float, shown: Any) -> dict[str, float | None]:
    return {"before": shown(before), "after": shown(after)}


def warnings(result: CorrectResult) -> list[Finding]:
    """Figures that are not estimable, and what the correction leaves."""
    exact = [f"{item.id} of {item.part}" for item in result.sizes if item.error[0] == 0]
    found = []
    if exact:
        reason = "no error before the correction"
        found.append(
            finding("not-estimable", quantity="reduction_percent", names=exact, reason=reason)
        )
    found += [*heights_differ(result.leaning), *errors_after(result), *ovals_left(result.ovals)]
    sure = [f"{i.id} of {i.part}" for i in result.sizes if i.u_error == 0]
    if sure:
        reason = "its uncertainty is unknown"
        found.append(finding("not-estimable", quantity="E_n", names=sure, reason=reason))
    return found


def csv_rows(result: CorrectResult) -> tuple[list[str], Iterable[list[object]]]:
    """One row a measured point, with its own place in the file."""
    header = ["part", "feature", "repeat", "operation"]
    header += [f"measured_{axis}_mm" for axis in AXES]
    for axis in AXES:
        header += [f"correction_{axis}_um", f"u_correction_{axis}_um"]
    header += [f"corrected_{axis}_mm" for axis in AXES]
    header += [f"u_corrected_{axis}_um" for axis in AXES]
    return header, (_flat(result, i) for i in range(len(result.points)))


def _flat(result: CorrectResult, i: int) -> list[object]:
    point = _point(result, i)
    row: list[object] = [point[name] for name in ("part", "feature", "repeat", "operation")]
    row += point["measured"].values()
    for axis in AXES:
        row += [point["correction_um"][axis], point["u_correction_um"][axis]]
    return [*row, *point["corrected"].values(), *point["u_corrected_um"].values()]
