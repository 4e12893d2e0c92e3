"""One-way data with unequal repeats, for the tests of the analysis of variance."""

import warnings
from contextlib import suppress

import numpy as np
import pytest
import scipy.stats

from mtu_cli.stats.anova import Cells, cells_of, moments, one_way, part_interval, reml
from mtu_cli.stats.least_squares import FloatArray, IntArray

PAPER = (5, 5, 5, 5, *[2] * 17)
"""Gilsinn & Ling 2004, section 4.1: repeats of the 21 parts, 54 in all."""


def simulated(
    repeats: tuple[int, ...], tables: int, s_part: float, s_repeat: float, seed: int
) -> tuple[FloatArray, IntArray]:
    """Values (tables, N) and the part (N,) of each."""
    rng = np.random.default_rng(seed)
    part: IntArray = np.repeat(np.arange(len(repeats)), repeats).astype(np.int64)
    parts = s_part * rng.standard_normal((tables, len(repeats)))
    return parts[:, part] + s_repeat * rng.standard_normal((tables, len(part))), part


def cells(values: FloatArray, part: IntArray, parts: int) -> Cells:
    """Cells of values (tables, N)."""
    tables = len(values)
    cell = np.arange(tables)[:, None] * parts + part
    return cells_of(values.ravel(), cell.ravel(), tables, parts)


def drawn(
    repeats: tuple[int, ...], tables: int, s_part: float, s_repeat: float, seed: int
) -> Cells:
    """Cells of simulated tables."""
    values, part = simulated(repeats, tables, s_part, s_repeat, seed)
    return cells(values, part, len(repeats))


# One-way analysis of variance: a slow plain version, expectations, coverage, edges.


TABLES = 2000


def plain(values: FloatArray, part: IntArray) -> dict[str, float]:
    """Gilsinn & Ling 2004, eqs. (29)-(30), as they are printed."""
    groups = [values[part == i] for i in np.unique(part)]
    N, a = len(values), len(groups)
    grand = sum(len(g) * g.mean() for g in groups) / N
    between = sum(len(g) * (g.mean() - grand) ** 2 for g in groups) / (a - 1)
    within = sum((len(g) - 1) * g.var(ddof=1) for g in groups if len(g) > 1) / (N - a)
    n0 = (N - sum(len(g) ** 2 for g in groups) / N) / (a - 1)
    return {"mean": grand, "ms_between": between, "ms_within": within, "n0": n0}


@pytest.mark.parametrize("repeats", [PAPER, (3, 3), (1, 4, 2), (2, 1, 1, 1, 6)])
def test_against_the_plain_version(repeats: tuple[int, ...]) -> None:
    values, part = simulated(repeats, 7, 2.0, 0.5, 3)
    values += 1000.0
    table = one_way(cells(values, part, len(repeats)))
    for i, row in enumerate(values):
        for name, expected in plain(row, part).items():
            # Common leading digits cost the plain version about four of sixteen.
            assert getattr(table, name)[i] == pytest.approx(expected, rel=1e-9), name
    np.testing.assert_allclose(table.F, table.ms_between / table.ms_within)


def test_scrambled_rows_and_missing_cells() -> None:
    values, part = simulated((3, 2, 4, 1), 2, 1.0, 1.0, 5)
    cell = (np.arange(2)[:, None] * 5 + part).ravel()
    order = np.random.default_rng(1).permutation(len(cell))
    keep = cell != 7
    found = cells_of(values.ravel()[order], cell[order], 2, 5)
    assert found.n.tolist() == [[3, 2, 4, 1, 0]] * 2
    assert one_way(found).parts.tolist() == [4, 4]
    thinned = one_way(cells_of(values.ravel()[keep], cell[keep], 2, 5))
    expected = plain(values[1][part != 2], part[part != 2])
    assert thinned.ms_between[1] == pytest.approx(expected["ms_between"], rel=1e-12)
    assert thinned.df_between.tolist() == [3, 2]


def test_critical_value_and_p_of_the_paper() -> None:
    """1.90 for 20 and 33 degrees of freedom (Gilsinn & Ling 2004, section 4.1)."""
    table = one_way(drawn(PAPER, 3, 1.0, 1.0, 8))
    assert (table.df_between[0], table.df_within[0]) == (20, 33)
    assert f"{table.F_critical_95[0]:.2f}" == "1.90"
    assert f"{table.n0[0]:.3f}" == "2.544"


@pytest.mark.parametrize("ratio", [0.3, 1.0, 5.0])
def test_interval_covers(ratio: float) -> None:
    """95 % intervals with the paper's design cover in 93 to 97 % of 2000 studies."""
    found = drawn(PAPER, TABLES, ratio, 1.0, 11)
    low, high = part_interval(found, one_way(found)).T
    assert 0.93 <= np.mean((low <= ratio**2) & (ratio**2 <= high)) <= 0.97


