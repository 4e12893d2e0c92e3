import statistics
import warnings

import numpy as np
import pytest
from numpy.typing import NDArray
from pass_designs import (
    DRIFT,
    NO_DRIFT,
    PLACES,
    UNBALANCED,
    Design,
    balanced,
    dense_covariance,
    drawn,
    fitted,
    plain_passes,
)
from scipy import stats
from scipy.linalg import orth
from scipy.special import stdtrit
from scipy.stats import ttest_ind

from mtu_cli.stats import outliers
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed_model import PassFit, fit_passes
from mtu_cli.stats.outliers import (
    GROSS,
    NEAR,
    NEAR_EFFICIENCY,
    OUTLYING_P,
    deviation_p,
    median_polish,
    outlying,
    outstanding_rows,
    spikes,
)
from mtu_cli.stats.pass_tests import (
    MAX_POSITIONS,
    FTest,
    lack_of_fit,
    pass_scatter,
    pass_trend,
    reversal,
)

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    # statsmodels ships no types.
    from statsmodels.regression.linear_model import OLS  # type: ignore[import-untyped]

IntArray = NDArray[np.int64]

DESIGNS = {"balanced": balanced(6), "balanced, both ways": balanced(6, both=True), **UNBALANCED}


def dummies(codes: IntArray | FloatArray) -> FloatArray:
    return np.array(codes[:, None] == np.unique(codes), dtype=np.float64)


def lines(codes: IntArray | FloatArray, position: FloatArray) -> FloatArray:
    """A level and a slope for every code."""
    own = dummies(codes)
    return np.hstack([own, own * (position[:, None] - 185.0) / 185.0])


def nested(y: FloatArray, full: FloatArray, reduced: FloatArray) -> FTest:
    """F test of nested models by statsmodels, on orthonormal bases of their columns."""
    F, p, df = OLS(y, orth(full)).fit().compare_f_test(OLS(y, orth(reduced)).fit())
    within = len(y) - np.linalg.matrix_rank(full)
    return FTest(F=float(F), p=float(p), df=(int(df), int(within)))


def assert_same(found: FTest | None, wanted: FTest) -> None:
    assert found is not None
    assert pytest.approx(wanted.F, rel=1e-7) == found.F
    assert found.p == pytest.approx(wanted.p, rel=1e-6, abs=1e-14)
    assert found.df == wanted.df


@pytest.mark.parametrize("name", DESIGNS)
@pytest.mark.parametrize("D", [NO_DRIFT, DRIFT], ids=["no drift", "drift"])
def test_pass_scatter_is_the_analysis_of_covariance(name: str, D: FloatArray) -> None:
    """One line a pass against one line a direction, by statsmodels, on any design."""
    design = DESIGNS[name]
    y = drawn(design, np.random.default_rng(1), D, reversal=3.0)
    wanted = nested(
        y, lines(design.group, design.position), lines(design.direction, design.position)
    )
    assert_same(pass_scatter(fitted(design, y)), wanted)


@pytest.mark.parametrize("both", [False, True], ids=["one direction", "both directions"])
def test_trend_is_the_slope_of_the_levels(both: bool) -> None:
    """Ordinary least squares of the passes' levels on direction and order, by statsmodels."""
    design = balanced(9, both=both)
    y = drawn(design, np.random.default_rng(2), reversal=3.0) + 0.4 * design.group
    order = np.array([3.0, 1.0, 4.0, 1.5, 9.0, 2.6, 5.0, 3.5, 8.0])
    level = plain_passes(design, y).lines[:, 0]
    columns = [np.ones(9), np.argsort(np.argsort(order))]
    if both:
        columns.append(np.where(np.arange(9) % 2 == 0, 1.0, -1.0))
    wanted = OLS(level, np.column_stack(columns)).fit()
    found = pass_trend(fitted(design, y), order)
    assert found is not None
    assert found.value == pytest.approx(wanted.params[1], rel=1e-8)
    assert found.u == pytest.approx(wanted.bse[1], rel=1e-8)
    assert found.p == pytest.approx(wanted.pvalues[1], rel=1e-7)
    assert found.dof == wanted.df_resid


