"""Circles in planes that lean: what they cut of a bore, and which axis a bore is taken along."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from correct_examples import DIAMETER, error_at, machine, ring_part, ring_places, ring_points, seen
from correct_shapes import RADIUS, Floats, lacking, ring, shape

from mtu_cli.analyses.correct import CorrectResult, correct
from mtu_cli.analyses.correct.leaning import bore, leaning
from mtu_cli.analyses.correct.strain import levers_of
from mtu_cli.analyses.correct.warnings import heights_differ
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
    assert [x.operation for x in leaning([drilled[0]], [drilled[1]])] == ["drilled"]
    # Of several parts the surest diameter counts.
    several = [replace(size, u=share * told.larger) for share in (0.9, 1.1)]
    assert leaning([own], several) == leaning([own], several[::-1]) == (told,)
    # Where nothing is uncertain a tenth of a um is told; rounding leans, too.
    slight = np.column_stack([ring(12), 0.00225 * ring(12)[:, 0]])
    (least,) = leaning([shape(slight)], [replace(size, u=0.0)])
    assert least.larger == pytest.approx(RADIUS * (1 / np.cos(0.00225) - 1), rel=1e-3)
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


def test_points_on_a_line_or_of_which_some_are_not_known_tell_no_bore() -> None:
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    unknown = np.column_stack([ring(6), [np.nan, *np.zeros(5)]])
    sideways = np.column_stack([ring(6), np.zeros(6)])[:, [2, 0, 1]] + [np.nan, 0.0, 0.0]
    for points in (line, unknown, sideways):
        assert bore(points).tolist() == [0.0, 0.0, 0.0]


def test_a_part_that_is_drawn_without_heights_is_seen_along_z() -> None:
    unknown = np.column_stack([ring(6), np.full(6, np.nan)])
    assert bore(unknown).tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_bore_is_along_what_its_drawing_is_round_along(axis: int) -> None:
    """Drawn on a slope, a circle seen along the machine's axis is none in its own plane."""
    flat = np.column_stack([ring(12), np.zeros(12)])
    slope = 0.05 * flat[:, 0] + 0.02 * flat[:, 1]
    drawn = np.roll(flat + slope[:, None] * [0.0, 0.0, 1.0], axis + 1, axis=1)
    assert bore(drawn).tolist() == np.eye(3)[axis].tolist()


def test_a_bore_at_45_degrees_may_be_touched_at_two_heights() -> None:
    """Half a millimetre apart along it: its plane leans by no more than their first harmonic."""
    points, axis = tilted(45.0)
    points = points + 0.5 * np.outer(np.arange(12) < 6, axis)
    assert np.arccos(abs(bore(points) @ axis)) < 2 / np.pi * 0.5 / RADIUS * 1.1


def two_heights(axis: str, step: float) -> Floats:
    """The ring about an axis, five points of eleven higher than the others."""
    own = ring_places(centre=(200.0, 200.0), diameter=DIAMETER)
    own[:, 2] = 200.0 + step * (own[:, 0] < 200.0 - 10.0)
    return np.roll(own, "xyz".index(axis) + 1, axis=1)


def at_two_heights(
    folder: Path, axis: str, *, calibrated: bool, three: list[int] | None = None
) -> CorrectResult:
    """What correct says of a ring about an axis that is touched as it is drawn; three points of it
    are drawn at one height: else they tell where it is drawn to lean.
    """
    T, true = np.full(11, 21.0), two_heights(axis, 2.0 if three is None else 0.9)
    drawn = true if three is None else np.where(axis == np.array(list("xyz")), 200.45, true)
    measured = seen(true, error_at, T)
    points = ring_points(measured, ["p"], covariates={"T_scale_degC": T}, z=True)
    points = replace(points, nominal=drawn)
    part = ring_part(folder, calibrated_mm=str(DIAMETER) if calibrated else "")
    if three is not None:
        (circle,) = part.part.circles
        own = circle.model_copy(update={"features": [f"r{i}" for i in three]})
        part = replace(part, part=part.part.model_copy(update={"circles": [own]}))
    return correct(machine(folder), part, points, Settings())


@pytest.mark.parametrize("drawn", ["flat", "as it leans", "at two heights", "without"])
def test_heights_are_told_however_a_round_bore_is_drawn(drawn: str, tmp_path: Path) -> None:
    true = ring_places(diameter=DIAMETER)
    slope = 0.005 * (true[:, 0] - 200.0)
    # Five points of eleven on one side: their first harmonic is as long as that slope.
    high = true[:, 0] < 200.0 - 10.0
    first = 2 / 11 * np.abs(high @ np.exp(2j * np.pi * np.arange(11) / 11))
    steps = 0.005 * DIAMETER / 2 / first * high
    heights = {"flat": np.zeros(11), "as it leans": slope, "at two heights": steps,
               "without": np.full(11, np.nan)}[drawn]  # fmt: skip
    T = np.full(11, 21.0)
    measured = seen(true, error_at, T)
    measured[:, 2] = steps if drawn == "at two heights" else slope
    points = ring_points(measured, ["p"], covariates={"T_scale_degC": T}, z=True)
    nominal = points.nominal.copy()
    nominal[:, 2] = heights
    found = correct(
        machine(tmp_path), ring_part(tmp_path), replace(points, nominal=nominal), Settings()
    )
    facts = [w.facts for w in found.warnings if w.code == "heights-differ"]
    assert facts[0]["angle_deg"] == pytest.approx(0.29, abs=0.005)
    assert facts[0]["larger_um"] == pytest.approx(1.1, abs=0.05)


