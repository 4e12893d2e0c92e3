"""The report of lengths: feature-to-feature lengths with uncertainty and conformance."""

from __future__ import annotations

from mtu_cli.analyses.lengths import LengthsResult
from mtu_cli.findings import listed
from mtu_cli.reports.document import MARK, OUTSIDE, Document, Table
from mtu_cli.reports.fields import Field, Fields, Group, shares, validation
from mtu_cli.reports.numbers import chance, percent, significant
from mtu_cli.units import UM

ROW: Fields = (
    Field("id", meaning="name of the length", head="length", show="text", mark=MARK),
    Field("from", "start", "feature at which it starts"),
    Field("to", "end", "feature at which it ends"),
    Field("nominal_mm", "nominal", "distance of the nominal places", head="nominal", show="mm"),
    Field("estimated_mm", "estimated", "nominal plus error"),
    Field("error_um", "error", "actual minus nominal length", head="error", u="u"),
    Field("variance_um2", "variance", "variance of the error of one future part"),
    Field("u_um", "u", "standard uncertainty, its square root", head="u", u="u"),
    Field("U_um", "U", "expanded uncertainty k u", head="U", u="u"),
    Field("k", meaning="coverage factor"),
    Field("dof_effective", "dof", "effective degrees of freedom (Welch-Satterthwaite); null: inf"),
    Field("interval_um", "interval", "error -+ U", show="interval"),
    Field(
        "interval95_um",
        "interval95",
        "interval that holds the error of 95 of 100 future parts (Student's t)",
        head="95 % interval",
        show="interval",
        u="u",
    ),
    Field(
        "independent.variance_um2",
        "independent_variance",
        "variance with ends and components independent (Gilsinn & Ling 2004, eq. (22))",
    ),
    Field(
        "independent.u_um",
        "independent_u",
        "standard uncertainty with ends and components independent",
        head="u indep.",
        detail=True,
    ),
    Field("independent.U_um", "independent_U", "k times it"),
    Field(
        "between_components.u_uncorrelated_um",
        "u_uncorrelated",
        "standard uncertainty without the measured correlation between components",
        csv="u_uncorrelated_um",
    ),
    Field(
        "between_components.u_bounds_um",
        "u_bounds",
        "standard uncertainty if `pair` were correlated with -1 and with +1",
        csv="u_bound_um",
        show="interval",
    ),
    Field(
        "between_components.pair",
        "pair",
        "the two components read in passes of their own that contribute most; null: fewer than two",
        csv="",
    ),
    Group(
        "conformance",
        (
            Field(
                "tolerance_um",
                "tolerance",
                "largest error allowed, plus and minus; conformance is null without one",
                csv="tolerance_um",
                head="tolerance",
                show=lambda value, u, digits: f"±{value:g}",
            ),
            Field(
                "probability",
                meaning="probability that the length of a future part is within its tolerance",
                csv="conformance_probability",
                head="conforming\n%",
                show="percent",
            ),
        ),
    ),
    shares(),
    validation("um"),
)
RESULTS: Fields = (
    Group("lengths", ROW, many=True),
    Group(
        "joint_conformance",
        (
            Field("lengths", meaning="lengths with a tolerance; null for fewer than two"),
            Field("probability", meaning="that all of them conform in one part (Monte Carlo)"),
            Field("se", meaning="standard error of the probability"),
        ),
    ),
    Field("monte_carlo.trials", "run.trials", "trials behind the validation"),
    Field("monte_carlo.converged", "run.converged", "whether they reached the digits asked for"),
)


def document(result: LengthsResult, digits: int = 2) -> Document:
    """One row a length; a length with an end beyond a measured range is marked."""
    from mtu_cli.reports.lengths_figure import figure

    outside = any(item.outside for item in result.lengths)
    k = result.lengths[0].k
    table = Table(
        title="Lengths",
        fields=ROW,
        items=result.lengths,
        footer=f"U = {k:g} u of one future part; error = actual minus nominal{OUTSIDE * outside}",
        notes=[
            "u indep.: ends and components independent (Gilsinn & Ling 2004, eq. (22)); first "
            "order valid: JCGM 101, clause 8",
            "shares of u^2: coefficients are the same for all parts, passes common to the points "
            "of one part, repeatability of each visit",
        ],
    )
    return Document(
        title="Lengths",
        results=(RESULTS, result),
        tables=[table],
        figure=lambda: figure(result, digits),
        verdict=_verdict(result),
        digits=digits,
    )


def _verdict(result: LengthsResult) -> str:
    known = [item for item in result.lengths if item.conformance is not None]
    if not known:
        worst = max(result.lengths, key=lambda item: item.u)
        return f"The largest expanded uncertainty is {significant(worst.U / UM)} um, of {worst.id}."
    low = min(item.conformance.probability for item in known if item.conformance)
    worst_names = [x.id for x in known if x.conformance and x.conformance.probability == low]
    sentence = f"The least probability of conformance is {percent(low)} %, of {listed(worst_names)}"
    joint = result.joint_conformance
    if joint is None:
        return f"{sentence}."
    return f"{sentence}; of all in one part {chance(joint.probability, joint.se)} %."
