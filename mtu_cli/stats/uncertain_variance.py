"""Tests against a variance that is itself a sum of mean squares of few degrees of freedom.

A mean square MS of nu degrees of freedom says of its expectation that it is MS nu/W, W a
chi-squared of nu: the t distribution of JCGM 101:2008, 6.4.9, is a normal one of that variance.
A sum sum_k c_k MS_k of independent ones is distributed as sum_k c_k MS_k nu_k/W_k, of which
the tails of t (Behrens and Fisher's) and F follow. With one mean square these are Student's
and Fisher's own; with several they do not reject too often, where Welch and Satterthwaite's
effective degrees of freedom do.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import chdtr, chdtrc, gammaincinv, ndtr

from mtu_cli.stats.coverage import welch_satterthwaite
from mtu_cli.stats.least_squares import FloatArray, quotient

AT_ONCE = 8
"""Variances at a time: the pairs of their sums stay in the processor's cache."""
MANY = 30.0
"""From so many degrees of freedom on Welch and Satterthwaite's formula does no harm."""
STEPS = 80
"""Halvings of a bracket that spans less than exp(60) to a part in 1e-10."""
BRACKET, FAR = 30.0, 1e6
NEAR = 1e-3
"""Standard deviations from the mean at which the formula is 0/0 but for its limit."""
NODES = 64
REACH = 6.0
"""Nodes NORMAL, from -REACH to REACH standard deviations of the normal scale, of WEIGHT."""
STEP = 2 * REACH / (NODES - 1)
NORMAL = np.linspace(-REACH, REACH, NODES)
WEIGHT = np.exp(-(NORMAL**2) / 2) / np.exp(-(NORMAL**2) / 2).sum()
EDGES = ndtr(np.linspace(-REACH, REACH - STEP, NODES - 1) + STEP / 2)
"""Shares of the normal scale up to half way between two nodes."""


class UncertainVariance(NamedTuple):
    """What mean squares tell of m variances: `values` with `weights`, each (m, nodes)."""

    values: FloatArray
    weights: FloatArray


