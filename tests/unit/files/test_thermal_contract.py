"""Known drifts in machine files: what is accepted, and every fault with its line and path."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.files.machine import Thermal, load_machine
from mtu_cli.findings import InputError

HEAD = "schema: mtu/machine/1\nname: m\nequations: {Ex: a}\ncomponents:\n"


def load(tmp_path: Path, component: str) -> Thermal:
    path = tmp_path / "m.yaml"
    path.write_text(f"{HEAD}  a: {component}\n")
    found = load_machine(path).machine.components["a"].thermal
    assert found is not None
    return found


def test_drifts_through_positions_and_the_same_everywhere(tmp_path: Path) -> None:
    """A lower degree, and noise of all sensors or by name."""
    placed = "{of: x, unit: um, thermal: {positions_mm: [300, 0, 75], gradients: "
    placed += "{T_01_degC: [-3.5, 0, 4], T_b_degC: [1, 2, 3]}, "
    more = "time_constants_min: {T_b_degC: 40}, s_leftover: 0.3, sensor_u_degC: 0.015}}"
    found = load(tmp_path, placed + more)
    assert (found.positions_mm, found.degree) == ([300, 0, 75], 2)
    assert found.gradients["T_01_degC"] == [-3.5, 0, 4]
    assert (found.time_constants_min, found.s_leftover) == ({"T_b_degC": 40}, 0.3)
    assert found.sensor_u_degC == {"T_01_degC": 0.015, "T_b_degC": 0.015}
    found = load(tmp_path, placed + "degree: 1, sensor_u_degC: {T_b_degC: 0.1}}}")
    assert (found.degree, found.sensor_u_degC) == (1, {"T_b_degC": 0.1})
    for of in ("of: x, ", ""):
        found = load(tmp_path, f"{{{of}unit: um, thermal: {{gradients: {{T_a_degC: 2}}}}}}")
        assert (found.positions_mm, found.degree) == (None, 0)
        assert found.gradients == {"T_a_degC": [2]}
        assert (found.time_constants_min, found.s_leftover, found.sensor_u_degC) == ({}, 0, {})


PLACED = "of: x, unit: um, thermal: {positions_mm: [0, 75], gradients: {T_a_degC: [1, 2]}"
PLAIN = "unit: um, thermal: {gradients: {T_a_degC: 1}"
FAULTS = [
    (
        PLAIN + ", degree: 1}",
        "thermal.degree: too little data: 1 position: '1'; expected at most 0",
    ),
    (PLACED + ", degree: 2}", "too little data: 2 positions: '2'; expected at most 1"),
    (
        "of: x, unit: um, thermal: {positions_mm: [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10], "
        "gradients: {T_a_degC: [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10]}}",
        "thermal.degree: wrong value: '10'; expected a number of at most 9",
    ),
    (
        "unit: um, thermal: {positions_mm: [0], gradients: {T_a_degC: 1}}",
        "thermal.positions_mm: positions of a component without `of`",
    ),
    (
        "of: x, unit: um, thermal: {positions_mm: [0.0, 5, -0.0], gradients: {T_a_degC: "
        "[1, 2, 3]}}",
        "thermal.positions_mm[2]: the position appears twice: '0'",
    ),
    (
        "of: x, unit: um, thermal: {positions_mm: [0, 75], gradients: {T_a_degC: 1}}",
        "thermal.gradients.T_a_degC: 1 gradient at 2 positions; expected one a position",
    ),
    (
        "unit: um, thermal: {gradients: {T_a_degC: [1, 2]}}",
        "thermal.gradients.T_a_degC: 2 gradients at 1 position; expected one a position",
    ),
    (
        "unit: um, thermal: {gradients: {spindle: 1}}",
        "thermal.gradients.spindle: not the name of a temperature: 'spindle'; expected "
        "T_<sensor>_degC",
    ),
    (
        "unit: um, thermal: {gradients: {T_a-b_degC: 1}}",
        "not the name of a temperature: 'T_a-b_degC'; expected T_<sensor>_degC",
    ),
    (
        PLAIN + ", time_constants_min: {T_a_degc: 3}}",
        "thermal.time_constants_min.T_a_degc: unknown sensor: 'T_a_degc'; did you mean 'T_a_degC'?",
    ),
    (
        PLAIN + ", sensor_u_degC: {T_b_degC: 1}}",
        "thermal.sensor_u_degC.T_b_degC: unknown sensor: 'T_b_degC'; did you mean",
    ),
]


@pytest.mark.parametrize(("component", "words"), FAULTS, ids=[words for _, words in FAULTS])
def test_a_faulty_drift(tmp_path: Path, component: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, f"{{{component}}}")
    (problem,) = caught.value.findings
    assert str(problem).startswith("m.yaml:5: components.a.thermal")
    assert words in str(problem)
