"""F tests of scatters: scipy's tails, the rate under the null, heavy tails, what is large."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import (
    Floats,
    coordinate_matrix,
    frame_of,
    holes,
    made,
    sizes,
    whole_frame,
)
from scipy.stats import binom, f, ks_1samp, norm

from mtu_cli.close_loop_sealed.stats.direction_noise import DirectionNoise
from mtu_cli.close_loop_sealed.stats.mean_squares import EntryNoise
from mtu_cli.close_loop_sealed.stats.scatter_tests import scatter_p, score_of, two_scatters_p

STRATA = made(12, 10, 2)
DOF = sizes(STRATA)
UNKNOWN = np.zeros(2)
NO_STEP = np.zeros(len(STRATA.all))


def coordinates(count: int, seed: int, part: float = 1.0, column: float = 1.0) -> Floats:
    """Of tables whose parts and columns have effects of these variances, entries of 1."""
    rng = np.random.default_rng(seed)
    tables = rng.normal(size=(count, 12, 10, 2))
    tables += np.sqrt(part) * rng.normal(size=(count, 12, 1, 2))
    tables += np.sqrt(column) * rng.normal(size=(count, 1, 10, 2))
    return STRATA.coordinates(tables)[0]


def noise(y: Floats) -> EntryNoise:
    return whole_frame(STRATA).noise(y, DOF, DOF, np.zeros((6, 6)))


def judged(y: Floats, predicted: Floats = UNKNOWN, dof: float = np.inf) -> Floats:
    return np.array([scatter_p(STRATA, own, noise(own), predicted, dof, NO_STEP) for own in y])


def plain(table: Floats) -> tuple[float, float]:
    """The same from the table's means, by scipy: columns beside the lines, parts, Bonferroni."""
    P, H, A = table.shape
    L = STRATA.columns[:, :3]
    p_column, p_part, ratios = [], [], []
    n = (P - 1) * (H - 3)
    for a in range(A):
        rest = table[:, :, a] - table[:, :, a].mean(axis=0)
        rest = rest - rest @ L @ L.T
        level = np.sum(rest**2) / n
        mean = table[:, :, a].mean(axis=0)
        column = P * np.sum((mean - L @ L.T @ mean) ** 2) / (H - 3)
        p_column.append(f.sf(column / (level * (1 + P)), H - 3, n))
        part = H * np.var(table[:, :, a].mean(axis=1), ddof=1) / (level * (1 + H))
        p_part.append(f.sf(part, P - 1, n))
        ratios.append(part)
    p_part.append(f.sf(np.mean(ratios), A * (P - 1), n))
    return min(1.0, A * min(p_column)), min(1.0, (A + 1) * min(p_part))


def test_p_are_those_of_f_tests_of_the_means() -> None:
    for seed in (1, 2, 3):
        rng = np.random.default_rng(seed)
        table = rng.normal(size=(12, 10, 2)) + 1.2 * rng.normal(size=(12, 1, 2))
        table += 1.2 * rng.normal(size=(1, 10, 2))
        y, _ = STRATA.coordinates(table)
        found = scatter_p(STRATA, y, noise(y), UNKNOWN, np.inf, NO_STEP)
        assert found == pytest.approx(plain(table), rel=1e-9)


