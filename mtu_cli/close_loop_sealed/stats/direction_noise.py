"""How far parts go along a direction, their turn or growth, by what is known to scatter them.

With t (P - 1) the contrasts of the parts along a direction w and sources of variance v_a, entries
along axis a and the machine's own scatter of parts, the sum of squares t't has the mean
sum_a v_a tr S_a and the variance 2 sum_ab v_a v_b tr S_a S_b, S_a the covariance of t for v_a = 1
(normal errors). In a complete table every S_a is a multiple of the identity; in an incomplete
one parts with fewer entries go farther by these, and less far by the machine's scatter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from mtu_cli.close_loop_sealed.stats.crossed import Completion, Freeing
from mtu_cli.close_loop_sealed.stats.design_inputs import (
    MOST,
    Inputs,
    Turned,
    coordinates,
    entry_and_column_inputs,
    part_inputs,
    signs,
    turning,
)
from mtu_cli.close_loop_sealed.stats.mean_squares import of_parts
from mtu_cli.close_loop_sealed.stats.scatter_tests import MANY
from mtu_cli.close_loop_sealed.stats.strata import Strata
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.uncertain_variance import uncertain_variance

TINY = 1e-300


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionNoise:
    """Of one direction: `mean` (A + 1,) tr S_a and `products` (A + 1, A + 1) tr S_a S_b, last the
    machine's scatter as predicted.
    """

    mean: FloatArray
    products: FloatArray

    def p(
        self, square: float, variance: FloatArray, dof: FloatArray, predicted_dof: float
    ) -> float:
        """p (one-sided) of the sum of squares `square` of t, where entries have the `variance`
        (A,), estimated with `dof` (A,), and the machine's scatter is known by `predicted_dof`.

        Numerator and denominator each have the degrees of freedom of their first two moments
        (Satterthwaite), but that the machine's scatter is what its mean square may stand for
        (`uncertain_variance`): passes that showed little of it by chance leave no trace in moments
        of how few they are.
        """
        v = np.append(variance, 1.0)
        own = v * self.mean
        expected, twice = float(own.sum()), float(v @ self.products @ v)
        if square <= 0 or expected <= 0:
            return 1.0
        known = uncertain_variance(own[-1:, np.newaxis], np.array([predicted_dof]))
        total = np.maximum(own[:-1].sum() + known.values[0], TINY)
        spread = np.maximum((own[:-1] ** 2 / dof).sum(), total**2 / MANY)
        n = expected**2 / max(twice, TINY)
        tails = fdtrc(n, total**2 / spread, square / total)
        return float(tails @ known.weights[0])


def direction_noise(
    strata: Strata,
    completion: Completion,
    freeing: Freeing | None,
    directions: FloatArray,
    predicted: FloatArray,
) -> tuple[DirectionNoise, ...]:
    """For `directions` (D, A, 1 + k) of a table freed by `freeing` and filled in by `completion`,
    every entry passed on, and every part as the machine scatters it: `predicted` (d, d), d =
    A (1 + k), is the covariance of a part's coordinates by that.
    """
    if completion.complete and freeing is None:
        return _complete_noise(strata, directions, predicted)
    turned = turning(strata, completion, freeing)
    flat = directions.reshape(len(directions), -1)
    entries, n = entry_and_column_inputs(strata, completion.observed)[0]
    t = _contrasts(strata, turned, entries, signs(n), flat)
    parts, scatter = strata.shape[0], None
    if parts <= MOST:
        own = _contrasts(strata, turned, part_inputs(strata), np.eye(parts), flat)
        scatter = np.einsum("pkci,kj->pjci", own, covariance_root(predicted))
    found = []
    for i, w in enumerate(flat):
        noise = _of_contrasts(t[..., i], whole=n <= MOST)
        if scatter is None:
            level = float(w @ predicted @ w)
            found.append(_with_level(*noise, level, parts - 1))
        else:
            rows = scatter[..., i].reshape(-1, parts - 1)
            S = rows.T @ rows
            found.append(_with_scatter(*noise, t[..., i], S))
    return tuple(found)


def _contrasts(
    strata: Strata, turned: Turned, inputs: Inputs, of: FloatArray, directions: FloatArray
) -> FloatArray:
    """(m, J, P - 1, D): what inputs with the signs `of` (m, n) do along `directions` (D, d)."""
    found = [of_parts(strata, y) @ directions.T for y in coordinates(strata, turned, inputs, of)]
    return np.concatenate(found)


def _complete_noise(
    strata: Strata, directions: FloatArray, predicted: FloatArray
) -> tuple[DirectionNoise, ...]:
    """Of a complete table."""
    n = strata.shape[0] - 1
    found = []
    for w in directions:
        own, level = (w**2).sum(axis=1), float(w.ravel() @ predicted @ w.ravel())
        found.append(_with_level(n * own, n * np.outer(own, own), level, n))
    return tuple(found)


def _with_level(
    mean: FloatArray, products: FloatArray, level: float, contrasts: int
) -> DirectionNoise:
    """Beside a scatter of the same variance `level` of every contrast: of very many parts, few of
    which show less, also where cells are missing.
    """
    return _joined(mean, products, level * contrasts, level * mean, level**2 * contrasts)


def _with_scatter(
    mean: FloatArray, products: FloatArray, t: FloatArray, S: FloatArray
) -> DirectionNoise:
    """Beside a scatter of the covariance S (P - 1, P - 1), t (m, A, P - 1) those of the entries."""
    crossed = np.einsum("map,pq,maq->a", t, S, t, optimize=True)
    return _joined(mean, products, float(np.trace(S)), crossed, float((S**2).sum()))


def _joined(
    mean: FloatArray, products: FloatArray, own: float, crossed: FloatArray, square: float
) -> DirectionNoise:
    beside = np.block([[products, crossed[:, None]], [crossed[None], np.full((1, 1), square)]])
    return DirectionNoise(mean=np.append(mean, own), products=beside)


def _of_contrasts(t: FloatArray, *, whole: bool) -> tuple[FloatArray, FloatArray]:
    """tr S_a (A,) and tr S_a S_b (A, A) of contrasts t (m, A, P - 1) of all entries along each
    axis, or of `m` sums of them with random signs.
    """
    m = len(t)
    mean = (t**2).sum(axis=(0, 2))
    if whole:
        S = np.einsum("map,maq->apq", t, t, optimize=True)
        return mean, np.einsum("apq,bpq->ab", S, S)
    # Two sums are independent, a sum of itself is not.
    squares = np.einsum("map,nbp->abmn", t, t, optimize=True) ** 2
    squares *= (1 - np.eye(m)) * m / (m - 1)
    return mean, squares.sum(axis=(2, 3))
