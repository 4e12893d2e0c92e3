"""The correlations of the normals behind inputs that are correlated and not all normal."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mtu_cli.analyses.budget.correlation import ROUNDING, uncorrelatable
from mtu_cli.analyses.budget.quantities import InputQuantity
from mtu_cli.analyses.budget.sources import Source
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import Finding, InputError
from mtu_cli.stats.least_squares import FloatArray


def copula_correlations(
    loaded: LoadedBudget, inputs: Sequence[InputQuantity], sources: Sequence[Source]
) -> tuple[FloatArray | None, ...]:
    """For each source that is a copula the correlation matrix of its normals, else None.

    Raises InputError where the stated coefficients are impossible with these distributions.
    """
    problems: list[Finding] = []
    found = [
        _matrix(source, inputs, loaded, problems) if source.how == "copula" else None
        for source in sources
    ]
    if problems:
        raise InputError(problems)
    return tuple(found)


def _matrix(
    source: Source,
    inputs: Sequence[InputQuantity],
    loaded: LoadedBudget,
    problems: list[Finding],
) -> FloatArray:
    from mtu_cli.stats.copula import largest_covariance, marginal, normal_correlation

    members = [marginal(item) for item in source.members]
    rho = np.eye(len(members))
    for a in range(len(members)):
        for b in range(a):
            wanted = float(source.covariance[a, b])
            if wanted == 0.0:
                continue
            r = normal_correlation(members[a], members[b], wanted)
            if r is None:
                unit = math.sqrt(source.covariance[a, a] * source.covariance[b, b])
                most = largest_covariance(members[a], members[b]) / unit
                pair = inputs[source.rows[b]].name, inputs[source.rows[a]].name
                problems.append(_too_strong(loaded, pair, wanted / unit, most))
                continue
            rho[a, b] = rho[b, a] = r
    least = float(np.linalg.eigvalsh(rho)[0])
    if least < -ROUNDING * len(rho) and not problems:
        why = f"the smallest eigenvalue of their Gaussian copula is {least:.4g}"
        expected = "smaller coefficients, or normal distributions"
        names = [inputs[row].name for row in source.rows]
        problems.append(uncorrelatable(loaded, names, why, expected))
    return rho


def _too_strong(loaded: LoadedBudget, pair: tuple[str, str], wanted: float, most: float) -> Finding:
    # Rounded towards 0, so that what it says can be had.
    shown = math.floor(1e6 * most) / 1e6
    why = "their distributions allow no coefficient so large"
    return uncorrelatable(loaded, pair, why, f"-{shown:g} to {shown:g}", f"{wanted:.9g}")
