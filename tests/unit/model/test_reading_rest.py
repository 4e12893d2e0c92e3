"""Readings less what declared effects say of them, against the effect's equation by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_examples import Segment, loaded, readings

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import Readings
from mtu_cli.model.fit import effects_on_readings, fit_machine, without_effects

MACHINE = """
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


def run() -> Readings:
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
    return loaded(folder, MACHINE.replace("FOUND", component))


def test_what_was_found_in_a_component_goes_from_its_readings_alone(tmp_path: Path) -> None:
    given = run()
    left, warned = without_effects(declared(tmp_path, "px"), given)
    warm = given.covariates["T_x_degC"].astype(float) - 20
    said = np.where(given.code == 0, GROWTH * given.position_mm * warm, 0.0)
    np.testing.assert_allclose(left.error, given.error - said, atol=1e-15)
    assert not warned
    # And so it is fitted: by the line of what is left.
    fit = fit_machine(declared(tmp_path, "px"), given)
    line = np.polynomial.polynomial.polyfit(given.position_mm[:45], left.error[:45], 1)
    found = fit.components["px"].estimate.coefficients
    assert np.asarray(found)[1] == pytest.approx(line[1], rel=0.05)
    assert fit.warnings == ()


def test_readings_that_lack_the_column_are_left_and_told(tmp_path: Path) -> None:
    given = replace(run(), covariates={})
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
