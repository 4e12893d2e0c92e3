"""A smooth profile estimated: a table of values along an axis with their covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.close_loop.design import Kernel
from mtu_cli.analyses.close_loop.likelihood import Fit, Likelihood
from mtu_cli.stats.kernels import smooth_root
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.smooth_profile import averaged

SAME = 1e-9
"""Of a line; less is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SmoothEffect:
    """Values (T,) at `knots` (T,) mm along axis `along`, about their line and the features' mean,
    with the covariance (T, T); `roughness` is the variance of the integrated Wiener process per
    mm^3, `between` a variance off the knots. In mm or rad.
    """

    along: str
    knots: FloatArray
    values: FloatArray
    covariance: FloatArray
    roughness: float
    dof: float
    between: float = 0.0

    @property
    def rms(self) -> float:
        """Root mean square of the values."""
        return float(np.sqrt(np.mean(self.values**2)))


def smooth_effect(likelihood: Likelihood, fit: Fit, kernel: Kernel) -> SmoothEffect:
    """The profile of a random function beside a fitted model (BLUP), its amplitude averaged over
    its posterior, so that future values between the places are covered at any amplitude.
    """
    design, strata = likelihood.design, likelihood.design.strata
    P, H, A = strata.shape
    (s,) = kernel.strata
    along = kernel.along
    places = np.nan_to_num(design.table.mean_places)[:, "xyz".index(along)]
    knots, at = np.unique(np.round(places, 6), return_inverse=True)
    part = strata.slices[s]
    _a, i, j = np.unravel_index(strata.place[part], (A, P, H))
    shared = np.flatnonzero(i == 0)
    basis = strata.of_features[strata.axis[s]][:, j[shared]] / strata.spread[part][shared]
    centred = places - places.mean()
    line = basis.T @ centred
    N = np.sqrt(P) * basis.T @ np.eye(len(knots))[at]
    y = fit.residual[part][shared]
    # Of readings the lines of the passes hold it: what is left of it is rounding.
    if np.linalg.norm(line) > SAME * np.linalg.norm(centred):
        unit = line / np.linalg.norm(line)
        N, y = N - np.outer(unit, unit @ N), y - unit * (unit @ y)
    B = smooth_root(knots)
    scale = float(np.mean((B[at] ** 2).sum(axis=1)))
    U, sizes, V = np.linalg.svd(N, full_matrices=False)
    kept = sizes > 1e-9 * sizes[0]
    G, z = sizes[kept, None] * V[kept], U[:, kept].T @ y
    rest = float(fit.residual[part] @ fit.residual[part] - z @ z) + float(likelihood.extra[s])
    # What the profile's own coordinates do not take is the error that it is judged by.
    nu = max(round(fit.dof[s]) - len(z), 1)
    if nu < 2 or rest <= 0:
        rest, nu = float(fit.dof[s] / fit.weights[s]), round(fit.dof[s])
    values, covariance, amplitude2 = averaged(G, z, B / np.sqrt(scale), rest, nu)
    variance = rest / nu * design.scale**2
    # The level is estimated with those of all other effects: of the features none is left here.
    about = np.eye(len(knots)) - np.bincount(at) / len(at)
    return SmoothEffect(
        along=along,
        knots=knots,
        values=about @ values * design.scale,
        covariance=about @ covariance @ about.T * variance,
        roughness=amplitude2 * variance / scale,
        dof=float(nu),
    )
