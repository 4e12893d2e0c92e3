"""Readings as tables of passes and targets, against loops over the readings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_examples import Segment, estimate, loaded, readings
from reading_examples import TARGETS, at, in_table_order, machine, only, run, tables_of
from thermal_machines import drift

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import Readings
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.fit import effects_on_readings, fit_machine, without_effects
from mtu_cli.stats.least_squares import BoolArray, FloatArray
from mtu_cli.units import ARCSEC, UM


def less_line(found: Readings, kept: BoolArray | None = None) -> FloatArray:
    """Errors less the least-squares line of all readings, or of those kept."""
    X = np.column_stack([np.ones(len(found)), found.position_mm])
    of = np.ones(len(found), bool) if kept is None else kept
    return np.asarray(found.error - X @ np.linalg.lstsq(X[of], found.error[of], rcond=None)[0])


def test_readings_less_their_own_line(tmp_path: Path) -> None:
    """Nothing was known: the line of all readings goes."""
    found = readings([run(5, slope=3e-4)])
    table = only(tables_of(machine(tmp_path), None, found))
    assert table.component == "px"
    assert table.axes == ("x",)
    assert table.unit == "um"
    assert table.fitted_degree == 1
    assert table.parts == ("1", "2", "3", "4", "5")
    assert table.features[:3] == ("-20 +", "-20 -", "0 +")
    assert table.common.shape == table.of_part.shape == (1, 8, 1, 0)
    left = less_line(found)
    for i in range(40):
        sign = "+" if found.direction[i] > 0 else "-"
        column = f"{found.position_mm[i]:g} {sign}"
        assert at(table, str(found.pass_number[i]), column) == pytest.approx(left[i], abs=1e-14)
    assert table.repeats.tolist() == [[1] * 8] * 5
    assert table.places[2, :, 0].tolist() == np.repeat(TARGETS, 2).tolist()
    assert np.isnan(table.places[..., 1:]).all()
    shapes = {name: value.shape for name, value in table.covariates.items()}
    assert shapes == {"sequence": (5, 1), "dir_x": (1, 8), "time_min": (5, 8)}
    assert table.covariates["dir_x"].ravel().tolist() == [1, -1] * 4
    assert table.covariates["time_min"][1].tolist() == [8, 15, 9, 14, 10, 13, 11, 12]


def test_what_was_known_goes_with_its_covariances(tmp_path: Path) -> None:
    """Coefficients from before: less c0 + c1 p, C common to all passes, D of each direction."""
    C = np.array([[4e-8, 1e-10], [1e-10, 9e-12]])
    D = np.array([[9e-8, 0.0], [0.0, 4e-12]])
    known = Estimates(components={"px": estimate("px", "x", [2e-3, -1e-4], C=C, D=D, s=5e-4)})
    found = readings([run(4)])
    table = only(tables_of(machine(tmp_path), known, found))
    assert table.fitted_degree == -1
    rows = np.argsort(found.pass_number * 1000 + np.abs(found.direction), kind="stable")
    expected = {
        (str(found.pass_number[i]), float(found.position_mm[i]), int(found.direction[i])):
        found.error[i] - 2e-3 + 1e-4 * found.position_mm[i]
        for i in rows
    }  # fmt: skip
    for (name, position, sign), value in expected.items():
        column = f"{position:g} {'+' if sign > 0 else '-'}"
        assert at(table, name, column) == pytest.approx(value, abs=1e-15)
    p, way = table.places[0, :, 0], table.covariates["dir_x"][0]
    X = np.column_stack([np.ones(8), p])
    F, R = table.common[0, :, 0], table.of_part[0, :, 0]
    assert len(table.common) == len(table.of_part) == 1
    np.testing.assert_allclose(F @ F.T, X @ C @ X.T, rtol=1e-9)
    # Forward and reverse of a pass are passes of their own to the fit.
    same = way[:, None] == way
    np.testing.assert_allclose(R @ R.T, np.where(same, X @ D @ X.T, 0.0), rtol=1e-9, atol=1e-18)


def test_a_component_without_an_axis(tmp_path: Path) -> None:
    """A reading is a pass, whose D is the component's whole scatter."""
    values = np.array([3.0, 4.0, 8.0]) * ARCSEC
    for passes in (None, np.arange(3) + 1):
        found = readings([Segment(name="ort", position=None, error=values, passes=passes)])
        table = only(tables_of(machine(tmp_path), None, found))
        assert table.axes == ("ort",)
        assert table.unit == "arcsec"
        assert table.features == ("ort",)
        assert table.parts == ("1", "2", "3")
        assert table.fitted_degree == 0
        np.testing.assert_allclose(table.errors[:, 0, 0] / ARCSEC, [-2, -1, 3], atol=1e-12)
        assert np.isnan(table.places).all()
    D = np.array([[1e-12]])
    known = Estimates(components={"ort": estimate("ort", None, [5 * ARCSEC], D=D, C=D / 4)})
    table = only(tables_of(machine(tmp_path), known, found))
    np.testing.assert_allclose(table.errors[:, 0, 0] / ARCSEC, [-2, -1, 3], atol=1e-12)
    assert np.abs(table.of_part).ravel().tolist() == pytest.approx([1e-6])
    assert np.abs(table.common).ravel().tolist() == pytest.approx([5e-7])


