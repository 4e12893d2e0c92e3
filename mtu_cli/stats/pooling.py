"""Estimates from trials: of blocks, with the first-order form as control variate; of one block,
JCGM 101:2008 to the letter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.blocks import LEAST_BLOCKS, QUANTILES, BatchSummary
from mtu_cli.stats.least_squares import BoolArray, FloatArray

GROUPS = 64
"""Groups of blocks for the control: their scatter tells its variance to a tenth or so."""
KNOWN = 1e-6
"""Share of the interval to which quantiles of a first-order form are known (`sum_quantile`): no end
is stated to be surer, be the output equal to its form."""
REACH = 2.0
"""Binomial standard deviations about an end's rank: the interval of 95 % for a quantile, whatever
the distribution (David & Nagaraja 2003, 7.1). The spread over one has half as many values in it
and is itself so unsure that two standard errors hold 92 % of the errors."""


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


MIDDLE = QUANTILES // 2
ENDS = np.array([0, 1, 2 + MIDDLE, 2 + QUANTILES + MIDDLE])
"""Mean, variance and the ends of the symmetric interval among a block's statistics."""


class Pool:
    """Running sums over blocks, added in the order of their numbers. Those of statistics are about
    the first block's, so that their squares do not cancel; nothing grows with the number of blocks.
    """

    _origin: FloatArray
    _shift: FloatArray
    _squares: FloatArray
    _sums: FloatArray
    _groups: FloatArray

    def __init__(self, u_exists: BoolArray) -> None:
        self.u_exists = u_exists
        self.blocks = 0
        self.trials = 0

    def add(self, batch: BatchSummary) -> None:
        """Takes in the next blocks."""
        if self.blocks == 0:
            self._origin = batch.statistics[0]
            self._shift, self._squares = np.zeros(len(self.u_exists)), np.zeros_like(batch.squares)
            self._sums = np.zeros((5, *self._origin.shape))
            self._groups = np.zeros((GROUPS, 5, len(ENDS), len(self.u_exists)))
        deviations, c = batch.statistics - self._origin, batch.controls
        means = deviations[:, 0]
        self._shift += batch.size * means.sum(axis=0)
        self._squares += batch.squares + batch.size * (means.T @ means)
        products = np.stack([deviations, deviations * deviations, c, c * c, deviations * c], axis=1)
        self._sums += products.sum(axis=0)
        groups = np.arange(self.blocks, self.blocks + len(c)) % GROUPS
        np.add.at(self._groups, groups, products[:, :, ENDS])
        self.trials += batch.size * len(c)
        self.blocks += len(c)

    def estimates(self) -> Estimates:
        """Estimates and their standard errors from all blocks so far (at least two): mean and
        covariance with divisor n - 1 over all trials where no control is used (JCGM 101:2008, 7.6,
        eq. (16) and (17)); interval ends as averages over blocks (7.9.4); standard errors
        s/sqrt(h).
        """
        value, of_value, slope = self._controlled()
        shift = self._shift / self.trials
        squares = self._squares - self.trials * np.multiply.outer(shift, shift)
        plain_covariance = squares / (self.trials - 1)
        variances = np.diagonal(plain_covariance)
        plain = np.array([self._origin[0] + shift, variances, value[2], value[3]])
        mean, variance, low, high = np.where(slope == 0.0, plain, value)
        u = np.where(self.u_exists, np.sqrt(np.maximum(variance, 0.0)), np.nan)
        se = np.sqrt(of_value)
        shortest_low, shortest_high = self._shortest()
        # The correlations are the sample's, the standard uncertainties u.
        sample = np.sqrt(variances)
        ratio = np.divide(u, sample, out=np.where(np.isnan(u), np.nan, 1.0), where=sample > 0.0)
        return Estimates(
            mean=mean,
            u=u,
            low=low,
            high=high,
            # Without a variance the scatter of block means says nothing about their error.
            se_mean=np.where(self.u_exists, se[0], np.nan),
            se_u=np.divide(se[1], 2.0 * u, out=np.zeros_like(u), where=u != 0.0),
            se_low=se[2],
            se_high=se[3],
            shortest_low=shortest_low,
            shortest_high=shortest_high,
            covariance=plain_covariance * np.outer(ratio, ratio),
        )

    def _controlled(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Each statistic with and without its control, the one of less variance: values,
        variances and slopes (0 without the control).

        Plain: the blocks' average with s_ss/(h (h - 1)). Controlled: group g of blocks gives
        Y_g = s_g - beta_g c_g with beta_g = S_sc/S_cc over the blocks outside the group, so
        that beta_g and c_g are independent and E Y_g = E s whatever their joint distribution
        (splitting; Avramidis & Wilson 1993). A slope from all blocks would have a bias of
        half a standard error where s is a curved function of c. The variance is that of the
        Y_g, sum n_g^2 (Y_g - Y)^2 G/(G - 1)/h^2.
        """
        h = self.blocks
        # Blocks in each group, of which the first have one more.
        groups = np.arange(min(h, GROUPS))
        n = (h // GROUPS + (groups < h % GROUPS))[:, np.newaxis, np.newaxis]
        s, _, c, cc, sc = self._groups[: len(n)].transpose(1, 0, 2, 3)
        total_s, total_ss, total_c, total_cc, total_sc = self._sums[:, ENDS]
        plain = np.maximum(total_ss - total_s**2 / h, 0.0) / (h * (h - 1))
        rest_c, rest_s, rest = total_c - c, total_s - s, h - n
        s_cc = total_cc - cc - rest_c**2 / rest
        s_sc = total_sc - sc - rest_s * rest_c / rest
        usable = (s_cc > 0.0).all(axis=0) & (h >= LEAST_BLOCKS)
        usable[:2] &= self.u_exists
        slope = np.divide(s_sc, s_cc, out=np.zeros_like(s_sc), where=usable)
        adjusted = s - slope * c
        value = adjusted.sum(axis=0) / h
        scatter = ((adjusted - n * value) ** 2).sum(axis=0) / h**2
        variance = scatter * (len(n) / max(len(n) - 1, 1))
        better = usable & (variance < plain)
        value = self._origin[ENDS] + np.where(better, value, total_s / h)
        # Rounding leaves no less of the scatter than this, whatever the difference says.
        least = np.finfo(np.float64).eps ** 2 * plain
        least[2:] = np.maximum(least[2:], (KNOWN * (value[3] - value[2])) ** 2)
        variance = np.where(better, np.maximum(variance, np.minimum(least, plain)), plain)
        return value, variance, np.where(better, slope.mean(axis=0), 0.0)

    def _shortest(self) -> tuple[FloatArray, FloatArray]:
        """Shortest interval (JCGM 101:2008, 7.7.2) from the block averages of the quantiles, the
        width being a parabola of the place between those at the plan's shares. A quantile takes the
        slope of its own control: that of another one may be worse than none.
        """
        s, _, c, cc, sc = self._sums
        spread = cc - c**2 / self.blocks
        usable = (spread > 0.0) & (self.blocks >= LEAST_BLOCKS)
        slope = np.divide(sc - s * c / self.blocks, spread, out=np.zeros_like(s), where=usable)
        averages = self._origin + (s - slope * c) / self.blocks
        lower, upper = averages[2 : 2 + QUANTILES], averages[: 1 + QUANTILES : -1]
        width = upper - lower
        best = np.argmin(width, axis=0)
        near = np.clip(best + np.array([[-1], [0], [1]]), 0, len(width) - 1)
        place = near, np.arange(len(best))
        before, least, after = width[place]
        bend = before - 2.0 * least + after
        inner = (near[0] < best) & (best < near[2]) & (bend > 0.0)
        step = np.where(inner, 0.5 * (before - after) / np.where(inner, bend, 1.0), 0.0)
        return _between(lower[place], step), _between(upper[place], step)


def _between(values: FloatArray, step: FloatArray) -> FloatArray:
    """The parabola through `values` (3, outputs) at -1, 0, 1, at `step` (outputs,)."""
    before, middle, after = values
    bend = before - 2.0 * middle + after
    result: FloatArray = middle + 0.5 * step * (after - before + step * bend)
    return result


def single_block_estimates(
    values: FloatArray, probability: float, u_exists: BoolArray
) -> Estimates:
    """Estimates from `values` (outputs, M).

    Mean and u by JCGM 101:2008, 7.6; q = pM rounded, the symmetric interval from
    r = (M - q)/2 or (M - q + 1)/2 and the shortest as the least y_(r+q) - y_(r), by 7.7.2.

    Standard errors are asymptotic: u/sqrt(M) for the mean, sqrt((m4 - u^4 (M-3)/(M-1))/M)/(2u)
    for u with the fourth central moment m4; for an end half the way to the values `REACH` binomial
    standard deviations sqrt(M a (1 - a)), a = (1 - p)/2, from its rank, rms of both sides.
    """
    outputs, trials = values.shape
    mean = values.mean(axis=1)
    centred = values - mean[:, np.newaxis]
    covariance = centred @ centred.T / (trials - 1)
    variance = np.where(u_exists, np.diagonal(covariance), np.nan)
    u = np.sqrt(variance)
    ordered = np.sort(values, axis=1)
    # 0.95 * 1e6 is 949999.9999999999: an integer but for rounding is an integer.
    q = math.floor(round(probability * trials, 6) + 0.5)
    r = max(1, (trials - q + 1) // 2)
    widths = ordered[:, q:] - ordered[:, : trials - q]
    best = np.argmin(widths, axis=1)
    rows = np.arange(outputs)
    undefined = np.where(u_exists, 1.0, np.nan)
    fourth = np.mean(centred**4, axis=1) - variance**2 * (trials - 3) / (trials - 1)
    of_variance = np.sqrt(np.maximum(fourth, 0.0) / trials)
    return Estimates(
        mean=mean,
        u=u,
        low=ordered[:, r - 1],
        high=ordered[:, r + q - 1],
        se_mean=u / math.sqrt(trials),
        se_u=np.divide(of_variance, 2.0 * u, out=np.zeros(outputs), where=u != 0.0),
        se_low=_end_error(ordered, r, probability),
        se_high=_end_error(ordered, r + q, probability),
        shortest_low=ordered[rows, best],
        shortest_high=ordered[rows, best + q],
        covariance=covariance * np.outer(undefined, undefined),
    )


def _end_error(ordered: FloatArray, rank: int, probability: float) -> FloatArray:
    trials = ordered.shape[1]
    a = 0.5 * (1.0 - probability)
    deviation = math.sqrt(trials * a * (1.0 - a))
    below = max(1, math.floor(rank - REACH * deviation))
    above = min(trials, math.ceil(rank + REACH * deviation))
    end = ordered[:, rank - 1]
    higher = (ordered[:, above - 1] - end) / max(above - rank, 1)
    lower = (end - ordered[:, below - 1]) / max(rank - below, 1)
    return np.sqrt((higher**2 + lower**2) / 2) * deviation
