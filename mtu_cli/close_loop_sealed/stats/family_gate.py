"""Family-wise error rate by the smallest p of a simulated null (Westfall & Young 1993)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray, least_squares

TAIL = 0.85
"""Beyond this quantile -log p is taken as linear in the statistic."""
COUNTED = 20
"""So many of the largest values give a p by their rank; beyond, their tail does."""
SMALLEST = 1e-6
"""No p is told smaller: no tail is known so far out."""
ENDS = 3
"""So many of the largest values do not bend that line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gate:
    """The null distribution of F statistics and of their smallest p.

    `null` (B, F) sorted by column; `start`, `slope` and `level` (F,) the line of -log p beyond
    the `TAIL` quantile; `largest` (B,) sorted, the largest -log p of each sample; `stream` (seed,
    key) the random numbers it was drawn by.
    """

    null: FloatArray
    start: FloatArray
    slope: FloatArray
    level: FloatArray
    largest: FloatArray
    stream: tuple[int, int] = (0, 0)

    def minus_log_p(self, statistics: FloatArray) -> FloatArray:
        """-log p (..., F) of each statistic by itself, from its own null."""
        B = len(self.null)
        found = np.empty(statistics.shape)
        for j in range(statistics.shape[-1]):
            own = statistics[..., j]
            above = B - np.searchsorted(self.null[:, j], own, side="left")
            ranked = -np.log((above + 0.5) / (B + 1))
            tail = self.level[j] + self.slope[j] * (own - self.start[j])
            # Without a slope nothing was drawn but one value: the rank is all that is known.
            tail = np.maximum(tail, 0.0) if self.slope[j] > 0 else ranked
            found[..., j] = np.where(own > self.start[j], tail, ranked)
        return found

    def statistic_of(self, minus_log_p: float, j: int) -> float:
        """The value of statistic `j` with this -log p, by its tail."""
        if self.slope[j] <= 0:
            return float(self.null[-1, j])
        beyond = (minus_log_p - self.level[j]) / self.slope[j]
        return float(max(self.start[j] + beyond, 0.0))

    def family_p(self, minus_log_p: FloatArray) -> FloatArray:
        """Probability that any of the F statistics has as small a p under the null."""
        B = len(self.largest)
        above = B - np.searchsorted(self.largest, minus_log_p, side="left")
        ranked = (above + 1) / (B + 1)
        # Beyond the last few of them by their own tail: -log p of any test is exponential.
        few = min(COUNTED, B)
        last = self.largest[B - few]
        tail = few / (B + 1) * np.exp(-np.maximum(minus_log_p - last, 0.0))
        found: FloatArray = np.where(above < few, np.maximum(tail, SMALLEST), ranked)
        return found


def gate_of(null: FloatArray, rng: np.random.Generator, independent: int = 0) -> Gate:
    """The gate of simulated statistics `null` (B, F).

    `independent` more tests, whose p is known in closed form and uniform under the null, share
    the error rate: their p are drawn.
    """
    B, F = null.shape
    ordered = np.sort(null, axis=0)
    first = int(TAIL * B)
    start, slope, level = ordered[first], np.zeros(F), np.zeros(F)
    for j in range(F):
        slope[j], level[j] = _tail(ordered[first:, j], B)
    gate = Gate(null=ordered, start=start, slope=slope, level=level, largest=np.zeros(0))
    largest = gate.minus_log_p(null).max(axis=1, initial=0.0)
    if independent:
        largest = np.maximum(largest, rng.exponential(size=(B, independent)).max(axis=1))
    return Gate(null=ordered, start=start, slope=slope, level=level, largest=np.sort(largest))


def _tail(values: FloatArray, B: int) -> tuple[float, float]:
    """Slope and level at the first value of -log p, fitted beyond it."""
    lp = -np.log((np.arange(len(values), 0, -1) - 0.5) / B)
    kept = len(values) - ENDS
    x = values[:kept] - values[0]
    if kept < 5 or x[-1] <= 0:
        return 0.0, float(lp[0])
    design = np.column_stack([np.ones(kept), x])
    level, slope = least_squares(design, lp[:kept]).coefficients
    return float(max(slope, 0.0)), float(level)