def test_readings_without_passes_are_repeats(tmp_path: Path) -> None:
    segment = replace(run(3), passes=None, direction=None, time=None)
    found = readings([segment])
    table = only(tables_of(machine(tmp_path), None, found))
    assert table.parts == ("0",)
    assert table.features == ("-20", "0", "15.5", "40")
    assert table.repeats.tolist() == [[6] * 4]
    left = less_line(found)[found.position_mm == 0]
    assert table.errors[0, 1, 0] == pytest.approx(left.mean(), abs=1e-15)
    assert table.covariates["sequence"].tolist() == [[1.0]]
    assert "dir_x" not in table.covariates


def test_files_number_their_passes_on_their_own(tmp_path: Path) -> None:
    """In order of time where the files share a clock, else file by file."""
    late, early = run(2), run(2, role="laser", seed=4)
    assert late.time is not None
    shared = replace(late, time=late.time + 100)
    both = readings([shared, early])
    table, _ = tables_of(machine(tmp_path), None, both)
    assert table[0].parts == ("laser.csv 1", "laser.csv 2", "lbb.csv 1", "lbb.csv 2")
    assert table[0].covariates["sequence"].ravel().tolist() == [1, 2, 3, 4]
    overlapping, _ = tables_of(machine(tmp_path), None, readings([late, early]))
    assert overlapping[0].parts == ("lbb.csv 1", "lbb.csv 2", "laser.csv 1", "laser.csv 2")


def test_targets_are_recorded_as_reached(tmp_path: Path) -> None:
    """Positions within a few um of 60 mm of travel are one target; the line is at their own."""
    exact = readings([run(4)])
    noise = np.random.default_rng(9).uniform(-2e-3, 2e-3, len(exact))
    found = replace(exact, position_mm=exact.position_mm + noise)
    table = only(tables_of(machine(tmp_path), None, found))
    assert table.errors.shape == (4, 8, 1)
    order = in_table_order(found, exact.position_mm)
    np.testing.assert_allclose(table.errors.ravel(), less_line(found)[order], atol=1e-14)
    np.testing.assert_allclose(table.places[..., 0].ravel(), found.position_mm[order])
    # So many positions that neighbours would run together stay their own.
    line = np.linspace(0, 1, 30_001)
    dense = readings([Segment(name="px", position=line, error=1e-3 * np.sin(line))])
    assert only(tables_of(machine(tmp_path), None, dense)).errors.shape == (1, 30_001, 1)


def test_passes_that_run_one_way_are_judged_in_pairs(tmp_path: Path) -> None:
    """Numbered one there, one back, they are the same table as there and back in one pass."""
    together = readings([run(4)])
    apart = replace(
        together, pass_number=2 * together.pass_number - (together.direction > 0).astype(int)
    )
    (one,), _ = tables_of(machine(tmp_path), None, together)
    (pairs,), _ = tables_of(machine(tmp_path), None, apart)
    assert pairs.parts == ("1/2", "3/4", "5/6", "7/8")
    assert pairs.features == one.features
    np.testing.assert_array_equal(pairs.errors, one.errors)
    np.testing.assert_array_equal(pairs.covariates["sequence"], one.covariates["sequence"])


def test_a_reading_without_a_covariate_has_that_of_its_pass(tmp_path: Path) -> None:
    """As for points, component by component."""
    found = readings([run(5)])
    load = found.pass_number.astype(np.float64)
    load[[3, 17]] = np.nan
    (table,), (told,) = tables_of(
        machine(tmp_path), None, replace(found, covariates={"load": load})
    )
    assert told.code == "missing-values"
    first = f"load (2 of 40 rows, the first {found.sources[0].shown}, row {found.row[3]})"
    assert told.facts["names"] == [first]
    assert table.covariates["load"].ravel().tolist() == [1, 2, 3, 4, 5]
    whole = only(tables_of(machine(tmp_path), None, found))
    np.testing.assert_array_equal(table.errors, whole.errors)


def with_temperature(found: Readings, values: FloatArray | None = None) -> Readings:
    T = np.asarray(20 + 0.2 * np.arange(len(found)) if values is None else values, np.float64)
    return replace(found, covariates={"T_a_degC": T})


