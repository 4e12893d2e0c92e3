"""The first-order result against the Monte Carlo: JCGM 101:2008, clause 8."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

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


def validated(
    run_to: Callable[[float], MonteCarloResult],
    first: Sequence[tuple[float, float, float]],
    digits: int,
    adaptive: bool,
) -> tuple[MonteCarloResult, list[Validation]]:
    """A Monte Carlo run to its numerical tolerance (JCGM 101:2008, 7.9.4) and, where clause 8 is
    not settled by that and the count is `adaptive`, to a fifth of clause 8's (8.2): what first
    order plainly fails needs no more trials to say so.

    `run_to` a fraction of the engine's tolerance; `first`: y, u(y) and k of every output, of nan
    where there is no first order, which leaves its outcome open.
    """
    run = run_to(1.0)
    verdicts = [_judge(*item, run, digits, i) for i, item in enumerate(first)]
    unsettled = any(not v.settled and u > 0.0 for v, (_, u, _) in zip(verdicts, first, strict=True))
    if adaptive and run.converged and unsettled:
        # The engine takes its tolerance from its own u, which may need a digit more: 0.105 beside
        # 0.074. The least of the tolerances of clause 8 over those of the engine.
        both = [(u, float(v)) for (_, u, _), v in zip(first, run.u, strict=True) if u > 0 and v > 0]
        ratios = [numerical_tolerance(u, digits) / numerical_tolerance(v, digits) for u, v in both]
        run = run_to(CONVERGED_TO * min([1.0, *filter(math.isfinite, ratios)]))
        verdicts = [_judge(*item, run, digits, i) for i, item in enumerate(first)]
    return run, verdicts


def _judge(
    mean: float, u: float, k: float, run: MonteCarloResult, digits: int, index: int
) -> Validation:
    """Clause 8 of an output; undecided where there is no first order."""
    if math.isnan(u):
        return Validation(passed=None, d_low=math.nan, d_high=math.nan, tolerance=math.nan)
    verdict = clause8(mean, u, k, run, digits, index)
    # The ends of a step's interval may agree: no u is still wrong where there is one.
    return replace(verdict, passed=False) if u == 0.0 and run.u[index] > 0.0 else verdict
