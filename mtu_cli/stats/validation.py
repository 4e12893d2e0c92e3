"""The first-order result against the Monte Carlo: JCGM 101:2008, clause 8."""

from __future__ import annotations

from dataclasses import dataclass

from mtu_cli.stats.coverage import numerical_tolerance
from mtu_cli.stats.monte_carlo import MonteCarloResult

CONVERGED_TO = 0.2
"""Share of the tolerance to which the Monte Carlo must have converged, 8.2."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Validation:
    """Outcome of clause 8 for one output, in its unit. `passed`: whether both differences of
    interval ends are at most `tolerance`; None where the Monte Carlo cannot tell: its own two
    standard errors exceed a fifth of the tolerance at an end (8.2), and a difference is within
    those two of the tolerance. `settled`: whether more trials would be of no use.
    """

    passed: bool | None
    d_low: float
    d_high: float
    tolerance: float
    settled: bool = True


def clause8(
    mean: float, u: float, k: float, result: MonteCarloResult, digits: int = 2, index: int = 0
) -> Validation:
    """d_low = |y - k u - y_low|, d_high = |y + k u - y_high|, JCGM 101:2008, 8.1, eq. (30)-(31).

    `mean`, `u`: first-order estimate y and u(y) of output `index`. `k`: the coverage factor for
    `result.probability` at the Welch-Satterthwaite degrees of freedom, not a rounded 2.
    `digits`: the significant digits of u(y) that matter; they set the tolerance delta (7.9.2).
    """
    tolerance = numerical_tolerance(u, digits)
    d_low = float(abs(mean - k * u - result.low[index]))
    d_high = float(abs(mean + k * u - result.high[index]))
    twice_low, twice_high = 2.0 * float(result.se_low[index]), 2.0 * float(result.se_high[index])
    # Without any uncertainty the ends differ by rounding alone.
    allowed = tolerance if u > 0 else 1e-9 * abs(mean)
    passed: bool | None = d_low <= allowed and d_high <= allowed
    clearly_failed = d_low - twice_low > allowed or d_high - twice_high > allowed
    clearly_passed = d_low + twice_low <= allowed and d_high + twice_high <= allowed
    short = max(twice_low, twice_high) > CONVERGED_TO * tolerance
    if short and not (clearly_failed or clearly_passed):
        passed = None
    return Validation(
        passed=passed,
        d_low=d_low,
        d_high=d_high,
        tolerance=tolerance,
        settled=clearly_failed or not short,
    )
