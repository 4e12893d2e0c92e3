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
from scipy.optimize import minimize_scalar
from scipy.stats import binom

from mtu_cli.analyses.correct import CorrectResult, correct
from mtu_cli.analyses.correct.scatter import (
    FormLeft,
    PointScatter,
    Ring,
    Squares,
    _estimate,
    forms_left,
    unexplained,
)
from mtu_cli.files.points import Points
from mtu_cli.model.geometry import fit_circle
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


# The scatter of measured points against a plain likelihood, what it adds to u, and the form left


NOISE = 1e-3


def ring(points: Floats, K: Floats | None = None, dof: float = np.inf) -> Ring:
    """A calibrated circle through points (n, 2) with the modelled covariance K along its radii."""
    fit, n = fit_circle(points), len(points)
    away = np.column_stack([fit.away, np.zeros(n)])
    covariance = np.zeros((n, n)) if K is None else K
    return Ring(
        kind="circle", id="a", operation="", calibrated=True, residuals=fit.residuals, away=away,
        K=covariance, dof=dof,
    )  # fmt: skip


def estimate(squares: Squares) -> PointScatter:
    return _estimate(squares, "form")


def test_unlike_squares_give_the_largest_likelihood() -> None:
    rng = np.random.default_rng(3)
    modelled, dof = rng.uniform(0, 4, 40), rng.integers(1, 4, 40).astype(float)
    sums = (modelled + 1.5) * rng.chisquare(dof)

    def plain(variance: float) -> float:
        each = modelled + variance
        return float(np.sum(dof * np.log(each) + sums / each))

    best = minimize_scalar(plain, bounds=(0, 20), method="bounded", options={"xatol": 1e-10})
    found = estimate(Squares(sums=sums * 1e-6, dof=dof, modelled=modelled * 1e-6))
    # A minimum is flat: its place is found to some roots of the rounding of its value.
    place = 10 * np.sqrt(np.finfo(float).eps)
    assert found.variance == pytest.approx(best.x * 1e-6, rel=place)


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
    assert [item.code for item in result.warnings] == []


def noisy(rng: np.random.Generator, visits: int, K: Floats | None = None) -> list[Ring]:
    """Visits of one round ring, on a machine that shifts its points by K in all of them."""
    true = ring_places()[:, :2]
    shift = np.zeros(11) if K is None else rng.multivariate_normal(np.zeros(11), K)
    moved = true + shift[:, None] * (true - [200.0, 180.0]) / 90.0
    return [ring(moved + NOISE * rng.standard_normal((11, 2)), K) for _ in range(visits)]


def repeats_of(rng: np.random.Generator, dof: float) -> PointScatter:
    """The variance of the points as repeats of so many degrees of freedom estimate it."""
    variance = NOISE**2 * (rng.chisquare(dof) / dof)
    return PointScatter(variance=variance, spread=0.0, dof=dof, origin="repeats")


@pytest.mark.parametrize(("dof", "oval"), [(None, 2.0), (8.0, 0.0)])
def test_p_of_a_round_ring_is_uniform(dof: float | None, oval: float) -> None:
    """By repeats and by visits; exact of noise alone, on the safe side beside a modelled oval."""
    rng, runs = np.random.default_rng(6), 1500
    angle = 2 * np.pi * np.arange(11) / 11
    K = None if not oval else (oval * NOISE) ** 2 * np.outer(np.cos(2 * angle), np.cos(2 * angle))
    p = []
    for _ in range(runs):
        scatter = None if dof is None else repeats_of(rng, dof)
        (form,) = forms_left(noisy(rng, 1 if dof else 3, K), scatter)
        p.append(form.p)
    for level in (0.05, 0.2):
        below = np.sum(np.array(p) < level)
        assert below <= binom.ppf(1 - 1e-4, runs, level)
        assert oval or below >= binom.ppf(1e-4, runs, level)


def test_a_form_is_tested_where_its_scatter_is_known_by_something_else() -> None:
    rng = np.random.default_rng(7)
    one = noisy(rng, 1)
    assert forms_left(one, None) == ()
    assert forms_left(one, PointScatter(variance=1.0, spread=0, dof=8, origin="form")) == ()
    assert forms_left([ring(ring_places()[:3, :2])] * 2, None) == ()
    # Without any scatter a form of rounding is none, and a true one certain.
    squashed = ring_places()[:, :2] * [1.0, 1 - 1e-5]
    for places, certain in ((ring_places()[:, :2], False), (squashed, True)):
        (form,) = forms_left([ring(places)] * 2, None)
        assert (form.p < 1e-6) is certain


def test_rings_are_judged_together_where_they_are_calibrated() -> None:
    def form(id: str, p: float, *, calibrated: bool = True) -> FormLeft:
        return FormLeft(
            kind="circle", id=id, operation="", calibrated=calibrated, visits=2, rms=1.0,
            explained=1.0, F=1.0, p=p,
        )  # fmt: skip

    known = [form("a", 0.02), form("b", 0.03), form("made", 1e-9, calibrated=False)]
    assert [item.id for item in unexplained(known)] == ["a"]


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
    assert codes_of(result) == (["form-left"] if angle else [])
    # Residuals of (r angle/2) sin 2 phi; what the model and probing explain is below 1 um.
    expected = DIAMETER / 4 * angle * np.sqrt(11 / 8 / 2)
    assert form.rms == pytest.approx(expected, abs=0.5e-3)
    assert form.explained < 1e-3


def codes_of(result: CorrectResult) -> list[str]:
    return [item.code for item in result.warnings]
