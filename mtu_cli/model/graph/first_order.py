"""First-order uncertainty of a graph's outputs, and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.model.graph.measurement_graph import Evaluation
from mtu_cli.stats.least_squares import FloatArray

ROUNDING = 256 * float(np.finfo(np.float64).eps)
"""Share of the largest coordinate below which a difference is rounding, not a derivative."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstOrder:
    """n outputs, k inputs. `nominal` (n,), `sizes` (n,) of `Evaluation`, `gradient` (n, k) with
    respect to the inputs, `u` (n,) standard uncertainties, `shares`: of the variance of each output
    by source, (n,) each, nan where it is 0 (JCGM 100:2008, 5.1.2, and 5.2.2 for correlated inputs).
    """

    nominal: FloatArray
    sizes: FloatArray
    gradient: FloatArray
    u: FloatArray
    shares: dict[str, FloatArray]
    by_place: dict[str, FloatArray]


def first_order(evaluation: Evaluation) -> FirstOrder:
    """Central differences over one standard uncertainty of each input, all in one batch.

    (f(x + u_i e_i) - f(x - u_i e_i)) / (2 u_i), as JCGM 100:2008, 5.1.3, note 2, allows: exact
    for what is of second order in the inputs; it differs from the derivative by what is of third
    order in u over the dimensions of the part. Where one of both has no finite value it is 0, and
    the trials tell whether the output has one.
    """
    inputs = evaluation.inputs
    k = inputs.k
    X = np.repeat(inputs.mean[:, None], 2 * k + 1, axis=1)
    X[np.arange(k), 1 + np.arange(k)] += inputs.u
    X[np.arange(k), 1 + k + np.arange(k)] -= inputs.u
    with np.errstate(all="ignore"):
        values = evaluation.run(X)
        half = 0.5 * (values[:, 1 : k + 1] - values[:, k + 1 :])
    change = np.where(np.isfinite(half), half, 0.0)
    nominal = values[:, 0]
    floor = ROUNDING * np.maximum(np.abs(nominal), evaluation.sizes)
    change[np.abs(change) <= floor[:, None]] = 0.0
    gradient = np.divide(change, inputs.u, out=np.zeros_like(change), where=inputs.u > 0)
    with np.errstate(over="ignore", invalid="ignore"):
        variance = np.sum((gradient @ inputs.factor) ** 2, axis=1)
        shares, by_place = _shares(evaluation, gradient, variance)
    return FirstOrder(
        nominal=nominal,
        sizes=evaluation.sizes,
        gradient=gradient,
        u=np.sqrt(variance),
        shares=shares,
        by_place=by_place,
    )


def _shares(
    evaluation: Evaluation, gradient: FloatArray, variance: FloatArray
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """c C_s c' of the covariance C_s that each source has, over c C c'; by source and by place."""
    inputs = evaluation.inputs
    total = np.where(variance > 0, variance, np.nan)
    by_source: dict[str, FloatArray] = {}
    by_place: dict[str, FloatArray] = {}
    for item, rows in zip(inputs.noises, inputs.rows, strict=True):
        c = gradient[:, rows]
        for source, covariance in item.sources:
            part = np.einsum("ni,ij,nj->n", c, covariance, c) / total
            by_source[source] = by_source.get(source, 0.0) + part
            name = source if source in item.places else item.places[0]
            by_place[name] = by_place.get(name, 0.0) + part
    return by_source, by_place
