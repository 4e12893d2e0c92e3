"""The report of lengths: feature-to-feature lengths with uncertainty and conformance."""

from __future__ import annotations

from functools import partial

import numpy as np

from mtu_cli.analyses.predictions import LengthsResult
from mtu_cli.reports import figures
from mtu_cli.reports.document import MARK, OUTSIDE, Document, Table, least_conforming
from mtu_cli.reports.fields import declare, rows_of
from mtu_cli.reports.figures import Intervals
from mtu_cli.reports.numbers import chance, significant, with_u
from mtu_cli.units import UM

ROW = declare(
    """
    id | ids | name of the length | length, text, mark=outside()
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
    outside=MARK,
    estimated=lambda x: x.nominal + x.error,
    U=lambda x: x.coverage_factor * np.sqrt(x.variance),
    ends=lambda x: x.error + x.coverage_factor * np.sqrt(x.variance) * np.array([-1.0, 1.0]),
    independent_U=lambda x: x.coverage_factor * np.sqrt(x.independent_variance),
)
RESULTS = declare(
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
    length=ROW,
)


def document(result: LengthsResult, digits: int = 2) -> Document:
    """One row a length; a length with an end beyond a measured range is marked."""
    footer = f"U = {result.coverage_factor:g} u of one future part; error = actual minus nominal"
    rows = rows_of(result, len(result.ids))
    table = Table("Lengths", ROW, rows, footer + OUTSIDE * any(result.outside))
    verdict = least_conforming(result.ids, result.conformance)
    if (joint := result.joint_conformance) is not None:
        verdict += f"; of all in one part {chance(joint.probability, joint.se)} %"
    if not verdict:
        worst = int(np.argmax(result.variance))
        U = significant(result.coverage_factor * np.sqrt(result.variance[worst]) / UM)
        verdict = f"The largest expanded uncertainty is {U} um, of {result.ids[worst]}"
    figure_ = partial(figure, result, digits)
    return Document("Lengths", (RESULTS, result), [table], figure_, f"{verdict}.", digits)


def figure(result: LengthsResult, digits: int = 2) -> figures.Figure:
    """A row a length, with error and U rounded as in the table."""
    k, value = result.coverage_factor, result.error / UM
    u, u_indep = (np.sqrt(v) / UM for v in (result.variance, result.independent_variance))
    none = np.nan, np.nan
    limits = [(c.tolerance.low, c.tolerance.high) if c else none for c in result.conformance]
    return figures.listing(
        f"Predicted errors of the lengths ± {k:g} u",
        [f"{name}, {x:.2f} mm" for name, x in zip(result.ids, result.nominal, strict=True)],
        [
            Intervals("with shared covariance", figures.BLUE, value, k * u),
            Intervals("independent ends and components", figures.ORANGE, value, k * u_indep, 0.28),
        ],
        "actual minus nominal length, um",
        limits=list(np.array(limits).T),
        texts=[
            " ± ".join(with_u(each, scale, digits)[0] for each in (x, k * scale)) + " um"
            for x, scale in zip(value, u, strict=True)
        ],
    )
