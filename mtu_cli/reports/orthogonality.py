"""The report of orthogonality: row-to-column angles by Monte Carlo and first order."""

from __future__ import annotations

from mtu_cli.analyses.orthogonality import Orthogonality, OrthogonalityResult
from mtu_cli.findings import listed
from mtu_cli.reports.document import MARK, OUTSIDE, Document, Table
from mtu_cli.reports.fields import Field, Fields, Group, conformance, shares, validation
from mtu_cli.reports.numbers import interval, significant, with_u
from mtu_cli.units import ARCSEC

ROW: Fields = (
    Field("id", meaning="name of the angle", head="angle", show="text", mark=MARK),
    Field("row", meaning="features of the row", csv=""),
    Field("column", meaning="features of the column", csv=""),
    Field("mean_arcsec", "run.mean.0", "angle minus 90 degrees", head="mean", u="scale"),
    Field(
        "u_arcsec",
        "run.u.0",
        "standard uncertainty; null where a source has two degrees of freedom or fewer",
        head="u",
        u="run.u.0",
    ),
    Field(
        "U_arcsec",
        lambda x: x.k * x.run.u[0],
        "expanded uncertainty k u",
        head="U",
        u="run.u.0",
    ),
    Field("k", meaning="coverage factor", csv=""),
    Field(
        "u_eq28_arcsec",
        "u_of_next_trial",
        "uncertainty of one more trial about the mean of all (Gilsinn & Ling 2004, eq. (28))",
    ),
    Field("trials", "run.trials", "Monte Carlo trials", head="trials", show="count", detail=True),
    Field("converged", "run.converged", "whether they reached the digits asked for"),
    Field(
        "interval95_arcsec",
        lambda item: (item.run.low[0], item.run.high[0]),
        "interval that holds 95 of 100 trials, as many beyond either end",
        head="95 % interval",
        show="interval",
        u="scale",
    ),
    Field(
        "shortest95_arcsec",
        lambda item: (item.run.shortest_low[0], item.run.shortest_high[0]),
        "shortest interval that holds 95 of 100 trials",
        show="interval",
    ),
    Field(
        "first_order.mean_arcsec",
        "first_order.mean",
        "the angle of the mean errors of the features",
    ),
    Field(
        "first_order.u_arcsec",
        "first_order.u",
        "standard uncertainty of first order",
        head="first order u",
        detail=True,
    ),
    Field(
        "first_order.dof_effective",
        "first_order.dof",
        "effective degrees of freedom (Welch-Satterthwaite); null: infinite",
        csv="dof_effective",
    ),
    Field(
        "first_order.interval95_arcsec",
        "first_order.interval95",
        "mean -+ t u of first order",
        csv="",
    ),
    conformance("arcsec"),
    validation("arcsec", csv="validation_passed"),
    Field("independent.mean_arcsec", "independent.mean.0", "mean with all features independent"),
    Field(
        "independent.u_arcsec",
        "independent.u.0",
        "standard uncertainty with all features independent (Gilsinn & Ling 2004)",
        head="u indep.",
        detail=True,
    ),
    Field(
        "independent.interval95_arcsec",
        lambda item: (item.independent.low[0], item.independent.high[0]),
        "interval with all features independent",
        csv="",
    ),
    shares("first_order.shares", "shares"),
    Field("independent.trials", meaning="trials of the independent features", csv=""),
    Field(
        "independent.first_order_u_arcsec",
        "independent_u",
        "standard uncertainty of first order with all features independent",
        csv="",
    ),
    *(
        Field(
            f"monte_carlo.se_{name}_arcsec", f"run.se_{name}.0", f"standard error of {what}", csv=""
        )
        for name, what in (
            ("mean", "the mean"),
            ("u", "u"),
            ("low", "the lower end of the interval"),
            ("high", "the upper end of the interval"),
        )
    ),
    Field(
        "monte_carlo.gain",
        lambda item: {name: values[0] for name, values in item.run.gain._asdict().items()},
        "how many times fewer trials the control variate needs, by statistic",
        csv="",
    ),
)
RESULTS: Fields = (Group("orthogonality", ROW, "angles", many=True),)


def document(result: OrthogonalityResult, digits: int = 2) -> Document:
    """One row an angle; an angle with a feature beyond a measured range is marked."""
    from mtu_cli.reports import monte_carlo_figures

    outside = any(item.outside for item in result.angles)
    k = result.angles[0].k
    table = Table(
        title="Orthogonality",
        fields=ROW,
        items=result.angles,
        footer=f"U = {k:g} u; angle from +x of the row to +y of the column, minus 90 degrees"
        f"{OUTSIDE * outside}",
        notes=[
            "u indep.: all features independent (Gilsinn & Ling 2004); first order valid: JCGM "
            "101, clause 8; no*: use the interval of the Monte Carlo",
        ],
    )
    return Document(
        title="Orthogonality",
        results=(RESULTS, result),
        tables=[table],
        figure=lambda: monte_carlo_figures.orthogonality(result),
        verdict=_verdict(result.angles, digits),
        digits=digits,
    )


def _verdict(angles: tuple[Orthogonality, ...], digits: int) -> str:
    """What the intervals say of the right angle."""
    out = [item.id for item in angles if not item.run.low[0] <= 0.0 <= item.run.high[0]]
    if len(angles) == 1:
        (item,) = angles
        mean, scale = item.run.mean[0] / ARCSEC, item.scale / ARCSEC
        ends = interval(item.run.low[0] / ARCSEC, item.run.high[0] / ARCSEC, scale, digits)
        holds = "does not contain" if out else "contains"
        return (
            f"{item.id} is predicted {with_u(mean, scale, digits)[0]} arcsec from a right angle; "
            f"its 95 % interval {ends} {holds} 0."
        )
    if out:
        return f"The 95 % interval does not contain 0 for {listed(out)}."
    widest = max(angles, key=lambda item: item.run.high[0] - item.run.low[0])
    width = significant((widest.run.high[0] - widest.run.low[0]) / ARCSEC, digits)
    return f"All 95 % intervals contain 0; the widest is {width} arcsec wide, of {widest.id}."