@pytest.mark.parametrize("repeats", [(2,) * 5, (1, 2, 3, 4, 5, 1, 2)])
@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.5])
def test_interval_covers_with_its_empty_ones_as_misses(
    repeats: tuple[int, ...], ratio: float
) -> None:
    """Small part scatter, few parts: [0, 0] misses any of it, and all together keep 95 %.

    It is there in 2.5 % of studies of parts that are alike, where F is below its quantile, and in
    fewer of others.
    """
    found = drawn(repeats, TABLES, ratio, 1.0, 13)
    table = one_way(found)
    low, high = part_interval(found, table).T
    error = 4 * np.sqrt(0.95 * 0.05 / TABLES)
    assert np.mean((low <= ratio**2) & (ratio**2 <= high)) > 0.95 - error
    empty = high == 0
    assert (low[empty] == 0).all()
    assert np.mean(empty) < 0.025 + 4 * np.sqrt(0.025 * 0.975 / TABLES)
    if len(set(repeats)) == 1:
        limit = scipy.stats.f.ppf(0.025, table.df_between, table.df_within)
        np.testing.assert_array_equal(empty, limit > table.F)
    assert empty.any()


def test_interval_is_exact_without_repeat_scatter() -> None:
    """Equal repeats: the parts' variance has its chi-squared interval (Student 1908)."""
    values, part = simulated((2,) * 6, 1, 1.0, 0.0, 9)
    found = cells(values, part, 6)
    # Quantiles of chi-squared with 5 degrees of freedom, from printed tables.
    expected = 5 * np.var(values[0][::2], ddof=1) / np.array([12.833, 0.8312])
    np.testing.assert_allclose(part_interval(found, one_way(found))[0], expected, rtol=1e-4)


@pytest.mark.parametrize("n", [2, 3, 7, 2001])
def test_equal_repeats_have_exactly_no_variance(n: int) -> None:
    values = np.repeat([0.1, 183.8437, 1e6 / 3], n)
    table = one_way(cells_of(values, np.repeat([0, 1, 2], n), 1, 3))
    assert table.ms_within[0] == 0
    assert np.isnan(table.F[0])
    assert np.isnan(table.p[0])


# Components of variance by REML against statsmodels, closed forms and the edges.


DESIGNS = [PAPER, (3, 1, 2, 4, 1), (2, 2, 5, 1, 1, 3, 4), (6, 1, 1, 1, 1, 1)]


def other(values: FloatArray, part: IntArray) -> tuple[float, float]:
    """statsmodels' MixedLM: where its gradients lead nowhere, without them."""
    statsmodels = pytest.importorskip("statsmodels.api")
    model = statsmodels.MixedLM(values, np.ones((len(values), 1)), groups=part)
    fits = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in ("bfgs", "powell"):
            # Its optimisers may step onto a singular Hessian.
            with suppress(np.linalg.LinAlgError):
                # What is called converged by default is good to three digits only.
                fits.append(model.fit(reml=True, method=[name], gtol=1e-8))
                if fits[-1].converged:
                    break
    best = max((fit for fit in fits if np.isfinite(fit.llf)), key=lambda fit: fit.llf)
    return float(np.ravel(best.cov_re)[0]), float(best.scale)


@pytest.mark.parametrize("repeats", DESIGNS)
@pytest.mark.parametrize("s_part", [0.0, 0.4, 4.0])
def test_against_statsmodels(repeats: tuple[int, ...], s_part: float) -> None:
    """To four digits; near 0, where statsmodels' optimisers reach no more, of s_repeat^2."""
    values, part = simulated(repeats, 3, s_part, 1.0, 21)
    found = reml(cells(values, part, len(repeats)))
    for i, row in enumerate(values):
        expected = other(row, part)
        near = 1e-4 * expected[1] if expected[0] < 0.1 * expected[1] else 0.0
        assert found.part[i] == pytest.approx(expected[0], rel=1e-4, abs=near)
        assert found.repeat[i] == pytest.approx(expected[1], rel=1e-4)


@pytest.mark.parametrize("s_part", [0.0, 1.0, 100.0, 4e4, 1e5, 1e7])
def test_balanced_data_have_the_moment_estimate(s_part: float) -> None:
    """Where it is not negative (Searle, Casella & McCulloch 1992, 3.8); F up to 1e14 and more."""
    found = drawn((3,) * 8, 300, s_part, 1.0, 2)
    table = one_way(found)
    expected = moments(table)
    positive = expected.part_estimate > 1e-6
    assert positive.sum() > 100
    ours = reml(found)
    np.testing.assert_allclose(ours.part[positive], expected.part[positive], rtol=1e-6)
    np.testing.assert_allclose(ours.repeat[positive], expected.repeat[positive], rtol=1e-6)


def test_equal_repeats_leave_the_variance_of_the_means() -> None:
    values, part = simulated((3, 1, 2, 2), 1, 1.0, 0.0, 3)
    found = reml(cells(values, part, 4))
    means = [values[0][part == i][0] for i in range(4)]
    assert found.repeat[0] == 0
    assert found.part[0] == pytest.approx(np.var(means, ddof=1), rel=1e-9)