@pytest.mark.parametrize(("axis", "clause"), [("x", False), ("y", False), ("z", True)])
@pytest.mark.parametrize("calibrated", [True, False])
def test_heights_are_told_along_the_axis_of_the_bore(
    tmp_path: Path, axis: str, clause: bool, calibrated: bool
) -> None:
    """Of any circle; without z only one about z is left."""
    found = at_two_heights(tmp_path, axis, calibrated=calibrated)
    (told,) = (w for w in found.warnings if w.code == "heights-differ")
    assert (told.facts["axis"], told.facts["names"]) == (axis, ["ring"])
    assert ("no column z_mm" in (told.expected or "")) == clause
    assert found.ovals == ()


def test_three_points_of_a_circle_lie_at_heights_too(tmp_path: Path) -> None:
    """Which no oval can be told of."""
    three = [0, 4, 7]
    found = at_two_heights(tmp_path, "z", calibrated=True, three=three)
    (lean,) = found.leaning
    true = two_heights("z", 0.9)[three]
    normal = np.cross(true[1] - true[0], true[2] - true[0])
    assert lean.angle == pytest.approx(np.arccos(abs(normal[2]) / np.linalg.norm(normal)), rel=1e-2)


def test_of_a_bore_that_is_inclined_no_axis_is_told(tmp_path: Path) -> None:
    found = at_two_heights(tmp_path, "z", calibrated=True)
    own = replace(found.leaning[0], axis=None, operation="milled", larger=0.4142, angle=0.5)
    first, second = heights_differ([found.leaning[0], own])
    assert (first.facts["axis"], second.facts["axis"]) == ("z", "the axis of the inclined bore")
    assert second.facts["names"] == ["milled ring"]
    assert second.facts["larger_um"] == pytest.approx(414.2)
    assert second.expected == "points at one height"


@pytest.mark.parametrize(("degrees", "axis"), [(0.5, "z"), (2.0, None), (89.5, "x")])
def test_a_bore_is_along_an_axis_to_a_degree(
    degrees: float, axis: str | None, tmp_path: Path
) -> None:
    points, _ = tilted(degrees)
    size = replace(lacking(tmp_path, np.zeros((3, 3))).sizes[0], kind="circle", id="a", u=1e-6)
    own = shape(np.column_stack([ring(12), 0.02 * ring(12)[:, 0]]))
    (told,) = leaning([replace(own, bore=bore(points))], [size])
    assert told.axis == axis


def test_what_heights_make_is_laid_to_them(tmp_path: Path) -> None:
    """A bore of the calibrated diameter is larger by what its heights make; where it is larger by
    twice that and more the model or the calibration is at fault.
    """
    found = at_two_heights(tmp_path, "z", calibrated=True)
    larger = found.leaning[0].larger
    for off, heights in ((1.1 * larger, True), (2.2 * larger, False), (-1.1 * larger, False)):
        for before, fact in ((0.5 * off, "rms_before_um"), (2 * off, "half_width_um")):
            sizes = tuple(
                replace(own, u=1e-6, size=(own.reference + before, own.reference + off))
                for own in found.sizes
            )
            told = [w for w in replace(found, sizes=sizes).warnings if w.code.startswith("errors")]
            assert [fact in w.facts for w in told] == [True]
            cause = told[0].facts["cause"]
            assert ("lie at different heights" in cause) == heights
            assert ("calibrated_mm" in cause) != heights


@pytest.mark.parametrize("digits", [2, 3])
def test_an_inclined_bore_of_four_rounded_points_is_inclined(digits: int) -> None:
    """By one degree: what its points are out of round is the drawing's rounding, no heights."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        lean, way, first = np.radians(1.0), rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 1.0)
        along = np.array([np.sin(lean) * np.cos(way), np.sin(lean) * np.sin(way), np.cos(lean)])
        a = np.cross(along, [0.0, 0.0, 1.0])
        a /= np.linalg.norm(a)
        at = first + np.arange(4) * np.pi / 2.0
        ring = np.outer(np.cos(at), a) + np.outer(np.sin(at), np.cross(along, a))
        drawn = np.round([100.123, 50.456, -7.0] + 50.0 * ring, digits)
        assert abs(bore(drawn) @ along) == pytest.approx(1.0, abs=1e-5)
