"""Block summaries pooled into estimates, with and without the control variate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.block_plan import LEAST_BLOCKS, BlockPlan
from mtu_cli.stats.blocks import BlockSummary
from mtu_cli.stats.tail_sums import TailSums

FloatArray = NDArray[np.float64]

GROUPS = 64
"""Groups of blocks for the control: their scatter tells its variance to a tenth or so."""


class Gain(NamedTuple):
    """Variance of the plain estimate over that of the estimate used, each (outputs,).

    From the scatter of the blocks; 1 where the plain estimate is used. With g, the same
    standard error would take g times as many trials without the control variate.
    """

    mean: FloatArray
    u: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimates:
    """Pooled estimates: each (outputs,), `covariance` (outputs, outputs)."""

    mean: FloatArray
    u: FloatArray
    low: FloatArray
    high: FloatArray
    se_mean: FloatArray
    se_u: FloatArray
    se_low: FloatArray
    se_high: FloatArray
    shortest_low: FloatArray
    shortest_high: FloatArray
    covariance: FloatArray
    gain: Gain


class _Controlled(NamedTuple):
    value: FloatArray
    variance: FloatArray
    gain: FloatArray
    slope: FloatArray


class Pool:
    """Running sums over blocks, added in the order of their numbers.

    Sums of statistics are taken about the first block's, so that their squares do not
    cancel; nothing here grows with the number of blocks.
    """

    _origin: FloatArray
    _mean: FloatArray
    _squares: FloatArray
    _count: NDArray[np.int64]
    _sums: FloatArray
    _lower: TailSums
    _upper: TailSums

    def __init__(self, plan: BlockPlan, u_exists: NDArray[np.bool_]) -> None:
        self.plan = plan
        self.u_exists = u_exists
        self.blocks = 0
        self.trials = 0

    def add(self, block: BlockSummary) -> None:
        """Takes in the next block."""
        if self.blocks == 0:
            self._start(block)
        else:
            # Chan, Golub & LeVeque 1983: sums of products of two samples into one.
            total = self.trials + block.count
            apart = block.statistics[0] - self._mean
            self._squares += block.squares
            self._squares += np.outer(apart, apart) * (self.trials * block.count / total)
            self._mean = self._mean + apart * (block.count / total)
        self.trials += block.count
        self.add_statistics(block)
        self._lower.add(block.lower, block.linear_lower)
        self._upper.add(block.upper, block.linear_upper)

    def add_statistics(self, block: BlockSummary) -> None:
        """Takes in what `gain` alone needs of the next block."""
        if self.blocks == 0:
            self._origin = block.statistics
            self._count = np.zeros(GROUPS, dtype=np.int64)
            self._sums = np.zeros((5, GROUPS, *block.statistics.shape))
        self.blocks += 1
        away = block.statistics - self._origin
        c = np.zeros_like(away) if block.controls is None else block.controls
        group = (self.blocks - 1) % GROUPS
        self._count[group] += 1
        self._sums[:, group] += np.array([away, away * away, c, c * c, away * c])

    def _start(self, block: BlockSummary) -> None:
        self._mean = block.statistics[0]
        self._squares = block.squares.copy()
        self._lower, self._upper = TailSums(block.lower), TailSums(block.upper)

    def estimates(self) -> Estimates:
        """Estimates and their standard errors from all blocks so far (at least two).

        mean and covariance with divisor n - 1 over all trials where no control is used
        (JCGM 101:2008, 7.6, eq. (16) and (17)); interval ends as averages over blocks
        (7.9.4); standard errors from the scatter of the blocks, s/sqrt(h).
        """
        fit = self._controlled()
        plain_covariance = self._squares / (self.trials - 1)
        plain = np.array([self._mean, np.diagonal(plain_covariance), fit.value[2], fit.value[3]])
        mean, variance, low, high = np.where(fit.slope == 0.0, plain, fit.value)
        u = np.where(self.u_exists, np.sqrt(np.maximum(variance, 0.0)), np.nan)
        se = np.sqrt(fit.variance)
        se_u = np.divide(se[1], 2.0 * u, out=np.zeros_like(u), where=u != 0.0)
        shortest_low, shortest_high = self._shortest(low, high)
        return Estimates(
            mean=mean,
            u=u,
            low=low,
            high=high,
            # Without a variance the scatter of block means says nothing about their error.
            se_mean=np.where(self.u_exists, se[0], np.nan),
            se_u=se_u,
            se_low=se[2],
            se_high=se[3],
            shortest_low=shortest_low,
            shortest_high=shortest_high,
            covariance=rescaled(plain_covariance, u),
            gain=Gain(*fit.gain),
        )

    def gain(self) -> Gain:
        """The gain alone of `estimates`."""
        return Gain(*self._controlled().gain)

    def _controlled(self) -> _Controlled:
        """Each statistic with and without its control; the one of less variance is used.

        Plain: the blocks' average with s_ss/(h (h - 1)). Controlled: group g of blocks gives
        Y_g = s_g - beta_g c_g with beta_g = S_sc/S_cc over the blocks outside the group, so
        that beta_g and c_g are independent and E Y_g = E s whatever their joint distribution
        (splitting; Avramidis & Wilson 1993). A slope from all blocks would have a bias of
        half a standard error where s is a curved function of c. The variance is that of the
        Y_g, sum n_g^2 (Y_g - Y)^2 G/(G - 1)/h^2.
        """
        h, count = self.blocks, self._count
        groups = np.flatnonzero(count)
        n = count[groups][:, np.newaxis, np.newaxis]
        s, ss, c, cc, sc = (sums[groups] for sums in self._sums)
        total_s, total_c = s.sum(axis=0), c.sum(axis=0)
        plain = np.maximum(ss.sum(axis=0) - total_s**2 / h, 0.0) / (h * (h - 1))
        rest_c, rest_s, rest = total_c - c, total_s - s, h - n
        s_cc = cc.sum(axis=0) - cc - rest_c**2 / rest
        s_sc = sc.sum(axis=0) - sc - rest_s * rest_c / rest
        usable = np.all(s_cc > 0.0, axis=0) & (h >= LEAST_BLOCKS)
        usable[:2] &= self.u_exists
        slope = np.divide(s_sc, s_cc, out=np.zeros_like(s_sc), where=usable)
        adjusted = s - slope * c
        value = adjusted.sum(axis=0) / h
        scatter = ((adjusted - n * value) ** 2).sum(axis=0) / h**2
        variance = scatter * (len(groups) / max(len(groups) - 1, 1))
        better = usable & (variance < plain)
        # Rounding leaves no less of the scatter than this, whatever the difference says.
        variance = np.maximum(variance, np.finfo(np.float64).eps ** 2 * plain)
        variance = np.where(better, variance, plain)
        gain = np.divide(plain, variance, out=np.ones_like(plain), where=better & (variance > 0.0))
        value = self._origin + np.where(better, value, total_s / h)
        return _Controlled(value, variance, gain, np.where(better, slope.mean(axis=0), 0.0))

    def _shortest(
        self, symmetric_low: FloatArray, symmetric_high: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Shortest interval from the block averages of the ordered values.

        JCGM 101:2008, 7.7.2: among the intervals from y_(r) to y_(r+q) the one of least width.
        Averages of ordered values stand for y_(r), and p (m + 1) for q, between ranks. Of short
        blocks they only say how far its ends are from those of the symmetric one, which have no
        bias.
        """
        plan = self.plan
        lower, upper = self._lower.averages(self.blocks), self._upper.averages(self.blocks)
        low, high = np.empty(len(lower)), np.empty(len(upper))
        for i in range(len(lower)):
            rank, partner = _shortest_ranks(lower[i], upper[i], plan)
            low[i] = lower[i] @ plan.weights_at(rank)
            high[i] = upper[i] @ plan.weights_at(partner)
        if plan.is_short:
            low += symmetric_low - lower @ plan.end_weights
            high += symmetric_high - upper @ plan.end_weights
        return low, high


def _shortest_ranks(lower: FloatArray, upper: FloatArray, plan: BlockPlan) -> tuple[float, float]:
    """Ranks of the ends of the shortest interval, from below and from above."""
    ranks = np.arange(1, plan.tail + 1, dtype=np.float64)
    outside = (1.0 - plan.probability) * (plan.size + 1)
    inside = ranks <= outside - 1.0
    widths = np.interp(outside - ranks[inside], ranks, upper) - lower[inside]
    best = int(np.argmin(widths))
    rank = ranks[best]
    if 0 < best < len(widths) - 1:
        before, least, after = widths[best - 1 : best + 2]
        bend = before - 2.0 * least + after
        # The least of a smooth width lies between ranks; a parabola finds it to a tenth of one.
        rank += 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(rank), float(outside - rank)


def rescaled(covariance: FloatArray, u: FloatArray) -> FloatArray:
    """Covariance with the sample's correlations and the standard uncertainties `u`."""
    sample = np.sqrt(np.diagonal(covariance))
    ratio = np.divide(u, sample, out=np.where(np.isnan(u), np.nan, 1.0), where=sample > 0.0)
    scaled: FloatArray = covariance * np.outer(ratio, ratio)
    return scaled
