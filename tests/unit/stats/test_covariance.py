"""Positive parts of differences of mean squares; covariances from matrices that need not be any."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh
from scipy.special import logsumexp
from trial_models import Bent

from mtu_cli.stats.blocks import BlockPlan, BlockSummariser, Draws, weights_of
from mtu_cli.stats.covariance import (
    as_covariance,
    bounded,
    correlation_of,
    covariance_root,
    factor_of,
    positive_part,
)
from mtu_cli.stats.kernels import (
    AMPLITUDES,
    LOG_PRIOR,
    averaged,
    interpolation_covariance,
    smooth_root,
    weights,
    wiener,
)
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.uncertain_variance import (
    UncertainVariance,
    f_tails,
    mean_square_tails,
    pooled_p,
    uncertain_variance,
)


def spread(rng: np.random.Generator, size: int) -> FloatArray:
    S = rng.normal(size=(size, size + 2))
    result: FloatArray = S @ S.T
    return result


@pytest.mark.parametrize("size", [1, 2, 4])
@pytest.mark.parametrize("less", [0.0, 0.5, 2.0, 50.0])
def test_against_the_generalised_eigenproblem(size: int, less: float) -> None:
    """S v = l M v: D keeps max(l - less, 0)."""
    rng = np.random.default_rng(int(10 * less) + size)
    for _ in range(20):
        S, M = spread(rng, size), spread(rng, size)
        D = positive_part(S, M, less)
        values, v = eigh(S, M)
        kept = np.maximum(values - less, 0.0)
        np.testing.assert_allclose(D, (M @ v * kept) @ (M @ v).T, atol=1e-9 * np.abs(S).max())
        assert np.linalg.eigvalsh(D).min() >= -1e-12 * np.abs(S).max()
        if values.min() > less:
            np.testing.assert_allclose(D, S - less * M, atol=1e-9 * np.abs(S).max())


@pytest.mark.parametrize("seed", range(8))
def test_variances_stay_and_no_combination_has_one_below_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    s = np.exp(4 * rng.standard_normal(5))
    R = np.clip(rng.uniform(-1.5, 1.5, (5, 5)), -1, 1)
    R = np.triu(R, 1) + np.triu(R, 1).T + np.eye(5)
    found = as_covariance(R * np.outer(s, s)) / np.outer(s, s)
    assert np.linalg.eigvalsh(R)[0] < -1e-3
    np.testing.assert_allclose(np.diag(found), 1.0, rtol=1e-12)
    assert np.linalg.eigvalsh(found)[0] > -1e-12


@pytest.mark.parametrize("r", [-1.0, -0.4, 0.0, 1.0])
def test_roots_give_the_covariance_again(r: float) -> None:
    C = np.array([[1.0, r, 0.0], [r, 1.0, 0.0], [0.0, 0.0, 0.0]])
    C *= np.outer(s := np.array([1e-6, 40.0, 1.0]), s)
    for F in (factor_of(C), covariance_root(C)):
        np.testing.assert_allclose(F @ F.T, C, atol=1e-14 * 1600)
    assert factor_of(C).shape == (3, 1 if abs(r) == 1 else 2)
    assert correlation_of(C)[0, 1] == pytest.approx(r)
    assert np.isnan(correlation_of(C)[0, 2])


def test_bounded_by_what_scatters() -> None:
    """-S <= K <= S: both differences have no negative eigenvalue; within the bounds K stays."""
    rng = np.random.default_rng(3)
    S = spread(rng, 3) * np.outer(s := np.array([1e-4, 1.0, 30.0]), s)
    K = 5 * spread(rng, 3) * np.outer(s, s) - S
    cut = bounded(K, S)
    for whole in (S - cut, S + cut):
        assert np.linalg.eigvalsh(whole / np.outer(s, s)).min() > -1e-9
    np.testing.assert_allclose(bounded(0.3 * S, S), 0.3 * S, rtol=1e-9)
    assert not bounded(K, np.zeros((3, 3))).any()


def test_a_metric_that_rounding_made_singular() -> None:
    """As that of the powers of a high degree: Cholesky's factor breaks off."""
    s = np.array([1.0, 1e-8, 1e5])
    metric = (np.full((3, 3), 1.0 + 1e-9) - 1e-9 * np.eye(3)) * np.outer(s, s)
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(metric)
    found = positive_part(5.0 * metric, metric, 2.0)
    np.testing.assert_allclose(found, 3.0 * metric, rtol=1e-6)


