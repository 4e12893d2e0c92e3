"""NIST Statistical Reference Datasets, one-way analysis of variance.

Data and certified values (15 digits, computed by NIST in multiple precision) are from
https://www.itl.nist.gov/div898/strd/anova/anova.html, which is in the public domain. The nine
SmLs sets are generated (Simon & Lesage 1989, Computational Statistics & Data Analysis 8, 325):
9 treatments, whose values alternate 0.1 below and above the first, above 1, 7 or 13 constant
leading digits. The score is the log relative error, the number of digits that agree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from mtu_cli.stats.anova import cells_of, one_way
from mtu_cli.stats.least_squares import FloatArray

SIRSTV = """
196.3052 196.1240 196.1890 196.2569 196.3403

196.3042 196.3825 196.1669 196.3257 196.0422

196.1303 196.2005 196.2889 196.0343 196.1811

196.2795 196.1748 196.1494 196.1485 195.9885

196.2119 196.1051 196.1850 196.0052 196.2090
"""
ATMWTAG = """
107.8681568 107.8681465 107.8681572 107.8681785 107.8681446 107.8681903 107.8681526
107.8681494 107.8681616 107.8681587 107.8681519 107.8681486 107.8681419 107.8681569
107.8681508 107.8681672 107.8681385 107.8681518 107.8681662 107.8681424 107.8681360
107.8681333 107.8681610 107.8681477

107.8681079 107.8681344 107.8681513 107.8681197 107.8681604 107.8681385 107.8681642
107.8681365 107.8681151 107.8681082 107.8681517 107.8681448 107.8681198 107.8681482
107.8681334 107.8681609 107.8681101 107.8681512 107.8681469 107.8681360 107.8681254
107.8681261 107.8681450 107.8681368
"""


@dataclass(frozen=True)
class Certified:
    """Values of the certificate, and the digits asked of ours."""

    F: float
    s: float
    r2: float
    digits: float


CERTIFIED = {
    "SiRstv": Certified(1.18046237440255, 1.04076068334656e-01, 1.90999039051129e-01, 9),
    "AtmWtAg": Certified(1.59467335677930e01, 1.51048314446410e-05, 2.57426544538321e-01, 7),
}
# Treatments of n values: (F, R^2); the residual standard deviation is 0.1 in all of them.
GENERATED = {
    21: (2.1e01, 4.82758620689655e-01),
    201: (2.01e02, 4.71830985915493e-01),
    2001: (2.001e03, 4.70712773465067e-01),
}
LEADING = {"1": 9.0, "1000000": 7.0, "1000000000000": 4.0}
FIRST_DIGITS = (4, 3, 5, 3, 5, 3, 5, 3, 5)


def generated(leading: str, n: int) -> list[FloatArray]:
    """A SmLs set: one decimal, as it is printed."""
    found = []
    for first in FIRST_DIGITS:
        digits = [first, *([first - 1, first + 1] * ((n - 1) // 2))]
        found.append(np.array([float(f"{leading}.{digit}") for digit in digits]))
    return found


def printed(text: str) -> list[FloatArray]:
    return [np.array(block.split(), dtype=np.float64) for block in text.strip().split("\n\n")]


def digits(found: float, certified: float) -> float:
    return float(-np.log10(max(abs(found - certified) / abs(certified), 1e-15)))


def check(groups: list[FloatArray], certified: Certified) -> None:
    values = np.concatenate(groups)
    part = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    table = one_way(cells_of(values, part, 1, len(groups)))
    assert digits(table.F[0], certified.F) >= certified.digits
    assert digits(np.sqrt(table.ms_within[0]), certified.s) >= certified.digits
    between = table.df_between[0] * table.ms_between[0]
    within = table.df_within[0] * table.ms_within[0]
    assert digits(between / (between + within), certified.r2) >= certified.digits
    assert table.df_between[0] == len(groups) - 1
    assert table.df_within[0] == len(values) - len(groups)


@pytest.mark.parametrize(("name", "text"), [("SiRstv", SIRSTV), ("AtmWtAg", ATMWTAG)])
def test_measured_sets(name: str, text: str) -> None:
    check(printed(text), CERTIFIED[name])


@pytest.mark.parametrize("n", GENERATED)
@pytest.mark.parametrize("leading", LEADING)
def test_generated_sets(leading: str, n: int) -> None:
    F, r2 = GENERATED[n]
    check(generated(leading, n), Certified(F, 0.1, r2, LEADING[leading]))
