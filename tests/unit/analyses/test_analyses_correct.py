"""Corrected points, diameters and lengths of rings whose true size is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from correct_examples import (
    DIAMETER,
    ROUNDING,
    ROUNDING_MM,
    codes,
    error_at,
    machine,
    ring_part,
    ring_places,
    ring_points,
    rings,
    seen,
)
from model_examples import part_of, stated
from numpy.typing import NDArray

from mtu_cli.analyses.correct import correct
from mtu_cli.files.points import Points
from mtu_cli.model.prediction import predict
from mtu_cli.model.settings import Settings
from mtu_cli.stats.coverage import coverage_factor

Floats = NDArray[np.float64]
SETTINGS = Settings()


def test_a_known_error_is_removed_to_rounding(tmp_path: Path) -> None:
    true, measured, temperature = rings(3)
    points = ring_points(measured, ["a", "b", "c"], None, {"T_scale_degC": temperature})
    result = correct(machine(tmp_path), ring_part(tmp_path), points, SETTINGS)
    assert np.abs(result.corrected[:, :2] - true[:, :2]).max() < ROUNDING_MM
    assert np.isnan(result.corrected[:, 2]).all()
    assert result.axes == ("x", "y")
    assert result.warnings == ()
    for item, T in zip(result.sizes, temperature.reshape(3, 11).mean(axis=1), strict=True):
        # Shrunk by the gradients of the scales alone: the mean of those of x and y. In a ring the
        # temperature is up to 0.05 K from its mean.
        scale = -0.055e-3 - 11e-6 * (T - 20)
        assert item.error[0] == pytest.approx(DIAMETER * scale, abs=DIAMETER * 11e-6 * 0.05)
        assert abs(item.error[1]) < ROUNDING_MM
        assert item.form[1] < ROUNDING_MM < item.form[0]
        assert item.reduction_percent == pytest.approx(100.0, rel=ROUNDING)


def test_many_points_are_corrected_as_one_by_one(tmp_path: Path) -> None:
    """Pieces and rows: every point has the error and variance of its own prediction."""
    _, measured, temperature = rings(8)
    points = ring_points(measured, list("abcdefgh"), None, {"T_scale_degC": temperature})
    model = machine(tmp_path)
    result = correct(model, None, points, SETTINGS)
    assert codes(result) == ["no-scatter-known"]
    for i in (0, 10, 63, 64, 87):
        alone = predict(model, ["p"], measured[i : i + 1], {"T_scale_degC": temperature[i]})
        variance = alone.variance(np.eye(2))
        assert result.error[i, :2] == pytest.approx(alone.mean, rel=ROUNDING)
        assert result.u[i, :2] ** 2 == pytest.approx(np.diag(alone.covariance), rel=ROUNDING)
        assert result.dof[i, :2] == pytest.approx(variance.dof, rel=ROUNDING)


def test_u_of_a_diameter_is_that_of_its_points_with_their_covariance(tmp_path: Path) -> None:
    """Slowly: differences for the gradient, the covariance matrix of all errors of the part."""
    from mtu_cli.model.geometry import fit_circle

    _, measured, temperature = rings(2)
    points = ring_points(measured, ["a", "b"], None, {"T_scale_degC": temperature})
    model = machine(tmp_path)
    result = correct(model, ring_part(tmp_path), points, SETTINGS)
    # Differences lose (h/r)^2 = 1e-12 to the curvature and 3e-14 mm/h = 3e-10 to rounding.
    corrected, h = result.corrected[11:, :2], 1e-4
    gradient = np.zeros((11, 2))
    for i, j in np.ndindex(11, 2):
        sides = []
        for sign in (1, -1):
            moved = corrected.copy()
            moved[i, j] += sign * h
            sides.append(2 * fit_circle(moved).radius)
        gradient[i, j] = (sides[0] - sides[1]) / (2 * h)
    prediction = predict(
        model, [f"p{i}" for i in range(11)], measured[11:], {"T_scale_degC": temperature[11:]}
    )
    g = gradient.ravel()
    ring = result.sizes[1]
    assert ring.u**2 == pytest.approx(g @ prediction.covariance @ g, rel=3e-9)
    half = coverage_factor(0.95, ring.dof) * ring.u
    assert ring.interval95 == pytest.approx((ring.size[1] - half, ring.size[1] + half))
    alone = correct(model, ring_part(tmp_path), points, Settings(correlation="independent"))
    assert alone.sizes[1].u ** 2 == pytest.approx(g**2 @ prediction.independent_variance, rel=3e-9)
    assert np.isinf(alone.sizes[1].dof)


def test_the_calibration_is_part_of_the_error_but_not_of_the_diameter(tmp_path: Path) -> None:
    _, measured, temperature = rings(1)
    points = ring_points(measured, ["a"], None, {"T_scale_degC": temperature})
    part = ring_part(tmp_path, U_um="1.0")
    ring = correct(machine(tmp_path), part, points, SETTINGS).sizes[0]
    bare = correct(machine(tmp_path), ring_part(tmp_path), points, SETTINGS).sizes[0]
    assert ring.u == bare.u == bare.u_error
    assert ring.u_error**2 == pytest.approx(ring.u**2 + 0.0005**2)
    assert ring.dof_error == pytest.approx(ring.dof * ring.u_error**4 / ring.u**4)
    half = coverage_factor(0.95, ring.dof_error) * ring.u_error
    assert ring.error_interval95 == pytest.approx((ring.error[1] - half, ring.error[1] + half))


def test_repeats_are_averaged_and_share_what_the_machine_did(tmp_path: Path) -> None:
    true = np.vstack([ring_places(diameter=DIAMETER + d) for d in (0.001, 0.003, 0.0)])
    temperature = np.full(33, 21.0)
    measured = seen(true, error_at, temperature)
    points = ring_points(measured, ["a", "a", "b"], [1, 2, 1], {"T_scale_degC": temperature})
    result = correct(machine(tmp_path), ring_part(tmp_path), points, SETTINGS)
    first, second = result.sizes
    assert [item.n_repeats for item in result.sizes] == [2, 1]
    assert first.size[1] == pytest.approx(DIAMETER + 0.002, abs=ROUNDING_MM)
    assert first.s_repeats == pytest.approx(0.002 / np.sqrt(2), abs=ROUNDING_MM)
    assert np.isnan(second.s_repeats)
    # Both rings of the part have the same u by the machine; only the points' scatter averages out.
    scatter = result.scatter
    assert scatter is not None
    assert (scatter.origin, scatter.dof) == ("repeats", 22)
    # Places 0.001 mm apart along the radius: squares of half of it, on two repeats of 11 points.
    assert scatter.s == pytest.approx(0.001 / np.sqrt(2 * 2), abs=ROUNDING_MM)
    machine_alone = second.u**2 - 4 / 11 * scatter.variance
    # Their diameters, and with them u by slopes, differ by 3 um of 180 mm.
    larger = 0.003 / DIAMETER
    assert first.u**2 == pytest.approx(machine_alone + 2 / 11 * scatter.variance, rel=larger)


@pytest.mark.parametrize(
    ("calibrated", "T", "expected", "warned"),
    [
        ("{20: 180.0124, 26: 180.0137}", 23.0, 180.01305, []),
        ("{20: 180.0124, 26: 180.0137}", 29.0, 180.01435, ["outside-measured-range"]),
        ("{20: 180.0, 22: 180.001, 30: 180.009}", 26.0, 180.005, []),
        ("{20: 180.0124}", 21.0, 180.0124, ["outside-measured-range"]),
        ("180.0124", 21.0, 180.0124, []),
    ],
)
def test_the_calibrated_diameter_at_the_temperature_of_the_ring(
    tmp_path: Path, calibrated: str, T: float, expected: float, warned: list[str]
) -> None:
    _, measured, temperature = rings(1)
    own: dict[str, NDArray[np.float64] | NDArray[np.object_]] = {"T_scale_degC": temperature}
    points = ring_points(measured, ["a"], None, own)
    column = replace(points, covariates=own | {"T_ring_degC": np.full(11, T)})
    part = ring_part(tmp_path, calibrated_mm=calibrated, temperature="T_ring_degC")
    model = machine(tmp_path)
    for found in (
        correct(model, part, column, SETTINGS),
        correct(model, part, points, SETTINGS, {"T_ring_degC": T}),
    ):
        assert found.sizes[0].reference == pytest.approx(expected, abs=ROUNDING_MM)
        assert found.sizes[0].temperature == pytest.approx(T)
        assert codes(found) == warned


def of_one_part(measured: Floats, places: Floats) -> Points:
    """Points a, b, c, ... of one part, measured (n, 3) at nominal places (n, 3)."""
    n = len(places)
    return replace(
        ring_points(ring_places(), ["p"]),
        part=np.zeros(n, np.int64), features=tuple("abcdefgh"[:n]), feature=np.arange(n),
        operation=np.full(n, -1), measured=measured, nominal=places, repeat=np.full(n, -1),
        time_min=np.full(n, np.nan), sequence=np.ones(n, np.int64),
        direction=np.full((n, 3), np.nan), file_index=np.zeros(n, np.int64), row=np.arange(n) + 2,
    )  # fmt: skip


def test_lengths_and_a_sphere(tmp_path: Path) -> None:
    """Ends and points in space; the machine's error is a plain offset of scale in z."""
    model = stated(
        tmp_path,
        """\
        components: {s: {of: z, unit: um, coefficients: [0, 0.1], u_future: 0.6}}
        equations: {Ez: s}
        """,
    )
    part = part_of(
        tmp_path,
        """\
        features:
          a: {x_mm: 0, y_mm: 0, z_mm: 50}
          b: {x_mm: 0, y_mm: 0, z_mm: 150}
          c: {x_mm: 50, y_mm: 0, z_mm: 100}
          d: {x_mm: 0, y_mm: 50, z_mm: 100}
          e: {x_mm: -50, y_mm: 0, z_mm: 100}
        lengths: [{from: a, to: b}]
        spheres: [{id: ball, features: [a, b, c, d, e], calibrated_mm: 100}]
        """,
    )
    places = np.array([(0, 0, 50), (0, 0, 150), (50, 0, 100), (0, 50, 100), (-50, 0, 100)], float)

    def stretched(place: Floats, _: Floats) -> Floats:
        return np.column_stack([np.zeros((5, 2)), 1e-4 * place[:, 2]])

    measured = seen(places, stretched, np.zeros(5))
    points = of_one_part(measured, places)
    result = correct(model, part, points, SETTINGS)
    (sphere,), (length,) = result.of_kind("sphere"), result.of_kind("length")
    # What is read is stretched by 1e-4 of itself: m = t/(1 - 1e-4).
    assert length.error[0] == pytest.approx(100 / (1 - 1e-4) - 100, abs=ROUNDING_MM)
    assert abs(length.error[1]) < ROUNDING_MM
    # Only the repeatabilities of the two ends, 0.6 um each, are not shared.
    assert length.u == pytest.approx(0.0006 * np.sqrt(2), rel=ROUNDING)
    assert abs(sphere.error[1]) < ROUNDING_MM < sphere.error[0]
    # Nothing moves x and y, which no equation has.
    assert codes(result) == ["axis-without-equation"] * 2
