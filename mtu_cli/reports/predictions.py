"""The reports of predict-points, lengths and orthogonality: errors of features, lengths between
them and row-to-column angles, with uncertainty and conformance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from mtu_cli.analyses.predictions import LengthsResult, OrthogonalityResult, PointsResult
from mtu_cli.findings import listed
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.measurands import Conformance
from mtu_cli.reports import figures
from mtu_cli.reports.document import KIND, Document, Table
from mtu_cli.reports.fields import Fields, declare, rows_of
from mtu_cli.reports.figures import Maps, Side
from mtu_cli.reports.numbers import chance, plus_minus, significant, with_u
from mtu_cli.units import ARCSEC, UM

DAGGER = "\N{DAGGER}"
OUTSIDE = f"; {DAGGER} outside the measured range of a component"
COMMON: dict[str, Any] = {
    "dagger": lambda outside: DAGGER if outside else "",
    "U": lambda x: x.coverage_factor * np.sqrt(x.variance),
    "diameter": lambda value, u, digits: f"⌀{value:g}",
    "conformance": """
        conformance.
            tolerance_UNIT | tolerance.stated | errors allowed: plus and minus this, or \
                [low, high]; conformance is null without \
                | tolerance, tolerance, csv=tolerance_UNIT, size=as_stated()
            *conforming
    """,
    "conforming": """
        probability | | probability that a future part is within the tolerance \
            | conforming / %, percent, csv=conformance_probability
    """,
    "shares": """
        coefficients | | share of u^2 of the coefficients, the same for all parts \
            | coefficients / % of u^2, share, json, detail
        passes | | share of the drift between passes, common to the points of one part; \
            negative: a covariance that reduces u | passes / % of u^2, share, json, detail
        repeatability | | share of the repeatability of every visit \
            | repeatability / % of u^2, share, json, detail
    """,
}


def _least_conforming(conformances: Mapping[str, Conformance]) -> str:
    """A clause on the least probability of conformance; empty without any tolerance."""
    if not conformances:
        return ""
    low = min(conformances.values(), key=lambda c: c.probability)
    least = listed(name for name, c in conformances.items() if c.probability == low.probability)
    text = chance(low.probability, low.se)
    return f"The least probability of conformance is {text} %, of {least}"


def point(axes: Sequence[str]) -> Fields:
    """The figures of one feature, of every axis its error with uncertainty."""
    return declare(
        """
        id | | name of the feature | feature, text, mark=dagger(outside)
        x_mm | place.0 | nominal place; null: not given | x, mm
        y_mm | place.1 | nominal place; null: not given | y, mm
        z_mm | place.2 | nominal place; null: not given | z, mm
        for AXIS in axes
            -. | AXIS
                EAXIS_um | prediction.mean | actual minus nominal AXIS | EAXIS, u=root(variance)
                u_AXIS_um | root(variance) | standard uncertainty of one future part \
                    | u, u=root(variance)
                U_AXIS_um | U() | expanded uncertainty k u | U, u=root(variance)
                var_AXIS_um2 | variance | variance, u squared
                dof_effective_AXIS | dof | effective degrees of freedom; null: infinite
                interval95_AXIS_um | interval95 | interval that holds the error of 95 of 100 \
                    future parts (Student's t) | 95 %, interval, u=root(variance)
                independent.u_AXIS_um | root(prediction.independent_variance) | standard \
                    uncertainty with components and points independent (Gilsinn & Ling 2004) \
                    | u indep., detail
                independent.var_AXIS_um2 | prediction.independent_variance | its square | -, json
            shares.AXIS. | split(AXIS) | *shares
        conformance.
            position_um | tolerance.high | diameter of the zone of true position; conformance is \
                null without | position, diameter(), csv=position_um, size=as_stated()
            *conforming
            se | | standard error of the probability (Monte Carlo) | -, json
        outside_measured_range | outside | components whose measured range it leaves | -, json
        """,
        axes=axes,
        split=lambda x: None if x.independent else x.table.split.shares(x.index),
        **COMMON,
    )


def _features(result: PointsResult) -> list[dict[str, Any]]:
    """Each with the rows of the result, (feature, axis), by axis."""
    of, rows = result.prediction, iter(rows_of(result, len(result.variance)))
    return [
        {
            "id": name, "place": place, "conformance": conformance,
            "outside": [x for (x, *_), at in of.outside.items() if name in at],
            **{axis: next(rows) for axis in of.axes},
        }
        for name, place, conformance in zip(of.ids, of.points, result.conformance, strict=True)
    ]  # fmt: skip


def _names(result: PointsResult) -> list[str]:
    return [f"{x}.{axis}" for x in result.prediction.ids for axis in result.prediction.axes]


def of_points(fields: Fields, *, with_covariance: bool = True) -> Fields:
    """The figures of the report, of points with these."""
    text = """
        axes | prediction.axes | axes that the machine has an equation for
        points[] | rows() | *point
        covariance_rows | names() | feature and axis of every row (--covariance)
        covariance_um2 | covariance | covariance of all errors of one part (--covariance)
    """
    results = declare(text, rows=_features, names=_names, point=fields)
    return results if with_covariance else results[:2]


POINT = point(AXES)
POINTS = of_points(POINT)


def points(result: PointsResult, digits: int = 2, *, with_covariance: bool = False) -> Document:
    """One row a feature; with --covariance that between all features and axes."""
    title, (axes, ids) = "Errors of the features", (result.prediction.axes, result.prediction.ids)
    fields, k = point(axes), result.coverage_factor
    footer = f"U = {k:g} u; error = actual minus nominal; {KIND[result.independent]}"
    footer += OUTSIDE * bool(result.prediction.outside)
    E, U = result.prediction.mean / UM, k * np.sqrt(result.variance) / UM
    row, worst = int(np.argmax(abs(E))), int(np.argmax(U))
    names = [f"E{axes[each % len(axes)]} of {ids[each // len(axes)]}" for each in (row, worst)]
    verdict = (
        f"The largest predicted error is {names[0]}, {plus_minus(E[row], U[row], digits)} um; the "
        f"largest expanded uncertainty {significant(U[worst], digits)} um, of {names[1]}."
    )
    if least := _least_conforming(result.conformances):
        verdict += f" {least}."
    table = Table(title, fields, _features(result), footer)
    source = of_points(fields, with_covariance=with_covariance), result
    return Document(title, source, [table], points_figure, verdict, digits)


def points_figure(result: PointsResult) -> figures.Figure:
    """Arrows, ellipses of k u about their tips; without Ex, Ey or places intervals by row."""
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
    intervals = [("", figures.BLUE, result.prediction.mean / UM, U, 0.0)]
    return figures.listing(f"{title} ± {k:g} u", _names(result), intervals, "um")


LENGTH = declare(
    """
    id | ids | name of the length | length, text, mark=dagger(outside)
    from | ends.0 | feature at which it starts
    to | ends.1 | feature at which it ends
    nominal_mm | nominal | distance of the nominal places | nominal, mm
    estimated_mm | estimated() | nominal plus error
    error_um | error | actual minus nominal length | error, u=root(variance)
    variance_um2 | variance | variance of the error of one future part
    u_um | root(variance) | standard uncertainty, its square root | u, u=root(variance)
    U_um | U() | expanded uncertainty k u | U, u=root(variance)
    k | coverage_factor | coverage factor
    dof_effective | dof | effective degrees of freedom (Welch-Satterthwaite); null: inf
    interval_um | ends() | error -+ U | -, interval
    interval95_um | interval95 | interval that holds the error of 95 of 100 future parts \
        (Student's t) | 95 % interval, interval, u=root(variance)
    independent.variance_um2 | independent_variance | variance with ends and components \
        independent (Gilsinn & Ling 2004, eq. (22))
    independent.u_um | root(independent_variance) | standard uncertainty with ends and \
        components independent | u indep., detail
    independent.U_um | independent_U() | k times it
    between_components.u_uncorrelated_um | u_uncorrelated | standard uncertainty without the \
        measured correlation between components | -, csv=u_uncorrelated_um
    between_components.u_bounds_um | u_bounds | standard uncertainty if `pair` were correlated \
        with -1 and with +1 | -, interval, csv=u_bound_um
    between_components.pair | pair | the two components read in passes of their own that \
        contribute most; null: fewer than two | -, json
    *conformance
    shares. | | *shares
    *validation
    """,
    UNIT="um",
    estimated=lambda x: x.nominal + x.error,
    ends=lambda x: x.error + x.coverage_factor * np.sqrt(x.variance) * np.array([-1.0, 1.0]),
    independent_U=lambda x: x.coverage_factor * np.sqrt(x.independent_variance),
    **COMMON,
)
LENGTHS = declare(
    """
    lengths[] | rows() | *length
    joint_conformance.
        lengths | | lengths with a tolerance; null for fewer than two
        probability | | that all of them conform in one part (Monte Carlo)
        se | | standard error of the probability
    monte_carlo.trials | run.trials | trials behind the validation
    monte_carlo.converged | run.converged | whether they reached the digits asked for
    """,
    rows=lambda result: rows_of(result, len(result.ids)),
    length=LENGTH,
)


def lengths(result: LengthsResult, digits: int = 2) -> Document:
    """One row a length; a length with an end beyond a measured range is marked."""
    footer = f"U = {result.coverage_factor:g} u of one future part; error = actual minus nominal"
    rows = rows_of(result, len(result.ids))
    table = Table("Lengths", LENGTH, rows, footer + OUTSIDE * any(result.outside))
    verdict = _least_conforming(result.conformances)
    if (joint := result.joint_conformance) is not None:
        verdict += f"; of all in one part {chance(joint.probability, joint.se)} %"
    if not verdict:
        worst = int(np.argmax(result.variance))
        U = significant(result.coverage_factor * np.sqrt(result.variance[worst]) / UM)
        verdict = f"The largest expanded uncertainty is {U} um, of {result.ids[worst]}"
    figure = partial(lengths_figure, digits=digits)
    return Document("Lengths", (LENGTHS, result), [table], figure, f"{verdict}.", digits)


def lengths_figure(result: LengthsResult, digits: int = 2) -> figures.Figure:
    """A row a length, with error and U rounded as in the table."""
    k, value = result.coverage_factor, result.error / UM
    u, u_indep = (np.sqrt(v) / UM for v in (result.variance, result.independent_variance))
    none = np.nan, np.nan
    limits = [(c.tolerance.low, c.tolerance.high) if c else none for c in result.conformance]
    return figures.listing(
        f"Predicted errors of the lengths ± {k:g} u",
        [f"{name}, {x:.2f} mm" for name, x in zip(result.ids, result.nominal, strict=True)],
        [
            ("with shared covariance", figures.BLUE, value, k * u, 0.0),
            ("independent ends and components", figures.ORANGE, value, k * u_indep, 0.28),
        ],
        "actual minus nominal length, um",
        limits=list(np.array(limits).T),
        texts=[
            " ± ".join(with_u(each, scale, digits)[0] for each in (x, k * scale)) + " um"
            for x, scale in zip(value, u, strict=True)
        ],
    )


ANGLE = declare(
    """
    id | | name of the angle | angle, text, mark=dagger(outside)
    mean_arcsec | run.mean.0 | angle minus 90 degrees | mean, u=scale
    u_arcsec | run.u.0 | standard uncertainty; null where a source has two degrees of freedom \
        or fewer | u, u=run.u.0
    U_arcsec | U() | expanded uncertainty k u | U, u=run.u.0
    u_eq28_arcsec | eq28() | u of one more trial about the mean (Gilsinn & Ling 2004, eq. (28))
    trials | run.trials | Monte Carlo trials | trials, count, detail
    converged | run.converged | whether they reached the digits asked for
    interval95_arcsec | ends() | interval that holds 95 of 100 trials, as many beyond either end \
        | 95 % interval, interval, u=scale
    shortest95_arcsec | shortest() | shortest interval that holds 95 of 100 trials | -, interval
    first_order.mean_arcsec | model.linear_mean.0 | the angle of the mean errors of the features
    first_order.u_arcsec | model.linear_u.0.0 | u of first order | first order u, detail
    first_order.dof_effective | model.dof.0 | effective degrees of freedom \
        (Welch-Satterthwaite); null: infinite | -, csv=dof_effective
    first_order.interval95_arcsec | interval95 | mean -+ t u of first order | -, json
    *conformance
    *validation
    independent.mean_arcsec | independent.mean.0 | mean with all features independent
    independent.u_arcsec | independent.u.0 | standard uncertainty with all features independent \
        (Gilsinn & Ling 2004) | u indep., detail
    first_order.shares. | shares | *shares
    """,
    UNIT="arcsec",
    ends=lambda x: (x.run.low[0], x.run.high[0]),
    shortest=lambda x: (x.run.shortest_low[0], x.run.shortest_high[0]),
    eq28=lambda x: x.run.u[0] * (1.0 + 1.0 / x.run.trials) ** 0.5,
    **COMMON | {"U": lambda x: x.k * x.run.u[0]},
)
ANGLES = declare("orthogonality[] | angles | *angle", angle=ANGLE)


def orthogonality(result: OrthogonalityResult, digits: int = 2) -> Document:
    """One row an angle; an angle with a feature beyond a measured range is marked."""
    angles, title = result.angles, "Orthogonality"
    of = "angle from +x of the row to +y of the column, minus 90 degrees"
    footer = f"U = {angles[0].k:g} u; {of}{OUTSIDE * any(item.outside for item in angles)}"
    out = listed(item.id for item in angles if not item.run.low[0] <= 0.0 <= item.run.high[0])
    verdict = f"The 95 % interval does not contain 0 for {out}."
    if not out:
        verdict = "Every 95 % interval contains 0."
    if least := _least_conforming(result.conformances):
        verdict += f" {least}."
    table = Table(title, ANGLE, angles, footer)
    return Document(title, (ANGLES, result), [table], angles_figure, verdict, digits)


def angles_figure(result: OrthogonalityResult) -> figures.Figure:
    """Histogram of the trials of every angle, its interval, and the first-order curve."""
    trials = []
    for item in result.angles[:6]:
        run, model = item.run, item.model
        mean = with_u(run.mean[0] / ARCSEC, item.scale / ARCSEC)[0]
        first = model.linear_mean[0] / ARCSEC, model.linear_u[0, 0] / ARCSEC, model.dof[0]
        ends = float(run.low[0] / ARCSEC), float(run.high[0] / ARCSEC)
        text = f"{item.id}: mean {mean}, u {significant(run.u[0] / ARCSEC)} arcsec"
        label = "angle minus 90 degrees, arcsec"
        trials.append((text, label, run.samples[0] / ARCSEC, ends, first))
    return figures.histograms("Angles between rows and columns", trials)
