"""NIST Statistical Reference Datasets, linear least squares.

Data and certified values (15 digits, computed by NIST in 500-digit arithmetic) are from
https://www.itl.nist.gov/div898/strd/lls/lls.shtml, which is in the public domain. NIST calls
Norris and Pontius of lower, NoInt1 and NoInt2 of average, and the others of higher
difficulty. The score is the log relative error, the number of digits that agree
(McCullough 1998, The American Statistician 52, 358-366).
"""

from dataclasses import dataclass

import numpy as np
import pytest

from mtu_cli.stats.anova import cells_of, one_way
from mtu_cli.stats.least_squares import FloatArray, least_squares

CERTIFIED_DIGITS = 15.0


def numbers(text: str) -> FloatArray:
    return np.array(text.split(), dtype=np.float64)


NORRIS_X = """
0.2 337.4 118.2 884.6 10.1 226.5 666.3 996.3 448.6 777 558.2 0.4 0.6 775.5 666.9 338 447.5 11.6
556 228.1 995.8 887.6 120.2 0.3 0.3 556.8 339.1 887.2 999 779 11.1 118.3 229.2 669.1 448.9 0.5
"""

NORRIS_Y = """
0.1 338.8 118.1 888 9.2 228.1 668.5 998.5 449.1 778.9 559.2 0.3 0.1 778.1 668.8 339.3 448.9 10.8
557.7 228.3 998 888.8 119.6 0.3 0.6 557.6 339.3 888 998.5 778.9 10.2 117.6 228.9 668.4 449.2 0.2
"""

PONTIUS_Y = """
0.11019 0.21956 0.32949 0.43899 0.54803 0.65694 0.76562 0.87487 0.98292 1.09146 1.20001 1.30822
1.41599 1.52399 1.63194 1.73947 1.84646 1.95392 2.06128 2.16844 0.11052 0.22018 0.32939 0.43886
0.54798 0.65739 0.76596 0.87474 0.983 1.0915 1.20004 1.30818 1.41613 1.52408 1.63159 1.73965
1.84696 1.95445 2.06177 2.16829
"""

# Employment; the deflator, the product, unemployed, forces, population, year.
LONGLEY_ROWS = """
60323 83 234289 2356 1590 107608 1947
61122 88.5 259426 2325 1456 108632 1948
60171 88.2 258054 3682 1616 109773 1949
61187 89.5 284599 3351 1650 110929 1950
63221 96.2 328975 2099 3099 112075 1951
63639 98.1 346999 1932 3594 113270 1952
64989 99 365385 1870 3547 115094 1953
63761 100 363112 3578 3350 116219 1954
66019 101.2 397469 2904 3048 117388 1955
67857 104.6 419180 2822 2857 118734 1956
68169 108.4 442769 2936 2798 120445 1957
66513 110.8 444546 4681 2637 121950 1958
68655 112.6 482704 3813 2552 123366 1959
69564 114.2 502601 3931 2514 125368 1960
69331 115.7 518173 4806 2572 127852 1961
70551 116.9 554894 4007 2827 130081 1962
"""

FILIP_X = """
-6.860120914 -4.324130045 -4.358625055 -4.358426747 -6.955852379 -6.661145254 -6.355462942
-6.118102026 -7.115148017 -6.815308569 -6.519993057 -6.204119983 -5.853871964 -6.109523091
-5.79832982 -5.482672118 -5.171791386 -4.851705903 -4.517126416 -4.143573228 -3.709075441
-3.499489089 -6.300769497 -5.953504836 -5.642065153 -5.031376979 -4.680685696 -4.329846955
-3.928486195 -8.56735134 -8.363211311 -8.107682739 -7.823908741 -7.522878745 -7.218819279
-6.920818754 -6.628932138 -6.323946875 -5.991399828 -8.781464495 -8.663140179 -8.473531488
-8.247337057 -7.971428747 -7.676129393 -7.352812702 -7.072065318 -6.774174009 -6.478861916
-6.159517513 -6.835647144 -6.53165267 -6.224098421 -5.910094889 -5.598599459 -5.290645224
-4.974284616 -4.64454848 -4.290560426 -3.885055584 -3.408378962 -3.13200249 -8.726767166
-8.66695597 -8.511026475 -8.165388579 -7.886056648 -7.588043762 -7.283412422 -6.995678626
-6.691862621 -6.392544977 -6.067374056 -6.684029655 -6.378719832 -6.065855188 -5.752272167
-5.132414673 -4.811352704 -4.098269308 -3.66174277 -3.2644011
"""

