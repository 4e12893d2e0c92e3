"""The packages, in the forms in which each does the problem; imported where it is asked."""

import gc
import json
import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from peers_bench.problem import EXPRESSION, NAMES, Inputs, angle, predicted


@dataclass(frozen=True, kw_only=True)
class Tool:
    """`build` gives a package's model of the angle, `draw` (model, trials, seed) u and
    both ends of the 95 % interval by Monte Carlo; in the form that takes least time.
    """

    name: str
    build: Callable[[Inputs], Any]
    draw: Callable[[Any, int, int], tuple[float, ...]]

    @property
    def installed(self) -> str | None:
        """The version; None where it is not installed."""
        try:
            return version({"mtu": "mtu-cli", "bare": "numpy"}.get(self.name, self.name))
        except PackageNotFoundError:
            return None


# Only the random numbers: one thread of numpy (SFC64) into an array that stays in cache.


def bare_draw(inputs: Inputs, trials: int, seed: int) -> tuple[float, ...]:
    rng, chunk = np.random.Generator(np.random.SFC64(seed)), 8192
    block = np.empty((len(inputs.mean), chunk))
    for _ in range(trials // chunk):
        rng.standard_normal(out=block)
    rng.standard_normal(size=(len(inputs.mean), trials % chunk))
    return (math.nan,) * 3


# `mtu` by its own core: what `mtu orthogonality` does once the part's errors are predicted.

_predicted = cache(predicted)


def least() -> int:
    """The fewest trials with which the core uses its control variate."""
    from mtu_cli.stats.blocks import LEAST_BLOCKS, least_block
    from mtu_cli.stats.coverage import PROBABILITY

    return LEAST_BLOCKS * least_block(PROBABILITY, smooth=True)


def mtu_draw(_: Any, trials: int, seed: int) -> tuple[float, ...]:
    """Also the standard errors of the three that it states."""
    from mtu_cli.model.measurands import AngleTrials
    from mtu_cli.stats.coverage import PROBABILITY
    from mtu_cli.stats.monte_carlo import CONVERGED_TO, monte_carlo

    prediction, row, column = _predicted()
    model = AngleTrials(prediction, "angle", row, column, independent=True)
    found = monte_carlo(
        model, seed=seed, trials=trials, probability=PROBABILITY,
        tolerance_fraction=CONVERGED_TO, threads=1, keep=0,
    )  # fmt: skip
    names = ("u", "low", "high", "se_u", "se_low", "se_high")
    return tuple(float(getattr(found, name)[0]) for name in names)


def suncal_callable(inputs: Inputs) -> Any:
    from suncal import ModelCallable

    def f(**values: Any) -> Any:
        return angle([values[name] for name in NAMES])

    model = ModelCallable(f, names=["angle"], argnames=NAMES)
    for name, mean, u in zip(NAMES, *inputs, strict=True):
        model.var(name).measure(mean).typeb(std=u)
    return model


def suncal_draw(model: Any, trials: int, seed: int) -> tuple[float, ...]:
    np.random.seed(seed)  # noqa: NPY002 - it draws from numpy's one global stream
    result = model.monte_carlo(samples=trials)
    interval = result.expand("angle", conf=0.95)
    return float(result.uncertainty["angle"]), float(interval.low), float(interval.high)


def metrolopy_operators(inputs: Inputs) -> Any:
    import metrolopy

    return angle([metrolopy.gummy(x, u=u) for x, u in zip(*inputs, strict=True)])


def metrolopy_draw(y: Any, trials: int, seed: int) -> tuple[float, ...]:
    from metrolopy.distributions import Distribution

    Distribution.set_seed(seed)
    y.cimethod, y.p = "symmetric", 0.95
    y.sim(n=trials)
    return float(y.usim), float(y.cisim[0]), float(y.cisim[1])


def openturns_symbolic(inputs: Inputs) -> Any:
    import openturns

    normals = [openturns.Normal(x, u) for x, u in zip(*inputs, strict=True)]
    joint = openturns.RandomVector(openturns.JointDistribution(normals))
    function = openturns.SymbolicFunction(NAMES, [EXPRESSION])
    return openturns.CompositeRandomVector(function, joint)


def openturns_draw(y: Any, trials: int, seed: int) -> tuple[float, ...]:
    import openturns

    openturns.RandomGenerator.SetSeed(seed)
    sample = y.getSample(trials)
    low, high = sample.computeQuantile([0.025, 0.975])
    return float(sample.computeStandardDeviation()[0]), float(low[0]), float(high[0])


BARE = Tool(name="bare", build=lambda inputs: inputs, draw=bare_draw)
OURS = Tool(name="mtu", build=lambda _: None, draw=mtu_draw)
PEERS = (
    Tool(name="suncal", build=suncal_callable, draw=suncal_draw),
    Tool(name="metrolopy", build=metrolopy_operators, draw=metrolopy_draw),
    Tool(name="openturns", build=openturns_symbolic, draw=openturns_draw),
)
TOOLS = {tool.name: tool for tool in (BARE, OURS, *PEERS)}
Drawn = tuple[float, tuple[float, ...]]
"""Elapsed time, s; u, low, high, of `mtu` their standard errors, too."""


def begin() -> None:
    """At the start of a package's process: what the package prints is no output of ours."""
    os.dup2(2, 1)


def drawn(name: str, inputs: Path, trials: int, seed: int) -> Drawn:
    """One Monte Carlo from the inputs to u and the ends, in the package's own process."""
    tool, given = TOOLS[name], Inputs(*json.loads(inputs.read_text()))
    gc.collect()
    start = time.perf_counter()
    found = tool.draw(tool.build(given), trials, seed)
    return time.perf_counter() - start, found
