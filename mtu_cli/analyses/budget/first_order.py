"""The law of propagation of uncertainty, first and second order: JCGM 100:2008, 5.1.2 and 5.2."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.budget.inputs import Inputs
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.language import Node, names
from mtu_cli.language.derivative import PLACE, Derivatives, derivatives, taylor
from mtu_cli.stats.covariance import factor_of
from mtu_cli.stats.coverage import welch_satterthwaite
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstOrder:
    """One output: `value` y, `sensitivity` c (n,), `contribution` |c| u (n,), `u`, effective
    degrees of freedom `dof`.

    `share` (n,): c_i u_i sum_j r_ij c_j u_j / u^2, sums to 1; below 0 where a correlation
    makes u smaller. `second_value`, `second_u`: to the second order. nan where a derivative
    does not exist; `faults` says at which functions.
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
    faults: tuple[Finding, ...]


def first_order(loaded: LoadedBudget, inputs: Inputs) -> tuple[FirstOrder, ...]:
    """Every output of the budget.

    Raises InputError where an equation has no finite value at the estimates.
    """
    outputs, problems = [], []
    values = {item.name: item.value for item in inputs.quantities}
    for name, tree in loaded.trees.items():
        # Inputs without uncertainty are constants; an equation has few of the others.
        held = names(tree)
        rows = [i for i, x in enumerate(inputs.quantities) if x.u > 0.0 and x.name in held]
        slopes = derivatives(tree, values, [inputs.quantities[i].name for i in rows])
        if math.isfinite(slopes.value):
            # What overflows is inf or nan, and no uncertainty to the first order then exists.
            with np.errstate(over="ignore", under="ignore", invalid="ignore"):
                outputs.append(_output(name, tree, slopes, inputs, rows))
            continue
        what, at = "the equation", " at the estimates of its inputs"
        unknown = finding("no-finite-value", what=what, where=at)
        problems.append((*slopes.faults, unknown)[0].at(**loaded.where(name)))
    if problems:
        raise InputError(problems)
    return tuple(outputs)


def _output(
    name: str, tree: Node, slopes: Derivatives, inputs: Inputs, rows: Sequence[int]
) -> FirstOrder:
    g = np.zeros(len(inputs.quantities))
    g[rows] = slopes.first
    # Summed by sources, so that a variance of 0 is 0 and not what rounding leaves.
    variances = [source.variance(g) for source in inputs.sources]
    variance, dof = math.fsum(variances), math.nan
    if math.isfinite(variance):
        dofs = [source.dof(g) for source in inputs.sources]
        dof = welch_satterthwaite(np.array(variances), np.array(dofs))
    shift, more = _second_order(tree, slopes, inputs, rows)
    joint = g * (inputs.covariance @ g)
    return FirstOrder(
        name=name,
        value=slopes.value,
        sensitivity=g,
        contribution=np.abs(g) * inputs.u,
        u=math.sqrt(variance),
        dof=dof,
        share=joint / variance if variance > 0.0 else np.full(len(g), math.nan),
        second_value=slopes.value + shift,
        second_u=math.sqrt(variance + more) if variance + more >= 0.0 else math.nan,
        faults=slopes.faults,
    )


def _second_order(
    tree: Node, slopes: Derivatives, inputs: Inputs, rows: Sequence[int]
) -> tuple[float, float]:
    """What the second order adds to the value and to the variance.

    For jointly normal inputs of covariance V, gradient g, Hessian H:
    shift = tr(HV)/2, variance = g'Vg + tr(HVHV)/2 + sum_j (Vg)_j d/dx_j tr(HV). For independent
    inputs the last two are the terms of JCGM 100:2008, 5.1.2, note:
    sum_ij (f_ij^2/2 + f_i f_ijj) u_i^2 u_j^2. Where an input's own distribution has another
    fourth moment than a normal one (kappa its fourth cumulant) f_ii^2 kappa/4 + f_i f_iii kappa/3
    is added: x^2 at 0 has u = 0.89 u^2(x) for a rectangle, not 1.41.
    """
    members = [inputs.quantities[i] for i in rows]
    g, H, V = slopes.first, slopes.second, inputs.covariance[np.ix_(rows, rows)]
    HV = H @ V
    u = np.array([item.u for item in members])
    kappa = np.array([item.excess for item in members])
    # Products of small numbers with large ones, in an order in which neither leaves the range.
    bent, twisted = np.diag(H) * u * u, slopes.third * u * u * u
    own = float(np.sum(kappa * (bent**2 / 4.0 + g * u * twisted / 3.0)))
    more = 0.5 * float(np.sum(HV * HV.T)) + own
    along = V @ g
    if not np.all(np.isfinite(along)):
        return 0.5 * float(np.trace(HV)), math.nan
    if np.any(along):
        # The derivative of tr(HV) along Vg: V = F F', so that it is a sum over the columns of F.
        F = factor_of(V)
        moved = np.stack([np.repeat(along[:, None], F.shape[1], axis=1), F])
        values = {item.name: item.value for item in inputs.quantities}
        directions = {item.name: moved[:, i] for i, item in enumerate(members)}
        coefficients, _ = taylor(tree, values, directions.get, F.shape[1])
        more += 2.0 * float(np.sum(coefficients[PLACE[1, 2]]))
    return 0.5 * float(np.trace(HV)), more
