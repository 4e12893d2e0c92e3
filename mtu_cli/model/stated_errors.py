"""Errors along one axis that a machine file states: components, and effects that were found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.findings import error, suggestion
from mtu_cli.language import names
from mtu_cli.model.estimates import known_component
from mtu_cli.model.machine_model import AXES, component_alone, design, effect_alone, theta
from mtu_cli.model.variance import component_blocks
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import LENGTH, UNITS

POINTS = 11
"""Over the travel, of what is no table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedErrors:
    """Errors (2, n) forward and reverse at n positions along `axis`, mm or rad, and their
    covariance (2n, 2n); `turns`: the directions differ.
    """

    axis: str
    values: FloatArray
    covariance: FloatArray
    turns: bool
    angle: bool


def known_names(machine: LoadedMachine) -> list[str]:
    """What a table may be made of: components and effects."""
    return [*machine.machine.components, *(each.name for each in machine.machine.effects)]


def axis_of(machine: LoadedMachine, name: str) -> str:
    """The axis along which a component or an effect is an error; raises InputError for none."""
    component = machine.machine.components.get(name)
    if component is not None:
        if component.of is None:
            raise error("not-applicable", reason=f"{name} is a constant: no table of an axis")
        return str(component.of)
    place = [each.name for each in machine.machine.effects]
    if name not in place:
        near = suggestion(name, known_names(machine))
        raise error("unknown-name", path="--component", what="component", value=name, **near)
    form, effect = (
        machine.effect_forms[place.index(name)],
        machine.machine.effects[place.index(name)],
    )
    used = {
        x for each in form.values() for lever in each.coefficients.values() for x in names(lever)
    }
    used |= {x.of for x in effect.components.values() if x.of}
    (equation, *others) = form
    axes = {x.removeprefix("dir_") for x in used} & {"x", "y", "z"}
    left = used - {*axes, *(f"dir_{x}" for x in axes), *machine.machine.constants}
    if others or len(axes) != 1 or left or form[equation].remainder is not None:
        depends = ", ".join(sorted(left | (axes if len(axes) != 1 else set()))) or "several axes"
        reason = f"the effect {name} depends on {depends}: no table of one axis holds it"
        raise error("not-applicable", reason=reason)
    return axes.pop()


def output_of(machine: LoadedMachine, name: str, axis: str) -> str:
    """The axis whose error it is: `axis` itself where its equation holds it, else the only other
    one (y of a straightness of x in y).
    """
    place = {each.name: i for i, each in enumerate(machine.machine.effects)}
    if name in place:
        result = [equation[1:] for equation in machine.effect_forms[place[name]]]
    else:
        result = [key[1:] for key, form in machine.forms.items() if name in form.coefficients]
    return result[0] if len(result) == 1 else axis


def default_positions(machine: LoadedMachine, name: str, axis: str) -> FloatArray:
    """The positions of its table, or equal steps over the travel of its axis."""
    component = machine.machine.components.get(name)
    effects = [each for each in machine.machine.effects if each.name == name]
    tables = [component] if component else [x for e in effects for x in e.components.values()]
    for table in tables:
        if table is not None and table.at_mm:
            return np.array(table.at_mm, float)
    if axis not in machine.machine.travels:
        what, expected = (
            f"the travel of {axis}",
            "axes: in the machine file, or --from, --to, --step",
        )
        raise error("missing-input", what=what, expected=expected)
    return np.linspace(*machine.machine.travels[axis], POINTS)


def stated_errors(machine: LoadedMachine, name: str, positions: FloatArray) -> StatedErrors:
    """What the machine file says of a component or an effect at `positions` (n,), mm.

    Raises InputError for one without coefficients, or that depends on more than one axis.
    """
    axis, entry = axis_of(machine, name), machine.machine.components.get(name)
    if entry is None:
        model = effect_alone(machine, [x.name for x in machine.machine.effects].index(name))
    elif entry.coefficients is None:
        expected = "readings of it, or coefficients in the machine file"
        raise error("missing-input", what=f"an estimate of {name}", expected=expected)
    else:
        model = component_alone(name, axis, known_component(name, entry))
    way, points = f"dir_{axis}", np.full((2 * len(positions), 3), np.nan)
    points[:, AXES.index(axis)] = np.tile(positions, 2)
    rows = design(model, points, {way: np.repeat([1.0, -1.0], len(positions))})
    blocks = component_blocks(model, rows.J, rows.levers, rows.columns)
    return StatedErrors(
        axis=axis,
        values=(rows.J @ theta(model)).reshape(2, -1),
        covariance=np.sum([block.G @ block.C @ block.G.T for block in blocks], axis=0),
        turns=way in model.covariates(),
        angle=entry is not None and UNITS[entry.unit].dimension != LENGTH,
    )
