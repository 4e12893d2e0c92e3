"""The smallest effects that a table would show."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from mtu_cli.analyses.close_loop.diagnosis import Diagnosis
from mtu_cli.analyses.close_loop.gate import partial_out

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
    design, strata = found.design, found.design.strata
    fit = found.likelihood.fit(found.models.columns(found.model))
    P, H, _ = strata.shape
    of = design.of[: design.tested]
    counts = np.bincount(of)
    tests = int((counts > 0).sum())
    sizes = np.full(design.tested, np.nan)
    for (low, k), group in design.groups():
        left = partial_out(found.likelihood, group, (), low, fit.weights)
        # The coefficients are uncertain as far as is known beforehand.
        prior = np.sum(left.own_base**2 * found.likelihood.ridge(left.base), axis=(1, 2))
        signal = (np.einsum("smkk->m", left.information) + prior) / k
        crossed = design.columns.cross(left.own, left.own).sum(axis=-1)
        shares = fit.weights[:, None] * crossed
        v = np.maximum(fit.dof @ shares / shares.sum(axis=0) - k, 1.0)
        p = (1 - (1 - alpha) ** (1 / tests)) / counts[of[group]]
        c2 = v * np.expm1(np.minimum(chdtri(k, p) / v, 50.0))
        z = np.sqrt(c2) * (1 - 0.25 / v) + POWER_DEVIATE * np.sqrt(1 + c2 / (2 * v))
        axes = [np.bincount(strata.axis, own) > 0 for own in shares.T]
        cells = P * H * np.sum(axes, axis=1)
        seen = signal * k > LEAST * left.alone.sum(axis=1)
        sizes[group] = np.where(seen, z / np.sqrt(np.where(seen, signal, 1.0) * cells), np.nan)
    known = {c: sizes[(of == c) & np.isfinite(sizes)] for c in np.unique(of)}
    return {
        design.candidates[c].name: float(np.median(own)) * found.design.scale
        for c, own in known.items()
        if len(own)
    }
