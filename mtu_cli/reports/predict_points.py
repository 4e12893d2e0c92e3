"""The report of predict-points: the error of every feature, with uncertainty.

`z_mm` is null where the part gives no z: the machine then fixes it, or no equation needs it.
`shares` (of u^2, by axis) are null under the papers' independence and where u is 0.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from mtu_cli.analyses.predict_points import PointsResult
from mtu_cli.findings import Finding
from mtu_cli.reports.document import finite, matrix, root, um, um2
from mtu_cli.reports.numbers import MISSING, fixed, interval, with_u
from mtu_cli.reports.outside import components_beyond, mark_notes, marked
from mtu_cli.reports.points_figure import figure
from mtu_cli.reports.shares import shares_fields, shares_sheets
from mtu_cli.reports.tables import Column, Sheet
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

SHOWN_SHARES = 24
"""Errors whose u is taken apart in the table; of more only so many:"""
LARGEST_SHARES = 12

__all__ = ["csv_rows", "document", "figure", "table", "warnings"]


def document(result: PointsResult, *, with_covariance: bool = False) -> dict[str, Any]:
    """`results` of the report; the covariance between all points and axes only if asked for."""
    prediction = result.prediction
    beyond = components_beyond(prediction)
    results: dict[str, Any] = {
        "axes": list(prediction.axes),
        "points": [
            {**_point(result, i), "outside_measured_range": beyond.get(name, [])}
            for i, name in enumerate(prediction.ids)
        ],
    }
    if with_covariance:
        results["covariance_rows"] = [f"{i}.{a}" for i in prediction.ids for a in prediction.axes]
        results["covariance_um2"] = matrix(result.covariance / UM**2)
    return results


def _point(result: PointsResult, i: int) -> dict[str, Any]:
    prediction = result.prediction
    place = dict(zip(("x_mm", "y_mm", "z_mm"), map(finite, result.points[i]), strict=True))
    point: dict[str, Any] = {"id": prediction.ids[i], **place}
    for j, axis in enumerate(prediction.axes):
        point |= _axis(result, i * len(prediction.axes) + j, axis)
    apart: dict[str, Any] = {}
    for j, axis in enumerate(prediction.axes):
        variance = float(prediction.independent_variance[i * len(prediction.axes) + j])
        apart |= _scatter(axis, variance, result.coverage_factor)
    point["independent"] = apart
    rows = {axis: i * len(prediction.axes) + j for j, axis in enumerate(prediction.axes)}
    point["shares"] = {axis: shares_fields(result.shares(row)) for axis, row in rows.items()}
    if not result.independent:
        for j, axis in enumerate(prediction.axes):
            row = i * len(prediction.axes) + j
            point[f"variance_{axis}_um2"] = {
                "coefficients": um2(result.split.coefficients[row]),
                "passes": um2(result.split.passes[row]),
                "repeatability": um2(result.split.repeatability[row]),
            }
    return point


def _axis(result: PointsResult, row: int, axis: str) -> dict[str, Any]:
    low, high = result.interval95[row]
    return {
        f"E{axis}_um": um(result.prediction.mean[row]),
        **_scatter(axis, float(result.variance[row]), result.coverage_factor),
        f"dof_effective_{axis}": finite(result.dof[row]),
        f"interval95_{axis}_um": [um(low), um(high)],
    }


def _scatter(axis: str, variance: float, k: float) -> dict[str, Any]:
    u = root(variance)
    return {f"var_{axis}_um2": um2(variance), f"u_{axis}_um": um(u), f"U_{axis}_um": um(k * u)}


def warnings(result: PointsResult) -> list[Finding]:
    """The result's own warnings."""
    return list(result.warnings)


def table(result: PointsResult, digits: int = 2) -> list[Sheet]:
    """One row a feature: position, and E, u, U and 95 % by axis; um, u to `digits`.

    Three axes leave no room for the ends of the intervals, then half their width is shown; where
    not even that has room, the axes stand below each other, with the ends.
    """
    whole, short = (_sheet(result, digits, ends=ends) for ends in (True, False))
    sheet = short if short.fits() and not whole.fits() else whole
    return [sheet, *_shares(result, digits)]


