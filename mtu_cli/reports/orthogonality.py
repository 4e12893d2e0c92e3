"""The report of orthogonality: row-to-column angles by Monte Carlo and first order."""

from __future__ import annotations

from functools import partial

from mtu_cli.analyses.predictions import OrthogonalityResult
from mtu_cli.findings import listed
from mtu_cli.reports import figures
from mtu_cli.reports.document import MARK, OUTSIDE, Document, Table, least_conforming
from mtu_cli.reports.fields import declare
from mtu_cli.reports.numbers import significant, with_u
from mtu_cli.units import ARCSEC

DRAWN = 6
"""Angles drawn on one sheet."""
ROW = declare(
    """
    id | | name of the angle | angle, text, mark=outside()
    row | | features of the row | -, json
    column | | features of the column | -, json
    mean_arcsec | run.mean.0 | angle minus 90 degrees | mean, u=scale
    u_arcsec | run.u.0 | standard uncertainty; null where a source has two degrees of freedom \
        or fewer | u, u=run.u.0
    U_arcsec | U() | expanded uncertainty k u | U, u=run.u.0
    k | | coverage factor | -, json
    u_eq28_arcsec | eq28() | uncertainty of one more trial about the mean of all \
        (Gilsinn & Ling 2004, eq. (28))
    trials | run.trials | Monte Carlo trials | trials, count, detail
    converged | run.converged | whether they reached the digits asked for
    interval95_arcsec | ends() | interval that holds 95 of 100 trials, as many beyond either end \
        | 95 % interval, interval, u=scale
    shortest95_arcsec | shortest() | shortest interval that holds 95 of 100 trials | -, interval
    first_order.mean_arcsec | model.linear_mean.0 | the angle of the mean errors of the features
    first_order.u_arcsec | model.linear_u.0.0 | standard uncertainty of first order \
        | first order u, detail
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
    outside=MARK,
    U=lambda x: x.k * x.run.u[0],
    ends=lambda x: (x.run.low[0], x.run.high[0]),
    shortest=lambda x: (x.run.shortest_low[0], x.run.shortest_high[0]),
    eq28=lambda x: x.run.u[0] * (1.0 + 1.0 / x.run.trials) ** 0.5,
)
RESULTS = declare("orthogonality[] | angles | *angle", angle=ROW)


def document(result: OrthogonalityResult, digits: int = 2) -> Document:
    """One row an angle; an angle with a feature beyond a measured range is marked."""
    angles, title = result.angles, "Orthogonality"
    of = "angle from +x of the row to +y of the column, minus 90 degrees"
    footer = f"U = {angles[0].k:g} u; {of}{OUTSIDE * any(item.outside for item in angles)}"
    out = listed(item.id for item in angles if not item.run.low[0] <= 0.0 <= item.run.high[0])
    verdict = f"The 95 % interval does not contain 0 for {out}."
    if not out:
        verdict = "Every 95 % interval contains 0."
    if least := least_conforming([x.id for x in angles], [x.conformance for x in angles]):
        verdict += f" {least}."
    table = Table(title, ROW, angles, footer)
    return Document(title, (RESULTS, result), [table], partial(figure, result), verdict, digits)


def figure(result: OrthogonalityResult) -> figures.Figure:
    """Histogram of the trials of every angle, its interval, and the first-order curve."""
    trials = []
    for item in result.angles[:DRAWN]:
        run, model = item.run, item.model
        mean = with_u(run.mean[0] / ARCSEC, item.scale / ARCSEC)[0]
        first = model.linear_mean[0] / ARCSEC, model.linear_u[0, 0] / ARCSEC, model.dof[0]
        ends = float(run.low[0] / ARCSEC), float(run.high[0] / ARCSEC)
        text = f"{item.id}: mean {mean}, u {significant(run.u[0] / ARCSEC)} arcsec"
        label = "angle minus 90 degrees, arcsec"
        trials.append((text, label, run.samples[0] / ARCSEC, ends, first))
    return figures.histograms("Angles between rows and columns", trials)