def test_reversal_is_forward_minus_reverse() -> None:
    """Student's two-sample t of the passes' means."""
    design = balanced(10, both=True)
    y = drawn(design, np.random.default_rng(3), reversal=6.0)
    means = y.reshape(10, 8).mean(axis=1)
    wanted = ttest_ind(means[0::2], means[1::2])
    found = reversal(fitted(design, y), np.arange(10.0))
    assert found is not None
    assert found.value == pytest.approx(means[0::2].mean() - means[1::2].mean(), rel=1e-9)
    assert found.value > 0
    assert found.value / found.u == pytest.approx(wanted.statistic, rel=1e-8)
    assert found.p == pytest.approx(wanted.pvalue, rel=1e-7)
    assert found.dof == 8


def in_runs(design: Design, y: FloatArray, degree: int = 1) -> PassFit:
    """Two passes that follow each other are a run there and back."""
    runs = design.group // 2
    return fit_passes(y, design.position, degree, design.group, design.direction, runs)


def test_of_runs_the_reversal_is_that_of_levels_less_a_steady_drift() -> None:
    """Its value is the coefficient of direction beside order, by statsmodels; its u by hand."""
    design = balanced(10, both=True)
    rng = np.random.default_rng(5)
    shared = rng.normal(0, 2.0, 20)[design.group // 2]
    y = drawn(design, rng, reversal=6.0) + shared + 0.5 * design.group
    level = plain_passes(design, y).lines[:, 0]
    way = np.where(np.arange(10) % 2 == 0, 0.5, -0.5)
    wanted = OLS(level, np.column_stack([np.ones(10), way, np.arange(10)])).fit()
    found = reversal(in_runs(design, y), np.arange(10.0))
    assert found is not None
    assert found.value == pytest.approx(wanted.params[1], rel=1e-8)
    m, h = (level[0::2] + level[1::2]) / 2, (level[0::2] - level[1::2]) / 2
    # Runs are at -4, -2, 0, 2, 4: the sum of squares is 40.
    u2 = 4 * np.var(h, ddof=1) / 5 + np.var(m, ddof=1) / 40
    assert found.u == pytest.approx(u2**0.5, rel=1e-8)
    assert found.dof == 4


@pytest.mark.parametrize("drift", [1.0, 3.0])
def test_where_the_order_is_assumed_a_steady_drift_is_no_reversal(drift: float) -> None:
    """Reverse was read first, which without times nobody can say: the drift is in u."""
    design = balanced(10, both=True)
    rng = np.random.default_rng(9)
    alarms = 0
    for _ in range(300):
        y = drawn(design, rng, NO_DRIFT) + drift * (design.group // 2 * 2 + (design.direction > 0))
        found = reversal(in_runs(design, y), np.arange(10.0), timed=False)
        assert found is not None
        assert found.value == pytest.approx(drift, abs=1.5)
        alarms += found.p < 0.05
    assert alarms < 300 * (0.05 + 3 * (0.05 * 0.95 / 300) ** 0.5)


@pytest.mark.parametrize("passes", [2.0, 4.0, 8.0])
def test_a_warm_up_is_no_reversal(passes: float) -> None:
    """An axis that grows by 20 um, ever more slowly, with so many passes of a time constant."""
    design = balanced(10, both=True)
    rng = np.random.default_rng(7)
    growth = 20 * (1 - np.exp(-design.group / passes))
    alarms = 0
    for _ in range(300):
        found = reversal(in_runs(design, drawn(design, rng, NO_DRIFT) + growth), np.arange(10.0))
        assert found is not None
        alarms += found.p < 0.05
    assert alarms < 300 * (0.05 + 3 * (0.05 * 0.95 / 300) ** 0.5)


@pytest.mark.parametrize("name", DESIGNS)
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_lack_of_fit_within_passes(name: str, degree: int) -> None:
    """Free means against the polynomial, both beside the passes' own lines, by statsmodels."""
    design = DESIGNS[name]
    y = drawn(design, np.random.default_rng(4)) + 0.5 * np.sin(design.position / 30)
    own = lines(design.group, design.position) if degree else dummies(design.group)
    scaled = (design.position - 185.0) / 185.0
    powers = np.column_stack([scaled**k for k in range(degree + 1)])
    wanted = nested(y, np.hstack([own, dummies(design.position)]), np.hstack([own, powers]))
    assert_same(lack_of_fit(y, design.position, degree, design.group), wanted)


def test_what_cannot_be_tested_is_none() -> None:
    rng = np.random.default_rng(9)
    few = balanced(2)
    fit = fitted(few, drawn(few, rng))
    assert pass_scatter(fit) is not None
    assert pass_trend(fit, np.arange(2.0)) is None
    assert reversal(fit, np.arange(float(fit.n_passes))) is None
    y = rng.normal(size=8)
    assert lack_of_fit(y, PLACES, 1, None) is None
    assert lack_of_fit(y, np.repeat(PLACES[:2], 4), 1, None) is None
    assert lack_of_fit(y, np.zeros(8), 0, np.arange(8)) is None
    many = np.repeat(np.arange(MAX_POSITIONS + 1.0), 2)
    assert lack_of_fit(rng.normal(size=len(many)), many, 1, None) is None


# Runs there and back: their mean squares by statsmodels, by dense matrices, and by simulation.


WARM = np.array([[9.0, 0.01], [0.01, 4e-4]])


def warm(design: Design, rng: np.random.Generator, K: FloatArray) -> FloatArray:
    """What both directions of a run share at every reading: a level and a slope of covariance K."""
    run = design.group // 2
    shared = rng.multivariate_normal(np.zeros(2), K, size=int(run.max()) + 1)[run]
    found: FloatArray = shared[:, 0] + shared[:, 1] * (design.position - design.position.mean())
    return found


MISSING = {
    "readings missing": balanced(10, both=True).without({(0, 5), (1, 1), (1, 2), (4, 0)}),
    "one broke off": balanced(10, both=True).without({(3, i) for i in range(1, 8)}),
    "a pass without fellow": balanced(11, both=True),
}


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("name", MISSING)
def test_unbalanced_runs_against_dense_matrices(name: str, degree: int) -> None:
    """Every reading's covariance with every other written out: D within a pass, K within a run."""
    design = MISSING[name]
    rng = np.random.default_rng(3)
    y = drawn(design, rng, 3 * DRIFT, reversal=3.0) + warm(design, rng, 0.3 * WARM)
    fit = in_runs(design, y, degree)
    kept = fit.groups
    runs, signs = kept // 2, fit.group_direction
    both = [r for r in np.unique(runs) if (runs == r).sum() == 2]
    place = [[np.flatnonzero((runs == r) & (signs == s))[0] for s in (1, -1)] for r in both]
    there, back = (fit.pass_coefficients[[pair[i] for pair in place]] for i in (0, 1))
    K = (there - there.mean(axis=0)).T @ (back - back.mean(axis=0)) / (len(both) - 1)
    K = (K + K.T) / 2
    # Nothing is cut here.
    assert np.abs(np.linalg.eigvals(np.linalg.solve(fit.between, K))).max() < 1
    c = design.position.mean()
    X = np.stack([design.position**k for k in range(degree + 1)], axis=1)
    Z = np.column_stack([np.ones(len(y)), design.position - c])
    run = design.group // 2
    fellows = (run[:, None] == run) & (design.group[:, None] != design.group)
    H = np.linalg.inv(X.T @ X) @ X.T
    wanted = dense_covariance(design, degree, fit.s2, fit.D_moment)
    wanted = wanted + H @ np.where(fellows, Z @ K @ Z.T, 0.0) @ H.T
    scale = np.sqrt(np.diag(wanted))
    scaled = np.outer(scale, scale)
    np.testing.assert_allclose(fit.covariance / scaled, wanted / scaled, atol=1e-6)


@pytest.mark.parametrize(
    ("own", "shared"),
    [(NO_DRIFT, NO_DRIFT), (DRIFT, NO_DRIFT), (NO_DRIFT, WARM), (0.3 * DRIFT, 0.3 * WARM)],
    ids=["no drift", "own", "shared", "some of both"],
)
def test_intervals_cover_whatever_directions_share(own: FloatArray, shared: FloatArray) -> None:
    """95 % intervals with t of pass_dof hold the truth in 95 % of 600 simulated fits."""
    design = balanced(10, both=True)
    rng = np.random.default_rng(31)
    truth, at = np.array([3.0, -0.02]), np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 185.0]])
    hits = np.zeros(3)
    for _ in range(600):
        y = drawn(design, rng, own, reversal=3.0) + warm(design, rng, shared)
        fit = in_runs(design, y)
        u = np.sqrt(np.einsum("ij,jk,ik->i", at, fit.covariance, at))
        hits += np.abs(at @ (fit.plain.coefficients - truth)) <= stdtrit(fit.pass_dof, 0.975) * u
    assert (np.abs(hits / 600 - 0.95) < 3.3 * np.sqrt(0.95 * 0.05 / 600)).all()