# Ordered values of blocks against full sorts.


@pytest.mark.parametrize("m", [200, 201, 1000, 8192])
@pytest.mark.parametrize("f", [np.exp, np.round, np.zeros_like])
def test_quantiles_are_those_of_a_full_sort(f: Callable[[FloatArray], FloatArray], m: int) -> None:
    """Of skew values, of few values, of equal ones; a block too short for two tails is sorted."""
    block = f(np.random.default_rng(1).standard_normal((1, m)))
    before = block.copy()
    plan = BlockPlan(0.5 if m == 201 else 0.95, m, None)
    found = BlockSummariser(Bent(control=False), plan).summarise(Draws(values=block), 1).statistics
    ordered, weights = np.sort(block[0]), weights_of(plan, m)
    lower, upper = np.split(found[0, 2:, 0], 2)
    assert lower == pytest.approx(weights(ordered), rel=1e-12, abs=1e-12)
    assert upper == pytest.approx(weights(ordered[::-1]), rel=1e-12, abs=1e-12)
    assert np.array_equal(block, before)


def test_quantiles_of_equal_values_are_that_value_to_the_bit() -> None:
    plan = BlockPlan(0.95, 2000, None)
    found = BlockSummariser(Bent(control=False), plan).summarise(
        Draws(values=np.full((1, 6000), 0.1)), 3
    )
    assert np.unique(found.statistics[:, 2:]).tolist() == [0.1]


# The integrated Wiener process: splines of another library, and simulated paths.


KNOTS = np.array([0.0, 30.0, 80.0, 100.0, 170.0, 200.0])


def test_the_natural_cubic_spline_and_its_lines_beyond() -> None:
    values = np.array([1.0, -2.0, 0.5, 4.0, 3.0, -1.0])
    spline = CubicSpline(KNOTS, values, bc_type="natural")
    inside = np.linspace(0, 200, 41)
    assert weights(KNOTS, inside) @ values == pytest.approx(spline(inside), abs=1e-12)
    beyond = np.array([-50.0, -10.0, 220.0, 300.0])
    ends = np.where(beyond < 0, 0.0, 200.0)
    lines = spline(ends) + (beyond - ends) * spline(ends, 1)
    assert weights(KNOTS, beyond) @ values == pytest.approx(lines, abs=1e-11)
    assert np.array_equal(weights(KNOTS, KNOTS), np.eye(len(KNOTS)))


def test_what_knots_leave_open_is_that_of_paths() -> None:
    """Paths W(x) = int (x - t)+ dB(t) of a fine grid, from far below: variance of their misfit."""
    rng, step = np.random.default_rng(1), 0.5
    t = np.arange(-60.0, 240.0, step) + step / 2
    at = np.array([15.0, 60.0, 130.0, 210.0])
    places = np.concatenate([KNOTS, at])
    arms = np.clip(places[:, None] - t, 0.0, None)
    paths = arms @ (rng.standard_normal((len(t), 40_000)) * np.sqrt(step))
    missed = paths[len(KNOTS) :] - weights(KNOTS, at) @ paths[: len(KNOTS)]
    expected = np.cov(missed)
    found = interpolation_covariance(KNOTS, at)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert found / scale == pytest.approx(expected / scale, abs=0.03)


# A smooth profile averaged over its amplitude, against dense kriging of every reading.


AT = np.array([0.0, 40.0, 90.0, 150.0, 170.0, 240.0, 300.0])
PASSES = 4


