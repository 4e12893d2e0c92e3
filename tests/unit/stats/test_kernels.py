"""The integrated Wiener process: splines of another library, and simulated paths."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from mtu_cli.stats.kernels import left_open, line, smooth_root, weights, wiener

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
    found = left_open(KNOTS, at)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert found / scale == pytest.approx(expected / scale, abs=0.03)


def test_the_root_is_of_the_kernel_without_a_line() -> None:
    B = smooth_root(KNOTS)
    assert pytest.approx(np.zeros((2, 4)), abs=1e-7) == line(KNOTS, 0.0).T @ B
    # Contrasts that no line enters have the kernel's covariance.
    H = np.linalg.qr(line(KNOTS, 0.0), mode="complete")[0][:, 2:]
    expected = H.T @ wiener(KNOTS, KNOTS) @ H
    assert pytest.approx(expected, rel=1e-9) == H.T @ B @ B.T @ H