def test_with_missing_cells_noise_is_what_its_entries_give_there() -> None:
    """The mean squares of noise alone, entry by entry, of columns and of parts."""
    there = holes(12, 10, 0.3, 2)
    frame, y = frame_of(STRATA, there), coordinates(1, 12, part=5.0, column=5.0)[0]
    dof = sizes(STRATA, int((~there).sum()))
    own = frame.noise(y, dof, dof, np.zeros((6, 6)))
    T = coordinate_matrix(frame).reshape(STRATA.size, 12, 10, 2) * there[:, :, None]
    p_column, parts = [], []
    for a in range(2):
        v, n = own.variance[a], own.dof[a]
        each = own.variance @ (T**2).sum(axis=(1, 2)).T
        found = {s.kind: s for s in STRATA.all if s.axis == a and s.kind != "line"}
        column = np.arange(STRATA.size)[found["column"].slice][len(found["column"].lead) :]
        part = np.arange(STRATA.size)[found["part"].slice]
        ratio = np.mean(y[column] ** 2) / (np.mean(each[column]) + 12 * v)
        p_column.append(f.sf(ratio, len(column), n))
        parts.append((np.mean(y[part] ** 2) / (np.mean(each[part]) + 10 * v), n))
    p_part = [f.sf(ratio, 11, n) for ratio, n in parts]
    p_part.append(f.sf(np.mean([ratio for ratio, _ in parts]), 22, min(n for _, n in parts)))
    wanted = min(1.0, 2 * min(p_column)), min(1.0, 3 * min(p_part))
    assert scatter_p(STRATA, y, own, UNKNOWN, np.inf, NO_STEP) == pytest.approx(wanted, rel=1e-9)
    assert own.squares.rest[0] != pytest.approx(own.variance[0], rel=0.1)


def test_at_the_limit_of_what_is_ordinary_the_rate_is_kept() -> None:
    p = judged(coordinates(1500, 4))
    for hits in (p < 0.05).sum(axis=0):
        # Bonferroni can only be rarer; it is hardly so for two independent axes.
        assert binom.ppf(1e-4, 1500, 0.03) <= hits <= binom.ppf(1 - 1e-4, 1500, 0.05)
    quiet = judged(coordinates(300, 5, part=0.2, column=0.2))
    assert (quiet < 0.05).sum() <= 2


def test_larger_effects_of_single_columns_or_parts_are_seen() -> None:
    assert (judged(coordinates(100, 6, column=9.0))[:, 0] < 0.01).mean() > 0.9
    assert (judged(coordinates(100, 7, part=9.0))[:, 1] < 0.01).mean() > 0.9


def test_parts_are_held_against_the_machines_own_scatter_where_it_is_known() -> None:
    # Coordinates of a part: 10 entries of variance 3 + 1. The prediction, of 8 degrees of
    # freedom, is itself drawn.
    rng = np.random.default_rng(8)
    y = coordinates(1500, 9, part=3.0)
    p = [judged(own[None], np.full(2, 30.0 * rng.chisquare(8) / 8), 8.0)[0, 1] for own in y]
    assert sum(v < 0.05 for v in p) <= binom.ppf(1 - 1e-4, 1500, 0.05)
    assert (judged(y[:100], np.full(2, 3.0), np.inf)[:, 1] < 0.01).mean() > 0.9
    # Far below the prediction nothing is said.
    assert judged(y[:1], np.full(2, 300.0), np.inf)[0, 1] == 1.0
    # Nor where the model has scatter of parts that no one knows the size of.
    assert judged(100 * y[:1], np.full(2, np.inf), np.inf)[0, 1] == 1.0


def test_tables_without_scatter_or_too_small_say_nothing() -> None:
    nothing = np.zeros(STRATA.size)
    assert scatter_p(STRATA, nothing, noise(nothing), UNKNOWN, np.inf, NO_STEP) == (1.0, 1.0)
    small = made(2, 3, 1, lines=False)
    y = np.random.default_rng(10).normal(size=small.size)
    of_small = whole_frame(small).noise(y, sizes(small), sizes(small), np.zeros((1, 1)))
    assert scatter_p(small, y, of_small, np.zeros(1), np.inf, np.zeros(9)) == (1.0, 1.0)


