"""Coefficients along directions in which whole parts differ: by how much, few parts tell badly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.estimate import of_coordinates
from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan
from mtu_cli.close_loop_sealed.stats.column_groups import MemberColumns
from mtu_cli.close_loop_sealed.stats.estimated_scatter import inflation
from mtu_cli.close_loop_sealed.stats.stratified import StratifiedFit


def with_scatter_of_parts(
    scan: Scan, members: Sequence[MemberColumns], fit: StratifiedFit
) -> StratifiedFit:
    """The fit whose covariance and degrees of freedom know that the scatter of parts, by which
    their common directions are weighted, is an estimate (see `inflation`).

    Degrees of freedom by Welch-Satterthwaite (GUM, G.4.1).
    """
    null, strata = scan.null, scan.frame.strata
    if not len(fit.beta) or not np.isfinite(null.part_dof):
        return fit
    beta = of_coordinates(scan, members, fit.weights)
    total, more = np.diag(fit.covariance), np.zeros_like(fit.covariance)
    rest, doubt = total.copy(), np.zeros(len(total))
    for stratum in strata.all:
        b = len(stratum.lead)
        if not b:
            continue
        own = beta[stratum.start : stratum.start + b]
        place = stratum.axis * (1 + strata.lines) + np.array(stratum.lead, int)
        by_parts = own.T @ null.part[np.ix_(place, place)] @ own
        factor, n = inflation(null.part_dof, b)
        more += (factor - 1) * by_parts
        rest -= np.diag(by_parts)
        doubt += (factor * np.diag(by_parts)) ** 2 / n
    doubt += np.maximum(rest, 0.0) ** 2 / np.maximum(fit.dof, 1.0)
    known = np.diag(fit.covariance + more)
    dof = np.where(doubt > 0, known**2 / np.maximum(doubt, 1e-300), fit.dof)
    return replace(fit, covariance=fit.covariance + more, dof=np.minimum(dof, fit.dof))
