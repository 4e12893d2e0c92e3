"""Least-squares figures of many trials at once against one trial at a time."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mtu_cli.model.graph import fits

Floats = NDArray[np.float64]
TRIALS = 12
TURN = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
SHIFT = np.array([310.0, -45.0, 120.0])


def arc(n: int, degrees: float, radius: float) -> Floats:
    """Points (n, 3) of an arc that is turned and far from the origin."""
    t = np.radians(np.linspace(0, degrees, n))
    q = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    return np.asarray(radius * q @ TURN.T + SHIFT)


def ball(n: int, radius: float, reach: float = np.pi) -> Floats:
    """Points (n, 3) of a spherical cap: a spiral from the pole down to the angle `reach`."""
    t = np.arccos(np.linspace(1, np.cos(0.95 * reach), n))
    a = 2.39996 * np.arange(n)
    q = np.column_stack([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)])
    return np.asarray(radius * q @ TURN.T + SHIFT)


def drawn(nominal: Floats, noise: float, trials: int = TRIALS) -> list[Floats]:
    rng = np.random.default_rng(len(nominal))
    return [point[:, None] + noise * rng.normal(size=(3, trials)) for point in nominal]


def circle(points: list[Floats], nominal: Floats) -> tuple[Floats, Floats]:
    centre, radius = fits.circle_through([point[:, None] for point in nominal])(*points)
    return centre, radius


def sphere(points: list[Floats], nominal: Floats) -> tuple[Floats, Floats]:
    centre, radius = fits.sphere_through([point[:, None] for point in nominal])(*points)
    return centre, radius


def one(points: list[Floats], trial: int) -> Floats:
    return np.array([point[:, trial] for point in points])


@pytest.mark.parametrize("width", [10.0, 0.1, 0.01, 0.003])
def test_plane_of_a_strip(width: float) -> None:
    """Two edges 1 m long, `width` mm apart, 1 um noise: the narrowest turn about freely.

    Each normal is known as the step ends, 1e-13 of the length, over the least width drawn.
    """
    nominal = np.array([[0, 0, 0], [1000, 0, 0], [1000, width, 0], [0, width, 0], [500, width, 0]])
    points = drawn(nominal, 1e-3, 5000)
    centre, normal = fits.plane(points, np.array([0.0, 0.0, 1.0]))
    assert (normal[2] > 0).all()
    q = np.array(points).transpose(2, 0, 1)
    assert pytest.approx(q.mean(axis=1), rel=1e-12) == centre.T
    _, singular, Vt = np.linalg.svd(q - q.mean(axis=1, keepdims=True), full_matrices=False)
    away = np.linalg.norm(np.cross(normal.T, Vt[:, 2]), axis=1)
    # From where singular values are apart by s2^2 - s3^2, an error of 1e-10 mm turns the normal by
    # s2 over that; the last step may leave another of its own size.
    bound = 2e-10 * singular[:, 1] / (singular[:, 1] ** 2 - singular[:, 2] ** 2)
    assert np.all(away <= bound + 1e-12)


@pytest.mark.parametrize("degrees", [90.0, 20.0, 10.0, 5.0])
def test_circle_has_the_uncertainty_of_its_arc(degrees: float) -> None:
    """u(R)/u = sqrt of the last diagonal element of (X'X)^-1, X the rows (cos, sin, 1): least
    squares in the plane to first order (Gilsinn & Ling 2004, eq. (6), with these rows).
    """
    m, u = 20_000, 1e-4
    nominal = arc(8, degrees, 100.0)
    _, found = circle(drawn(nominal, u, m), nominal)
    t = np.radians(np.linspace(0, degrees, 8))
    X = np.column_stack([np.cos(t), np.sin(t), np.ones(8)])
    expected = u * np.sqrt(np.linalg.inv(X.T @ X)[2, 2])
    # Five standard errors, and the second order, which is as large as u(R)/R.
    assert found.std() == pytest.approx(expected, rel=5 / np.sqrt(2 * m) + expected / 100)
    assert found.mean() == pytest.approx(100, abs=5 * expected / np.sqrt(m) + 2 * expected**2 / 100)


@pytest.mark.parametrize(("n", "reach", "noise"), [(7, np.pi, 0.1), (9, 0.1, 1e-3)])
def test_sphere_of_radius_against_an_optimiser(n: int, reach: float, noise: float) -> None:
    nominal = ball(n, 12.5, reach)
    points = drawn(nominal, noise)
    radius = 12.5 + noise * np.linspace(-1, 1, TRIALS)
    given = [*(p[:, None] for p in nominal), radius]
    centre = np.asarray(fits.sphere_of_radius_through(given)(*points, radius))
    for trial in range(TRIALS):
        p = one(points, trial)

        def gaps(c: Floats, p: Floats = p, r: float = float(radius[trial])) -> Floats:
            away: Floats = np.linalg.norm(p - c, axis=1) - r
            return away

        other = least_squares(gaps, SHIFT, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac").x
        # The optimiser sees no more of the sum of squares than its rounding: noise times 1e-8.
        assert centre[:, trial] == pytest.approx(other, abs=1e-6)


def test_what_cannot_be_fitted_is_not_a_number() -> None:
    """One trial whose points are no sphere is seen, not hidden, and hides no other."""
    nominal = ball(6, 12.5)
    points = drawn(nominal, 1e-3, 3)
    for i, point in enumerate(points):
        point[:, 1] = [float(i), 0.0, 0.0]
    with np.errstate(all="ignore"):
        centre, _ = sphere(points, nominal)
    assert np.isfinite(centre).tolist() == [[True, False, True]] * 3
