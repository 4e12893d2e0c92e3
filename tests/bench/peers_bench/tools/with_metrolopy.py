"""metrolopy: by operators of its numbers, or with a function applied to them."""

from __future__ import annotations

from typing import Any

import metrolopy
from metrolopy.distributions import Distribution

from peers_bench.problem import Found, Inputs, angle
from peers_bench.tools import FirstOrder, MonteCarlo


def _numbers(inputs: Inputs) -> list[Any]:
    return [metrolopy.gummy(x, u=u) for x, u in zip(inputs.mean, inputs.u, strict=True)]


def _operators(inputs: Inputs) -> Any:
    return angle(_numbers(inputs))


def _function(inputs: Inputs) -> Any:
    return metrolopy.gummy.napply(lambda *values: angle(values), *_numbers(inputs))


def _drawn(y: Any, trials: int, seed: int) -> Found:
    Distribution.set_seed(seed)
    y.cimethod = "symmetric"
    y.p = 0.95
    y.sim(n=trials)
    low, high = y.cisim
    return Found(float(y.usim), float(low), float(high))


MONTE_CARLO: dict[str, MonteCarlo] = {
    "operators": lambda inputs, trials, seed, threads: _drawn(_operators(inputs), trials, seed),
    "function": lambda inputs, trials, seed, threads: _drawn(_function(inputs), trials, seed),
}
FIRST_ORDER: dict[str, FirstOrder] = {
    "operators": lambda inputs: ((y := _operators(inputs)).x, y.u),
    "function": lambda inputs: ((y := _function(inputs)).x, y.u),
}
