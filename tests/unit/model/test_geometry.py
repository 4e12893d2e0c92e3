"""Circles, spheres and planes against printed figures, scipy's optimiser and differences."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_examples import loaded, part_of
from model_examples import stated as with_estimates
from scipy.optimize import least_squares
from support import read_components
from table_trials import SIGMA, TARGETS, axis_machine, axis_readings, bend, table_coverage

from mtu_cli.analyses.axis_errors import stated
from mtu_cli.analyses.fit_components import fit_result
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.findings import InputError
from mtu_cli.model.features import feature_points, grid_of, outside_warnings
from mtu_cli.model.fit import estimates_from_fit, estimates_from_report, fit_machine
from mtu_cli.model.geometry import GeometryError, RoundFit, fit_circle, fit_round
from mtu_cli.model.graph import transitions
from mtu_cli.model.machine_model import MachineModel, build_model
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.reports.fit_components import document
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

GANDER = np.array([(1, 7), (2, 6), (5, 8), (7, 7), (9, 5), (3, 7)], float)


def arc(n: int, radius: float, noise: float, seed: int, angle: float = 5.0) -> FloatArray:
    """Points (n, 2) about an arc of `angle` rad."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, angle, n)
    circle: FloatArray = radius * np.column_stack([np.cos(t), np.sin(t)])
    found: FloatArray = circle + noise * rng.standard_normal((n, 2))
    return found


TURN = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
SHIFT = np.array([310.0, -45.0, 120.0])


def tilted(flat: FloatArray, lift: float = 0.0) -> FloatArray:
    """The points of a plane, turned into space and far from the origin, `lift` off the plane."""
    heights = lift * np.random.default_rng(2).standard_normal(len(flat))
    return np.asarray(np.column_stack([flat, heights]) @ TURN.T + SHIFT)


def cap(n: int, radius: float, reach: float = np.pi, noise: float = 0.0) -> FloatArray:
    """Points (n, 3) of a spherical cap: a spiral from the pole down to the angle `reach`."""
    t = np.arccos(np.linspace(1, np.cos(0.95 * reach), n))
    a = 2.39996 * np.arange(n)
    q = np.column_stack([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)])
    error = noise * np.random.default_rng(n).standard_normal((n, 3))
    return np.asarray(radius * q @ TURN.T + SHIFT + error)


def test_circle_of_gander_golub_and_strebel() -> None:
    """BIT 34 (1994): the geometric circle of the six points, as printed to four decimals."""
    found = fit_circle(GANDER)
    assert [*found.centre, found.radius] == pytest.approx([4.7398, 2.9835, 4.7142], abs=5e-5)


def bow(height: float) -> FloatArray:
    """An arc of 20 points over 100 mm, so many times 100 mm high."""
    x = np.linspace(-0.5, 0.5, 20)
    return np.asarray(100 * np.column_stack([x, height * (1 - 4 * x**2)]))


@pytest.mark.parametrize(
    ("fit", "points", "message"),
    [
        (fit_circle, [(0, 0), (1, 1), (2, 2), (3, 3)], "on a line"),
        (fit_circle, [(0, 0), (0, 0), (1, 1), (0, 0)], "on a line"),
        (fit_circle, [(1, 1)] * 4, "the same place"),
        (fit_circle, [(0, 0, 0), (1, 2, 3), (2, 4, 6), (3, 6, 9)], "on a line"),
        (fit_circle, [*np.eye(3), *-np.eye(3)], "in no plane"),
        # The normal equations lose the fourth power of its height over its length: 1e-20.
        (fit_circle, bow(1e-5), "hardly bend"),
        (fit_round, np.insert(arc(9, 90.0, 3.0, 1), 2, 4.0, axis=1), "plane or a circle"),
        (fit_round, cap(3, 1.0), "plane or a circle"),
    ],
)
def test_points_without_a_figure(
    fit: Callable[[FloatArray], RoundFit], points: FloatArray, message: str
) -> None:
    with pytest.raises(GeometryError, match=message):
        fit(np.array(points, float))
    assert fit_circle(bow(1e-2)).radius == pytest.approx(100 / 0.08, rel=1e-2)