# Rows and values that stand out: false alarms over a whole table, power, groups, spikes.


ROWS, COLUMNS = 21, 30
GROUPS = np.arange(COLUMNS) % 2


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """199 rotations: p in steps of 0.005 are fine enough for the 5 % level."""
    monkeypatch.setattr(outliers, "ROTATIONS", 199)


def clean(seed: int, rho: float, missing: float = 0.0) -> FloatArray:
    rng = np.random.default_rng([seed, 17])
    common = rng.standard_normal((ROWS, 2))[:, GROUPS]
    own = rng.standard_normal((ROWS, COLUMNS))
    table = np.sqrt(rho) * common + np.sqrt(1 - rho) * own
    table[rng.random(table.shape) < missing] = np.nan
    result: FloatArray = table
    return result


def alarmed(table: FloatArray, seed: int) -> np.ndarray:
    found = outstanding_rows(table, GROUPS, seed)
    rows: np.ndarray = np.minimum(found.by_row, found.by_cell.min(axis=1)) <= 0.05
    return rows


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(("rho", "missing"), [(0.0, 0.0), (0.8, 0.0), (0.5, 0.1)])
def test_false_alarms_of_a_whole_table(rho: float, missing: float) -> None:
    runs = 150
    alarms = sum(alarmed(clean(s, rho, missing), s).any() for s in range(runs)) / runs
    error = np.sqrt(0.05 * 0.95 / runs)
    assert alarms <= 0.05 + 3 * error
    # A test that never alarms would do that too; missing entries may cost some of the rate.
    assert alarms >= 0.005


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("rho", [0.0, 0.5])
def test_a_row_shifted_by_four_sigma_is_found(rho: float) -> None:
    runs = 60
    found = others = 0
    for seed in range(runs):
        table = clean(seed, rho)
        table[4] += 4.0
        rows = alarmed(table, seed)
        found += int(rows[4])
        others += int(np.delete(rows, 4).any())
    assert found >= 0.95 * runs
    assert others <= 0.15 * runs


