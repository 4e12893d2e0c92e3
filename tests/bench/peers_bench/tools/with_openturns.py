"""openturns: a formula that it compiles, or a Python function of whole samples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import openturns

from peers_bench.problem import Found, Inputs, angle, expression
from peers_bench.tools import FirstOrder, MonteCarlo


def _symbolic(inputs: Inputs) -> Any:
    return openturns.SymbolicFunction(inputs.names, [expression(inputs.names)])


def _python(inputs: Inputs) -> Any:
    def whole(sample: Any) -> Any:
        return angle(list(np.ascontiguousarray(np.asarray(sample).T)))[:, np.newaxis]

    return openturns.PythonFunction(len(inputs.mean), 1, func_sample=whole)


def _output(function: Any, inputs: Inputs) -> Any:
    normals = [openturns.Normal(x, u) for x, u in zip(inputs.mean, inputs.u, strict=True)]
    joint = openturns.RandomVector(openturns.JointDistribution(normals))
    return openturns.CompositeRandomVector(function, joint)


def _drawn(y: Any, trials: int, seed: int) -> Found:
    openturns.RandomGenerator.SetSeed(seed)
    sample = y.getSample(trials)
    u = sample.computeStandardDeviation()[0]
    low, high = sample.computeQuantile([0.025, 0.975])
    return Found(float(u), float(low[0]), float(high[0]))


def _propagated(y: Any) -> tuple[float, float]:
    moments = openturns.TaylorExpansionMoments(y)
    return float(moments.getMeanFirstOrder()[0]), math.sqrt(moments.getCovariance()[0, 0])


MONTE_CARLO: dict[str, MonteCarlo] = {
    "symbolic": lambda i, trials, seed, threads: _drawn(_output(_symbolic(i), i), trials, seed),
    "Python": lambda i, trials, seed, threads: _drawn(_output(_python(i), i), trials, seed),
}
FIRST_ORDER: dict[str, FirstOrder] = {
    "symbolic": lambda inputs: _propagated(_output(_symbolic(inputs), inputs)),
    "Python": lambda inputs: _propagated(_output(_python(inputs), inputs)),
}
