"""Figures with 95 % intervals, held against the bar."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv

Limits = tuple[float, float]
"""Lowest and highest value that holds."""


@dataclass(frozen=True, kw_only=True)
class Figure:
    """`value` with its 95 % interval, of `count` data sets; `percent`: a share."""

    value: float
    low: float
    high: float
    count: int
    percent: bool = True

    def holds(self, hold: Limits | None, beyond: Limits | None) -> str:
        """A bar holds where it lies within the interval or on the wrong side of it."""
        if not self.count or hold is None:
            return ""
        if beyond is not None and beyond[0] <= self.value <= beyond[1]:
            return "beyond"
        return "holds" if self.low <= hold[1] and self.high >= hold[0] else "MISSED"

    def words(self) -> str:
        if not self.count:
            return "-"
        times, digits = (100, ".1f") if self.percent else (1, ".3g")
        low, value, high = (
            f"{times * number:{digits}}" for number in (self.low, self.value, self.high)
        )
        return f"{value} ({low}-{high}) of {self.count}"


def share(of: Iterable[bool]) -> Figure:
    """The share of what is true, with the interval of Clopper and Pearson (1934)."""
    each = [bool(item) for item in of]
    hits, count = sum(each), len(each)
    low = float(betaincinv(hits, count - hits + 1, 0.025)) if hits else 0.0
    high = float(betaincinv(hits + 1, count - hits, 0.975)) if hits < count else 1.0
    return Figure(value=hits / max(count, 1), low=low, high=high, count=count)


def ratio(pairs: Iterable[tuple[float, float]]) -> Figure:
    """Sum over sum, with the interval by the linearised variance; a mean where the second is 1."""
    both = np.array(list(pairs), float).reshape(-1, 2)
    if len(both) < 2:
        return Figure(value=np.nan, low=-np.inf, high=np.inf, count=0, percent=False)
    value = float(both[:, 0].sum() / both[:, 1].sum())
    left = both[:, 0] - value * both[:, 1]
    u = float(np.sqrt(len(both)) * left.std(ddof=1) / both[:, 1].sum())
    return Figure(
        value=value, low=value - 1.96 * u, high=value + 1.96 * u, count=len(both), percent=False
    )


def mean(values: Iterable[float]) -> Figure:
    return ratio((value, 1.0) for value in values)


def median(values: Sequence[float]) -> Figure:
    """With the 5th and 95th percentile."""
    if not values:
        return mean([])
    low, middle, high = (float(value) for value in np.quantile(values, [0.05, 0.5, 0.95]))
    return Figure(value=middle, low=low, high=high, count=len(values), percent=False)