def _shares(result: PointsResult, digits: int) -> list[Sheet]:
    """What u consists of; of many errors of those alone that are known worst."""
    prediction = result.prediction
    names = [f"{name}.{axis}" for name in prediction.ids for axis in prediction.axes]
    rows, more = list(range(len(names))), []
    if len(rows) > SHOWN_SHARES:
        # Equal uncertainties in the order of the table, whatever the last digit says.
        rows.sort(key=lambda row: -float(f"{result.variance[row]:.9g}"))
        rows = rows[:LARGEST_SHARES]
        more = [f"the {len(rows)} largest u of {len(names)}; all are in the report (-o FILE)"]
    items = [
        (names[row], root(float(result.variance[row])) / UM, result.shares(row)) for row in rows
    ]
    return shares_sheets("u", "um", items, digits, more)


def _sheet(result: PointsResult, digits: int, *, ends: bool) -> Sheet:
    """The errors with the `ends` of their 95 % intervals or half the width."""
    axes = result.prediction.axes
    placed = [a for a in range(3) if np.isfinite(result.points[:, a]).any()]
    columns = [Column(title="feature\n", text=True, folds=True)]
    columns += [Column(title=f"{'xyz'[a]}\nmm") for a in placed]
    for axis in axes:
        columns.append(Column(title=f"E{axis}\num", begins=True))
        columns += [Column(title=f"{name}\num") for name in ("u", "U")]
        columns.append(Column(title="95 %\num" if ends else "95 %\n± um"))
    rows = []
    beyond = components_beyond(result.prediction)
    places = [_places(result.points[:, a]) for a in placed]
    for i, name in enumerate(result.prediction.ids):
        cells = [marked(name, [name], beyond), *(column[i] for column in places)]
        for k in range(len(axes)):
            cells += _cells(result, i * len(axes) + k, digits, ends=ends)
        rows.append(cells)
    notes = [f"U = {result.coverage_factor:g} u; error = actual minus nominal; {_kind(result)}"]
    if not ends:
        notes.append("95 %: E ± so much holds 95 of 100 future parts (Student's t)")
    notes += mark_notes(result.prediction)
    return Sheet(title="Errors of the features", columns=columns, rows=rows, notes=notes)


def _places(column: FloatArray) -> list[str]:
    """Coordinates in mm, with decimals only where the column has any."""
    whole = bool(np.all(np.isnan(column) | (column == np.round(column))))
    return [
        MISSING if np.isnan(value) else fixed(float(value), 0 if whole else 3) for value in column
    ]


def _kind(result: PointsResult) -> str:
    if result.independent:
        return "components and points taken as independent (Gilsinn & Ling 2004)"
    return "covariance of shared passes and coefficients included"


def _cells(result: PointsResult, row: int, digits: int, *, ends: bool) -> list[str]:
    error, u = result.prediction.mean[row] / UM, root(float(result.variance[row])) / UM
    low, high = result.interval95[row] / UM
    U = with_u(result.coverage_factor * u, u, digits)[0]
    last = interval(low, high, u, digits) if ends else with_u((high - low) / 2, u, digits)[0]
    return [*with_u(error, u, digits), U, last]


def csv_rows(result: PointsResult) -> tuple[list[str], Iterable[list[object]]]:
    """One row a feature, the fields of `results.points` side by side."""
    axes = result.prediction.axes
    header = ["id", "x_mm", "y_mm", "z_mm"]
    for a in axes:
        header += [f"E{a}_um", f"u_{a}_um", f"U_{a}_um", f"var_{a}_um2", f"dof_effective_{a}"]
        header += [f"interval95_{a}_low_um", f"interval95_{a}_high_um"]
        header += [f"independent_u_{a}_um"]
    points = document(result)["points"]
    return header, ([_flat(point, column) for column in header] for point in points)


def _flat(point: dict[str, Any], column: str) -> object:
    if column.startswith("independent_"):
        return point["independent"][column.removeprefix("independent_")]
    for end, index in (("_low_um", 0), ("_high_um", 1)):
        if column.endswith(end):
            return point[column.removesuffix(end) + "_um"][index]
    return point[column]
