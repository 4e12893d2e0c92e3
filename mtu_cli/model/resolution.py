"""The step to which measured coordinates were rounded."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

STEPS_MM = (1e-3, 5e-4, 1e-4, 5e-5, 1e-5)
"""Steps that measuring programs round to; who rounds to more than 1 um has at least that."""
WHOLE = 1e-6
"""How far a multiple may be from a whole number, by rounding of the arithmetic."""
MOST_DECIMALS = 7
FEWEST = 8
"""Whole numbers, of less than which more than 1 in 250 share a divisor by chance: of n at random
1 - 1/zeta(n) do.
"""
FEWEST_FIVES = 4
"""The same of numbers that share a 5, as displays have it: of n at random 5^-n do."""
ROUNDING_MM = 1e-9


def resolution(values: FloatArray) -> float:
    """The largest of `STEPS_MM` that all `values` (n,) mm are multiples of; 0 without one."""
    return next((step for step in STEPS_MM if in_steps(values, step)), 0.0)


def in_steps(values: FloatArray, step: float) -> bool:
    """Whether all `values` (n,) are multiples of the step."""
    count = values / step
    return bool((np.abs(count - np.round(count)) < WHOLE).all())


def last_digit(values: FloatArray) -> float:
    """The last digit of values (n,), mm: the largest step that all are whole numbers of. Fewer
    than FEWEST different ones have divisors by chance: theirs is the last decimal that any has,
    1 mm at most, or of FEWEST_FIVES five of it.
    """
    for decimals in range(MOST_DECIMALS):
        whole = values * 10.0**decimals
        if (np.abs(whole - np.round(whole)) < ROUNDING_MM * 10.0**decimals).all():
            numbers = np.unique(np.round(whole).astype(np.int64))
            unit = max(int(np.gcd.reduce(numbers)), 1)
            if len(numbers) < FEWEST:
                unit = 5 if unit % 5 == 0 and len(numbers) >= FEWEST_FIVES else 1
            return unit * 10.0**-decimals
    return 10.0**-MOST_DECIMALS
