"""The report of predict-points: the error of every feature, with uncertainty."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from mtu_cli.analyses.predictions import PointsResult
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.document import DAGGER, KIND, OUTSIDE, Document, Table, least_conforming
from mtu_cli.reports.fields import Field, Fields, Group, RowOf, declare, rows_of
from mtu_cli.reports.figures import Intervals, Maps, Side
from mtu_cli.reports.numbers import plus_minus, significant
from mtu_cli.units import UM

POINT = """
    id | prediction.ids | name of the feature | feature, text, mark=mark()
    x_mm | prediction.points.0 | nominal place; null: not given | x, mm
    y_mm | prediction.points.1 | nominal place; null: not given | y, mm
    z_mm | prediction.points.2 | nominal place; null: not given | z, mm
    *of_axes
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


def point(axes: tuple[str, ...], independent: bool = False) -> Fields:
    """The figures of one feature; of every axis its error with uncertainty: rows of the result are
    (feature, axis).
    """
    of_axes: list[Field | Group] = []
    for j, axis in enumerate(axes):

        def row(item: Any, j: int = j) -> RowOf:
            return RowOf(item.table, item.index * len(axes) + j)

        def split(item: Any, j: int = j) -> Any:
            return None if independent else item.table.split.shares(item.index * len(axes) + j)

        fields = declare(OF_AXIS, AXIS=axis, U=lambda x: x.coverage_factor * np.sqrt(x.variance))
        of_axes += [replace(each, within=(row,)) for each in fields if isinstance(each, Field)]
        of_axes += declare(f"shares.{axis}. | split() | *shares", split=split)
    return declare(
        POINT,
        of_axes=of_axes,
        mark=lambda item: DAGGER if _components_outside(item) else "",
        diameter=lambda value, u, digits: f"⌀{value:g}",
        outside=_components_outside,
    )


def _components_outside(item: Any) -> list[str]:
    """Components whose measured range the feature leaves."""
    components: list[str] = item.table.prediction.beyond.get(item.prediction.ids, [])
    return components


def _rows(result: PointsResult) -> list[RowOf]:
    return rows_of(result, len(result.prediction.ids))


def _names(result: PointsResult) -> list[str]:
    return [f"{x}.{axis}" for x in result.prediction.ids for axis in result.prediction.axes]


def results(fields: Fields) -> Fields:
    """The figures of the report, of points with these."""
    text = """
        axes | prediction.axes | axes that the machine has an equation for
        points[] | rows() | *point
    """
    return declare(text, rows=_rows, point=fields)


COVARIANCE = declare(
    """
    covariance_rows | names() | feature and axis of every row (--covariance)
    covariance_um2 | covariance | covariance of all errors of one part (--covariance)
    """,
    names=_names,
)
ROW = point(("x", "y", "z"))
RESULTS: Fields = (*results(ROW), *COVARIANCE)
"""Of a machine with equations for all axes."""


def document(result: PointsResult, digits: int = 2, *, with_covariance: bool = False) -> Document:
    """One row a feature; with --covariance that between all features and axes."""
    title, (axes, ids) = "Errors of the features", (result.prediction.axes, result.prediction.ids)
    fields, k = point(axes, result.independent), result.coverage_factor
    footer = f"U = {k:g} u; error = actual minus nominal; {KIND[result.independent]}"
    footer += OUTSIDE * bool(result.prediction.outside)
    E, U = result.prediction.mean / UM, k * np.sqrt(result.variance) / UM
    row, worst = int(np.argmax(abs(E))), int(np.argmax(U))
    names = [f"E{axes[each % len(axes)]} of {ids[each // len(axes)]}" for each in (row, worst)]
    verdict = (
        f"The largest predicted error is {names[0]}, {plus_minus(E[row], U[row], digits)} um; the "
        f"largest expanded uncertainty {significant(U[worst], digits)} um, of {names[1]}."
    )
    if least := least_conforming(ids, result.conformance):
        verdict += f" {least}."
    table, figure_ = Table(title, fields, _rows(result), footer), partial(figure, result)
    extra = [(COVARIANCE, result)] * with_covariance
    return Document(title, (results(fields), result), [table], figure_, verdict, digits, extra)


@figures.styled
def figure(result: PointsResult) -> figures.Figure:
    """Arrows of the errors at the features, ellipses of k standard uncertainties about their tips;
    without Ex, Ey or their places intervals row by row.
    """
    axes, k, ids = result.prediction.axes, result.coverage_factor, result.prediction.ids
    n, a = len(ids), len(axes)
    title = f"Predicted errors of {n} features, actual minus nominal"
    if {"x", "y"} <= set(axes) and np.isfinite(result.prediction.points[:, :2]).all():
        at = [AXES.index(axis) for axis in axes]
        errors, covariance = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
        errors[:, at] = result.prediction.mean.reshape(n, a) / UM
        covariance[np.ix_(range(n), at, at)] = result.own_covariances / UM**2
        side = Side("", figures.BLUE, errors, covariance)
        maps = Maps(ids, result.prediction.points, axes, [("", [side])], k)
        share = 100 * (1 - math.exp(-(k**2) / 2))
        page = figures.blank(maps.width, maps.height)
        maps.draw(page, f"{title}; ellipses: {k:g} u, {share:.0f} % of parts")
        return page
    U = k * np.sqrt(result.variance) / UM
    intervals = [Intervals("", figures.BLUE, result.prediction.mean / UM, U)]
    return figures.listing(f"{title} ± {k:g} u", _names(result), intervals, "um")