@pytest.mark.parametrize("seed", range(4))
def test_circle_and_sphere_against_an_optimiser(seed: int) -> None:
    for points, fit in (
        (arc(9, 90.0, 2.0, seed) + np.array([500.0, 200.0]), fit_circle),
        (cap(14 + seed, 12.5, noise=0.4), fit_round),
    ):
        start = np.append(points.mean(axis=0), 10.0)

        def distances(theta: FloatArray, points: FloatArray = points) -> FloatArray:
            away: FloatArray = np.linalg.norm(points - theta[:-1], axis=1) - theta[-1]
            return away

        other = least_squares(distances, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        found = fit(points)
        assert np.append(found.centre, found.radius) == pytest.approx(other, rel=1e-7)
        assert found.residuals == pytest.approx(distances(np.append(found.centre, found.radius)))


CASES: dict[str, tuple[Callable[[FloatArray], RoundFit], FloatArray]] = {
    "circle": (fit_circle, arc(9, 90.0, 3.0, 1)),
    "short arc": (fit_circle, arc(9, 90.0, 0.5, 2, angle=1.0)),
    "gander": (fit_circle, GANDER),
    "circle in space": (fit_circle, tilted(arc(9, 90.0, 3.0, 1), 1e-6)),
    "sphere": (fit_round, cap(12, 12.5, noise=0.5)),
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


# Least-squares figures of many trials at once against one trial at a time.


TRIALS = 12


def drawn(nominal: FloatArray, noise: float, trials: int = TRIALS) -> list[FloatArray]:
    rng = np.random.default_rng(len(nominal))
    return [point[:, None] + noise * rng.normal(size=(3, trials)) for point in nominal]


@pytest.mark.parametrize("width", [10.0, 0.1, 0.01, 0.003])
def test_plane_of_a_strip(width: float) -> None:
    """Two edges 1 m long, `width` mm apart, 1 um noise: the narrowest turn about freely.

    Each normal is known as the step ends, 1e-13 of the length, over the least width drawn.
    """
    nominal = np.array([[0, 0, 0], [1000, 0, 0], [1000, width, 0], [0, width, 0], [500, width, 0]])
    points = drawn(nominal, 1e-3, 5000)
    centre, normal = transitions.plane(points, np.array([0.0, 0.0, 1.0]))
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
    nominal = tilted(arc(8, 100.0, 0.0, 1, np.radians(degrees)))
    _, found = transitions.circle_through(nominal)(*drawn(nominal, u, m))
    t = np.radians(np.linspace(0, degrees, 8))
    X = np.column_stack([np.cos(t), np.sin(t), np.ones(8)])
    expected = u * np.sqrt(np.linalg.inv(X.T @ X)[2, 2])
    # Five standard errors, and the second order, which is as large as u(R)/R.
    assert found.std() == pytest.approx(expected, rel=5 / np.sqrt(2 * m) + expected / 100)
    assert found.mean() == pytest.approx(100, abs=5 * expected / np.sqrt(m) + 2 * expected**2 / 100)


@pytest.mark.parametrize(("n", "reach", "noise"), [(7, np.pi, 0.1), (9, 0.1, 1e-3)])
def test_sphere_of_radius_against_an_optimiser(n: int, reach: float, noise: float) -> None:
    nominal = cap(n, 12.5, reach)
    points = drawn(nominal, noise)
    radius = 12.5 + noise * np.linspace(-1, 1, TRIALS)
    centre = np.asarray(transitions.sphere_of_radius_through(nominal)(*points, radius))
    for trial in range(TRIALS):
        p = np.array([point[:, trial] for point in points])

        def gaps(c: FloatArray, p: FloatArray = p, r: float = float(radius[trial])) -> FloatArray:
            away: FloatArray = np.linalg.norm(p - c, axis=1) - r
            return away

        other = least_squares(gaps, SHIFT, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac").x
        # The optimiser sees no more of the sum of squares than its rounding: noise times 1e-8.
        assert centre[:, trial] == pytest.approx(other, abs=1e-6)


def test_what_cannot_be_fitted_is_not_a_number() -> None:
    """One trial whose points are no sphere is seen, not hidden, and hides no other."""
    nominal = cap(6, 12.5)
    points = drawn(nominal, 1e-3, 3)
    for i, point in enumerate(points):
        point[:, 1] = [float(i), 0.0, 0.0]
    with np.errstate(all="ignore"):
        centre, _ = transitions.sphere_through(nominal)(*points)
    assert np.isfinite(centre).tolist() == [[True, False, True]] * 3


# Features of a part, and grids of places over a machine's volume.


SPACE = """\
axes: {x: {travel_mm: [0, 100]}, y: {travel_mm: [20, 60]}}
components:
  px: {of: x, unit: um, coefficients: [0, 0], covariance: [[0, 0], [0, 0]], s_repeat: 0}
  sq: {unit: urad, coefficients: [50], u_future: 1}
equations: {Ex: px + y*sq}
"""


def grid(folder: Path, text: str, machine: str = SPACE) -> tuple[tuple[str, ...], FloatArray]:
    known = loaded(folder, machine)
    return grid_of(known, build(known), text)


def build(known: LoadedMachine) -> MachineModel:
    return build_model(known, estimates_from_fit(known, None))


def test_every_axis_has_its_count_from_end_to_end(tmp_path: Path) -> None:
    """y is needed by a lever arm alone, z by nothing."""
    ids, points = grid(tmp_path, "3,2")
    assert ids == ("0,20", "0,60", "50,20", "50,60", "100,20", "100,60")
    expected = [[x, y] for x in (0.0, 50.0, 100.0) for y in (20.0, 60.0)]
    assert points[:, :2].tolist() == expected
    assert np.isnan(points[:, 2]).all()
    assert len(grid(tmp_path, "4")[0]) == 16


def test_more_places_than_a_covariance_holds(tmp_path: Path) -> None:
    assert len(grid(tmp_path, "60,50")[0]) == 3000
    with pytest.raises(InputError, match="at most 3000 places, not 3050"):
        grid(tmp_path, "61,50")
    # Before so many are made.
    with pytest.raises(InputError, match="at most 3000 places, not 10000000000"):
        grid(tmp_path, "100000,100000,100000")


def test_features_have_the_coordinates_that_the_equations_need(tmp_path: Path) -> None:
    """One that the machine fixes is the machine's, which is warned of; so are places beyond the
    measured range.
    """
    part = part_of(tmp_path, "features: {a: {x_mm: 1, y_mm: 2, z_mm: 5}, b: {x_mm: 140, y_mm: 2}}")
    fixed = "constants: {z: 127}\n" + SPACE.replace("px + y*sq", "px + z*sq")
    model = build(loaded(tmp_path, fixed))
    ids, points, (warned,) = feature_points(part, model)
    assert (ids, warned.code) == (("a", "b"), "not-used")
    px = replace(model.terms[0].estimate, position_range=(0.0, 100.0))
    seen = replace(model, terms=(replace(model.terms[0], estimate=px), *model.terms[1:]))
    (outside,) = outside_warnings(predict(seen, ids, points).outside)
    assert "feature 'b' at 140 mm" in outside.message
    # Of several points of one name the farthest out.
    thrice = np.array([[100.001, 0, 0], [140, 0, 0], [101, 0, 0]])
    (outside,) = outside_warnings(predict(seen, ("b",) * 3, thrice).outside)
    assert "feature 'b' at 140 mm" in outside.message
    # Along other axes the same features are elsewhere.
    along_y = (
        "py: {of: y, unit: um, coefficients: [0, 0], covariance: [[0, 0], [0, 0]]}\nequations:"
    )
    both = build(
        loaded(tmp_path, SPACE.replace("equations:", f"  {along_y}").replace("y*sq", "py"))
    )
    near = (replace(x, estimate=replace(x.estimate, position_range=(0, 0.5))) for x in both.terms)
    warned_of = outside_warnings(predict(replace(both, terms=tuple(near)), ids, points).outside)
    assert ["feature 'a' at 1 mm" in warned_of[0].message, len(warned_of)] == [True, 2]
    assert "feature 'a' at 2 mm" in warned_of[1].message
    needing = build(loaded(tmp_path, SPACE.replace("px + y*sq", "px + z*sq")))
    with pytest.raises(InputError, match="without a z, of feature 'b'"):
        feature_points(part, needing)


# Errors along one axis that a machine file states, against what it predicts with and without.


MACHINE = """
axes: {x: {travel_mm: [0, 500]}}
components:
  a: {of: x, unit: um, coefficients: [1.0, 0.1], covariance: [[0.4, 0], [0, 1.0e-4]]}
  b: {of: x, unit: um}
  s: {of: x, unit: um, coefficients: [2.0]}
  t: {unit: urad, coefficients: [4.0], covariance: [[0.2]]}
equations: {Ex: a + b*0, Ey: s + x*t}
"""
EFFECTS = """
effects:
  - name: backlash
    parameters: {h: {value: 2.0, u: 0.3, unit: um}, g: {value: 5.0, u: 0.5, unit: urad}}
    covariance: [[0.09, -0.06], [-0.06, 0.25]]
    equations: {Ex: h*dir_x + (x - 30)*g}
  - name: tilt
    parameters: {q: {value: 2.0, u: 0.3, unit: urad/m}}
    equations: {Ex: q*x*y}
"""
PLACES = np.array([-20.0, 0.0, 35.0, 480.0])


def along_x(folder: Path, effects: str) -> Prediction:
    """Both directions at all places."""
    text = MACHINE.replace("b*0", "0*x").replace("  b: {of: x, unit: um}\n", "") + effects
    points = np.column_stack([np.tile(PLACES, 2), np.zeros((8, 2))])
    way = {"dir_x": np.repeat([1.0, -1.0], 4)}
    return predict(with_estimates(folder, text), [str(i) for i in range(8)], points, way)


def test_an_effect_is_what_it_adds_to_the_prediction(tmp_path: Path) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    effect = stated(machine, "backlash")
    values, covariance, turns = effect.errors_at(machine, PLACES)
    only = EFFECTS[: EFFECTS.index("  - name: tilt")]
    more, plain = along_x(tmp_path, only), along_x(tmp_path, "")
    assert values.ravel() == pytest.approx((more.mean - plain.mean)[0::2], rel=1e-12)
    added = (more.covariance - plain.covariance)[0::2, 0::2]
    assert covariance == pytest.approx(added, rel=1e-9, abs=1e-18)
    assert (effect.axis, turns, effect.angle) == ("x", True, False)


def test_a_component_is_what_is_predicted_with_it_alone(tmp_path: Path) -> None:
    machine, plain = loaded(tmp_path, MACHINE), along_x(tmp_path, "")
    values, covariance, _ = stated(machine, "a").errors_at(machine, PLACES)
    assert values.ravel() == pytest.approx(plain.mean[0::2])
    assert covariance == pytest.approx(plain.covariance[0::2, 0::2])
    assert (stated(machine, "a").output, stated(machine, "s").output) == ("x", "y")
    assert stated(machine, "a").default_positions(machine) == pytest.approx(np.arange(0, 501, 50))
    endless = loaded(tmp_path, MACHINE.replace("axes: {x: {travel_mm: [0, 500]}}", ""))
    with pytest.raises(InputError, match="the travel of x"):
        stated(endless, "a").default_positions(endless)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("t", "t is a constant"),
        ("tilt", "depends on x, y"),
        ("backlsh", "did you mean 'backlash'"),
        ("b", "an estimate of b"),
    ],
)
def test_what_makes_no_table_of_an_axis(tmp_path: Path, name: str, words: str) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    with pytest.raises(InputError, match=words):
        stated(machine, name).errors_at(machine, PLACES)


# Tables of smooth profiles: intervals that cover, a report that predicts the same, their files.


X = np.linspace(0.0, 400.0, TARGETS)
AT = np.array([0.0, 20.0, 40.0, 333.0, 420.0])
POINTS = np.column_stack([AT, np.zeros((len(AT), 2))])
IDS = [f"{x:g}" for x in AT]


@pytest.mark.parametrize("own", [0.0, 1.0])
def test_future_readings_between_the_targets(own: float, tmp_path: Path) -> None:
    """The short version of tests/bench/test_bench_rates.py."""
    found = table_coverage(axis_machine(tmp_path), 60, 6.0, seed=2, own=own)
    assert found.inside > 0.93
    assert found.width < (1.3 if own else 1.25)
    assert found.outside > 0.9


def test_readings_and_their_report_predict_the_same(tmp_path: Path) -> None:
    known, rng = axis_machine(tmp_path), np.random.default_rng(7)
    readings = axis_readings(X, bend(400.0, 4 * UM, rng), rng, own=2 * SIGMA)
    fit = fit_machine(known, readings)
    estimates = estimates_from_fit(known, fit)
    results = document(fit_result("m", fit, estimates)).record()
    item = results["components"]["dx_x"]
    assert item["shape"] == "table"
    assert item["degree"] is None
    assert item["at_mm"] == pytest.approx(X)
    assert item["between_um2"] == 0.0
    assert min(item["roughness_um2_per_mm3"], item["own_um2_per_mm3"]) > 0
    path = tmp_path / "components.json"
    path.write_text(json.dumps({"schema": "mtu/fit-components/1", "results": results}))
    again = estimates_from_report(known, read_components(path))

    def predicted(given: object) -> Prediction:
        return predict(build_model(known, given), IDS, POINTS)  # type: ignore[arg-type]

    first, second = predicted(estimates), predicted(again)
    assert second.mean == pytest.approx(first.mean, abs=1e-12)
    assert second.covariance == pytest.approx(first.covariance, rel=1e-9, abs=1e-18)
    assert second.variance().dof == pytest.approx(first.variance().dof, rel=1e-6)
    # What the interpolation leaves open: nothing at the targets, more beyond them.
    left = first.variance().by_block[1] / UM**2
    assert left[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert 0 < left[1] < left[4]
    assert [[*points] for points in first.outside.values()] == [["420"]]


@pytest.mark.parametrize(("amplitude", "degrees"), [(0.0, {0, 1}), (40.0, {None})])
def test_held_out_runs_choose_the_shape(
    amplitude: float, degrees: set[int | None], tmp_path: Path
) -> None:
    known, chosen = axis_machine(tmp_path, "degree: auto"), []
    for seed in range(6):
        rng = np.random.default_rng(seed)

        def wavy(x: np.ndarray) -> np.ndarray:
            return np.asarray(amplitude * SIGMA * np.sin(x / 25.0))

        readings = axis_readings(X, wavy, rng)
        chosen.append(fit_machine(known, readings).components["dx_x"].estimate.degree)
    assert sum(each in degrees for each in chosen) >= 5, chosen
