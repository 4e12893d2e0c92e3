"""The report of lengths: feature-to-feature lengths with uncertainty and conformance."""

from __future__ import annotations

from typing import Any

import numpy as np

from mtu_cli.analyses.lengths import LengthsResult
from mtu_cli.findings import listed
from mtu_cli.reports.document import MARK, OUTSIDE, Document, Table
from mtu_cli.reports.fields import (
    Field,
    Fields,
    Group,
    conformance,
    root,
    rows_of,
    shares,
    validation,
)
from mtu_cli.reports.numbers import chance, percent, significant
from mtu_cli.units import UM

u = root("variance")


def U(item: Any) -> float:
    """Expanded uncertainty k u."""
    return float(item.coverage_factor * u(item))


ROW: Fields = (
    Field("id", "ids", "name of the length", head="length", show="text", mark=MARK),
    Field("from", "ends.0", "feature at which it starts"),
    Field("to", "ends.1", "feature at which it ends"),
    Field("nominal_mm", "nominal", "distance of the nominal places", head="nominal", show="mm"),
    Field("estimated_mm", lambda x: x.nominal + x.error, "nominal plus error"),
    Field("error_um", "error", "actual minus nominal length", head="error", u=u),
    Field("variance_um2", "variance", "variance of the error of one future part"),
    Field("u_um", u, "standard uncertainty, its square root", head="u", u=u),
    Field("U_um", U, "expanded uncertainty k u", head="U", u=u),
    Field("k", "coverage_factor", "coverage factor"),
    Field("dof_effective", "dof", "effective degrees of freedom (Welch-Satterthwaite); null: inf"),
    Field("interval_um", lambda x: (x.error - U(x), x.error + U(x)), "error -+ U", show="interval"),
    Field(
        "interval95_um",
        "interval95",
        "interval that holds the error of 95 of 100 future parts (Student's t)",
        head="95 % interval",
        show="interval",
        u=u,
    ),
    Field(
        "independent.variance_um2",
        "independent_variance",
        "variance with ends and components independent (Gilsinn & Ling 2004, eq. (22))",
    ),
    Field(
        "independent.u_um",
        root("independent_variance"),
        "standard uncertainty with ends and components independent",
        head="u indep.",
        detail=True,
    ),
    Field(
        "independent.U_um",
        lambda x: x.coverage_factor * np.sqrt(x.independent_variance),
        "k times it",
    ),
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
    conformance("um"),
    shares(),
    validation("um"),
)
RESULTS: Fields = (
    Group("lengths", ROW, lambda result: rows_of(result, len(result.ids)), many=True),
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
    from mtu_cli.reports import prediction_figures

    k, outside = result.coverage_factor, any(result.outside)
    table = Table(
        title="Lengths",
        fields=ROW,
        items=rows_of(result, len(result.ids)),
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
        figure=lambda: prediction_figures.lengths(result, digits),
        verdict=_verdict(result),
        digits=digits,
    )


def _verdict(result: LengthsResult) -> str:
    known = {x: c.probability for x, c in zip(result.ids, result.conformance, strict=True) if c}
    if not known:
        worst = int(np.argmax(result.variance))
        U = result.coverage_factor * np.sqrt(result.variance[worst]) / UM
        return f"The largest expanded uncertainty is {significant(U)} um, of {result.ids[worst]}."
    low = min(known.values())
    worst_names = [name for name, probability in known.items() if probability == low]
    sentence = f"The least probability of conformance is {percent(low)} %, of {listed(worst_names)}"
    joint = result.joint_conformance
    if joint is None:
        return f"{sentence}."
    return f"{sentence}; of all in one part {chance(joint.probability, joint.se)} %."
