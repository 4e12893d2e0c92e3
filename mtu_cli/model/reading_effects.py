"""What the effects of a machine, found in a component's readings, say of its readings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.findings import Finding, finding
from mtu_cli.language import evaluate, names
from mtu_cli.language.linear import LinearForm
from mtu_cli.model.effect_parameters import declared_effects
from mtu_cli.model.effect_ranges import outside_seen
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS

if TYPE_CHECKING:
    from mtu_cli.files.machine import LoadedMachine

ELSEWHERE = 1.0
"""mm along axes that readings tell no position of: effect and lever arm have the same factor."""


def effects_on_readings(
    machine: LoadedMachine, component: str, places: FloatArray, columns: Mapping[str, np.ndarray]
) -> tuple[FloatArray, list[Finding]]:
    """The sum (n,) of the declared effects that were found in the readings of `component`, in
    its own unit, at `places` (n, 3) mm with the readings' `columns` (n,).

    An effect f of a component c stands in the machine's equations as L f, L = dE/dc its lever
    arm: f = (L f) / L. An effect whose covariate the readings lack is left out, with a warning.
    """
    total = np.zeros(len(places))
    warned = []
    own_columns = _numeric(columns) | {axis: places[:, i] for i, axis in enumerate(AXES)}
    for effect, form, declared in zip(
        machine.machine.effects, machine.effect_forms, declared_effects(machine), strict=True
    ):
        if effect.found.get("component") != component:
            continue
        values = _values(machine, places, columns)
        values |= {
            name: p.value * PARAMETER_UNITS[p.unit].to_internal
            for name, p in effect.parameters.items()
        }
        pair = _equation(machine, form, component)
        missing = [] if pair is None else sorted(_needed(pair) - set(values))
        if pair is None or missing:
            warned.append(_left_out(effect.name, component, missing))
            continue
        own, lever = pair
        said = np.zeros(len(places))
        for name, node in own.coefficients.items():
            said = said + np.asarray(values[name]) * evaluate(node, values)
        warned += outside_seen([declared], own_columns)
        total += said / evaluate(lever.coefficients[component], values)
    return total, warned


def _values(
    machine: LoadedMachine, places: FloatArray, columns: Mapping[str, np.ndarray]
) -> dict[str, FloatArray | float]:
    found: dict[str, FloatArray | float] = {
        name: item.value for name, item in machine.machine.constants.items()
    }
    for i, axis in enumerate(AXES):
        found.setdefault(axis, np.where(np.isfinite(places[:, i]), places[:, i], ELSEWHERE))
    return found | {n: c for n, c in _numeric(columns).items() if np.isfinite(c).all()}


def _numeric(columns: Mapping[str, np.ndarray]) -> dict[str, FloatArray]:
    return {n: c.astype(np.float64) for n, c in columns.items() if c.dtype != object}


def _equation(
    machine: LoadedMachine, form: Mapping[str, LinearForm], component: str
) -> tuple[LinearForm, LinearForm] | None:
    """An equation of the effect, and the same of the machine, that hold the component."""
    for name, own in form.items():
        lever = machine.forms.get(name)
        if lever is not None and component in lever.coefficients:
            return own, lever
    return None


def _needed(pair: tuple[LinearForm, LinearForm]) -> set[str]:
    own, _ = pair
    return {name for node in own.coefficients.values() for name in names(node)}


def _left_out(effect: str, component: str, missing: list[str]) -> Finding:
    reason = f"they have no column {', '.join(missing)}" if missing else "no equation holds both"
    return finding("effect-not-removed", effect=effect, component=component, reason=reason)
