"""Circles, spheres and planes against printed figures, scipy's optimiser and differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mtu_cli.model.geometry import GeometryError, RoundFit, fit_circle, fit_plane, fit_sphere

Floats = NDArray[np.float64]
GANDER = np.array([(1, 7), (2, 6), (5, 8), (7, 7), (9, 5), (3, 7)], float)


def arc(n: int, radius: float, noise: float, seed: int, angle: float = 5.0) -> Floats:
    """Points (n, 2) about an arc of `angle` rad."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, angle, n)
    circle: Floats = radius * np.column_stack([np.cos(t), np.sin(t)])
    found: Floats = circle + noise * rng.standard_normal((n, 2))
    return found


def tilted(flat: Floats, seed: int, lift: float) -> Floats:
    """The points of a plane, turned into space, `lift` off the plane."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    heights = lift * rng.standard_normal(len(flat))
    turned: Floats = np.column_stack([flat, heights]) @ turn
    turned += np.array([310.0, -45.0, 120.0])
    return turned


def ball(n: int, radius: float, noise: float, seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    out = rng.standard_normal((n, 3))
    out /= np.linalg.norm(out, axis=1)[:, None]
    return radius * out + noise * rng.standard_normal((n, 3)) + [5.0, -7.0, 300.0]


def test_circle_of_gander_golub_and_strebel() -> None:
    """BIT 34 (1994): the geometric circle of the six points, as printed to four decimals."""
    found = fit_circle(GANDER)
    assert found.centre == pytest.approx([4.7398, 2.9835], abs=5e-5)
    assert found.radius == pytest.approx(4.7142, abs=5e-5)


@pytest.mark.parametrize("seed", range(4))
def test_circle_and_sphere_against_an_optimiser(seed: int) -> None:
    for points, fit in (
        (arc(9, 90.0, 2.0, seed) + np.array([500.0, 200.0]), fit_circle),
        (ball(14, 12.5, 0.4, seed), fit_sphere),
    ):
        start = np.append(points.mean(axis=0), 10.0)

        def distances(theta: Floats, points: Floats = points) -> Floats:
            away: Floats = np.linalg.norm(points - theta[:-1], axis=1) - theta[-1]
            return away

        other = least_squares(distances, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        found = fit(points)
        assert np.append(found.centre, found.radius) == pytest.approx(other, rel=1e-7)
        assert found.residuals == pytest.approx(distances(np.append(found.centre, found.radius)))


def test_plane_against_an_optimiser() -> None:
    points = tilted(arc(8, 90.0, 2.0, 3), 4, 1.5)

    def heights(theta: Floats) -> Floats:
        normal = np.array(
            [np.sin(theta[0]) * np.cos(theta[1]), np.sin(theta[0]) * np.sin(theta[1]),
             np.cos(theta[0])]
        )  # fmt: skip
        above: Floats = points @ normal - theta[2]
        return above

    found = fit_plane(points)
    starts = [(a, b, 0.0) for a in (0.5, 1.5) for b in (0.0, 1.5, 3.0, 4.5)]
    costs = [2 * least_squares(heights, start, xtol=1e-15, ftol=1e-15).cost for start in starts]
    assert float(found.heights @ found.heights) == pytest.approx(min(costs), rel=1e-10)
    assert found.basis @ found.normal == pytest.approx([0, 0], abs=1e-14)


def test_a_circle_in_space_is_the_circle_of_its_plane() -> None:
    """Without height above the plane the fit does not see how the plane lies."""
    flat = arc(11, 90.0, 1.0, 6)
    there, here = fit_circle(tilted(flat, 7, 0.0)), fit_circle(flat)
    assert there.radius == pytest.approx(here.radius, rel=1e-13)
    assert there.residuals == pytest.approx(here.residuals, abs=1e-11)
    assert there.form == pytest.approx(here.form)
    assert here.form == here.residuals.max() - here.residuals.min()


CASES: dict[str, tuple[Callable[[Floats], RoundFit], Floats]] = {
    "circle": (fit_circle, arc(9, 90.0, 3.0, 1)),
    "short arc": (fit_circle, arc(9, 90.0, 0.5, 2, angle=1.0)),
    "gander": (fit_circle, GANDER),
    "circle in space": (fit_circle, tilted(arc(9, 90.0, 3.0, 1), 2, 2.0)),
    "sphere": (fit_sphere, ball(12, 12.5, 0.5, 1)),
}


@pytest.mark.parametrize("case", CASES)
def test_gradients_against_differences(case: str) -> None:
    """Central differences over h: their error is h^2 times third derivatives of order 1/r^2."""
    fit, points = CASES[case]
    found, h = fit(points), 1e-4
    for i, j in np.ndindex(points.shape):
        up, down = points.copy(), points.copy()
        up[i, j] += h
        down[i, j] -= h
        over, under = fit(up), fit(down)
        assert found.radius_gradient[i, j] == pytest.approx(
            (over.radius - under.radius) / (2 * h), abs=1e-7
        )


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([(0, 0), (1, 1), (2, 2), (3, 3)], "on a line"),
        ([(0, 0), (0, 0), (1, 1), (0, 0)], "2 distinct points; a circle needs 3"),
        ([(1, 1)] * 4, "the same place"),
        ([(0, 0, 0), (1, 2, 3), (2, 4, 6), (3, 6, 9)], "on a line"),
        ([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], "in no plane"),
    ],
)
def test_points_without_a_circle(points: list[tuple[float, ...]], message: str) -> None:
    with pytest.raises(GeometryError, match=message):
        fit_circle(np.array(points, float))


def test_an_arc_that_hardly_bends_is_no_circle() -> None:
    """The normal equations lose the fourth power of its height over its length: 1e-20."""
    x = np.linspace(-0.5, 0.5, 20)
    for height, fits in ((1e-2, True), (1e-5, False)):
        points = 100 * np.column_stack([x, height * (1 - 4 * x**2)])
        if fits:
            assert fit_circle(points).radius == pytest.approx(100 / (8 * height), rel=1e-2)
        else:
            with pytest.raises(GeometryError, match="hardly bend"):
                fit_circle(points)


def test_points_without_a_sphere() -> None:
    flat = np.column_stack([arc(9, 90.0, 3.0, 1), np.full(9, 4.0)])
    with pytest.raises(GeometryError, match="plane or a circle"):
        fit_sphere(flat)
    with pytest.raises(GeometryError, match="3 distinct points; a sphere needs 4"):
        fit_sphere(ball(3, 1.0, 0.0, 1))


@pytest.mark.parametrize("angle", [6.2, 3.0, 1.0, 0.3])
@pytest.mark.parametrize("noise", [0.0, 1e-9, 1e-7, 1e-5, 1e-3])
def test_circles_of_any_roundness_are_fitted(angle: float, noise: float) -> None:
    """Down to the rounding of the coordinates, where a sum of squares shows no way down."""
    for seed in range(20):
        points = arc(8, 90.0, 90 * noise * angle**2 / 40, seed, angle)
        points = points + np.array([612.0, -300.0])
        found = fit_circle(points)
        away = points - found.centre
        unit = away / np.linalg.norm(away, axis=1)[:, None]
        # The residuals of the minimum are orthogonal to what centre and radius can do.
        assert abs(found.residuals.sum()) < 1e-9
        assert np.abs(found.residuals @ unit).max() < 1e-9
