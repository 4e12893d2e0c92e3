"""What a virtual machine assumes where a request does not state it, and what it refuses."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from model_examples import loaded, part_of

from mtu_cli.analyses.simulate import DEFAULT_POSITIONS, Request, SimulateResult, simulate
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import InputError
from mtu_cli.language import parse
from mtu_cli.model.fit import estimates_from_fit, thermal_from_machine_file
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.simulate import DriftPlan, PartsPlan

MACHINE = """
axes: {x: {travel_mm: [0, 400]}, y: {travel_mm: [0, 300]}}
components:
  a: {of: x, unit: um, coefficients: [1, 0.01], s_repeat: 0.3}
  b: {of: y, unit: um, coefficients: [2, 0], thermal: {gradients: {T_b_degC: 2.0}}}
  c: {of: y, unit: um, coefficients: [0, 0],
      thermal: {gradients: {T_c_degC: [1, 3]}, positions_mm: [0, 200], degree: 1}}
  t: {unit: arcsec, coefficients: [3], thermal: {gradients: {T_b_degC: 0.5}}}
constants: {arm: 100}
equations: {Ex: a + b + arm*t, Ey: c}
"""
PART = """
features: {p: {x_mm: 10, y_mm: 20}, q: {x_mm: 150, y_mm: 20}, r: {x_mm: 80, y_mm: 90}}
"""
PLAN = PartsPlan(parts=4, repeats=1, cmm_u_um=0.0, reverse_every=0, minutes=0.5)
TEST = DriftPlan(
    reference=20.0, sensor_noise_degc=0.0, cycles=1, interval_min=10.0, reading_noise_um=0.0,
    reading_noise_arcsec=0.0, positions={}, settled={},
)  # fmt: skip
NOTHING = Request(
    files={}, passes=1, positions={}, component=None, part=None, parts=None, rooms=(), test=None
)


@pytest.fixture
def machine(tmp_path: Path) -> LoadedMachine:
    return loaded(tmp_path, MACHINE)


@pytest.fixture
def part(tmp_path: Path) -> LoadedPart:
    return part_of(tmp_path, PART)


def made(machine: LoadedMachine, *kinds: str, **request: Any) -> SimulateResult:
    """The files of some kinds; the laser's is of lengths."""
    estimates = estimates_from_fit(machine, None)
    thermal = thermal_from_machine_file(machine)
    model = build_model(machine, replace(estimates, thermal=thermal))
    files = {kind: Path("run.rtl" if kind == "laser" else "made.csv") for kind in kinds}
    return simulate(model, machine, replace(NOTHING, files=files, **request), 1)


def test_readings_extend_over_the_part_where_no_positions_are_stated(
    machine: LoadedMachine, part: LoadedPart
) -> None:
    stated = np.array([0.0, 400.0])
    found = made(machine, "lbb", part=part, positions={"x": stated}).columns["lbb"]
    of = {name: found["position_mm"][found["component"] == name] for name in "abt"}
    assert list(of["a"]) == [0, 400, 400, 0]
    assert list(of["b"][:DEFAULT_POSITIONS]) == list(np.linspace(20, 90, DEFAULT_POSITIONS))
    assert list(of["t"]) == [0]


def test_a_laser_is_read_where_its_component_alone_is(machine: LoadedMachine) -> None:
    result = made(machine, "laser", positions={"x": np.array([0.0, 400.0])}, component="a")
    assert set(result.columns["laser"]["component"]) == {"a"}
    assert set(result.columns["laser"]["unit"]) == {"um"}


@pytest.mark.parametrize(
    ("kind", "asked", "words"),
    [
        ("lbb", {}, "the range along x, y is missing"),
        ("laser", {}, "what the laser reads is missing"),
        ("laser", {"component": "aa"}, "--laser-component: unknown component: 'aa'; did you mean"),
        ("laser", {"component": "t"}, "t is read in arcsec, and a .rtl file holds um"),
        ("drift", {"test": replace(TEST, positions={"b": np.ones(2)})}, "appears twice"),
        ("drift", {"test": replace(TEST, settled={"c": np.ones(3)})}, "one at each of 2 positions"),
    ],
)
def test_faults_name_the_option(
    machine: LoadedMachine, kind: str, asked: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError) as fault:
        made(machine, kind, **asked)
    assert words in str(fault.value)


def test_a_part_that_does_not_extend_along_an_axis(machine: LoadedMachine, tmp_path: Path) -> None:
    flat = part_of(tmp_path, PART.replace("y_mm: 90", "y_mm: 20"))
    with pytest.raises(InputError, match="does not extend along y"):
        made(machine, "lbb", part=flat)


def test_drift_is_read_where_gradients_are_else_in_the_middle(machine: LoadedMachine) -> None:
    """A settled drift is in the unit of its component: of c the gradients are 1 and 3 um/degC."""
    test = replace(TEST, settled={"c": np.array([6.0, 18.0])})
    result = made(machine, "drift", test=test)
    found = result.columns["drift"]
    of = {name: found["position_mm"][found["component"] == name] for name in "bct"}
    assert (set(of["b"]), set(of["c"])) == ({150.0}, {0.0, 200.0})
    assert np.isnan(of["t"]).all()
    assert result.climate is not None
    sensors = result.climate[1]
    assert sensors.shares[sensors.names.index("T_c_degC")] == pytest.approx(1)


def test_parts_take_the_rooms_in_turn(machine: LoadedMachine, part: LoadedPart) -> None:
    """The drift test is there for its sensors alone."""
    result = made(machine, "cmm", part=part, parts=PLAN, rooms=[20.0, 26.0], test=TEST)
    assert list(result.columns) == ["cmm"]
    found = result.columns["cmm"]
    warm = np.array([found["T_b_degC"][found["part"] == str(n)].mean() for n in (1, 2, 3, 4)])
    assert np.abs(warm - [20, 26, 20, 26]).max() < 1
    Ex = found["x_mm"] - np.tile([10.0, 150, 80], 4)
    without = made(machine, "cmm", part=part, parts=replace(PLAN, covariates={
        "T_b_degC": parse("20"), "T_c_degC": parse("20")})).columns["cmm"]  # fmt: skip
    drift = 2e-3 + 100 * np.radians(0.5 / 3600)
    assert Ex - (without["x_mm"] - np.tile([10.0, 150, 80], 4)) == pytest.approx(
        drift * (found["T_b_degC"] - 20), abs=1e-12
    )
