"""The report of predict-points: the error of every feature, with uncertainty."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from mtu_cli.analyses.predict_points import PointsResult
from mtu_cli.reports import prediction_figures
from mtu_cli.reports.document import DAGGER, KIND, OUTSIDE, Document, Table
from mtu_cli.reports.fields import CONFORMING, Field, Fields, Group, RowOf, declare, rows_of, shares
from mtu_cli.reports.numbers import plus_minus, significant
from mtu_cli.units import UM

POINT = """
    id | prediction.ids | name of the feature | feature, text, mark=mark()
    x_mm | points.0 | nominal place; null: not given | x, mm
    y_mm | points.1 | nominal place; null: not given | y, mm
    z_mm | points.2 | nominal place; null: not given | z, mm
    *errors
    conformance.
        position_um | | diameter of the zone of true position; conformance is null without \
            | position, diameter(), csv=position_um, size=as_stated()
        *conforming
        se | | standard error of the probability (Monte Carlo) | -, json
    outside_measured_range | outside() | components whose measured range the feature leaves \
        | -, json
"""
OF_AXIS = """
    EAXIS_um | prediction.mean | error along AXIS: actual minus nominal \
        | EAXIS, u=root(variance)
    u_AXIS_um | root(variance) | standard uncertainty of one future part | u, u=root(variance)
    U_AXIS_um | U() | expanded uncertainty k u | U, u=root(variance)
    var_AXIS_um2 | variance | variance, u squared
    dof_effective_AXIS | dof | effective degrees of freedom (Welch-Satterthwaite); null: infinite
    interval95_AXIS_um | interval95 | interval that holds the error of 95 of 100 future parts \
        (Student's t) | 95 %, interval, u=root(variance)
    independent.u_AXIS_um | root(prediction.independent_variance) | standard uncertainty with \
        components and points independent (Gilsinn & Ling 2004) | u indep., detail
    independent.var_AXIS_um2 | prediction.independent_variance | its square | -, json
"""
NATURES = """
    variance_AXIS_um2.coefficients | split.coefficients | variance of what the readings leave \
        open | -, json, unit=um2
    variance_AXIS_um2.passes | split.passes | variance of the drift between passes \
        | -, json, unit=um2
    variance_AXIS_um2.repeatability | split.repeatability | variance of each visit \
        | -, json, unit=um2
"""


def _outside(item: Any) -> list[str]:
    """Components whose measured range the feature leaves."""
    left: list[str] = item.table.prediction.beyond.get(item.prediction.ids, [])
    return left


def point(axes: tuple[str, ...], independent: bool = False) -> Fields:
    """The figures of one feature; of every axis its error with uncertainty."""
    of_axes = (_of_axis(axis, j, len(axes), independent) for j, axis in enumerate(axes))
    return declare(
        POINT,
        errors=[field for fields in of_axes for field in fields],
        mark=lambda item: DAGGER if _outside(item) else "",
        diameter=lambda value, u, digits: f"⌀{value:g}",
        outside=_outside,
        **CONFORMING,
    )


def _of_axis(axis: str, j: int, count: int, independent: bool) -> Iterator[Field | Group]:
    """The figures along one axis; rows of the result are (feature, axis)."""

    def row(item: Any) -> RowOf:
        return RowOf(item.table, item.index * count + j)

    def split(item: Any) -> Any:
        return None if independent else item.table.split.shares(item.index * count + j)

    yield from _within(row, OF_AXIS.replace("AXIS", axis))
    yield shares(f"shares.{axis}", split)
    yield from () if independent else _within(row, NATURES.replace("AXIS", axis))


def _within(row: Any, text: str) -> Iterator[Field]:
    for field in declare(text, U=lambda x: x.coverage_factor * np.sqrt(x.variance)):
        if isinstance(field, Field):
            yield replace(field, within=(row,))


def _rows(result: PointsResult) -> list[RowOf]:
    return rows_of(result, len(result.prediction.ids))


def results(fields: Fields) -> Fields:
    """The figures of the report, of points with these."""
    text = """
        axes | prediction.axes | axes that the machine has an equation for
        points[] | rows() | *point
    """
    return declare(text, rows=_rows, point=fields)


COVARIANCE = declare(
    """
    covariance_rows | rows() | feature and axis of every row (--covariance)
    covariance_um2 | covariance | covariance of all errors of one part (--covariance)
    """,
    rows=lambda x: [f"{name}.{axis}" for name in x.prediction.ids for axis in x.prediction.axes],
)
ROW = point(("x", "y", "z"))
RESULTS: Fields = (*results(ROW), *COVARIANCE)
"""Of a machine with equations for all axes."""


def document(result: PointsResult, digits: int = 2, *, with_covariance: bool = False) -> Document:
    """One row a feature; the covariance between all features and axes where it is asked for."""
    title, fields = "Errors of the features", point(result.prediction.axes, result.independent)
    of = f"U = {result.coverage_factor:g} u; error = actual minus nominal"
    footer = f"{of}; {KIND[result.independent]}{OUTSIDE * bool(result.prediction.outside)}"
    table = Table(title, fields, _rows(result), footer)
    figure = partial(prediction_figures.points, result)
    shown, also = (results(fields), result), [(COVARIANCE, result)] * with_covariance
    return Document(title, shown, [table], figure, _verdict(result, digits), digits, also)


def _verdict(result: PointsResult, digits: int) -> str:
    """The largest error and the largest U."""
    axes, ids = result.prediction.axes, result.prediction.ids
    E, U = result.prediction.mean / UM, result.coverage_factor * np.sqrt(result.variance) / UM
    row, worst = int(np.argmax(abs(E))), int(np.argmax(U))
    names = [f"E{axes[each % len(axes)]} of {ids[each // len(axes)]}" for each in (row, worst)]
    return (
        f"The largest predicted error is {names[0]}, {plus_minus(E[row], U[row], digits)} um; the "
        f"largest expanded uncertainty {significant(U[worst], digits)} um, of {names[1]}."
    )
