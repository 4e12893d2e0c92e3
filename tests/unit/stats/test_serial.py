"""Regression with errors that follow each other: exact limits, coverage, attenuation, clusters."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from made_tables import remembering
from plain_selection import by_full_refits
from scipy.integrate import solve_ivp
from scipy.signal import lfilter
from scipy.special import stdtrit

from mtu_cli.stats.least_squares import (
    Compressed,
    FloatArray,
    compress,
    ridge,
    stepwise,
    together,
)
from mtu_cli.stats.resolution import hidden, rounding_variance, step_of
from mtu_cli.stats.serial import (
    Block,
    SerialFit,
    collinearity,
    first_order_lag,
    normality_p,
)

NONE = np.zeros((2, 2))


def blocks(
    rng: np.random.Generator, phi: float, count: int = 6, n: int = 30, noise: float = 0.0
) -> list[Block]:
    found = []
    for cluster in range(count):
        X = np.column_stack([np.linspace(0, 3, n) ** 0.5, remembering(rng, n, 0.9)])
        y = X @ [2.0, -1.0] + cluster + 0.3 * remembering(rng, n, phi)
        read = X + noise * rng.standard_normal(X.shape)
        found.append(Block(read, y, cluster, noise**2 * np.eye(2)))
    return found


def test_white_errors_are_least_squares() -> None:
    """Levels of blocks are those of indicator columns, and the u that of s^2 (X'X)^-1."""
    given = blocks(np.random.default_rng(1), 0.0, count=4, n=200)
    X = np.vstack([np.hstack([b.X, np.tile(np.eye(4)[b.cluster], (200, 1))]) for b in given])
    y = np.concatenate([b.y for b in given])
    b, rss, *_ = np.linalg.lstsq(X, y, rcond=None)
    u = np.sqrt(rss[0] / (len(y) - 6) * np.diag(np.linalg.inv(X.T @ X))[:2])
    found = SerialFit(given, levels=True).combinations(np.eye(2))
    assert found.value == pytest.approx(b[:2], abs=0.2 * u.min())
    assert found.u == pytest.approx(u, rel=0.5)


@pytest.mark.parametrize("phi", [0.0, 0.95])
def test_intervals_cover(phi: float) -> None:
    held, sets = [], 60
    for rng in np.random.default_rng(2).spawn(sets):
        found = SerialFit(blocks(rng, phi), levels=True).combinations(np.eye(2))
        half = stdtrit(found.dof, 0.975) * found.u
        held += (np.abs(found.value - [2.0, -1.0]) <= half).tolist()
    assert np.mean(held) > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / len(held))


def test_clusters_decide_where_there_are_many() -> None:
    """With a slope of its own in each cluster, u is that of the mean of their slopes."""
    rng = np.random.default_rng(3)
    x = np.linspace(-1, 1, 20)[:, None]
    slopes = 1 + 0.5 * rng.standard_normal(12)
    given = [
        Block(x, x[:, 0] * slope + 0.01 * rng.standard_normal(20), c, np.zeros((1, 1)))
        for c, slope in enumerate(slopes)
    ]
    found = SerialFit(given, levels=True).combinations(np.eye(1))
    assert found.clustered[0]
    assert found.dof[0] == pytest.approx(11, abs=0.1)
    assert found.value[0] == pytest.approx(slopes.mean(), abs=0.02)
    assert found.u[0] == pytest.approx(np.std(slopes, ddof=1) / np.sqrt(12), rel=0.05)


def test_noise_of_the_columns_is_taken_back() -> None:
    given = blocks(np.random.default_rng(4), 0.0, count=12, n=100, noise=0.4)
    plain = SerialFit([b._replace(noise=NONE) for b in given], levels=True)
    found = SerialFit(given, levels=True).combinations(np.eye(2))
    assert abs(plain.combinations(np.eye(2)).value[1]) < 0.95
    assert found.value[1] == pytest.approx(-1.0, abs=3 * found.u[1])


# Normality by its rate of rejection; variance inflation of dependent columns.


