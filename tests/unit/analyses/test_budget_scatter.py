"""The Monte Carlo's own standard errors, distribution by distribution, against closed forms.

Peers state none (openturns pull request 2882). Of one input as it is, every figure is known
exactly: its mean, u and quantiles.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from budget_examples import evaluated
from scipy.optimize import brentq
from scipy.special import chdtri, ndtri, stdtrit

from mtu_cli.stats.monte_carlo import MonteCarloResult
from mtu_cli.stats.pooling import KNOWN

SEEDS = 20
STATISTICS = ("mean", "u", "low", "high")


def inexact_end(d: float) -> float:
    """97.5 % quantile of a rectangle whose half-width is rectangular in 1 -+ d.

    P(X > x) = ((1 + d - m) - x ln((1 + d)/m))/(4 d), m = max(1 - d, x): the mean over w of
    (1 - x/w)/2.
    """

    def beyond(x: float) -> float:
        m = max(1.0 - d, x)
        return ((1.0 + d - m) - x * math.log((1.0 + d) / m)) / (4.0 * d) - 0.025

    return float(brentq(beyond, 0.1, 1.0 + d, xtol=1e-14))


# Entry of the file, standard deviation, upper end of the 95 % interval.
SHAPES = {
    "normal": ("u: 1", 1.0, float(ndtri(0.975))),
    "t9": ("u: 1, dof: 9", math.sqrt(9 / 7), float(stdtrit(9, 0.975))),
    "rectangular": ("half_width: 1, distribution: rectangular", math.sqrt(1 / 3), 0.95),
    "triangular": (
        "half_width: 1, distribution: triangular",
        math.sqrt(1 / 6),
        1 - math.sqrt(0.05),
    ),
    "trapezoidal": (
        "half_width: 1, top: 0.5, distribution: trapezoidal",
        math.sqrt(1.25 / 6),
        1 - math.sqrt(0.05 * 0.75),
    ),
    "arcsine": (
        "half_width: 1, distribution: arcsine",
        math.sqrt(1 / 2),
        math.sin(0.475 * math.pi),
    ),
    "curvilinear-trapezoidal": (
        "half_width: 1, inexact: 0.5, distribution: curvilinear-trapezoidal",
        math.sqrt((1 + 0.25 / 3) / 3),
        inexact_end(0.5),
    ),
    "rectangular, dof 50": (
        "half_width: 1, dof: 50, distribution: rectangular",
        math.sqrt((1 + 0.01 / 3) / 3),
        inexact_end(0.1),
    ),
}


def run(equation: str, entry: str, seed: int, trials: int, threads: int = 2) -> MonteCarloResult:
    text = f"equation: {equation}\ninputs: {{x: {{value: 0, {entry}}}}}\n"
    return evaluated(text, seed=seed, trials=trials, threads=threads).run


def deviations(found: MonteCarloResult, exact: tuple[float, ...]) -> list[float]:
    """(estimate - exact)/(stated standard error) of mean, u and both ends."""
    return [
        (float(getattr(found, name)[0]) - value) / float(getattr(found, f"se_{name}")[0])
        for name, value in zip(STATISTICS, exact, strict=True)
        if getattr(found, f"se_{name}")[0] > 0.0
    ]


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_in_a_long_run(name: str) -> None:
    """2e6 trials: mean, u and ends within four of the standard errors that are stated for them.

    A bias of 1e-4 u at an end, a hundredth of the tolerance of two digits, is found. What the
    control variate gives exactly (a normal or t as it is) is so to 1e-6.
    """
    entry, u, end = SHAPES[name]
    found = run("x", entry, 11, 2_000_000)
    for statistic, exact in zip(STATISTICS, (0.0, u, -end, end), strict=True):
        value, error = getattr(found, statistic)[0], getattr(found, f"se_{statistic}")[0]
        assert value == pytest.approx(exact, abs=4.0 * error + 1e-6 * u), statistic
        assert error <= 5e-4 * u


# Root mean square of 20 standard normal deviations: outside these in 1 case of 1000.
ROOT_MEAN_SQUARE = [math.sqrt(float(chdtri(SEEDS, p)) / SEEDS) for p in (0.9995, 0.0005)]


# Second, fourth and sixth moments; of inexact limits those of a rectangle times E w^2, w^4, w^6 of
# a half-width w that is rectangular in 1 -+ 1/2.
MOMENTS = {
    "rectangular": (1 / 3, 1 / 5, 1 / 7),
    "arcsine": (1 / 2, 3 / 8, 5 / 16),
    "curvilinear-trapezoidal": (
        (1 + 0.25 / 3) / 3,
        (1 + 2 * 0.25 + 0.0625 / 5) / 5,
        (1 + 5 * 0.25 + 3 * 0.0625 + 0.015625 / 7) / 7,
    ),
}


@pytest.mark.parametrize("name", MOMENTS)
def test_deviations_scatter_as_stated(name: str) -> None:
    """20 seeds of 4e5 trials: as standard normal deviations do, of x + x^3/5.

    A standard error from 48 blocks has a tenth of scatter of its own, which widens the limits by
    1 + 0.1^2.
    """
    entry, _, end = SHAPES[name]
    second, fourth, sixth = MOMENTS[name]
    u = math.sqrt(second + 2 * fourth / 5 + sixth / 25)
    end += end**3 / 5
    exact = (0.0, u, -end, end)
    runs = [run("x + x**3/5", entry, seed, 400_000) for seed in range(SEEDS)]
    z = np.array([deviations(found, exact) for found in runs])
    low, high = ROOT_MEAN_SQUARE
    # No end is stated to be surer than the quantiles of the first-order form are known.
    least = KNOWN * 2.0 * end
    errors = np.array([[f.se_mean[0], f.se_u[0], f.se_low[0], f.se_high[0]] for f in runs])
    surest = np.all(errors < 1.01 * least, axis=0) & np.array([False, False, True, True])
    for value, is_least in zip(np.sqrt(np.mean(z * z, axis=0)), surest, strict=True):
        assert value < high * 1.01
        assert is_least or value > low / 1.01


def test_a_curved_output_scatters_as_stated() -> None:
    """x^2 of a normal is chi-squared of one degree of freedom: mean 1, u sqrt(2), by quantiles."""
    exact = (1.0, math.sqrt(2.0), float(chdtri(1, 0.975)), float(chdtri(1, 0.025)))
    runs = [run("x**2", "u: 1", seed, 400_000) for seed in range(SEEDS)]
    z = np.array([deviations(found, exact) for found in runs])
    low, high = ROOT_MEAN_SQUARE
    for value in np.sqrt(np.mean(z * z, axis=0)):
        assert low / 1.01 < value < high * 1.01


@pytest.mark.parametrize(
    ("entry", "u"),
    [
        # Corners that no series follows: no map, but the variance is known and serves u.
        ("half_width: 1, dof: 50, distribution: arcsine", math.sqrt((1 + 0.01 / 3) / 2)),
        ("half_width: 1, distribution: arcsine, contributions: [{u: 0.0001}]",
         math.sqrt(0.5 + 1e-8)),
    ],
)  # fmt: skip
def test_u_where_no_map_is_known(entry: str, u: float) -> None:
    found = run("x", entry, 5, 500_000)
    assert found.u[0] == pytest.approx(u, abs=4.0 * found.se_u[0] + 1e-9)


@pytest.mark.parametrize(
    "second", ["u: 0.2, dof: 50", "half_width: 0.3, distribution: rectangular"]
)
@pytest.mark.parametrize("dof", [2.5, 3.0, 9.0])
def test_u_of_correlated_inputs_with_scales_of_their_own(second: str, dof: float) -> None:
    """2 x - y, r = 0.5, where no map is known either. Of what is linear u is known:
    E S = sqrt(nu/2) Gamma((nu - 1)/2)/Gamma(nu/2) scales the covariance, E S^2 the variance.
    """
    text = f"equation: 2*x - y\ninputs: {{x: {{value: 1, u: 0.1, dof: {dof}}}, "
    text += f"y: {{value: 2, {second}}}}}\ncorrelations: [[x, y, 0.5]]\n"
    found = evaluated(text, seed=3, trials=200_000).run

    def scale(nu: float) -> float:
        return math.sqrt(nu / 2) * math.gamma((nu - 1) / 2) / math.gamma(nu / 2)

    normal = "dof" in second
    u_y, inflation, es = (0.2, 50 / 48, scale(50)) if normal else (math.sqrt(0.03), 1.0, 1.0)
    variance = (
        4 * 0.01 * dof / (dof - 2) + u_y**2 * inflation - 4 * 0.5 * 0.1 * u_y * scale(dof) * es
    )
    # The coefficient of the normals behind a rectangle is found to 1e-13.
    assert found.u[0] == pytest.approx(math.sqrt(variance), rel=1e-11)


@pytest.mark.parametrize("dof", [0.5, 1, 2])
def test_u_beside_a_correlated_input_that_has_none(dof: float) -> None:
    """x has no variance, its scale perhaps no mean; what is the sum of y, z and w has its own."""
    text = f"""
        equations: {{E: x + y + z + w, Y: y + z + w}}
        units: {{E: mm, Y: mm}}
        inputs:
          x: {{unit: mm, value: 1, u: 0.1, dof: {dof}}}
          y: {{unit: mm, value: 1, u: 0.1, dof: 5}}
          z: {{unit: mm, value: 1, u: 0.1, dof: 9}}
          w: {{unit: mm, value: 1, half_width: 0.3, distribution: rectangular}}
        correlations: [[x, y, 0.5], [y, z, 0.5]]
        """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = evaluated(text, seed=3, trials=50_000).run
    e = [math.sqrt(nu / 2) * math.gamma((nu - 1) / 2) / math.gamma(nu / 2) for nu in (5, 9)]
    variance = 0.01 * (5 / 3 + 9 / 7 + 2 * 0.5 * e[0] * e[1]) + 0.03
    assert math.isnan(found.u[0])
    assert found.u[1] == pytest.approx(math.sqrt(variance), rel=1e-11)