def test_large_tables_by_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outliers, "ENTRIES", 0)
    table = clean(6, 0.3)
    assert not alarmed(table, 1).any()
    table[3] += 5.0
    assert np.flatnonzero(alarmed(table, 1)).tolist() == [3]
    many = np.random.default_rng(1).standard_normal((300, 40))
    many[8] += 1.0
    many[200, 6] = 12.0
    found = outstanding_rows(many, np.zeros(40, np.int64), 1)
    assert found.by_row[8] <= 0.05
    assert found.by_cell[200, 6] <= 0.001
    runs = 120
    alarms = sum(alarmed(clean(s, 0.5), s).any() for s in range(runs)) / runs
    assert alarms <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / runs)


def test_grubbs() -> None:
    """Critical values of Grubbs 1969, Technometrics 11, Table I, two-sided 5 %: the largest of n
    deviations at 5 % / (2 n) in a tail.
    """
    printed = {10: 2.290, 20: 2.709, 30: 2.908}
    for n, value in printed.items():
        # His third decimal is off by one in places.
        p = deviation_p(np.array([value - 0.001, value + 0.001]), np.full(2, float(n)))
        assert p[1] < 0.05 / n < p[0]
    assert deviation_p(np.array(1.0), np.array(2.0)) == 1.0


