"""How far parts go along a direction, their turn or growth, by the noise of single entries alone.

With t (P - 1) the contrasts of the parts along a direction w and entries of variance v_a along
axis a, the sum of squares t't has the mean sum_a v_a tr S_a and the variance
2 sum_ab v_a v_b tr S_a S_b, S_a the covariance of t for v_a = 1 (normal entries). In a complete
table S_a is |w_a|^2 times the identity; in an incomplete one parts with fewer entries go
farther.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.crossed import Completion, Freeing
from mtu_cli.stats.design_inputs import (
    coordinates,
    entry_and_column_inputs,
    signs,
    turning,
)
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mean_squares import of_parts
from mtu_cli.stats.scatter_tests import variance_ratio_p
from mtu_cli.stats.strata import Strata


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionNoise:
    """Of one direction: `mean` (A,) tr S_a and `products` (A, A) tr S_a S_b; `contrasts` P - 1."""

    mean: FloatArray
    products: FloatArray
    contrasts: int

    def p(
        self,
        square: float,
        variance: FloatArray,
        dof: FloatArray,
        predicted: float,
        predicted_dof: float,
    ) -> float:
        """p (one-sided) of the sum of squares `square` of t, where entries have the `variance`
        (A,), estimated with `dof` (A,), and every contrast `predicted` beside them.

        Numerator and denominator each have the degrees of freedom of their first two moments
        (Satterthwaite).
        """
        own, level = variance * self.mean, predicted * self.contrasts
        expected = float(own.sum()) + level
        twice = float(variance @ self.products @ variance)
        twice += predicted * (2 * float(own.sum()) + level)
        spread = float((own**2 / dof).sum()) + level**2 / predicted_dof
        tiny = 1e-300
        return variance_ratio_p(
            square, expected, expected**2 / max(twice, tiny), expected**2 / max(spread, tiny)
        )


def complete_noise(strata: Strata, directions: FloatArray) -> tuple[DirectionNoise, ...]:
    """Of a complete table, for `directions` (D, A, 1 + k)."""
    n = strata.shape[0] - 1
    sizes = (directions**2).sum(axis=2)
    return tuple(
        DirectionNoise(mean=n * own, products=n * np.outer(own, own), contrasts=n) for own in sizes
    )


def direction_noise(
    strata: Strata, completion: Completion, freeing: Freeing | None, directions: FloatArray
) -> tuple[DirectionNoise, ...]:
    """Of a table freed by `freeing` and filled in by `completion`: every entry passed on."""
    if completion.complete and freeing is None:
        return complete_noise(strata, directions)
    turned = turning(strata, completion, freeing)
    entries, n = entry_and_column_inputs(strata, completion.observed)[0]
    of = signs(n)
    flat = directions.reshape(len(directions), -1)
    found = [of_parts(strata, y) @ flat.T for y in coordinates(strata, turned, entries, of)]
    # (n, A, P - 1, D)
    t = np.concatenate(found)
    return tuple(_of_contrasts(t[..., i], whole=len(of) == n) for i in range(len(directions)))


def _of_contrasts(t: FloatArray, *, whole: bool) -> DirectionNoise:
    """Of contrasts t (m, A, P - 1) of all entries along each axis, or of `m` sums of them with
    random signs.
    """
    m, _, contrasts = t.shape
    mean = (t**2).sum(axis=(0, 2))
    # tr S_a S_b by the smaller of the two products of t_a and t_b.
    if whole and m >= contrasts:
        S = np.einsum("map,maq->apq", t, t, optimize=True)
        products = np.einsum("apq,bpq->ab", S, S)
    else:
        squares = np.einsum("map,nbp->abmn", t, t, optimize=True) ** 2
        if not whole:
            # Two sums are independent, a sum of itself is not.
            squares *= (1 - np.eye(m)) * m / (m - 1)
        products = squares.sum(axis=(2, 3))
    return DirectionNoise(mean=mean, products=products, contrasts=contrasts)