def uncertain_variance(
    squares: FloatArray, dof: FloatArray, *terms: tuple[FloatArray, FloatArray]
) -> UncertainVariance:
    """The distribution of sums of mean squares `squares` (K, m) of `dof` (K,), inf if known, and of
    `terms`, with degrees of freedom by item, each (m,).

    Negative entries (differences of mean squares) are taken off the others in proportion; a
    sum below 0 is 0.
    """
    for values, df in terms:
        numbers = np.unique(df[(values > 0) & (df > 0)])
        squares = np.vstack([squares, np.where(df == numbers[:, None], values, 0.0)])
        dof = np.append(dof, numbers)
    total, positive = squares.sum(axis=0), np.maximum(squares, 0.0)
    whole = positive.sum(axis=0)
    share = quotient(np.maximum(total, 0.0), whole, 0.0)
    nodes = [
        _convolution(rows, dof)
        for rows in np.array_split(positive * share, len(whole) // AT_ONCE + 1, axis=1)
    ]
    return UncertainVariance(*map(np.concatenate, zip(*nodes, strict=True)))


def f_tails(
    mean_square: FloatArray, dof: FloatArray, variance: UncertainVariance
) -> tuple[FloatArray, FloatArray]:
    """P (m,) that a mean square (m,) of `dof` (m,) and such expectation is larger, and smaller: of
    the square of a normal deviation, with one degree of freedom, that it is larger either way.

    nan where there is no mean square, or 0 against 0; a scatter where none is expected has
    (0, 1).
    """
    d = np.where(dof > 0, dof, np.nan)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        x = d * mean_square[:, None] / variance.values
    high, low = (np.einsum("mn,mn->m", tail(d, x), variance.weights) for tail in (chdtrc, chdtr))
    return high, low


def _convolution(c: FloatArray, dof: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights (m, NODES) of sum_k c_k nu_k/W_k, one mean square after the other."""
    many = dof >= MANY
    values, weights = np.zeros((c.shape[1], NODES)), np.tile(WEIGHT, (c.shape[1], 1))
    if many.any():
        # As one (JCGM 100, G.4.1).
        nu = welch_satterthwaite(c[many], dof[many])
        values = c[many].sum(axis=0)[:, None] * _inverse_chi_squared(nu)
    for row, nu in zip(c[~many], dof[~many], strict=True):
        positive = np.flatnonzero(row > 0)
        if not len(positive):
            continue
        term = row[positive, None] * _of_dof(float(nu))
        alone = (values[positive] == 0).all(axis=1)
        values[positive[alone]] = term[alone]
        pairs = positive[~alone]
        if len(pairs):
            sums = values[pairs, :, None] + term[~alone, None, :]
            values[pairs], weights[pairs] = _merge(sums, weights[pairs, :, None] * WEIGHT)
    return values, weights


@lru_cache(256)
def _of_dof(nu: float) -> FloatArray:
    """nu/W (1, nodes): most of the time of a sum where it is made anew."""
    return _inverse_chi_squared(np.full(1, nu))


def _inverse_chi_squared(dof: FloatArray) -> FloatArray:
    """nu/W (m, nodes) at the nodes of the normal scale, from its smallest value to its largest."""
    distinct, index = np.unique(np.minimum(dof, 1e9), return_inverse=True)
    nu = distinct[:, None]
    result: FloatArray = nu / (2 * gammaincinv(nu / 2, ndtr(-NORMAL)))
    return np.where(np.isinf(dof)[:, None], 1.0, result[index])


def _merge(sums: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """All pairs (m, NODES, NODES) in the order of their sum; what lies between two quantiles of
    the normal scale becomes one node at its geometric mean.
    """
    m = len(sums)
    pairs, w = sums.reshape(m, -1), weights.reshape(m, -1)
    order = np.argsort(pairs, axis=1, kind="stable")
    pairs, w = (np.take_along_axis(each, order, 1) for each in (pairs, w))
    middle = np.cumsum(w, axis=1) - w / 2
    node = np.searchsorted(EDGES, middle) + NODES * np.arange(m)[:, None]
    total, logs = (
        np.bincount(node.ravel(), each.ravel(), NODES * m).reshape(m, NODES).astype(np.float64)
        for each in (w, w * np.log(pairs))
    )
    return np.exp(quotient(logs, total, 0.0)), total


def mean_square_tails(
    mean_square: float, sizes: FloatArray, dof: float, variance: UncertainVariance
) -> tuple[float, float]:
    """P that a mean of squares whose eigenvalues are `sizes` (n,), 0 or more, each of `dof` degrees
    of freedom, is larger, and smaller, than `mean_square`, its expectation being such a `variance`
    (of one measurand): `f_tails` for squares that are not all alike.

    Of the sum of chi-squared variables by the saddlepoint of K(z) = -(dof/2) sum log(1 - 2 z
    sizes), as Kuonen (Biometrika 86 (1999) 929) has it, with r* for Lugannani and Rice's formula:
    to some percent of the smaller tail.
    """
    sizes = sizes[sizes > 0] / (dof * sizes.sum())
    largest = float(sizes.max())
    share = sizes / largest
    # Beyond that a tail is 0, and cannot be calculated with.
    target = np.clip(mean_square / variance.values[0], FAR**-2, FAR) / (dof * largest)
    # u with sum share/(1 + (u - 1) share) = target, which falls as u grows.
    low, high = np.full(len(target), -BRACKET), np.full(len(target), BRACKET)
    for _ in range(STEPS):
        middle = (low + high) / 2
        value = (share / (1.0 + (np.exp(middle)[:, None] - 1.0) * share)).sum(axis=1)
        low, high = np.where(value > target, middle, low), np.where(value > target, high, middle)
    u = np.exp((low + high) / 2)
    # 1 - 2 z sizes, z the saddlepoint.
    factors = 1.0 + (u[:, None] - 1.0) * share
    z = (1.0 - u) / (2.0 * largest)
    K = -0.5 * dof * np.log(factors).sum(axis=1)
    second = 2.0 * dof * ((sizes / factors) ** 2).sum(axis=1)
    w = np.sign(z) * np.sqrt(np.maximum(2.0 * (z * target * dof * largest - K), 0.0))
    near = np.abs(w) < NEAR
    safe = np.where(near, 1.0, w)
    ratio = np.where(near, 1.0, z * np.sqrt(second)) / safe
    skewness = 8.0 * dof * (sizes**3).sum() / (2.0 * dof * (sizes**2).sum()) ** 1.5
    r = w + np.where(near, skewness / 6.0, np.log(np.where(near, 1.0, ratio)) / safe)
    return float(ndtr(-r) @ variance.weights[0]), float(ndtr(r) @ variance.weights[0])


def pooled_p(
    ratios: FloatArray, correlation: FloatArray, shared: FloatArray, variance: UncertainVariance
) -> float:
    """Two-sided p of the mean T of m `ratios` of mean squares to their expectations, T of such an
    expected `variance`.

    Of normal errors T is a sum of chi-squared variables whose sizes are the eigenvalues of the
    `correlation` (m, m) of what the mean squares are of; where items have unequal numbers of these
    its degrees of freedom are those that give its variance, the mean of `shared` (m, m), the
    covariance of any two ratios if the expectations are right.
    """
    sizes = np.maximum(np.linalg.eigvalsh(correlation), 0.0)
    dof = 2.0 * float((correlation**2).mean() / shared.mean())
    tails = mean_square_tails(float(ratios.mean()), sizes, dof, variance)
    return min(2 * min(tails), 1.0)
