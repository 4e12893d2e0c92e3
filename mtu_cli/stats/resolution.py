"""What the last printed digit hides: readings cannot scatter less than they were rounded to.

Of readings rounded to a step the variance of one by rounding is r = step^2/12 (JCGM 100:2008,
F.2.2.1). Where their s is below step/2, repeats are rounded alike: r is then added once to the
variance of each mean, not divided by the number n of its readings, so that the s^2 of an analysis
of n readings a place is s^2 + n r. Elsewhere the readings differ by whole steps, and s holds r
already.
"""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

MOST_DECIMALS = 9
"""What has more digits was calculated, not read."""
FEWEST_VALUES = 5
"""Different values that share a coarser step than their last decimal by chance in 4 % of cases."""
SEEN = 10_000
"""Values that show what all were rounded to."""
LARGEST_COUNT = 2.0**53
"""Beyond it not every whole number is a float."""
SLACK = 1e-6
"""How far a multiple of the step may be from a whole number."""


def step_of(values: FloatArray) -> float:
    """The step of `values`, in the unit that they were printed in: the last decimal place that any
    of them has, or a multiple of it that at least five different ones are whole numbers of. 0 and
    nan have no last place: of nothing else it is 0. Of calculated values it is 1e-9.

    >>> step_of(np.array([0.25, 0.3, 0.0])), step_of(np.array([10.0, 30.0, 20.0, 50.0, 70.0]))
    (0.01, 10.0)
    """
    distinct = np.unique(values.ravel()[:: values.size // SEEN + 1])
    distinct = distinct[np.isfinite(distinct) & (distinct != 0)]
    if not len(distinct):
        return 0.0
    for decimals in range(MOST_DECIMALS):
        count = distinct * 10.0**decimals
        whole = np.round(count)
        slack = SLACK + 16 * np.finfo(np.float64).eps * np.abs(count)
        if (np.abs(count - whole) < slack).all():
            several = len(whole) >= FEWEST_VALUES and np.abs(whole).max() < LARGEST_COUNT
            shared = int(np.gcd.reduce(whole.astype(np.int64))) if several else 1
            return max(shared, 1) / 10.0**decimals
    return 10.0**-MOST_DECIMALS


def rounding_variance(values: FloatArray, unit: float = 1.0) -> float:
    """r = step^2/12 of `values` (n,) that were printed in a unit of `unit` times theirs."""
    return (step_of(values / unit) * unit) ** 2 / 12


def hidden(s2: FloatArray | float, r: FloatArray | float) -> FloatArray:
    """The variance of a mean by rounding that `s2` does not hold: r where s < step/2, else 0."""
    return np.where(np.asarray(s2) < 3 * np.asarray(r), r, 0.0)


FEWEST_PAIRS = 8
"""Values that must agree for a column to repeat another."""
CLEAR = 3.0
"""Standard deviation of the values over what rounding may make of them, from which on agreement of
all is no chance: about one in four at each (2/3 of the density of a normal law, 0.4).
"""


def proportional(column: FloatArray, values: FloatArray, digit: float, coarsest: float) -> bool:
    """Whether a column (n,) is proportional to values (n,) to the last digit of both: `digit` that
    of the values, in their unit, `coarsest` the coarsest that the column may have in it.
    """
    both = np.isfinite(column) & np.isfinite(values)
    y, x = column[both], values[both]
    if len(y) < FEWEST_PAIRS or not x.any():
        return False
    factor = float(y @ x / (x @ x))
    size = abs(factor)
    most = 0.51 * (min(step_of(column), size * coarsest) + size * digit)
    clear = size * float(x.std()) > CLEAR * most
    return clear and bool((np.abs(y - factor * x) <= most).all())
