"""Circles in planes that lean: what they cut of a bore, and which axis a bore is taken along."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from correct_examples import DIAMETER, error_at, machine, ring_part, ring_places, ring_points, seen
from correct_shapes import RADIUS, Floats, lacking, ring, shape

from mtu_cli.analyses.correct import correct
from mtu_cli.analyses.correct.leaning import bore, leaning
from mtu_cli.analyses.correct.strain import levers_of
from mtu_cli.model.geometry import fit_circle
from mtu_cli.model.settings import Settings


def test_a_bore_cut_askew_is_the_ellipse_of_the_cut() -> None:
    """Touched at heights that rise along a slope of 0.02: r (1/cos - 1) longer."""
    flat = ring(24)
    tilted = np.column_stack([flat, 0.02 * flat @ [0.6, 0.8]])
    own = shape(tilted)
    levers = levers_of("circle", own.radius, own.away)
    assert levers is not None
    seen_strain = levers.estimator @ own.residuals
    assert levers.basis.T @ own.oblique == pytest.approx(seen_strain, rel=1e-3)


def test_a_plane_that_leans_makes_a_bore_larger(tmp_path: Path) -> None:
    """Touched alternately half a millimetre higher and lower on one side."""
    found = lacking(tmp_path, np.zeros((3, 3)))
    size = replace(found.sizes[0], kind="circle", id="a", operation="", u=1e-3)
    flat, tilted = ring(12), np.column_stack([ring(12), 0.02 * ring(12)[:, 0]])
    own = shape(tilted)
    (told,) = leaning([own], [size])
    assert told.angle == pytest.approx(0.02, rel=1e-3)
    assert told.larger == pytest.approx(2 * (fit_circle(tilted).radius - RADIUS), rel=0.02)
    assert leaning([own], [replace(size, u=1.1 * told.larger)]) == ()
    assert leaning([shape(flat)], [size]) == ()
    drilled = (replace(own, operation="drilled"), replace(size, operation="drilled"))
    assert [x.id for x in leaning([drilled[0]], [drilled[1]])] == ["drilled a"]
    # Where nothing is uncertain rounding leans, too.
    level = np.column_stack([ring(12), 1e-6 * ring(12)[:, 0]])
    assert leaning([shape(level)], [replace(size, u=0.0)]) == ()


def tilted(degrees: float, n: int = 12) -> tuple[Floats, Floats]:
    """A ring whose bore is inclined from z towards x, and the unit vector along it."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return ring(n) @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0]]), np.array([-s, 0.0, c])


@pytest.mark.parametrize("n", [5, 6, 7, 8, 10])
@pytest.mark.parametrize("height", [0.1, 10.0])
def test_two_heights_of_points_tell_no_axis_of_the_bore(n: int, height: float) -> None:
    """However they are spread over the ring: it is along the machine's, here z."""
    for high in list(product([0.0, height], repeat=n))[1:-1]:
        points = np.column_stack([ring(n), high])
        assert np.abs(bore(points)) == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
        assert np.abs(bore(points[:, [2, 0, 1]])) == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("degrees", [1.0, 10.0, 30.0, 44.0, 46.0, 90.0])
@pytest.mark.parametrize("digits", [2, 6])
def test_a_bore_that_is_drawn_inclined_is_along_its_drawing(degrees: float, digits: int) -> None:
    """Coordinates that are rounded to q mm turn the plane by q / sqrt(12) sqrt(2 / n) / r."""
    points, axis = tilted(degrees)
    points = np.round(points + np.array([3.0, 4.0, 5.0]), digits)
    off = 10**-digits / np.sqrt(12) * np.sqrt(2 / 12) / RADIUS
    assert abs(bore(points) @ axis) == pytest.approx(1.0, abs=(4 * off) ** 2)


def test_a_bore_at_45_degrees_may_be_touched_at_two_heights() -> None:
    """Half a millimetre apart along it: its plane leans by no more than their first harmonic."""
    points, axis = tilted(45.0)
    points = points + 0.5 * np.outer(np.arange(12) < 6, axis)
    assert np.arccos(abs(bore(points) @ axis)) < 2 / np.pi * 0.5 / RADIUS * 1.1


@pytest.mark.parametrize(
    ("drawn", "told"), [("flat", True), ("as it leans", False), ("at two heights", True)]
)
def test_a_ring_is_along_what_it_is_drawn_along(drawn: str, told: bool, tmp_path: Path) -> None:
    true = ring_places(diameter=DIAMETER)
    slope = 0.005 * (true[:, 0] - 200.0)
    # Five points of eleven on one side: their first harmonic is as long as that slope.
    high = true[:, 0] < 200.0 - 10.0
    first = 2 / 11 * np.abs(high @ np.exp(2j * np.pi * np.arange(11) / 11))
    steps = 0.005 * DIAMETER / 2 / first * high
    heights = {"flat": np.zeros(11), "as it leans": slope, "at two heights": steps}[drawn]
    T = np.full(11, 21.0)
    measured = seen(true, error_at, T)
    measured[:, 2] = steps if drawn == "at two heights" else slope
    points = ring_points(measured, ["p"], covariates={"T_scale_degC": T}, z=True)
    nominal = points.nominal.copy()
    nominal[:, 2] = heights
    found = correct(
        machine(tmp_path), ring_part(tmp_path), replace(points, nominal=nominal), Settings()
    )
    messages = [w.message for w in found.warnings if w.code == "heights-differ"]
    assert bool(messages) == told
    if told:
        assert "the plane through them leans by 0.29 degrees" in messages[0]
        assert "and 1.1 um larger" in messages[0]