@pytest.mark.parametrize("memory", [0.0, 0.19, 0.7, 0.9])
def test_normal_residuals_are_rejected_as_often_as_said(memory: float) -> None:
    """5 %, whether or not the readings follow each other; skewed ones nearly always."""
    rng, n, runs = np.random.default_rng(2), 1200, 600
    shocks = rng.standard_normal((runs, n)) * np.sqrt(1 - memory**2)
    values = lfilter([1.0], [1.0, -memory], shocks, axis=1)[:, 200:]
    effective = 1000 * (1 - memory) / (1 + memory)
    p = np.array([normality_p(row, effective) for row in values])
    assert 0.025 < np.mean(p < 0.05) < 0.085
    skewed = np.array([normality_p(np.exp(row), effective) for row in values[:100]])
    assert np.mean(skewed < 0.05) > 0.95


def test_normality_of_too_few_or_equal_residuals_is_unknown() -> None:
    values = np.random.default_rng(3).standard_normal(100)
    assert normality_p(values, 18.0) is None
    assert normality_p(values[:19], 19.0) is None
    assert normality_p(values[:20], 20.0) is not None
    assert normality_p(np.zeros(50), 50.0) is None


def columns(n: int = 60) -> FloatArray:
    rng = np.random.default_rng(11)
    X = rng.normal(size=(n, 4)) @ rng.normal(size=(4, 4)) * [1.0, 1e3, 1e-3, 1.0] + [20, 0, 1, -5]
    centred: FloatArray = X - X.mean(axis=0)
    return centred


def test_dependent_columns() -> None:
    X = columns()
    X[:, 3] = X[:, 0] / X[:, 0].std() - X[:, 1] / X[:, 1].std()
    condition, found = collinearity(X)
    assert np.isinf(found[[0, 1, 3]]).all()
    assert found[2] == pytest.approx(collinearity(X[:, :3])[1][2], rel=1e-6)
    assert condition == np.inf


# The last digit that values were printed to, and what it hides.


EXACT = np.random.default_rng(1).uniform(-500, 500, 200)


@pytest.mark.parametrize("step", [5.0, 0.01, 5e-3, 2e-3, 1e-4, 1e-6])
def test_the_last_printed_place_is_found(step: float) -> None:
    printed = np.round(EXACT / step) * step
    assert step_of(printed) == pytest.approx(step)
    # In another unit it is what it is there.
    assert step_of(printed * 4.848e-6 / 4.848e-6) == pytest.approx(step)


@pytest.mark.parametrize(
    ("values", "step"),
    [
        ([97.012], 1e-3),
        ([0.0, 0.3, 0.1 + 0.2, np.nan], 0.1),
        ([12.004, 12.008, 12.004], 1e-3),
        ([10.0, 20.0, 30.0, 40.0], 1.0),
        ([10.0, 20.0, 30.0, 40.0, 60.0], 10.0),
        ([np.pi, 1.0], 1e-9),
        ([0.0, np.nan], 0.0),
        ([], 0.0),
    ],
)
def test_a_coarser_step_takes_five_values(values: list[float], step: float) -> None:
    assert step_of(np.array(values)) == pytest.approx(step)


@pytest.mark.parametrize("s", [0.0, 0.1, 0.3, 0.6, 2.0])
def test_what_is_added_holds_the_error_of_a_mean_of_any_number(s: float) -> None:
    """Means of 20 readings of one value, at all places between two steps: their rms error is no
    more than u, which rounding alone makes where they hardly scatter.
    """
    rng = np.random.default_rng(3)
    true = rng.uniform(0, 1, 4000)
    read = np.round(true[:, None] + s * rng.standard_normal((4000, 20)))
    error = np.sqrt(np.mean((read.mean(axis=1) - true) ** 2))
    s2 = read.var(axis=1, ddof=1)
    u2 = s2 / 20 + hidden(s2, rounding_variance(read.ravel()))
    assert error <= 1.05 * np.sqrt(np.mean(u2))
    assert s > 0 or error == pytest.approx(np.sqrt(np.mean(u2)), rel=0.15)


# Lags.


def uneven(n: int = 40, seed: int = 3) -> tuple[FloatArray, FloatArray]:
    """A rough signal of two columns at uneven times, in min."""
    rng = np.random.default_rng(seed)
    return 20 + rng.normal(size=(n, 2)).cumsum(axis=0), np.cumsum(rng.uniform(0.2, 9.0, n))


