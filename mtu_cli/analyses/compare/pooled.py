"""The pooled scatter of many items: what no single item shows may be seen in all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.model.variance import MeanSquares, PassSquare
from mtu_cli.stats.anova import OneWay
from mtu_cli.stats.chi_squared_sum import mean_square_tails
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.uncertain_variance import uncertain_variance

FEWEST = 2
"""Items that are more than one."""


class Joint(NamedTuple):
    """How m items are predicted to scatter together: their `covariance` (m, m), mm^2, the mean
    `squares` behind it and those of them that are of `passes`.
    """

    covariance: FloatArray
    squares: MeanSquares
    passes: Sequence[PassSquare | None]

    def only(self, kept: NDArray[np.bool_]) -> Joint:
        """The same of the items `kept` (m,)."""
        of_mean, of_part = self.squares.of_mean[:, kept], self.squares.of_part[:, kept]
        passes = [own and PassSquare(own.g[kept], own.S) for own in self.passes]
        squares = MeanSquares(of_mean=of_mean, of_part=of_part, dof=self.squares.dof)
        return Joint(self.covariance[np.ix_(kept, kept)], squares, passes)


@dataclass(frozen=True, slots=True, kw_only=True)
class PooledTest:
    """One test of the scatter of `items`: `ratio`, the scatter from part to part over the predicted
    one, two-sided `p`, and `p_hopeless`, that of the scatter that any test should see.
    """

    items: int
    ratio: float
    p: float
    p_hopeless: float


@dataclass(frozen=True, kw_only=True)
class PooledItems:
    """The m items of one operation whose scatter can be tested: `ratio` MS_between/expectation, the
    `correlation` (m, m) of the means of one part and `shared` (m, m), the covariance of any two of
    these ratios if the expectations are right.

    An expectation is 1 = `weights` (m,) times what the mean squares of `joint` predict of a part,
    and `within`, the share of the CMM, which has `within_dof`.
    """

    operation: str
    ratio: FloatArray
    correlation: FloatArray
    shared: FloatArray
    joint: Joint
    weights: FloatArray
    within: FloatArray
    within_dof: FloatArray
    hopeless: float

    @cached_property
    def test(self) -> PooledTest | None:
        """The mean ratio T of the items; None of fewer than two.

        Of normal errors T is a sum of chi-squared variables whose sizes are the eigenvalues of the
        correlation; where items lack parts its degrees of freedom are those that give its variance,
        the mean of `shared`. A mean square of passes is one matrix at all items, one of
        repeatability is as far off at all of them, the CMM's is estimated at each by itself.
        `p_hopeless` is that of a scatter `hopeless` times the predicted one. Less the CMM's share w
        T is of the parts alone: `ratio`^2 = (T - w)/(1 - w).
        """
        m = len(self.ratio)
        if m < FEWEST:
            return None
        T, w = float(self.ratio.mean()), float(self.within.mean())
        sizes = np.maximum(np.linalg.eigvalsh(self.correlation), 0.0)
        dof = 2.0 * float((self.correlation**2).mean() / self.shared.mean())
        variance = uncertain_variance(*self._expected())
        high, low = mean_square_tails(T, sizes, dof, variance)
        far, _ = mean_square_tails(self.hopeless**2, sizes, dof, variance)
        return PooledTest(
            items=m,
            ratio=float(np.sqrt(max(T - w, 0.0) / (1 - w))),
            p=min(2 * min(high, low), 1.0),
            p_hopeless=2 * far,
        )

    def _expected(self) -> tuple[FloatArray, FloatArray]:
        """The mean squares (K, 1) that the expectation of T consists of, and their degrees of
        freedom (K,).
        """
        weights, joint, within = self.weights, self.joint, self.within
        more = [1.0 if own is None else own.independent(weights) for own in joint.passes]
        of_cmm = within > 0
        spread = float((within[of_cmm] ** 2 / self.within_dof[of_cmm]).sum())
        cmm = float(within.sum()) ** 2 / spread if spread > 0 else np.inf
        squares = np.append((joint.squares.of_part * weights).mean(axis=1), within.mean())
        return squares[:, None], np.append(joint.squares.dof * np.array(more), cmm)


def pooled_items(
    operation: str,
    own: NDArray[np.intp],
    expected: FloatArray,
    table: OneWay,
    joint: Joint,
    hopeless: float,
) -> PooledItems:
    """The items at `own` (m,) of a `table`, of which MS_between is `expected` (m,), mm^2."""
    df, weights = table.df_between[own], table.n0[own] / expected
    apart = table.df_within[own] > 0
    # Of part means relative to their variance; the CMM is in the variances alone.
    alike = joint.covariance * np.sqrt(weights * weights[:, None])
    np.fill_diagonal(alike, 1.0)
    return PooledItems(
        operation=operation,
        ratio=table.ms_between[own] / expected,
        correlation=alike,
        shared=2.0 * alike**2 / np.maximum(df, df[:, None]),
        joint=joint,
        weights=weights,
        within=np.where(apart, table.ms_within[own], 0.0) / expected,
        within_dof=np.where(apart, table.df_within[own], np.inf),
        hopeless=hopeless,
    )
