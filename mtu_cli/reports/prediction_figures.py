"""Pictures of predictions: lengths with tolerances, errors of features."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Maps, Side, page_of
from mtu_cli.reports.figures import Intervals
from mtu_cli.reports.labels import spread
from mtu_cli.reports.numbers import with_u
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mtu_cli.analyses.lengths import LengthsResult
    from mtu_cli.analyses.predict_points import PointsResult

ROWS = 80
"""Errors or lengths with a line of their own on one sheet."""


@figures.styled
def lengths(result: LengthsResult, digits: int = 2) -> Figure:
    """A row a length, the numbers beside it to the places of the table."""
    k, rows = result.coverage_factor, spread(len(result.ids), ROWS)
    value = result.error[rows] / UM
    u, apart = (np.sqrt(v[rows]) / UM for v in (result.variance, result.independent_variance))
    shown = [
        Intervals("with shared covariance", figures.BLUE, value, k * u),
        Intervals("independent ends and components", figures.ORANGE, value, k * apart, 0.28),
    ]
    conformance = [result.conformance[i] for i in rows]
    tolerances = [None if each is None else each.tolerance for each in conformance]
    limits = np.array([(math.nan,) * 2 if x is None else (x.low, x.high) for x in tolerances])
    some = f" ({len(rows)} of {len(result.ids)})" if len(rows) < len(result.ids) else ""
    page = figures.listing(
        f"Predicted errors of the lengths ± {k:g} u{some}",
        [f"{result.ids[i]}, {result.nominal[i]:.2f} mm" for i in rows],
        shown,
        "actual minus nominal length, um",
        limits=list(limits.T),
        # "-3.5 ± 14.0 um": error and k u, to the last place of u.
        beside=[
            " ± ".join(with_u(x, one, digits)[0] for x in (v, k * one)) + " um"
            for v, one in zip(value, u, strict=True)
        ],
    )
    figures.legend(page)
    return page


@figures.styled
def points(result: PointsResult) -> Figure:
    """Arrows of the errors at the features, ellipses of k standard uncertainties about their tips;
    without Ex, Ey or their places intervals row by row.
    """
    axes, k, ids = result.prediction.axes, result.coverage_factor, result.prediction.ids
    n, a = len(ids), len(axes)
    title = f"Predicted errors of {n} features, actual minus nominal"
    if {"x", "y"} <= set(axes) and np.isfinite(result.points[:, :2]).all():
        at = [AXES.index(axis) for axis in axes]
        errors, covariance = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
        errors[:, at] = result.prediction.mean.reshape(n, a) / UM
        covariance[np.ix_(range(n), at, at)] = result.own_covariances / UM**2
        side = Side("", figures.BLUE, errors, covariance)
        maps = Maps(ids, result.points, axes, (("", (side,)),), k)
        inside = 100 * (1 - math.exp(-(k**2) / 2))
        return page_of(maps, f"{title}; ellipses: {k:g} u, {inside:.0f} % of parts")
    rows, half = spread(n * a, ROWS), k * np.sqrt(result.variance) / UM
    bars = Intervals("", figures.BLUE, result.prediction.mean[rows] / UM, half[rows])
    names = [f"{ids[i // a]} {axes[i % a]}" for i in rows]
    return figures.listing(f"{title} ± {k:g} u", names, [bars], "um")
