"""Probability that what a machine will make conforms to its tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.model.settings import Settings
from mtu_cli.model.trials import PointTrials
from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import monte_carlo

JOINT_TRIALS = 200_000
"""Trials behind the joint probability of conformance; its standard error is stated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conformance:
    """Probability that the error of a future part is within -+ `tolerance` (mm)."""

    tolerance: float
    probability: float


def conformance_of(
    tolerance_um: float | None, error: float, u: float, dof: float
) -> Conformance | None:
    """P(|error of a future part| <= tolerance) with t at the effective degrees of freedom."""
    from scipy.special import ndtr, stdtr

    if tolerance_um is None:
        return None
    tolerance = tolerance_um * 1e-3
    if u == 0:
        return Conformance(tolerance=tolerance, probability=float(abs(error) <= tolerance))

    def below(t: float) -> float:
        return float(ndtr(t) if np.isinf(dof) else stdtr(dof, t))

    inside = below((tolerance - error) / u) - below((-tolerance - error) / u)
    return Conformance(tolerance=tolerance, probability=inside)


class _AllWithin:
    """1 where every toleranced length of a trial's part is within its tolerance, else 0."""

    def __init__(self, model: PointTrials, limits: FloatArray) -> None:
        self.names = ("all_within",)
        self.linear_mean = None
        self.u_exists = (True,)
        self.model = model
        self.limits = limits[:, None]

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        values = self.model.values(rng, m)
        within = np.all(np.abs(values) <= self.limits, axis=0, keepdims=True)
        return Draws(values=within.astype(np.float64))


def joint_conformance(
    model: PointTrials, items: Sequence[Conformance | None], settings: Settings
) -> tuple[float, float] | None:
    """Probability that one part conforms in all its toleranced lengths, and its standard error.

    The lengths of a part are correlated, so this is not the product of their probabilities; nor is
    it more than the least of them, which the trials may scatter beyond.
    """
    limits = np.array([np.inf if item is None else item.tolerance for item in items])
    if np.isfinite(limits).sum() < 2:
        return None
    result = monte_carlo(
        _AllWithin(model, limits),
        seed=settings.seed,
        trials=settings.trials or JOINT_TRIALS,
        threads=settings.threads,
    )
    n = result.trials
    p = float(result.mean[0])
    # One miss more and one hit more: 200 000 hits of 200 000 are not certainty.
    cautious = (p * n + 1) / (n + 2)
    least = min(item.probability for item in items if item is not None)
    return min(p, least), float(np.sqrt(cautious * (1 - cautious) / n))