FILIP_Y = """
0.8116 0.9072 0.9052 0.9039 0.8053 0.8377 0.8667 0.8809 0.7975 0.8162 0.8515 0.8766 0.8885
0.8859 0.8959 0.8913 0.8959 0.8971 0.9021 0.909 0.9139 0.9199 0.8692 0.8872 0.89 0.891 0.8977
0.9035 0.9078 0.7675 0.7705 0.7713 0.7736 0.7775 0.7841 0.7971 0.8329 0.8641 0.8804 0.7668
0.7633 0.7678 0.7697 0.77 0.7749 0.7796 0.7897 0.8131 0.8498 0.8741 0.8061 0.846 0.8751 0.8856
0.8919 0.8934 0.894 0.8957 0.9047 0.9129 0.9209 0.9219 0.7739 0.7681 0.7665 0.7703 0.7702 0.7761
0.7809 0.7961 0.8253 0.8602 0.8809 0.8301 0.8664 0.8834 0.8898 0.8964 0.8963 0.9074 0.9119
0.9228
"""


@dataclass(frozen=True)
class Reference:
    """A design, its readings, the certified coefficients and their standard deviations.

    `digits` must agree in the coefficients, `sd_digits` in their standard deviations.
    """

    X: FloatArray
    y: FloatArray
    certified: FloatArray
    deviations: FloatArray
    digits: float = 9.0
    sd_digits: float = 9.0


def powers(x: FloatArray, degree: int) -> FloatArray:
    return np.vander(x, degree + 1, increasing=True)


WAMPLER_X = np.arange(21.0)
WAMPLER_1 = powers(WAMPLER_X, 5).sum(axis=1)
WAMPLER_DELTA = numbers(
    """759 -2048 2048 -2048 2523 -2048 2048 -2048 1838 -2048 2048 -2048 1838 -2048 2048 -2048
    2523 -2048 2048 -2048 759"""
)
WAMPLER_3_SD = numbers(
    """2152.32624678170 2363.55173469681 779.343524331583 101.475507550350 5.64566512170752
    0.112324854679312"""
)


def wampler(y: FloatArray, certified: FloatArray, sd: FloatArray, digits: float) -> Reference:
    return Reference(powers(WAMPLER_X, 5), y, certified, sd, digits)


LONGLEY_Y, *LONGLEY_COLUMNS = numbers(LONGLEY_ROWS).reshape(16, 7).T
LONGLEY = np.column_stack([np.ones(16), *LONGLEY_COLUMNS])

# Filip, Wampler4 and Wampler5 lose digits to condition numbers and large residuals (a
# hundredfold from one Wampler set to the next): asked for is what double precision can give.
REFERENCES = {
    "Norris": Reference(
        powers(numbers(NORRIS_X), 1),
        numbers(NORRIS_Y),
        numbers("-0.262323073774029 1.00211681802045"),
        numbers("0.232818234301152 0.429796848199937E-03"),
    ),
    "Pontius": Reference(
        powers(np.tile(150000.0 * np.arange(1, 21), 2), 2),
        numbers(PONTIUS_Y),
        numbers("0.673565789473684E-03 0.732059160401003E-06 -0.316081871345029E-14"),
        numbers("0.107938612033077E-03 0.157817399981659E-09 0.486652849992036E-16"),
    ),
    "NoInt1": Reference(
        np.arange(60.0, 71.0)[:, None],
        np.arange(130.0, 141.0),
        numbers("2.07438016528926"),
        numbers("0.165289256198347E-01"),
    ),
    "NoInt2": Reference(
        np.array([[4.0], [5.0], [6.0]]),
        np.array([3.0, 4.0, 4.0]),
        numbers("0.727272727272727"),
        numbers("0.420827318078432E-01"),
    ),
    "Longley": Reference(
        LONGLEY,
        LONGLEY_Y,
        numbers(
            """-3482258.63459582 15.0618722713733 -0.358191792925910E-01 -2.02022980381683
            -1.03322686717359 -0.511041056535807E-01 1829.15146461355"""
        ),
        numbers(
            """890420.383607373 84.9149257747669 0.334910077722432E-01 0.488399681651699
            0.214274163161675 0.226073200069370 455.478499142212"""
        ),
    ),
    "Filip": Reference(
        powers(numbers(FILIP_X), 10),
        numbers(FILIP_Y),
        numbers(
            """-1467.48961422980 -2772.17959193342 -2316.37108160893 -1127.97394098372
            -354.478233703349 -75.1242017393757 -10.8753180355343 -1.06221498588947
            -0.670191154593408E-01 -0.246781078275479E-02 -0.402962525080404E-04"""
        ),
        numbers(
            """298.084530995537 559.779865474950 466.477572127796 227.204274477751
            71.6478660875927 15.2897178747400 2.23691159816033 0.221624321934227
            0.142363763154724E-01 0.535617408889821E-03 0.896632837373868E-05"""
        ),
        6.0,
        6.0,
    ),
    "Wampler3": wampler(WAMPLER_1 + WAMPLER_DELTA, np.ones(6), WAMPLER_3_SD, 9.0),
    "Wampler4": wampler(WAMPLER_1 + 100 * WAMPLER_DELTA, np.ones(6), 100 * WAMPLER_3_SD, 7.0),
    "Wampler5": wampler(WAMPLER_1 + 1e4 * WAMPLER_DELTA, np.ones(6), 1e4 * WAMPLER_3_SD, 6.0),
}


