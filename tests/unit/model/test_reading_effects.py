"""Effects of a machine that were found in readings, taken off the readings again."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mtu_cli.files.machine import LoadedMachine, load_machine
from mtu_cli.model.fit import effects_on_readings

MACHINE = """\
schema: mtu/machine/1
name: two components
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
PLACES = np.column_stack([np.array([0.0, 100.0, 300.0]), *[np.full(3, np.nan)] * 2])
DIRECTION = np.array([1.0, -1.0, 1.0])


def machine(tmp_path: Path) -> LoadedMachine:
    path = tmp_path / "machine.yaml"
    path.write_text(MACHINE)
    return load_machine(path)


def test_an_effect_is_divided_by_the_lever_arm_of_its_component(tmp_path: Path) -> None:
    own = machine(tmp_path)
    total, warned = effects_on_readings(own, "dx", PLACES, {"dir_x": DIRECTION})
    np.testing.assert_allclose(total, 4e-3 * DIRECTION, rtol=1e-12)
    assert not warned
    total, _ = effects_on_readings(own, "ez", PLACES, {})
    # y, which the readings do not tell, falls out.
    rate = 2 * np.pi / 648_000 / 1000
    np.testing.assert_allclose(total, rate * (PLACES[:, 0] - 100), rtol=1e-12)
