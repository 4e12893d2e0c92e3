"""The law of propagation of uncertainty, first and second order: JCGM 100:2008, 5.1.2 and 5.2."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.budget.correlation import factor_of
from mtu_cli.analyses.budget.quantities import InputQuantity
from mtu_cli.analyses.budget.sources import Source
from mtu_cli.analyses.budget.tails import Tail, long_tails
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.language import Node, names
from mtu_cli.language.derivative import PLACE, Derivatives, derivatives, taylor
from mtu_cli.stats.coverage import welch_satterthwaite
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.validation import Validation

EXTREME = 1e50
"""From here on, and below its reciprocal, an output is divided before it is squared."""
ROUNDED = 1e-16
LEAST_EXPONENT = -300


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstOrder:
    """One output: `value` y, `sensitivity` c (n,), `contribution` |c| u (n,), `u`, effective
    degrees of freedom `dof`.

    `share` (n,): c_i u_i sum_j r_ij c_j u_j / u^2, sums to 1; below 0 where a correlation
    makes u smaller. `second_value`, `second_u`: to the second order. nan where a derivative
    does not exist; `faults` says at which functions. `tails`: the sources of few degrees of
    freedom. `scale`: a power of ten by which the output is to be divided before anything
    of it is squared; 1 unless it is very large or very small.
    """

    name: str
    value: float
    sensitivity: FloatArray
    contribution: FloatArray
    u: float
    dof: float
    share: FloatArray
    second_value: float
    second_u: float
    tails: tuple[Tail, ...]
    faults: tuple[Finding, ...]
    scale: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputBudget:
    """One output: first order, its expanded uncertainty U = k u, and clause 8's verdict.

    `k_probability`: the factor for the coverage probability at the output's effective degrees
    of freedom; k itself is that, unless a factor is given.
    """

    first: FirstOrder
    unit: str
    k: float
    k_probability: float
    validation: Validation

    @property
    def expanded(self) -> float:
        """U = k u."""
        return self.k * self.first.u

    @property
    def interval(self) -> tuple[float, float]:
        """First-order interval y -+ k u for the coverage probability."""
        half = self.k_probability * self.first.u
        return self.first.value - half, self.first.value + half


def first_order(
    loaded: LoadedBudget,
    inputs: Sequence[InputQuantity],
    covariance: FloatArray,
    sources: Sequence[Source],
) -> tuple[FirstOrder, ...]:
    """Every output of the budget.

    Raises InputError where an equation has no finite value at the estimates.
    """
    found, problems = [], []
    for name, tree in loaded.trees.items():
        slopes = _derivatives(tree, inputs)
        if not math.isfinite(slopes.value):
            problems.append(_no_value(loaded, name, slopes))
            continue
        # What overflows is inf or nan, and no uncertainty to the first order then exists.
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            found.append(_output(name, tree, slopes, inputs, covariance, sources))
    if problems:
        raise InputError(problems)
    return tuple(found)


def _no_value(loaded: LoadedBudget, name: str, slopes: Derivatives) -> Finding:
    path = loaded.place(name)
    line = loaded.line_of(*path)
    where = ".".join(str(step) for step in path)
    if slopes.faults:
        return slopes.faults[0].at(file=loaded.source.shown, line=line, path=where)
    return finding(
        "no-value-here",
        operation="the equation",
        at="the estimates of its inputs",
        file=loaded.source.shown,
        line=line,
        path=where,
    )


def _derivatives(tree: Node, inputs: Sequence[InputQuantity]) -> Derivatives:
    """With respect to all inputs; those without uncertainty are constants. The others that the
    equation does not have are at no cost: a file may have thousands, an equation has few.
    """
    values = {item.name: item.value for item in inputs}
    uncertain = [item.name for item in inputs if item.u > 0.0]
    slopes = derivatives(tree, values, uncertain)
    n = len(inputs)
    rows = [i for i, item in enumerate(inputs) if item.u > 0.0]
    first, third, second = np.zeros(n), np.zeros(n), np.zeros((n, n))
    first[rows], third[rows] = slopes.first, slopes.third
    second[np.ix_(rows, rows)] = slopes.second
    return Derivatives(
        value=slopes.value, first=first, second=second, third=third, faults=slopes.faults
    )


def _scale(slopes: Derivatives, inputs: Sequence[InputQuantity]) -> float:
    """Power of ten near the largest |c_i| u_i, or near the rounding of the value if larger."""
    sizes = np.abs(slopes.first) * np.array([item.u for item in inputs])
    known = [float(size) for size in sizes if math.isfinite(size)]
    size = max([*known, ROUNDED * abs(slopes.value)])
    if size == 0.0 or 1.0 / EXTREME < size < EXTREME:
        return 1.0
    return 10.0 ** max(math.floor(math.log10(size)), LEAST_EXPONENT)


def _output(
    name: str,
    tree: Node,
    slopes: Derivatives,
    inputs: Sequence[InputQuantity],
    covariance: FloatArray,
    sources: Sequence[Source],
) -> FirstOrder:
    scale = _scale(slopes, inputs)
    g = slopes.first / scale
    joint = g * (covariance @ g)
    # Summed by sources, so that a variance of 0 is 0 and not what rounding leaves.
    variances = [source.variance(g) for source in sources]
    variance = math.fsum(variances)
    dof = math.nan
    if math.isfinite(variance):
        dof = welch_satterthwaite(
            np.array(variances), np.array([source.dof(g) for source in sources])
        )
    mean, second_variance = _second_order(tree, slopes, inputs, covariance, variance, scale)
    share = joint / variance if variance > 0.0 else np.full(len(g), math.nan)
    u = np.array([item.u for item in inputs])
    return FirstOrder(
        name=name,
        value=slopes.value,
        sensitivity=slopes.first,
        contribution=np.abs(slopes.first) * u,
        u=scale * math.sqrt(variance),
        dof=dof,
        share=share,
        second_value=slopes.value + scale * mean,
        second_u=scale * math.sqrt(second_variance) if second_variance >= 0.0 else math.nan,
        tails=long_tails(g, slopes.second / scale, math.sqrt(variance), inputs, sources),
        faults=slopes.faults,
        scale=scale,
    )


def _second_order(
    tree: Node,
    slopes: Derivatives,
    inputs: Sequence[InputQuantity],
    covariance: FloatArray,
    variance: float,
    scale: float,
) -> tuple[float, float]:
    """Shift of the mean and variance to the second order, of the output over `scale`.

    For jointly normal inputs of covariance V, gradient g, Hessian H:
    shift = tr(HV)/2, variance = g'Vg + tr(HVHV)/2 + sum_j (Vg)_j d/dx_j tr(HV). For independent
    inputs the last two are the terms of JCGM 100:2008, 5.1.2, note:
    sum_ij (f_ij^2/2 + f_i f_ijj) u_i^2 u_j^2. Where an input's own distribution has another
    fourth moment than a normal one (kappa its fourth cumulant) f_ii^2 kappa/4 + f_i f_iii kappa/3
    is added: x^2 at 0 has u = 0.89 u^2(x) for a rectangle, not 1.41.
    """
    held = names(tree)
    rows = np.array([i for i, item in enumerate(inputs) if item.name in held], dtype=np.intp)
    inputs = [inputs[i] for i in rows]
    g, third = slopes.first[rows] / scale, slopes.third[rows] / scale
    H, V = slopes.second[np.ix_(rows, rows)] / scale, covariance[np.ix_(rows, rows)]
    HV = H @ V
    shift = 0.5 * float(np.trace(HV))
    quadratic = 0.5 * float(np.sum(HV * HV.T))
    # Products of small numbers with large ones, in an order in which neither leaves the range.
    u = np.array([item.u for item in inputs])
    kappa = np.array([item.excess for item in inputs])
    bent, twisted = np.diag(H) * u * u, third * u * u * u
    own = float(np.sum(kappa * (bent**2 / 4.0 + g * u * twisted / 3.0)))
    rest = _third(tree, inputs, V, V @ g) / scale
    return shift, variance + quadratic + own + rest


def _third(
    tree: Node, inputs: Sequence[InputQuantity], covariance: FloatArray, along: FloatArray
) -> float:
    """The derivative of tr(HV) along Vg: V = F F', so that it is a sum over the columns of F."""
    if not np.any(along) or not np.all(np.isfinite(along)):
        return 0.0 if np.all(np.isfinite(along)) else math.nan
    F = factor_of(covariance)
    directions = np.stack([np.repeat(along[:, None], F.shape[1], axis=1), F])
    values = {item.name: item.value for item in inputs}
    ordered = [item.name for item in inputs]
    coefficients, _ = taylor(tree, values, ordered, directions)
    return 2.0 * float(np.sum(coefficients[PLACE[1, 2]]))
