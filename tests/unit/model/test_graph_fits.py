"""Least-squares figures of many trials at once against one trial at a time."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mtu_cli.model.geometry import fit_circle, fit_plane, fit_sphere
from mtu_cli.model.graph import fits

Floats = NDArray[np.float64]
TRIALS = 12
TURN = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
SHIFT = np.array([310.0, -45.0, 120.0])


def circle_points(n: int, noise: float) -> list[Floats]:
    rng = np.random.default_rng(n)
    t = np.linspace(0, 4.5, n)
    nominal = (TURN @ np.array([40 * np.cos(t), 40 * np.sin(t), 0 * t])).T + SHIFT
    return [point[:, None] + noise * rng.normal(size=(3, TRIALS)) for point in nominal]


def sphere_points(n: int, noise: float) -> list[Floats]:
    rng = np.random.default_rng(n)
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return [
        12.5 * point[:, None] + SHIFT[:, None] + noise * rng.normal(size=(3, TRIALS))
        for point in directions
    ]


@pytest.mark.parametrize("noise", [1e-3, 0.5])
@pytest.mark.parametrize("n", [4, 9])
def test_plane(n: int, noise: float) -> None:
    points = circle_points(n, noise)
    centre, normal = fits.plane(points, TURN[:, 2])
    for trial in range(TRIALS):
        one = fit_plane(np.array([point[:, trial] for point in points]))
        assert centre[:, trial] == pytest.approx(one.centroid, rel=1e-13)
        assert normal[:, trial] @ TURN[:, 2] > 0
        assert abs(normal[:, trial] @ one.normal) == pytest.approx(1.0, abs=1e-12)
        assert np.cross(normal[:, trial], one.normal) == pytest.approx(np.zeros(3), abs=1e-10)


@pytest.mark.parametrize("noise", [1e-3, 0.5])
@pytest.mark.parametrize("n", [4, 9])
def test_circle(n: int, noise: float) -> None:
    points = circle_points(n, noise)
    centre, radius = fits.circle(points, TURN[:, 2])
    for trial in range(TRIALS):
        one = fit_circle(np.array([point[:, trial] for point in points]))
        assert centre[:, trial] == pytest.approx(one.centre, rel=1e-10)
        assert radius[trial] == pytest.approx(one.radius, rel=1e-9)


@pytest.mark.parametrize("noise", [1e-3, 0.3])
@pytest.mark.parametrize("n", [5, 12])
def test_sphere(n: int, noise: float) -> None:
    points = sphere_points(n, noise)
    centre, radius = fits.sphere(points)
    for trial in range(TRIALS):
        one = fit_sphere(np.array([point[:, trial] for point in points]))
        assert centre[:, trial] == pytest.approx(one.centre, rel=1e-9)
        assert radius[trial] == pytest.approx(one.radius, rel=1e-8)


def test_sphere_of_radius_against_an_optimiser() -> None:
    points = sphere_points(7, 0.1)
    radius = np.linspace(12.4, 12.6, TRIALS)
    centre = fits.sphere_of_radius(points, radius)
    for trial in range(TRIALS):
        p = np.array([point[:, trial] for point in points])

        def gaps(c: Floats, p: Floats = p, r: float = float(radius[trial])) -> Floats:
            away: Floats = np.linalg.norm(p - c, axis=1) - r
            return away

        other = least_squares(gaps, SHIFT, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        assert centre[:, trial] == pytest.approx(other, abs=1e-6)


def test_three_points_of_a_triangle_of_known_sides() -> None:
    """Sides 3, 4, 5: the hypotenuse is the diameter."""
    corners = [np.array([[0.0], [0.0], [7.0]]), np.array([[3.0], [0.0], [7.0]])]
    corners.append(np.array([[0.0], [4.0], [7.0]]))
    centre, radius = fits.circumcircle(*corners)
    assert centre[:, 0] == pytest.approx([1.5, 2.0, 7.0], abs=1e-14)
    assert radius[0] == pytest.approx(2.5, rel=1e-15)


def test_what_cannot_be_fitted_is_not_a_number() -> None:
    """One trial whose points are no sphere is seen, not hidden."""
    points = [np.array([[float(i)], [0.0], [0.0]]) for i in range(6)]
    with np.errstate(all="ignore"):
        centre, _ = fits.sphere(points)
    assert not np.isfinite(centre).all()
