"""Entries off lines of parts and means of columns: against one large system, and by their rates."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom
from scipy.stats import t as student

from mtu_cli.close_loop_sealed.stats import shrunken_lines
from mtu_cli.close_loop_sealed.stats.shrunken_lines import MARGIN, RATE, OffLines, off_lines

Floats = NDArray[np.float64]


def places(P: int, H: int, rng: np.random.Generator) -> Floats:
    """Holes about their middle, alike in all parts, behind a column of ones."""
    own = rng.uniform(-1.0, 1.0, (H, 2))
    own -= own.mean(axis=0)
    found: Floats = np.broadcast_to(np.column_stack([np.ones(H), own]), (P, H, 3)).copy()
    return found


def turned(rng: np.random.Generator, X: Floats, sizes: tuple[float, float]) -> Floats:
    """Unit noise, an intercept a part, and slopes of these standard deviations."""
    P, H, _ = X.shape
    slopes = rng.normal(size=(P, 2)) * sizes
    left = rng.normal(size=(P, H)) + np.einsum("phi,pi->ph", X[..., 1:], slopes)
    left -= np.median(left, axis=1, keepdims=True)
    found: Floats = (left - np.median(left, axis=0))[..., None]
    return found


def judged(y: Floats, X: Floats) -> OffLines:
    return off_lines(y, X[..., 1:], np.zeros(y.shape[2]))


def by_one_system(y: Floats, X: Floats, of_slopes: Floats, own: int) -> tuple[float, float]:
    """What one entry is off, and the variance of that over single entries', by generalized least
    squares of all others at once: columns and intercepts fixed, slopes in the covariance, of
    variances `of_slopes` over that of entries.
    """
    P, H, _ = X.shape
    part, hole = np.divmod(np.arange(P * H), H)
    fixed = np.column_stack([part[:, None] == np.arange(P), hole[:, None] == np.arange(1, H)])
    Z = X[..., 1:].reshape(P * H, 2)
    V = np.eye(P * H) + (Z * of_slopes) @ Z.T * (part[:, None] == part)
    rest = np.isfinite(y) & (np.arange(P * H) != own)
    W, F = np.linalg.inv(V[np.ix_(rest, rest)]), fixed[rest].astype(float)
    C = np.linalg.inv(F.T @ W @ F)
    gain = V[own, rest] @ W
    free = fixed[own] - gain @ F
    off = (
        y[own]
        - fixed[own] @ (C @ F.T @ W @ y[rest])
        - gain @ (y[rest] - F @ (C @ F.T @ W @ y[rest]))
    )
    return float(off), float(V[own, own] - gain @ V[rest, own] + free @ C @ free)


@pytest.mark.parametrize("sizes", [(0.0, 0.0), (0.5, 2.0), (30.0, 5.0)])
def test_every_score_is_that_of_one_system_of_all_others(
    sizes: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(1)
    X = places(8, 9, rng)
    y = turned(rng, X, sizes)
    variances = np.array(sizes) ** 2

    def known(X: Floats, *given: Floats) -> tuple[Floats, Floats]:
        found = np.tile(variances * given[2][0] ** 2, (8, 1, 1)) * np.abs(slopes).max() ** 2
        return found[0], found

    slopes = X[..., 1:]
    monkeypatch.setattr(shrunken_lines, "slope_variances", known)
    found = judged(y, X)
    spread = float(found.spread[0])
    values, scores = y.reshape(-1), found.score.reshape(-1)
    for own in range(8 * 9):
        off, variance = by_one_system(values, X, variances, own)
        assert scores[own] == pytest.approx(abs(off) / (spread * np.sqrt(variance)), abs=1e-6)
    values = values.copy()
    values[21] += 40.0
    gross = judged(values.reshape(8, 9, 1), X)
    spread = float(gross.spread[0])
    off, variance = by_one_system(values, X, variances, 21)
    assert gross.deviation.reshape(-1)[21] == pytest.approx(off, abs=1e-6)
    # Without it the others of its part and column are not quite alike.
    assert gross.score.reshape(-1)[21] == pytest.approx(
        abs(off) / (spread * np.sqrt(variance)), rel=0.05
    )


@pytest.mark.parametrize("missing", [0.0, 0.3])
@pytest.mark.parametrize("sizes", [(0.0, 0.0), (5.0, 0.5)])
def test_scores_are_in_standard_deviations_wherever_an_entry_is(
    sizes: tuple[float, float], missing: float
) -> None:
    """Nine holes in a patch and one far off: alone, it makes the line of its part."""
    rng, count = np.random.default_rng(2), 150
    squares, cells, beyond = np.zeros(10), np.zeros(10), 0
    for _ in range(count):
        X = places(20, 10, rng)
        X[:, :9, 1:] *= 0.1
        X[:, 9, 1:] = 1.0
        X[..., 1:] -= X[..., 1:].mean(axis=1, keepdims=True)
        X[..., 1:] = X[..., 1:] @ np.linalg.eigh(X[0, :, 1:].T @ X[0, :, 1:])[1]
        y = turned(rng, X, sizes)
        y[rng.random((20, 10)) < missing] = np.nan
        found = judged(y, X)
        there = np.isfinite(y[..., 0]) & (found.score[..., 0] > 0)
        squares += (np.where(there, found.score[..., 0], 0.0) ** 2).sum(axis=0)
        cells += there.sum(axis=0)
        beyond += bool((found.score > found.limit).any())
    # Squares of normal scores have a variance of 2; half as much again, as cells of a part
    # hang together.
    mean, slack = squares / cells, 4 * np.sqrt(3.0 / cells.min())
    np.testing.assert_allclose(mean[:9], 1.0, atol=slack)
    # No variance of slopes is estimated below 0: where parts do not turn, a lone place has more.
    assert (1.0 if any(sizes) else 0.8) - slack < mean[9] < 1.0 + slack
    # A standard deviation beyond what the farthest passes in 5 %.
    assert beyond <= binom.ppf(1 - 1e-3, count, 0.01)


def test_the_limit_is_students_of_what_is_left() -> None:
    rng = np.random.default_rng(3)
    y = rng.normal(size=(4, 6, 1))
    found = judged(y - y.mean(axis=1, keepdims=True), np.ones((4, 6, 1)))
    assert found.limit[0] == pytest.approx(MARGIN + student.isf(RATE / (2 * 24), 15), rel=1e-9)


def test_a_part_that_alone_turned_keeps_its_line() -> None:
    rng, kept = np.random.default_rng(4), 0
    for _ in range(30):
        X = places(12, 16, rng)
        y = rng.normal(size=(12, 16, 1))
        y[5, :, 0] += 15.0 * X[5, :, 1]
        kept += not (found := judged(y - np.median(y), X)).score.max() > found.limit
    assert kept == 30


def test_a_table_without_scatter_has_nothing_off() -> None:
    y = np.zeros((6, 8, 2))
    y[0, 0] = 1.0
    found = judged(y, np.ones((6, 8, 1)))
    assert not found.score.any()


def test_an_entry_of_which_nothing_is_expected_has_no_score() -> None:
    """Alone in its part, or alone in its column."""
    rng = np.random.default_rng(5)
    y = rng.normal(size=(6, 8, 1))
    y[2, 1:] = np.nan
    y[:, 5] = np.nan
    y[4, 5] = 100.0
    y[2, 0] = 50.0
    found = judged(y, np.ones((6, 8, 1)))
    assert found.score[2, 0, 0] == 0.0
    assert found.score[4, 5, 0] == 0.0
    assert found.score.max() < found.limit[0]