@pytest.mark.parametrize("size", [0.0, 1.0, 20.0])
def test_mean_and_covariance_are_those_of_dense_kriging(size: float) -> None:
    """y = f(x) + e of every reading, f without a line about the knots; 1/sigma^2 as prior."""
    rng = np.random.default_rng(3)
    T = len(AT)
    y = size * np.sin(AT / 60) + rng.standard_normal((PASSES, T))
    line = np.column_stack([np.ones(T), AT])
    M = np.eye(T) - line @ np.linalg.pinv(line)
    y = y @ M
    K = M @ wiener(AT, AT) @ M
    K /= np.trace(K) / T
    N = np.tile(np.eye(T), (PASSES, 1))
    n = PASSES * (T - 2)
    logs, means, covariances = [], [], []
    # A basis of what the lines of the passes leave: there the noise is white.
    free = np.kron(np.eye(PASSES), np.linalg.svd(M)[0][:, : T - 2].T)
    for a2 in AMPLITUDES**2:
        V = np.eye(n) + a2 * free @ N @ K @ N.T @ free.T
        gain = a2 * K @ N.T @ free.T @ np.linalg.inv(V)
        z = free @ y.ravel()
        logs.append(-np.linalg.slogdet(V)[1] / 2 - n / 2 * np.log(z @ np.linalg.solve(V, z)))
        means.append(gain @ z)
        covariances.append(a2 * K - gain @ free @ N @ K * a2)
    weight = np.exp(np.array(logs) + LOG_PRIOR - logsumexp(np.array(logs) + LOG_PRIOR))
    dense = weight @ np.array(means)

    G = np.sqrt(PASSES) * M
    mean = y.mean(axis=0)
    sse, nu = float(((y - mean) ** 2).sum()), (PASSES - 1) * (T - 2)
    B = smooth_root(AT)
    B /= np.sqrt((B**2).sum() / T)
    kept = np.linalg.svd(M)[0][:, : T - 2].T
    found, covariance, amplitude2 = averaged(kept @ G, np.sqrt(PASSES) * kept @ mean, B, sse, nu)
    assert found == pytest.approx(dense, abs=2e-3 * max(size, 0.5))
    apart = np.array(means) - dense
    spread = (apart.T * weight) @ apart / (sse / nu)
    expected = np.einsum("a,aij->ij", weight, np.array(covariances)) + spread
    assert covariance == pytest.approx(expected, rel=0.02, abs=2e-3 * float(np.max(expected)))
    assert amplitude2 == pytest.approx(float(weight @ AMPLITUDES**2), rel=0.02)


# Tails of t, F and Behrens-Fisher: printed tables, plain integration, draws.


def one(squares: list[float], dof: list[float], m: int = 1) -> tuple[FloatArray, FloatArray]:
    """The same mean squares for m items."""
    return np.repeat(np.array(squares)[:, None], m, axis=1), np.array(dof)


# Student's t exceeded on either side with 5 %, 1 %, 0.1 %: any printed table.
T_TABLE = {
    1: (12.706, 63.657, 636.619), 2: (4.303, 9.925, 31.599), 3: (3.182, 5.841, 12.924),
    8: (2.306, 3.355, 5.041), 20: (2.086, 2.845, 3.850), 60: (2.000, 2.660, 3.460),
    np.inf: (1.960, 2.576, 3.291),
}  # fmt: skip
# F exceeded with 5 % and 1 %, 20 and 10 degrees of freedom above.
F_TABLE = {
    (20, 2): (19.446, 99.449), (20, 4): (5.803, 14.020), (20, 8): (3.150, 5.359),
    (20, 60): (1.748, 2.198), (10, 20): (2.348, 3.368), (1, 4): (7.709, 21.198),
    (20, np.inf): (1.571, 1.878), (10, np.inf): (1.831, 2.321),
}  # fmt: skip
# Fisher & Yates, Statistical Tables, table VI: 5 % points of Sukhatme's d for
# theta = 0, 15, ..., 90 degrees, nu1 = 6.
SUKHATME = {
    6: (2.447, 2.440, 2.435, 2.435, 2.435, 2.440, 2.447),
    8: (2.447, 2.430, 2.398, 2.364, 2.331, 2.310, 2.306),
    12: (2.447, 2.423, 2.367, 2.301, 2.239, 2.193, 2.179),
}


def t_tail(deviation: FloatArray, variance: UncertainVariance) -> FloatArray:
    """Two-sided p of a normal deviation of such variance."""
    return f_tails(deviation**2, np.ones_like(deviation), variance)[0]


@pytest.mark.parametrize("dof", T_TABLE)
def test_one_mean_square_is_students_t(dof: float) -> None:
    t = np.array(T_TABLE[dof])
    found = t_tail(t, uncertain_variance(*one([1.0], [dof], 3)))
    # Half a unit of the last digit of t is at most this share of its tail; where dof is 1,
    # summing over nodes costs 0.2 %.
    assert found == pytest.approx([0.05, 0.01, 0.001], rel=0.003)
    assert t_tail(-2 * t, uncertain_variance(*one([4.0], [dof], 3))) == pytest.approx(found)


