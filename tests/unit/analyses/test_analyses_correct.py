"""Corrected points, diameters and lengths of rings whose true size is known; the scatter of points
and the form left; covariates and drifts that lag.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from correct_examples import (
    DIAMETER,
    ROUNDING,
    ROUNDING_MM,
    error_at,
    machine,
    ring_part,
    ring_places,
    ring_points,
    rings,
    seen,
)
from made_tables import made_points
from model_examples import part_of, stated
from numpy.typing import NDArray
from support import codes

from mtu_cli.analyses.correct import correct
from mtu_cli.analyses.correct.sizes import REACH
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.model.geometry import fit_circle
from mtu_cli.model.machine_model import MachineModel, drift_terms
from mtu_cli.model.prediction import predict
from mtu_cli.model.settings import Settings
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.serial import first_order_lag
from mtu_cli.units import UNITS

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


def test_u_of_a_diameter_is_that_of_its_points_with_their_covariance(tmp_path: Path) -> None:
    """Slowly: differences for the gradient, the covariance matrix of all errors of the part."""
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
    own: dict[str, FloatArray | NDArray[np.object_]] = {"T_scale_degC": temperature}
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
    measured = places / np.array([1, 1, 1 - 1e-4])
    points = made_points(["p"] * 5, np.arange(5), list("abcde"), measured, places)
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


# The scatter of measured points against a plain likelihood, what it adds to u, and the form left


@pytest.mark.parametrize("repeats", [1, 2])
def test_the_scatter_of_rings_is_found(tmp_path: Path, repeats: int) -> None:
    """40 rings with 2 um on every coordinate, besides 0.4 and 0.5 um that the model knows."""
    rng = np.random.default_rng(5)
    n, places = 20 * repeats, np.tile(ring_places(diameter=DIAMETER), (20, 1))
    visit = rng.standard_normal(places.shape) * [0.4e-3, 0.5e-3, 0]
    measured = np.tile(
        (seen(places, error_at, np.full(220, 20.0)) + visit).reshape(20, 1, 11, 3),
        (1, repeats, 1, 1),
    ).reshape(-1, 3)
    measured = measured + 2e-3 * rng.standard_normal(measured.shape)
    points = ring_points(
        measured,
        [str(i // repeats) for i in range(n)],
        [1 + i % repeats for i in range(n)],
        {"T_scale_degC": np.full(11 * n, 20.0)},
    )
    result = correct(machine(tmp_path), ring_part(tmp_path), points, Settings())
    scatter = result.scatter
    assert scatter is not None
    assert scatter.origin == ("form" if repeats == 1 else "repeats")
    assert scatter.dof == (160 if repeats == 1 else 440)
    # The standard error of a standard deviation of nu degrees of freedom is its 1/sqrt(2 nu).
    assert scatter.s == pytest.approx(2e-3, rel=4 / np.sqrt(2 * scatter.dof))
    more = result.u_corrected[:, :2] ** 2 - result.u[:, :2] ** 2
    assert more == pytest.approx(np.full((11 * n, 2), scatter.variance), rel=ROUNDING)
    assert codes(result) == []


@pytest.mark.parametrize("angle", [0.0, 50e-6])
def test_a_squareness_that_the_model_lacks_is_left_as_form(tmp_path: Path, angle: float) -> None:
    """Two parts read twice; 50 urad on a ring of 180 mm make an ellipse of 4.5 um."""
    rng = np.random.default_rng(1)
    true, T = np.tile(ring_places(diameter=DIAMETER), (4, 1)), np.full(44, 21.0)
    lacking = np.zeros((3, 3))
    lacking[1, 0] = angle
    measured = seen(true, lambda p, t: error_at(p, t) + p @ lacking, T)
    measured[:, :2] += 5e-4 * rng.standard_normal((44, 2))
    points = ring_points(measured, ["p", "p", "q", "q"], [1, 2, 1, 2], {"T_scale_degC": T})
    result = correct(machine(tmp_path), ring_part(tmp_path), points, Settings())
    (form,) = result.forms
    assert (form.id, form.visits) == ("ring", 4)
    assert codes(result) == (["form-left"] if angle else [])
    # Residuals of (r angle/2) sin 2 phi; what the model and probing explain is below 1 um.
    expected = DIAMETER / 4 * angle * np.sqrt(11 / 8 / 2)
    assert form.rms == pytest.approx(expected, abs=0.5e-3)
    assert form.explained < 1e-3


# Covariates, and drifts that lag behind temperatures.


def test_covariates_come_from_the_rows_else_from_the_call(tmp_path: Path) -> None:
    _, measured, temperature = rings(1)
    model, part = machine(tmp_path), ring_part(tmp_path)
    bare = ring_points(measured, ["a"])
    given = correct(model, part, bare, SETTINGS, {"T_scale_degC": 20.0})
    assert given.error[:, :2] == pytest.approx(error_at(measured, np.full(11, 20.0))[:, :2])
    own = ring_points(measured, ["a"], None, {"T_scale_degC": temperature})
    both = correct(model, part, own, SETTINGS, {"T_scale_degC": 35.0})
    assert both.error[:, :2] == pytest.approx(error_at(measured, temperature)[:, :2])
    assert codes(both) == ["not-used"]


def test_what_was_not_measured_or_calibrated_is_said(tmp_path: Path) -> None:
    _, measured, temperature = rings(1)
    points = ring_points(measured, ["a"], None, {"T_scale_degC": temperature})
    model, ring = machine(tmp_path), ring_part(tmp_path)
    bare = correct(model, ring_part(tmp_path, calibrated_mm=""), points, SETTINGS)
    assert codes(bare) == ["not-estimable"]
    assert np.isnan(bare.sizes[0].error).all()
    assert bare.sizes[0].size[1] == pytest.approx(DIAMETER, abs=ROUNDING_MM)
    other = part_of(tmp_path, "features: {q: {x_mm: 0, y_mm: 0}, w: {x_mm: 9, y_mm: 0}}\n"
                    "lengths: [{from: q, to: w}]\n")  # fmt: skip
    for part, of in ((ring, points.where(np.arange(11) != 4)), (other, points)):
        found = correct(model, part, of, SETTINGS)
        assert (codes(found), found.sizes) == (["not-measured", "no-scatter-known"], ())


def lagging(model: MachineModel, taus: tuple[float, float]) -> MachineModel:
    """The model with drifts of px and py that follow one sensor with a lag each."""
    terms = list(model.terms)
    for name, tau in zip(("px", "py"), taus, strict=True):
        (term,) = [item for item in model.terms if item.estimate.name == name]
        drift = ThermalEstimate(
            component=name, of=None, unit=UNITS["um"], sensors=("T_a_degC",), reference=20.0,
            coefficients=np.array([[2e-3]]), covariance=np.zeros((1, 1)), coefficient_dof=np.inf,
            leftover=np.zeros((1, 1)), leftover_dof=np.inf, time_constants=np.array([tau]),
            sensor_u=np.zeros(1), temperature_range=np.array([[20.0, 26.0]]),
        )  # fmt: skip
        terms.append(drift_terms(drift, term.levers)[0])
    return replace(model, terms=tuple(terms))


def test_a_drift_that_lags_sees_the_history_of_all_parts(tmp_path: Path) -> None:
    count, taus = 20, (40.0, 15.0)
    time = 2.0 * np.arange(11.0 * count)
    sensor = 20 + 6 * (1 - np.exp(-time / 50))
    place = np.tile(ring_places(), (count, 1))
    own: dict[str, FloatArray | NDArray[np.object_]] = {
        "T_scale_degC": np.full(len(time), 20.0),
        "T_a_degC": sensor,
    }
    parts = [f"p{i}" for i in range(count)]
    model = lagging(machine(tmp_path), taus)
    order = np.random.default_rng(1).permutation(len(time))
    # The rows of a file need not be in the order of time.
    shuffled = [column[order] for column in (time, sensor)]
    points = ring_points(place, parts, None, own | {"T_a_degC": shuffled[1]}, time=shuffled[0])
    result = correct(model, None, points, SETTINGS)
    settled = error_at(place, np.full(len(time), 20.0))
    lagged = first_order_lag(sensor[:, None], time, np.array(taus))[:, order, 0]
    for axis in (0, 1):
        drift = result.error[:, axis] - settled[:, axis]
        # What is more than REACH time constants ago is forgotten, of 6 degC at most.
        forgotten = 2e-3 * 6 * np.exp(-REACH)
        assert drift == pytest.approx(2e-3 * (lagged[axis] - 20), abs=forgotten)
    # It matters: a drift that began anew with every part would be off by the whole lag.
    assert np.abs(2e-3 * (shuffled[1] - lagged[0])).max() > 1e3 * forgotten
    still = ring_points(place, parts, None, own)
    assert "settled-temperatures" in codes(correct(model, None, still, SETTINGS))
    hot = ring_points(place, parts, None, own | {"T_a_degC": sensor + 2}, time=time)
    assert "outside-measured-range" in codes(correct(model, None, hot, SETTINGS))