def test_a_lag_against_an_integrator() -> None:
    """tau du/dt = T - u, interval by interval, so that no step of the integrator has a kink."""
    signal, time = uneven()
    constants = np.array([5.0, 0.0, 80.0])
    found = first_order_lag(signal, time, constants)
    assert (found[1] == signal).all()
    for k, j in ((0, 0), (2, 1)):
        T, tau, u = signal[:, j], constants[k], signal[0, j]
        for i in range(1, len(time)):

            def slope(
                t: float, state: FloatArray, T: FloatArray = T, tau: float = tau
            ) -> FloatArray:
                return np.asarray((np.interp(t, time, T) - state) / tau, float)

            span = (float(time[i - 1]), float(time[i]))
            u = solve_ivp(slope, span, np.array([u]), rtol=1e-10, atol=1e-12).y[0, -1]
            assert found[k, i, j] == pytest.approx(u, rel=1e-8)


def test_an_earlier_time_starts_a_new_run_and_after_an_infinite_step_all_is_settled() -> None:
    signal, _ = uneven(30)
    time, tau = np.tile(np.linspace(0.0, 40.0, 15), 2), np.array([9.0])
    found = first_order_lag(signal, time, tau)
    for run in (slice(0, 15), slice(15, 30)):
        assert (found[:, run] == first_order_lag(signal[run], time[run], tau)).all()
    far = first_order_lag(np.array([[20.0], [26.0]]), np.array([0.0, np.inf]), tau)
    assert far[0, :, 0] == pytest.approx([20.0, 26.0])
    assert first_order_lag(signal[:1], np.zeros(1), tau).shape == (1, 1, 2)


def test_rows_of_one_moment_are_one_sample() -> None:
    """Their mean, as if it had been read once; without lag every row keeps its own."""
    rng = np.random.default_rng(9)
    time = np.sort(rng.uniform(0, 100, 12))
    signal, tau = rng.normal(size=(12, 2)), np.array([0.0, 7.0])
    count = rng.integers(1, 4, 12)
    off = [0.1 * (np.arange(k) - (k - 1) / 2) for k in count]
    rows = np.concatenate([signal[i] + own[:, None] for i, own in enumerate(off)])
    found = first_order_lag(rows, np.repeat(time, count), tau)
    assert (found[0] == rows).all()
    once = np.repeat(first_order_lag(signal, time, tau)[1], count, axis=0)
    assert found[1] == pytest.approx(once, rel=1e-12, abs=1e-12)
    equal = first_order_lag(np.repeat(signal, count, axis=0), np.repeat(time, count), tau)
    assert (equal[1] == once).all()


# Compressed rows.


def test_compressed_rows_count_their_pairs_and_levels() -> None:
    Z = np.column_stack([np.ones(6), np.random.default_rng(1).normal(size=(6, 2))])
    found = compress(Z)
    assert (found.n, found.pairs, compress(Z[:1]).pairs) == (6, 5, 0)
    plain = sum((np.outer(a, b) for a, b in pairwise(Z)), np.zeros((3, 3)))
    assert found.lag == pytest.approx(plain, rel=1e-12)
    centred = found.about_mean()
    assert (found.levels, centred.levels, together([centred, centred]).levels) == (1, 1, 2)


# Ridge paths.

PENALTIES = np.array([0.0, 1e-6, 1e-2, 0.3, 10.0])


@pytest.mark.parametrize("repeated", [False, True])
def test_a_ridge_path_is_the_closed_form(repeated: bool) -> None:
    """(X'X + P)^-1 X'y, (X'X + P)^-1 X'X (X'X + P)^-1 and tr (X'X + P)^-1 X'X by inverses, from
    the rows and from a factor of them; a column without any rise gets nothing.
    """
    rng = np.random.default_rng(5)
    X = rng.normal(size=(60, 4))
    X[:, 3] = X[:, 2] + 0.05 * X[:, 3]
    X = X * [1.0, 1e3, 1e-2, 1e-2] + [20.0, 0.0, 1.0, 0.0]
    y = X @ [1.0, 1e-3, 50.0, 20.0] + rng.normal(size=60)
    live = [0, 2, 3] if repeated else [0, 1, 2, 3]
    if repeated:
        X[:, 1] = 7.0
    left, target = (X - X.mean(axis=0))[:, live], y - y.mean()
    S = left.T @ left
    factor = compress(np.column_stack([np.ones(60), X, y])).inner([1, 2, 3, 4, 5])
    for columns, response in ((X - X.mean(axis=0), target), (factor[:, :4], factor[:, 4])):
        path = ridge(columns, response, 60, PENALTIES)
        assert not np.delete(path.coefficients, live, axis=1).any()
        for i, penalty in enumerate(PENALTIES):
            inverse = np.linalg.inv(S + penalty * np.diag(np.diag(S)))
            assert path.coefficients[i, live] == pytest.approx(inverse @ left.T @ target, rel=1e-7)
            one = ridge(columns, response, 60, PENALTIES[i : i + 1])
            covariance = one.unit_covariance[np.ix_(live, live)]
            assert covariance == pytest.approx(inverse @ S @ inverse, rel=1e-6)
            assert path.effective[i] == pytest.approx(np.trace(inverse @ S), rel=1e-9)


