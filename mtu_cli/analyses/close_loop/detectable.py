"""The smallest effects that a table would show."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from mtu_cli.analyses.close_loop.diagnosis import Diagnosis

POWER_DEVIATE = 0.8416212335729143
"""Normal deviate of a power of 80 %."""
LEAST = 1e-9
"""Share of a column that its margins and the coefficients must leave."""


def minimum_detectable(found: Diagnosis, alpha: float) -> dict[str, float]:
    """Root mean square, mm or rad, over the cells of the smallest effect of each candidate that
    passes the gate four times in five; the median over its members. The effects that were found are
    in the model.

    The deviance of k columns among v degrees of freedom passes its limit D where the statistic t of
    noncentral Student distribution is above c = sqrt(v (exp(D / v) - 1)). By (t (1 - 1/4v) - z) /
    sqrt(1 + t^2/2v) ~ N(0, 1) (Abramowitz & Stegun 1972, 26.7.10) that has a probability of 80 % at
    a signal-to-noise z = c (1 - 1/4v) + 0.84 sqrt(1 + c^2/2v). D is Sidak's over all candidates
    and the members of each.
    """
    design, strata, ridge = found.posed.design, found.posed.strata, found.likelihood.ridge
    fit = found.likelihood.fit(found.models.columns(found.model))
    P, H, _ = strata.shape
    cross, members = design.columns.cross, design.members[: design.tested]
    counts = np.bincount([member.candidate for member in members])
    tests = int((counts > 0).sum())
    groups: dict[tuple[tuple[int, ...], int], list[int]] = {}
    for m, member in enumerate(members):
        if member.own:
            groups.setdefault((member.low, len(member.own)), []).append(m)
    of = design.of[: design.tested]
    sizes = np.full(design.tested, np.nan)
    for (margins, k), group in groups.items():
        own, low = np.array([members[m].own for m in group]), np.array([*margins, *design.common])
        low = low.astype(int)
        crossed = cross(own[:, :, None], own[:, None, :])
        inner = np.einsum("s,smkk->m", fit.weights, crossed)
        # The fitted coefficients have a known variance.
        spread = np.tensordot(fit.weights, cross(low[:, None], low), 1) + np.diag(ridge(low))
        across = np.tensordot(fit.weights, cross(own[:, :, None], low), 1)
        taken = across @ np.linalg.pinv(spread, hermitian=True)
        signal = (inner - np.einsum("mkz,mkz->m", taken, across)) / k
        shares = fit.weights[:, None] * np.einsum("smkk->sm", crossed)
        v = np.maximum(fit.dof @ shares / shares.sum(axis=0) - k, 1.0)
        p = (1 - (1 - alpha) ** (1 / tests)) / counts[of[group]]
        c2 = v * np.expm1(np.minimum(chdtri(k, p) / v, 50.0))
        z = np.sqrt(c2) * (1 - 0.25 / v) + POWER_DEVIATE * np.sqrt(1 + c2 / (2 * v))
        axes = [np.bincount(strata.axis, own) > 0 for own in shares.T]
        cells = P * H * np.sum(axes, axis=1)
        seen = signal * k > LEAST * inner
        sizes[group] = np.where(seen, z / np.sqrt(np.where(seen, signal, 1.0) * cells), np.nan)
    known = {c: sizes[(of == c) & np.isfinite(sizes)] for c in np.unique(of)}
    return {
        design.candidates[c].name: float(np.median(own)) * found.posed.scale
        for c, own in known.items()
        if len(own)
    }