def test_entries_that_do_not_scatter_at_all_were_rounded_or_are_known_exactly() -> None:
    """Columns of one error in every part are held against the rounding step, if there is one."""
    own = np.random.default_rng(21).normal(size=(10, 2)) * np.ones((12, 1, 1))
    y, _ = STRATA.coordinates(own)
    y = np.where(np.abs(y) > 1e-12, y, 0.0)
    assert scatter_p(STRATA, y, noise(y), UNKNOWN, np.inf, NO_STEP) == (0.0, 1.0)
    # Twelve equal entries make a column's mean square twelve times the columns' variance.
    beside = STRATA.columns[:, :3]
    left = own[0] - beside @ beside.T @ own[0]
    found = [f.sf(v / 0.8, 7, 11 * 7) for v in np.sum(left**2, axis=0) / 7]
    step = np.full(len(STRATA.all), 0.8)
    p, of_parts = scatter_p(STRATA, y, noise(y), UNKNOWN, np.inf, step)
    assert p == pytest.approx(min(1.0, 2 * min(found)), rel=1e-9)
    assert of_parts == 1.0
    assert 0.001 < p < 1


@pytest.mark.parametrize(("n", "m"), [(3.0, 12.0), (20.0, 5.0), (7.0, np.inf)])
def test_one_sided_ratios_are_f_tails(n: float, m: float) -> None:
    """A direction in which only the machine scatters, n contrasts of it."""
    own = DirectionNoise(mean=np.array([0.0, 1.3 * n]), products=np.diag([0.0, 1.3**2 * n]))

    def p(square: float, of: DirectionNoise = own) -> float:
        return of.p(square, np.zeros(1), np.full(1, 30.0), m)

    assert p(2.2 * n) == pytest.approx(f.sf(2.2 / 1.3, n, min(m, 1e9)), rel=1e-4)
    assert p(0.0) == p(2.2, replace(own, mean=np.zeros(2))) == 1.0


def test_two_scatters_of_normal_entries_have_uniform_p() -> None:
    rng = np.random.default_rng(11)
    found = [
        two_scatters_p(rng.normal(size=(30, 8)), rng.normal(size=(30, 8)), 1.0)[0]
        for _ in range(1000)
    ]
    # Excess kurtosis is only ever added, which makes p a little large.
    assert ks_1samp(found, lambda v: v, alternative="greater").pvalue > 1e-3
    hits = sum(p < 0.05 for p in found)
    assert binom.ppf(1e-4, 1000, 0.03) <= hits <= binom.ppf(1 - 1e-4, 1000, 0.06)


def test_heavy_tails_are_no_difference_of_scatters() -> None:
    rng = np.random.default_rng(12)
    p, plain_p = [], []
    for _ in range(1000):
        a, b = rng.standard_t(5, size=(2, 30, 8))
        p.append(two_scatters_p(a, b, 1.0)[0])
        tail = f.sf(np.var(a) / np.var(b), 240, 240)
        plain_p.append(2 * min(tail, 1 - tail))
    hits, plain_hits = sum(v < 0.05 for v in p), sum(v < 0.05 for v in plain_p)
    assert hits <= binom.ppf(1 - 1e-4, 1000, 0.07)
    assert plain_hits > 2 * hits


def test_two_scatters_tell_how_far_they_are_apart() -> None:
    rng = np.random.default_rng(13)
    a, b = 2 * rng.normal(size=4000), rng.normal(size=4000)
    p, log_ratio = two_scatters_p(a, b, 1.0)
    assert p < 1e-12
    assert log_ratio == pytest.approx(np.log(4), abs=5 * np.sqrt(4 / 4000))
    assert two_scatters_p(b, a, 1.0) == pytest.approx((p, -log_ratio))
    # Entries of half a degree of freedom tell half as much.
    near = 1.05 * b
    z = norm.isf(two_scatters_p(near, a / 2, 1.0)[0] / 2)
    assert norm.isf(two_scatters_p(near, a / 2, 0.5)[0] / 2) == pytest.approx(z / np.sqrt(2))
    assert two_scatters_p(a, np.zeros(3), 1.0) == (1.0, 0.0)


@pytest.mark.parametrize("p", [0.9, 0.05, 1e-9])
def test_scores_are_squared_deviates(p: float) -> None:
    assert score_of(p) == pytest.approx(float(norm.isf(p / 2) ** 2), rel=1e-9)
