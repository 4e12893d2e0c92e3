"""The packages, in the forms in which each does the problem; imported where it is asked."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from peers_bench.problem import EXPRESSION, NAMES, Inputs, angle, predicted


@dataclass(frozen=True, kw_only=True)
class Tool:
    """`build` gives a package's model of the angle, `propagate` value and u of it to first order,
    `draw` (model, trials, seed, threads) u and both ends of the 95 % interval by Monte Carlo.

    `slow`: timed with a fifth of the trials, times five.
    """

    package: str
    form: str = ""
    build: Callable[[Inputs], Any]
    propagate: Callable[[Any], tuple[float, float]] | None = None
    draw: Callable[[Any, int, int, int | None], tuple[float, ...]] | None = None
    slow: bool = False

    @property
    def name(self) -> str:
        return f"{self.package} ({self.form})" if self.form else self.package

    @property
    def installed(self) -> str | None:
        """The version; None where it is not installed."""
        try:
            return version({"mtu": "mtu-cli", "bare": "numpy"}.get(self.package, self.package))
        except PackageNotFoundError:
            return None


# Only the random numbers: one thread of numpy (SFC64) into an array that stays in cache.


def bare_draw(inputs: Inputs, trials: int, seed: int, threads: int | None) -> tuple[float, ...]:
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


def mtu_draw(_: Any, trials: int | None, seed: int, threads: int | None) -> tuple[float, ...]:
    """Also the standard errors of the three that it states; `trials` None lets the count adapt."""
    from mtu_cli.analyses.orthogonality import angle_trials
    from mtu_cli.stats.coverage import PROBABILITY
    from mtu_cli.stats.monte_carlo import monte_carlo
    from mtu_cli.stats.validation import CONVERGED_TO

    prediction, row, column = _predicted()
    model = angle_trials("angle", row, column, prediction, independent=True)
    found = monte_carlo(
        model, seed=seed, trials=trials, probability=PROBABILITY,
        tolerance_fraction=CONVERGED_TO, threads=threads, keep=0,
    )  # fmt: skip
    names = ("u", "low", "high", "se_u", "se_low", "se_high")
    return tuple(float(getattr(found, name)[0]) for name in names)


def mtu_propagate(_: Any) -> tuple[float, float]:
    from mtu_cli.analyses.orthogonality import angle_trials

    prediction, row, column = _predicted()
    model = angle_trials("angle", row, column, prediction, independent=True)
    return float(model.linear_mean[0]), float(model.linear_u[0, 0])


def suncal_callable(inputs: Inputs) -> Any:
    from suncal import ModelCallable

    def f(**values: Any) -> Any:
        return angle([values[name] for name in NAMES])

    return _measured(ModelCallable(f, names=["angle"], argnames=NAMES), inputs)


def suncal_expression(inputs: Inputs) -> Any:
    from suncal import Model

    return _measured(Model(f"angle = {EXPRESSION}"), inputs)


def _measured(model: Any, inputs: Inputs) -> Any:
    for name, mean, u in zip(NAMES, *inputs, strict=True):
        model.var(name).measure(mean).typeb(std=u)
    return model


def suncal_draw(model: Any, trials: int, seed: int, _: int | None) -> tuple[float, ...]:
    np.random.seed(seed)  # noqa: NPY002 - it draws from numpy's one global stream
    result = model.monte_carlo(samples=trials)
    interval = result.expand("angle", conf=0.95)
    return float(result.uncertainty["angle"]), float(interval.low), float(interval.high)


def suncal_propagate(model: Any) -> tuple[float, float]:
    result = model.calculate_gum()
    return float(result.expected["angle"]), float(result.uncertainty["angle"])


def metrolopy_operators(inputs: Inputs) -> Any:
    import metrolopy

    return angle([metrolopy.gummy(x, u=u) for x, u in zip(*inputs, strict=True)])


def metrolopy_function(inputs: Inputs) -> Any:
    import metrolopy

    numbers = [metrolopy.gummy(x, u=u) for x, u in zip(*inputs, strict=True)]
    return metrolopy.gummy.napply(lambda *values: angle(values), *numbers)


def metrolopy_draw(y: Any, trials: int, seed: int, _: int | None) -> tuple[float, ...]:
    from metrolopy.distributions import Distribution

    Distribution.set_seed(seed)
    y.cimethod, y.p = "symmetric", 0.95
    y.sim(n=trials)
    return float(y.usim), float(y.cisim[0]), float(y.cisim[1])


def openturns_symbolic(inputs: Inputs) -> Any:
    import openturns

    return _output(openturns.SymbolicFunction(NAMES, [EXPRESSION]), inputs)


def openturns_python(inputs: Inputs) -> Any:
    import openturns

    def whole(sample: Any) -> Any:
        return angle(list(np.ascontiguousarray(np.asarray(sample).T)))[:, np.newaxis]

    return _output(openturns.PythonFunction(len(NAMES), 1, func_sample=whole), inputs)


def _output(function: Any, inputs: Inputs) -> Any:
    import openturns

    normals = [openturns.Normal(x, u) for x, u in zip(*inputs, strict=True)]
    joint = openturns.RandomVector(openturns.JointDistribution(normals))
    return openturns.CompositeRandomVector(function, joint)


def openturns_draw(y: Any, trials: int, seed: int, _: int | None) -> tuple[float, ...]:
    import openturns

    openturns.RandomGenerator.SetSeed(seed)
    sample = y.getSample(trials)
    low, high = sample.computeQuantile([0.025, 0.975])
    return float(sample.computeStandardDeviation()[0]), float(low[0]), float(high[0])


def openturns_propagate(y: Any) -> tuple[float, float]:
    import openturns

    moments = openturns.TaylorExpansionMoments(y)
    return float(moments.getMeanFirstOrder()[0]), math.sqrt(moments.getCovariance()[0, 0])


def gtc(inputs: Inputs) -> Any:
    from GTC import ureal

    return angle([ureal(x, u) for x, u in zip(*inputs, strict=True)])


def uncertainties_(inputs: Inputs) -> Any:
    from uncertainties import ufloat

    return angle([ufloat(x, u) for x, u in zip(*inputs, strict=True)])


BARE = Tool(package="bare", build=lambda inputs: inputs, draw=bare_draw)
OURS = Tool(package="mtu", build=lambda _: None, propagate=mtu_propagate, draw=mtu_draw)
ADAPTIVE = Tool(
    package="mtu",
    form="count adapts",
    build=lambda _: None,
    draw=lambda model, trials, seed, threads: mtu_draw(model, None, seed, threads),
)
PEERS = (
    Tool(package="suncal", form="callable", build=suncal_callable, propagate=suncal_propagate,
         draw=suncal_draw),
    Tool(package="suncal", form="expression", build=suncal_expression, propagate=suncal_propagate,
         draw=suncal_draw),
    Tool(package="metrolopy", form="operators", build=metrolopy_operators,
         propagate=lambda y: (y.x, y.u), draw=metrolopy_draw),
    Tool(package="metrolopy", form="function", build=metrolopy_function,
         propagate=lambda y: (y.x, y.u), draw=metrolopy_draw, slow=True),
    Tool(package="openturns", form="symbolic", build=openturns_symbolic,
         propagate=openturns_propagate, draw=openturns_draw),
    Tool(package="openturns", form="Python", build=openturns_python,
         propagate=openturns_propagate, draw=openturns_draw, slow=True),
    Tool(package="GTC", build=gtc, propagate=lambda y: (float(y.x), float(y.u))),
    Tool(package="uncertainties", build=uncertainties_,
         propagate=lambda y: (float(y.n), float(y.s))),
)  # fmt: skip
TOOLS = {tool.name: tool for tool in (BARE, OURS, ADAPTIVE, *PEERS)}