# Forward-backward selection.


def independent(Z: FloatArray) -> Compressed:
    """Rows without any autocorrelation, so that their number is their effective one."""
    rows = compress(Z)
    return replace(rows, lag=np.zeros_like(rows.lag))


def collinear(seed: int, n: int = 40, k: int = 7) -> FloatArray:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, k)) @ rng.normal(size=(k, k)) + 20
    y = X @ (rng.normal(size=k) * (rng.uniform(size=k) < 0.5)) + rng.normal(size=n) * 2
    return np.column_stack([np.ones(n), X, y])


def alike(seed: int, apart: float, n: int = 300) -> FloatArray:
    """Eight sensors that follow one room with lags of their own; two more repeat one nearly.

    What the repeats hold beyond it, `apart` of its size, counts in the reading as much as it.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(n)[:, None]
    X = 6 * (1 - np.exp(-time / rng.uniform(40, 120, 8))) + 0.3 * rng.normal(size=(n, 8))
    own = rng.normal(size=(n, 2))
    y = X[:, :4] @ rng.normal(size=4) + own[:, 0] + 0.5 * rng.normal(size=n)
    return np.column_stack([np.ones(n), X, X[:, :1] + apart * own, y])


@pytest.mark.parametrize("limits", [(0.05, 0.10), (0.15, 0.15)])
def test_selection_against_full_refits(limits: tuple[float, float]) -> None:
    sets = [collinear(seed) for seed in range(60)]
    sets += [alike(seed, apart) for apart in (1e-1, 1e-3, 3e-5) for seed in range(10)]
    sizes = set()
    for Z in sets:
        expected = by_full_refits(Z, len(Z), *limits)
        assert list(stepwise(independent(Z), *limits)) == expected
        sizes.add(len(expected))
    assert len(sizes) > 3


def test_error_rate_on_noise_that_follows_itself() -> None:
    """A slow column and noise that it has nothing to do with: 5 % may enter, not half of them.

    The autocorrelation is estimated, so that the rate is near its nominal value only; the
    number of readings alone would let far more in.
    """
    rng = np.random.default_rng(6)
    n, draws, entered, naive = 300, 400, 0, 0
    for _ in range(draws):
        Z = np.column_stack([np.ones(n), remembering(rng, n, 0.99), remembering(rng, n, 0.8)])
        entered += len(stepwise(compress(Z)))
        naive += len(stepwise(independent(Z)))
    error = np.sqrt(0.05 * 0.95 / draws)
    assert 0.05 - 4 * error < entered / draws < 0.08 + 4 * error
    assert naive / draws > 0.3


def test_exact_fits_columns_of_nothing_and_too_few_readings() -> None:
    rng = np.random.default_rng(1)
    X, one = rng.normal(size=(30, 5)) + 20, np.ones(30)
    Z = np.column_stack([one, X, 2 * X[:, 1] - X[:, 3] + 4])
    assert stepwise(independent(Z)) == (2, 4)
    # What is left of a slow column is rounding, which may follow itself: it must not hide it.
    x = np.linspace(20.0, 26.0, 500)
    for slope in np.geomspace(1e-5, 1e3, 10):
        assert stepwise(compress(np.column_stack([np.ones(500), x, slope * x + 0.3]))) == (1,)
    for columns in ([one, X[:, 0]], [one, X[:, 0], 3 * one], [one, 7 * one, X[:, 0]]):
        assert stepwise(compress(np.column_stack(columns))) == ()
    for n in (1, 2):
        assert stepwise(compress(np.array([[1.0, 1, 1], [1, 2, 4]])[:n])) == ()