# The one definition of an outlier, against a plain version, and how often chance meets it.


RNG = np.random.default_rng(20261128)


def plain(values: list[float], fitted: int) -> tuple[set[int], float]:
    """Value by value, with statistics of the library, Student's t and the truncated normal of
    scipy.
    """
    middle = statistics.median(values)
    away = [abs(v - middle) for v in values]
    n, dof = len(values), len(values) - fitted - 1
    near = sorted(away)[: int(NEAR * n)]
    end = float(stats.norm.isf((1 - NEAR) / 2))
    normal = float(stats.truncnorm(-end, end).var())
    s = (statistics.fmean(d**2 for d in near) / normal / (dof / n)) ** 0.5
    t = float(stats.t.isf(OUTLYING_P / (2 * n), NEAR_EFFICIENCY * dof))
    return {i for i, d in enumerate(away) if d > max(GROSS, t) * s}, s


@pytest.mark.parametrize("n", [12, 40, 300])
@pytest.mark.parametrize("slips", [0, 1, 2])
def test_as_a_plain_version(n: int, slips: int) -> None:
    values = RNG.normal(0, 1, n)
    at = RNG.choice(n, slips, replace=False)
    values[at] += RNG.choice([-1, 1], slips) * RNG.uniform(60, 100, slips)
    found, s = outlying(values, fitted=2)
    expected, plain_s = plain(values.tolist(), fitted=2)
    assert set(np.flatnonzero(found)) == expected
    assert s == pytest.approx(plain_s, rel=1e-9)


def test_chance_seldom_meets_it() -> None:
    """A thousandth of the samples at most, of few values and of many."""
    for n in (8, 20, 80):
        sets = RNG.normal(0, 1, (1000, n))
        assert sum(bool(outlying(own)[0].any()) for own in sets) <= 1
        assert sum(bool(spikes(own.cumsum())[0].any()) for own in sets) <= 3


def test_spikes_of_a_curve_are_named_and_its_kinks_are_not() -> None:
    t = np.arange(60.0)
    curve = np.where(t < 30, t, 30 + 5 * (t - 30)) + RNG.normal(0, 0.05, 60)
    assert not spikes(curve)[0].any()
    for at in ([10], [29], [30], [5, 7], [40, 41], [3, 20, 33, 50]):
        own = curve.copy()
        own[at] += 40
        assert np.flatnonzero(spikes(own)[0]).tolist() == at


def test_a_last_digit_is_no_outlier() -> None:
    """All readings alike but one, by one digit: with the variance of the display it is none."""
    values = np.array([2.0] * 19 + [3.0])
    assert outlying(values)[0].sum() == 1
    assert not outlying(values, r=1 / 12)[0].any()
    assert outlying(np.where(values == 3, 30, values), r=1 / 12)[0].sum() == 1
    curve = np.where(np.arange(40) == 20, 1.0, 0.0)
    assert not spikes(curve, r=1 / 12)[0].any()
    assert spikes(30 * curve, r=1 / 12)[0].sum() == 1


def test_a_polish_leaves_what_is_neither_of_row_nor_of_column() -> None:
    """Levels of rows and columns and slopes of rows are taken out, one slip is not."""
    x = np.arange(5.0)
    table = np.arange(6.0)[:, None] + x**2 + np.outer([0, 1, 2, 3, 4, 5.0], x)
    table[2, 3] += 9.0
    table[4, 0] = np.nan
    left = median_polish(table, x)
    assert left[2, 3] == pytest.approx(9.0, abs=0.5)
    left[2, 3] = 0.0
    assert np.nanmax(np.abs(left)) < 0.5