def agreeing_digits(found: FloatArray | float, certified: FloatArray | float) -> float:
    error = np.abs(found - certified) / np.abs(certified)
    return float(min(CERTIFIED_DIGITS, -np.log10(np.max(error) + 1e-16)))


RESIDUAL_SD = {"Norris": (0.884796396144373, 1e-12), "Pontius": (0.205177424076185e-03, 1e-10)}


@pytest.mark.parametrize("name", REFERENCES)
def test_certified_values(name: str) -> None:
    item = REFERENCES[name]
    fit = least_squares(item.X, item.y)
    assert fit.rank == item.X.shape[1]
    assert agreeing_digits(fit.coefficients, item.certified) >= item.digits
    deviations = np.sqrt(fit.s2 * np.diag(fit.unscaled_covariance))
    assert agreeing_digits(deviations, item.deviations) >= item.sd_digits
    if name in RESIDUAL_SD:
        s, rel = RESIDUAL_SD[name]
        assert np.sqrt(fit.s2) == pytest.approx(s, rel=rel)


@pytest.mark.parametrize("base", [1.0, 0.1], ids=["Wampler1", "Wampler2"])
def test_exact_polynomials(base: float) -> None:
    """Wampler1 and 2: y is the polynomial with coefficients base^k, residuals are zero."""
    certified: FloatArray = base ** np.arange(6.0)
    y: FloatArray = np.round(powers(WAMPLER_X, 5) @ certified, 5)
    fit = least_squares(powers(WAMPLER_X, 5), y)
    assert agreeing_digits(fit.coefficients, certified) >= 9.0
    assert np.sqrt(fit.s2) <= 1e-12 * y.max()


def test_the_generated_wampler_sets_are_the_printed_ones() -> None:
    """First, middle and last readings as NIST prints them."""
    printed = {
        "Wampler3": (760, -2042, 113159, 3369180),
        "Wampler4": (75901, -204794, 315911, 3444321),
        "Wampler5": (7590001, -20479994, 20591111, 10958421),
    }
    for name, values in printed.items():
        y = REFERENCES[name].y
        assert (y[0], y[1], y[10], y[20]) == values


# NIST Statistical Reference Datasets, one-way analysis of variance.
#
# Data and certified values (15 digits, computed by NIST in multiple precision) are from
# https://www.itl.nist.gov/div898/strd/anova/anova.html, which is in the public domain. The nine
# SmLs sets are generated (Simon & Lesage 1989, Computational Statistics & Data Analysis 8, 325):
# 9 treatments, whose values alternate 0.1 below and above the first, above 1, 7 or 13 constant
# leading digits.

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


def check(groups: list[FloatArray], certified: Certified) -> None:
    values = np.concatenate(groups)
    part = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    table = one_way(cells_of(values, part, 1, len(groups)))
    assert agreeing_digits(table.F[0], certified.F) >= certified.digits
    assert agreeing_digits(np.sqrt(table.ms_within[0]), certified.s) >= certified.digits
    between = table.df_between[0] * table.ms_between[0]
    within = table.df_within[0] * table.ms_within[0]
    assert agreeing_digits(between / (between + within), certified.r2) >= certified.digits
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
