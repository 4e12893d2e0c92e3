"""`mtu` by its own core: what `mtu orthogonality` does once the part's errors are predicted."""

from __future__ import annotations

from functools import cache

from mtu_cli.analyses.orthogonality import angle_trials, plain_angle_trials
from mtu_cli.model.measurands import AngleTrials
from mtu_cli.model.settings import PROBABILITY
from mtu_cli.stats.blocks import LEAST_BLOCKS, least_block
from mtu_cli.stats.monte_carlo import MonteCarloResult, monte_carlo
from mtu_cli.stats.validation import CONVERGED_TO
from peers_bench.problem import Found, Inputs, predicted
from peers_bench.tools import FirstOrder, MonteCarlo

LEAST = LEAST_BLOCKS * least_block(PROBABILITY, smooth=True)
"""The fewest trials with which the core uses its control variate."""

_prediction = cache(predicted)


def _model() -> AngleTrials:
    prediction, row, column = _prediction()
    return angle_trials("angle", row, column, prediction, independent=True)


def run(trials: int | None, seed: int, threads: int | None) -> MonteCarloResult:
    """Set up and run; `trials` None lets the count adapt, as the command does."""
    return monte_carlo(
        _model(),
        seed=seed,
        trials=trials,
        probability=PROBABILITY,
        tolerance_fraction=CONVERGED_TO,
        threads=threads,
        keep=0,
    )


def _found(result: MonteCarloResult) -> Found:
    return Found(float(result.u[0]), float(result.low[0]), float(result.high[0]))


def fixed(inputs: Inputs, trials: int, seed: int, threads: int | None) -> Found:
    return _found(run(trials, seed, threads))


def adaptive(inputs: Inputs, trials: int, seed: int, threads: int | None) -> Found:
    return _found(run(None, seed, threads))


def first_order(inputs: Inputs) -> tuple[float, float]:
    prediction, row, column = _prediction()
    model = plain_angle_trials("angle", row, column, prediction, independent=True)
    return float(model.linear_mean[0]), float(model.linear_u[0, 0])


MONTE_CARLO: dict[str, MonteCarlo] = {"": fixed, "count adapts": adaptive}
FIRST_ORDER: dict[str, FirstOrder] = {"": first_order}
