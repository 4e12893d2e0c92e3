"""Checks of what has no name: dense densities, plain loops, what they see and what they leave."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import Floats, contrasts, made
from scipy.stats import binom, multivariate_normal

from mtu_cli.close_loop_sealed.stats.kernel_ratio import RATIOS
from mtu_cli.close_loop_sealed.stats.remainder import (
    COMMON_SHAPE,
    DRAWN,
    REACH,
    Remainder,
    remainder_of,
)
from mtu_cli.close_loop_sealed.stats.strata import Strata

STRATA = made(12, 10, 2)
PLACES = np.random.default_rng(3).uniform(0.0, 100.0, (10, 2))
PLAIN = np.broadcast_to(np.eye(2), (2, 2, 2))
CHECKS = remainder_of(STRATA, PLAIN, PLACES)
NAMES = DRAWN


def statistics(tables: Floats, checks: Remainder = CHECKS) -> Floats:
    y, _ = checks.strata.coordinates(tables)
    return checks.statistics(y)


def normal(count: int, seed: int, strata: Strata = STRATA) -> Floats:
    return np.asarray(np.random.default_rng(seed).normal(size=(count, *strata.shape)))


def largest_ratio(y: Floats, K: Floats) -> float:
    """max over rho of twice the log density ratio, the level profiled out; not below 0."""
    n = len(y)

    def log_density(V: Floats) -> float:
        level = y @ np.linalg.solve(V, y) / n
        return float(multivariate_normal.logpdf(y, cov=level * V))

    K = K / np.trace(K) * n
    plain = log_density(np.eye(n))
    return max(0.0, *(2 * (log_density(np.eye(n) + rho * K) - plain) for rho in RATIOS))


def stratum(y: Floats, kind: str, axis: int, line: int = 0) -> Floats:
    (own,) = (s for s in STRATA.all if (s.kind, s.axis, s.line) == (kind, axis, line))
    return np.asarray(y[own.slice])


def test_serial_checks_are_random_walks_of_the_parts() -> None:
    y, _ = STRATA.coordinates(normal(1, 4)[0])
    walk = np.cumsum(np.eye(12), axis=0) @ np.cumsum(np.eye(12), axis=0).T
    K = contrasts(12).T @ walk @ contrasts(12)
    offsets = sum(largest_ratio(stratum(y, "part", a), K) for a in (0, 1))
    lines = sum(largest_ratio(stratum(y, "line", a, i), K) for a in (0, 1) for i in (1, 2))
    found = CHECKS.statistics(y[None])[0]
    assert found[NAMES.index("serial-correlation")] == pytest.approx(offsets, rel=1e-8)
    assert found[NAMES.index("serial-shape")] == pytest.approx(lines, rel=1e-8)


def test_the_spatial_check_is_a_smooth_field_of_the_columns() -> None:
    whitening = np.random.default_rng(5).normal(size=(2, 2, 2)) + 2 * PLAIN
    checks = remainder_of(STRATA, whitening, PLACES)
    y, _ = STRATA.coordinates(normal(1, 6)[0])
    extent = np.ptp(PLACES, axis=0).max()
    distance2 = np.array([[np.sum((a - b) ** 2) for b in PLACES] for a in PLACES])
    expected = []
    for reach in REACH:
        field = np.exp(-0.5 * distance2 / (reach * extent) ** 2)
        total = 0.0
        for axis in (0, 1):
            W = np.eye(9)
            W[:2, :2] = whitening[axis]
            K = W @ STRATA.columns[:, 1:].T @ field @ STRATA.columns[:, 1:] @ W.T
            total += largest_ratio(stratum(y, "column", axis), K)
        expected.append(total)
    found = checks.statistics(y[None])[0, NAMES.index("spatial-correlation")]
    assert found == pytest.approx(max(expected), rel=1e-8)


def plain_pattern(table: Floats) -> float:
    """Entries beside part, lines and column, each axis to one scale, clipped; singular values."""
    P, H, A = table.shape
    L = STRATA.columns[:, :3]
    rest = np.empty_like(table)
    for a in range(A):
        own = table[:, :, a] - table[:, :, a].mean(axis=0)
        own = own - own @ L @ L.T
        rest[:, :, a] = own / np.sqrt(np.sum(own**2) / ((P - 1) * (H - 3)))
    spread = 1.4826 * np.median(np.abs(rest), axis=(0, 1))
    rest = np.clip(rest, -2.5 * spread, 2.5 * spread).reshape(P, H * A)
    values = np.linalg.svd(rest - rest.mean(axis=0), compute_uv=False) ** 2
    return float(values[0] / (values.sum() / P))


def test_the_pattern_is_the_largest_singular_value_over_the_mean() -> None:
    for seed in (7, 8):
        table = normal(1, seed)[0] * [1.0, 4.0]
        found = statistics(table[None])[0, NAMES.index("interaction-pattern")]
        assert found == pytest.approx(plain_pattern(table), rel=1e-9)


def test_the_common_shape_is_the_plane_through_the_columns_means() -> None:
    """Against least squares of the means on the two lines, a likelihood ratio for each axis."""
    table = normal(1, 18)[0]
    mean, lines = table.mean(axis=0), STRATA.columns[:, :3]
    rest = mean - lines @ lines.T @ mean
    about = mean - mean.mean(axis=0)
    expected = 9 * np.log((about**2).sum(axis=0) / (rest**2).sum(axis=0))
    found = statistics(table[None])[0, NAMES.index(COMMON_SHAPE)]
    assert found == pytest.approx(expected.max(), rel=1e-9)


def smooth_field() -> Floats:
    distance2 = ((PLACES[:, None] - PLACES) ** 2).sum(axis=2)
    K = np.exp(-0.5 * distance2 / (0.3 * np.ptp(PLACES, axis=0).max()) ** 2)
    return np.asarray(np.linalg.cholesky(K + 1e-9 * np.eye(10)))


def drifting(rng: np.random.Generator, shape: Floats) -> Floats:
    walk = np.cumsum(rng.normal(size=12))
    return np.asarray(walk[:, None] * shape)[..., None] * [1.0, 0.0]


def hidden(what: str, rng: np.random.Generator) -> Floats:
    """An effect (12, 10, 2) without a name, about as large as one entry scatters."""
    if what == "interaction-pattern":
        return np.asarray(rng.normal(size=(12, 1, 1)) * rng.normal(size=(1, 10, 2)))
    if what == "serial-correlation":
        return drifting(rng, np.ones((1, 10)))
    if what == "serial-shape":
        return drifting(rng, 3 * STRATA.columns[:, 1][None])
    if what == COMMON_SHAPE:
        plane = 2 * STRATA.columns[:, 1:3] @ rng.choice([-1.0, 1.0], (2, 2))
        return np.broadcast_to(plane[None], (12, 10, 2))
    return np.broadcast_to((smooth_field() @ rng.normal(size=(10, 2)))[None], (12, 10, 2))


@pytest.mark.parametrize("name", NAMES)
def test_each_check_sees_what_it_is_for(name: str) -> None:
    limit = np.quantile(statistics(normal(1000, 9)), 0.95, axis=0)
    rng = np.random.default_rng(10)
    tables = normal(100, 11) + np.array([hidden(name, rng) for _ in range(100)])
    seen = (statistics(tables) > limit)[:, NAMES.index(name)].mean()
    assert seen > 0.6
    # None of the other checks for parts takes a field of the columns for its own, and so on.
    if name in ("serial-correlation", "spatial-correlation"):
        other = "spatial-correlation" if name == "serial-correlation" else "serial-correlation"
        hits = int((statistics(tables) > limit)[:, NAMES.index(other)].sum())
        assert hits <= binom.ppf(1 - 1e-4, 100, 0.07)


def test_heavy_tails_are_no_pattern() -> None:
    rng = np.random.default_rng(12)
    limit = np.quantile(statistics(normal(2000, 13))[:, 0], 0.95)
    hits = int((statistics(rng.standard_t(4, size=(500, *STRATA.shape)))[:, 0] > limit).sum())
    # Without the clipping a quarter of them and more.
    assert hits <= binom.ppf(1 - 1e-4, 500, 0.07)


def test_checks_that_cannot_be_had_are_zero() -> None:
    small = made(3, 5, 1, lines=False)
    checks = remainder_of(small, np.zeros((1, 0, 0)), PLACES[:5])
    assert checks.serial is None
    assert checks.spatial == ()
    found = statistics(normal(2, 14, small), checks)
    np.testing.assert_array_equal(found, 0)
    y, _ = small.coordinates(normal(1, 14, small)[0])
    drift, field = checks.unnamed(y)
    assert np.isneginf(drift).all()
    assert np.isneginf(field).all()


def test_places_that_are_not_known_have_no_field() -> None:
    checks = remainder_of(STRATA, PLAIN, np.zeros((10, 0)))
    found = statistics(normal(2, 15), checks)
    np.testing.assert_array_equal(found[:, NAMES.index("spatial-correlation")], 0)
    assert (found[:, NAMES.index("interaction-pattern")] > 0).all()


def test_drifts_and_fields_without_a_name_are_found_on_their_axis() -> None:
    rng = np.random.default_rng(16)
    found = []
    for table in normal(40, 17):
        table += drifting(rng, np.ones((1, 10)))
        table[:, :, 1] += 2 * (smooth_field() @ rng.normal(size=10))
        found.append(CHECKS.unnamed(STRATA.coordinates(table)[0]))
    drift, field = np.median(found, axis=0)
    # More likely than not where they are, less where they are not.
    assert drift[0] > 0
    assert field[1] > 0
    assert drift[1] < 0
    assert field[0] < 0
