"""The smallest effects that a table would show."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from mtu_cli.analyses.close_loop.diagnosis import Diagnosis
from mtu_cli.stats.least_squares import FloatArray

POWER_DEVIATE = 0.8416212335729143
"""Normal deviate of a power of 80 %."""
LEAST = 1e-9
"""Share of a column that must be left beside its margins and the coefficients."""


def minimum_detectable(found: Diagnosis, alpha: float) -> dict[str, float]:
    """Root mean square, mm or rad, over the cells of the smallest effect of each candidate that
    passes the gate four times in five; the median over its members. What was found is no noise.

    The deviance of k columns among v degrees of freedom passes its limit D where the statistic t of
    noncentral Student distribution is above c = sqrt(v (exp(D / v) - 1)). By (t (1 - 1/4v) - z) /
    sqrt(1 + t^2/2v) ~ N(0, 1) (Abramowitz & Stegun 1972, 26.7.10) that has a probability of 80 % at
    a signal-to-noise z = c (1 - 1/4v) + 0.84 sqrt(1 + c^2/2v). D is Sidak's over all candidates
    and the members of each.
    """
    design, strata = found.posed.design, found.posed.strata
    fit = found.likelihood.fit(found.models.columns(found.model))
    P, H, _ = strata.shape
    columns, members = design.columns, design.members[: design.tested]
    counts = np.bincount([member.candidate for member in members])
    tests = int((counts > 0).sum())
    inverses: dict[tuple[int, ...], FloatArray] = {}
    sizes: dict[str, list[float]] = {}
    for member in members:
        own, low = np.array(member.own, int), np.array([*member.low, *design.common], int)
        crossed = columns.cross(own[:, None], own)
        inner = np.tensordot(fit.weights, crossed, 1)
        if member.low not in inverses:
            # The fitted coefficients have a known variance.
            spread = columns.weighed(fit.weights, low[:, None], low)
            spread += np.diag(found.likelihood.ridge(low))
            inverses[member.low] = np.asarray(np.linalg.pinv(spread, hermitian=True), float)
        beside = columns.weighed(fit.weights, low[:, None], own)
        free = inner - beside.T @ inverses[member.low] @ beside
        k, signal = len(own), float(np.trace(free)) / max(len(own), 1)
        if signal <= LEAST * float(np.trace(inner)):
            continue
        shares = fit.weights * np.einsum("skk->s", crossed)
        v = max(float(shares @ fit.dof / shares.sum()) - k, 1.0)
        p = (1 - (1 - alpha) ** (1 / tests)) / counts[member.candidate]
        c2 = v * float(np.expm1(min(float(chdtri(k, p)) / v, 50.0)))
        z = np.sqrt(c2) * (1 - 0.25 / v) + POWER_DEVIATE * np.sqrt(1 + c2 / (2 * v))
        cells = P * H * len({strata.axis[s] for s in np.flatnonzero(shares)})
        name = design.candidates[member.candidate].name
        sizes.setdefault(name, []).append(float(z) / np.sqrt(signal * cells))
    return {name: float(np.median(own)) * found.posed.scale for name, own in sizes.items()}