@pytest.mark.parametrize("tau", [0.0, 7.0])
def test_known_drift_goes_where_its_temperatures_are(tmp_path: Path, tau: float) -> None:
    """A ramp of 0.2 degC a minute from rest: T - 20 - g tau (1 - exp(-t/tau))."""
    known = drift("px", "x", ("T_a_degC",), np.array([[1.5], [0.01]]), time_constants=(tau,))
    estimates = Estimates(
        components={"px": estimate("px", "x", [0.0, 1e-4])}, thermal={"px": known}
    )
    found = with_temperature(readings([run(3)]))
    table = only(tables_of(machine(tmp_path), estimates, found))
    t, p = found.time_min, found.position_mm
    rise = 0.2 * t - (0.2 * tau * (1 - np.exp(-t / tau)) if tau else 0.0)
    left = found.error - 1e-4 * p - UM * (1.5 + 0.01 * p) * rise
    order = in_table_order(found)
    np.testing.assert_allclose(table.errors.ravel(), left[order], atol=1e-14)
    assert table.covariates["T_a_degC"].shape == (3, 8)
    for bare in (readings([run(3)]), with_temperature(found, np.full(24, np.nan))):
        (table,), warned = tables_of(machine(tmp_path), estimates, bare)
        assert [item.code for item in warned] == ["drift-not-removed"]
        np.testing.assert_allclose(table.errors.ravel(), (bare.error - 1e-4 * p)[order], atol=1e-15)


# Readings less what declared effects say of them, against the effect's equation by hand.


GROWING = """
axes: {x: {travel_mm: [0, 400]}}
components:
  px: {of: x, unit: um}
  py: {of: y, unit: um}
equations: {Ex: px, Ey: py}
effects:
- name: thermal-growth-x
  family: thermal-growth
  equations: {Ex: growth*x*(T_x_degC - 20)}
  parameters: {growth: {value: 11, u: 0.2, unit: um/m/K}}
  covariance: [[0.04]]
  found: {component: FOUND}
"""
GROWTH = 11e-6


def warm_runs() -> Readings:
    rng = np.random.default_rng(1)
    position = np.tile(np.linspace(0.0, 400.0, 9), 5)
    passes = np.repeat(np.arange(5) + 1, 9)
    both = [
        Segment(name=name, position=position, error=1e-3 * rng.normal(size=45), passes=passes)
        for name in ("px", "py")
    ]
    found = readings(both)
    return replace(found, covariates={"T_x_degC": 20 + rng.uniform(0, 6, 90)})


def declared(folder: Path, component: str) -> LoadedMachine:
    return loaded(folder, GROWING.replace("FOUND", component))


def test_readings_that_lack_the_column_are_left_and_told(tmp_path: Path) -> None:
    warm = warm_runs()
    left, warned = without_effects(declared(tmp_path, "px"), warm)
    rise = warm.covariates["T_x_degC"].astype(float) - 20
    said = np.where(warm.code == 0, GROWTH * warm.position_mm * rise, 0.0)
    np.testing.assert_allclose(left.error, warm.error - said, atol=1e-15)
    assert not warned
    given = replace(warm, covariates={})
    left, warned = without_effects(declared(tmp_path, "px"), given)
    np.testing.assert_array_equal(left.error, given.error)
    (told,) = warned
    assert told.code == "not-used"
    assert (told.facts["effect"], told.facts["component"]) == ("thermal-growth-x", "px")
    assert fit_machine(declared(tmp_path, "px"), given).warnings == (told,)


BENT = """
components:
  dx: {of: x, unit: um, coefficients: [0, 0]}
  ez: {of: x, unit: arcsec, coefficients: [0, 0]}
equations: {Ex: dx + y*ez}
effects:
- name: backlash-x
  parameters: {lost: {value: 4, unit: um}}
  equations: {Ex: lost*dir_x}
  found: {component: dx}
- name: bend-x
  parameters: {growth: {value: 2, unit: arcsec/m}}
  equations: {Ex: y*growth*(x - 100)}
  found: {component: ez}
- name: of-points
  parameters: {shift: {value: 9, unit: um}}
  equations: {Ex: shift}
"""


def test_an_effect_is_divided_by_the_lever_arm_of_its_component(tmp_path: Path) -> None:
    own, x, direction = loaded(tmp_path, BENT), np.array([0.0, 100, 300]), np.array([1.0, -1, 1])
    places = np.column_stack([x, np.full((3, 2), np.nan)])
    total, warned = effects_on_readings(own, "dx", places, {"dir_x": direction})
    np.testing.assert_allclose(total, 4e-3 * direction, rtol=1e-12)
    assert not warned
    total, _ = effects_on_readings(own, "ez", places, {})
    # y, which the readings do not tell, falls out.
    np.testing.assert_allclose(total, 2 * np.pi / 648_000 / 1000 * (x - 100), rtol=1e-12)