@pytest.mark.parametrize("dof", F_TABLE)
def test_one_mean_square_is_fishers_f(dof: tuple[int, float]) -> None:
    F = np.array(F_TABLE[dof])
    variance = uncertain_variance(*one([3.0], [dof[1]], 2))
    high, low = f_tails(3.0 * F, np.full(2, dof[0]), variance)
    assert high == pytest.approx([0.05, 0.01], rel=0.005)
    assert low == pytest.approx(1 - high, abs=1e-9)


@pytest.mark.parametrize("dof", SUKHATME)
def test_two_mean_squares_are_behrens_and_fishers(dof: int) -> None:
    d = np.array(SUKHATME[dof])
    theta = np.radians(np.arange(0, 91, 15))
    squares = np.array([np.cos(theta) ** 2, np.sin(theta) ** 2])
    found = t_tail(d, uncertain_variance(squares, np.array([6.0, dof])))
    # The third decimal of d, half a unit, is 0.00004 of p; gathering nodes costs as much.
    assert found == pytest.approx(np.full(7, 0.05), abs=0.00012)


@pytest.mark.parametrize("truth", [(1.0, 1.0, 0.0), (1.0, 0.02, 0.0)])
def test_no_more_false_alarms_than_said(truth: tuple[float, float, float]) -> None:
    """Sums of mean squares of 2, 1 and 30 degrees of freedom: at 5 % and 0.5 %. Student's t
    with the effective degrees of freedom of JCGM 100, G.4.1, would alarm twice as often."""
    rng = np.random.default_rng(11)
    n, dof = 4_000, np.array([2.0, 1.0, 30.0])
    squares = np.array([c * rng.chisquare(nu, n) / nu for c, nu in zip(truth, dof, strict=True)])
    deviation = np.sqrt(sum(truth)) * rng.standard_normal(n)
    p = t_tail(deviation, uncertain_variance(squares, dof))
    for level in (0.05, 0.005):
        assert (p < level).mean() < level + 3.3 * np.sqrt(level / n)
    assert (p < 0.05).mean() > 0.005


@pytest.mark.parametrize("nu", [4.0, 12.0])
def test_a_mean_square_against_one_of_few_readings_is_fishers(nu: float) -> None:
    """A hundredth for the nodes of the variance."""
    variance = uncertain_variance(np.array([[2.5]]), np.array([nu]))
    high, low = mean_square_tails(6.0, np.full(6, 0.7), 5.0, variance)
    assert high == pytest.approx(stats.f.sf(6.0 / 2.5, 30, nu), rel=0.01)
    assert low == pytest.approx(stats.f.cdf(6.0 / 2.5, 30, nu), rel=0.01)


def p_of(ratio: FloatArray, correlation: FloatArray, df: float, dof: float = np.inf) -> float:
    """p of items of one mean square whose values have this correlation."""
    variance = uncertain_variance(np.ones((1, 1)), np.array([dof]))
    return pooled_p(ratio, correlation, 2 * correlation**2 / df, variance)


@pytest.mark.parametrize("T", [1.2, 1.5, 0.7])
def test_independent_items_are_one_chi_squared(T: float) -> None:
    """30 items of 4 degrees of freedom: chi-squared of 120, to 1 in 1000."""
    found = p_of(np.full(30, T), np.eye(30), 4.0)
    tail = min(stats.chi2.sf(120 * T, 120), stats.chi2.cdf(120 * T, 120))
    assert found == pytest.approx(2 * tail, rel=1e-3)


@pytest.mark.parametrize("common", [0.3, 0.8])
@pytest.mark.parametrize("tail", [0.0005, 0.005, 0.025])
def test_correlated_items_against_draws(common: float, tail: float) -> None:
    """Four standard errors of the drawn quantiles, and 2 % for the formula."""
    m, df, draws = 24, 5, 100_000
    correlation = common * np.ones((m, m)) + (1 - common) * np.eye(m)
    sizes = np.linalg.eigvalsh(correlation)
    T = np.random.default_rng(11).chisquare(df, (draws, m)) @ sizes / (df * m)
    for end in np.quantile(T, [tail, 1 - tail]):
        found = p_of(np.full(m, end), correlation, df)
        error = 2 * 4 * np.sqrt(tail / draws)
        assert found == pytest.approx(2 * tail, abs=error + 0.02 * 2 * tail)
