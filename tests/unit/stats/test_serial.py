"""Regression with errors that follow each other: exact limits, coverage, attenuation, clusters."""

from __future__ import annotations

import numpy as np
import pytest
from made_tables import remembering
from scipy.special import stdtrit

from mtu_cli.stats.serial import Block, SerialFit

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
