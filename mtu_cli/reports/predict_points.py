"""The report of predict-points: the error of every feature, with uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from mtu_cli.analyses.predict_points import PointsResult
from mtu_cli.reports.document import DAGGER, OUTSIDE, Document, Table
from mtu_cli.reports.fields import Field, Fields, Group, RowOf, conforming, read, rows_of, shares
from mtu_cli.reports.numbers import plus_minus, significant
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

NATURES = {
    "coefficients": "of what the readings leave open",
    "passes": "of the drift between passes",
    "repeatability": "of each visit",
}


def _outside(item: Any) -> list[str]:
    """Components whose measured range the feature leaves."""
    found: list[str] = item.table.prediction.beyond.get(item.prediction.ids, [])
    return found


def _mark(item: Any) -> str:
    return DAGGER if _outside(item) else ""


def point(axes: tuple[str, ...], *, independent: bool = False) -> Fields:
    """The figures of one feature; of every axis its error with uncertainty."""
    return (
        Field(
            "id", "prediction.ids", "name of the feature", head="feature", show="text", mark=_mark
        ),
        *(
            Field(
                f"{name}_mm", f"points.{i}", "nominal place; null: not given", head=name, show="mm"
            )
            for i, name in enumerate("xyz")
        ),
        *(
            field
            for j, axis in enumerate(axes)
            for field in _of_axis(axis, j, len(axes), independent=independent)
        ),
        Group(
            "conformance",
            (
                Field(
                    "position_um",
                    meaning="diameter of the zone of true position; conformance is null without",
                    csv="position_um",
                    head="position",
                    # As the part file has it.
                    size=lambda _: 1.0,
                    show=lambda value, u, digits: f"⌀{value:g}",
                    begins=True,
                ),
                conforming(),
                Field("se", meaning="standard error of the probability (Monte Carlo)", csv=""),
            ),
        ),
        Field(
            "outside_measured_range",
            _outside,
            "components whose measured range the feature leaves",
            csv="",
        ),
    )


def _of_axis(axis: str, j: int, count: int, *, independent: bool) -> Iterator[Field | Group]:
    def at(path: str) -> Callable[[Any], Any]:
        """What belongs to the feature and the axis; rows are (feature, axis)."""
        return lambda item: read(item.table, path)[item.index * count + j]

    def of_k(value: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return lambda item: item.table.coverage_factor * value(item)

    u, variance = _rooted(at("variance")), at("prediction.independent_variance")
    u_apart = _rooted(variance)
    yield Field(
        f"E{axis}_um",
        at("prediction.mean"),
        f"error along {axis}: actual minus nominal",
        head=f"E{axis}",
        u=u,
        begins=True,
    )
    yield Field(f"u_{axis}_um", u, "standard uncertainty of one future part", head="u", u=u)
    yield Field(f"U_{axis}_um", of_k(u), "expanded uncertainty k u", head="U", u=u)
    yield Field(f"var_{axis}_um2", at("variance"), "variance, u squared")
    yield Field(
        f"dof_effective_{axis}",
        at("dof"),
        "effective degrees of freedom (Welch-Satterthwaite); null: infinite",
    )
    yield Field(
        f"interval95_{axis}_um",
        at("interval95"),
        "interval that holds the error of 95 of 100 future parts (Student's t)",
        head="95 %",
        show="interval",
        u=u,
    )
    yield Field(
        f"independent.u_{axis}_um",
        u_apart,
        "standard uncertainty with components and points independent (Gilsinn & Ling 2004)",
        head="u indep.",
        detail=True,
    )
    yield Field(f"independent.var_{axis}_um2", variance, "its square", csv="")
    yield Field(f"independent.U_{axis}_um", of_k(u_apart), "k times it", csv="")
    # The papers' independence does not separate coefficients from passes.
    yield shares(
        f"shares.{axis}",
        lambda item: None if independent else item.table.split.shares(item.index * count + j),
    )
    for name, meaning in () if independent else NATURES.items():
        yield Field(
            f"variance_{axis}_um2.{name}",
            at(f"split.{name}"),
            f"variance {meaning}",
            unit="um2",
            csv="",
        )


def _rooted(value: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda item: np.sqrt(value(item))


def _rows(result: PointsResult) -> list[RowOf]:
    return rows_of(result, len(result.prediction.ids))


def results(fields: Fields) -> Fields:
    """The figures of the report, of points with these."""
    return (
        Field("axes", "prediction.axes", "axes that the machine has an equation for"),
        Group("points", fields, _rows, many=True),
    )


def _covariance_rows(result: PointsResult) -> list[str]:
    return [f"{name}.{axis}" for name in result.prediction.ids for axis in result.prediction.axes]


COVARIANCE: Fields = (
    Field("covariance_rows", _covariance_rows, "feature and axis of every row (--covariance)"),
    Field("covariance_um2", "covariance", "covariance of all errors of one part (--covariance)"),
)
ROW = point(("x", "y", "z"))
RESULTS: Fields = (*results(ROW), *COVARIANCE)
"""Of a machine with equations for all axes."""


def document(
    result: PointsResult, digits: int = 2, *, grid: bool = False, with_covariance: bool = False
) -> Document:
    """One row a feature; of a `grid` the figure shows levels. The covariance between all features
    and axes only where it is asked for.
    """
    axes = result.prediction.axes
    fields = point(axes, independent=result.independent)
    rows = _rows(result)
    kind = "components and points independent" if result.independent else "covariance included"
    outside = OUTSIDE * bool(result.prediction.outside)
    table = Table(
        title="Errors of the features",
        fields=fields,
        items=rows,
        footer=f"U = {result.coverage_factor:g} u; error = actual minus nominal; {kind}{outside}",
        notes=[
            "shares of u^2: coefficients are the same for all parts, passes common to the points "
            "of one part, repeatability of each visit; u indep.: components and points "
            "independent (Gilsinn & Ling 2004)"
        ],
    )
    return Document(
        title="Errors of the features",
        results=(results(fields), result),
        also=[(COVARIANCE, result)] * with_covariance,
        tables=[table],
        figure=lambda: _figure(result, grid=grid),
        verdict=_verdict(result, digits),
        digits=digits,
    )


def _figure(result: PointsResult, *, grid: bool) -> Any:
    from mtu_cli.reports import prediction_figures

    return (prediction_figures.volume if grid else prediction_figures.points)(result)


def _verdict(result: PointsResult, digits: int) -> str:
    def name(values: FloatArray) -> tuple[int, str]:
        # Equal figures in the order of the table, whatever the last digit says.
        row = max(range(len(values)), key=lambda i: float(f"{values[i]:.9g}"))
        feature, axis = divmod(row, len(result.prediction.axes))
        return row, f"E{result.prediction.axes[axis]} of {result.prediction.ids[feature]}"

    U = result.coverage_factor * np.sqrt(result.variance) / UM
    row, largest = name(abs(result.prediction.mean))
    error = plus_minus(result.prediction.mean[row] / UM, U[row], digits)
    worst, least_known = name(U)
    return (
        f"The largest predicted error is {largest}, {error} um; the largest expanded uncertainty "
        f"{significant(U[worst], digits)} um, of {least_known}."
    )
