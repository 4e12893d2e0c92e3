"""suncal: a Python function, or an expression that sympy reads."""

from __future__ import annotations

from typing import Any

import numpy as np
from suncal import Model, ModelCallable

from peers_bench.problem import Found, Inputs, angle, expression
from peers_bench.tools import FirstOrder, MonteCarlo


def _callable(inputs: Inputs) -> Any:
    names = inputs.names

    def f(**values: Any) -> Any:
        return angle([values[name] for name in names])

    return _measured(ModelCallable(f, names=["angle"], argnames=names), inputs)


def _symbolic(inputs: Inputs) -> Any:
    return _measured(Model(f"angle = {expression(inputs.names)}"), inputs)


def _measured(model: Any, inputs: Inputs) -> Any:
    for name, mean, u in zip(inputs.names, inputs.mean, inputs.u, strict=True):
        model.var(name).measure(mean).typeb(std=u)
    return model


def _drawn(model: Any, trials: int, seed: int) -> Found:
    np.random.seed(seed)  # noqa: NPY002 - it draws from numpy's one global stream
    result = model.monte_carlo(samples=trials)
    interval = result.expand("angle", conf=0.95)
    return Found(float(result.uncertainty["angle"]), float(interval.low), float(interval.high))


def _propagated(model: Any) -> tuple[float, float]:
    result = model.calculate_gum()
    return float(result.expected["angle"]), float(result.uncertainty["angle"])


MONTE_CARLO: dict[str, MonteCarlo] = {
    "callable": lambda inputs, trials, seed, threads: _drawn(_callable(inputs), trials, seed),
    "expression": lambda inputs, trials, seed, threads: _drawn(_symbolic(inputs), trials, seed),
}
FIRST_ORDER: dict[str, FirstOrder] = {
    "callable": lambda inputs: _propagated(_callable(inputs)),
    "expression": lambda inputs: _propagated(_symbolic(inputs)),
}
