"""Errors along one axis that a machine file states: components, and effects that were found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.findings import error, suggestion
from mtu_cli.model.estimates import known_component
from mtu_cli.model.machine_model import AXES, component_alone, coordinates_of, design, effect_alone
from mtu_cli.model.prediction import component_blocks
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import LENGTH, UNITS

POINTS = 11
"""Positions over the travel, where there is no table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """A component or an effect of a machine file that is an error along one `axis`, in the
    direction of the axis `output` (y of a straightness of x in y); `at_mm` of a table.
    """

    name: str
    axis: str
    output: str
    angle: bool = False
    at_mm: FloatArray | None = None

    def default_positions(self, machine: LoadedMachine) -> FloatArray:
        """The positions of its table, or equal steps over the travel of its axis."""
        if self.at_mm is not None:
            return self.at_mm
        if self.axis not in machine.machine.travels:
            expected = "axes: in the machine file, or --from, --to, --step"
            raise error("missing-input", what=f"the travel of {self.axis}", expected=expected)
        return np.linspace(*machine.machine.travels[self.axis], POINTS)

    def errors_at(
        self, machine: LoadedMachine, positions: FloatArray
    ) -> tuple[FloatArray, FloatArray, bool]:
        """Its errors (2, n) by the machine file, forward and reverse at `positions` (n,) mm, in mm
        or rad, their covariance (2n, 2n), and whether the directions differ.

        Raises InputError for a component without coefficients.
        """
        entry = machine.machine.components.get(self.name)
        if entry is None:
            model = effect_alone(
                machine, [x.name for x in machine.machine.effects].index(self.name)
            )
        elif entry.coefficients is None:
            expected = "readings of it, or coefficients in the machine file"
            raise error("missing-input", what=f"an estimate of {self.name}", expected=expected)
        else:
            model = component_alone(self.name, self.axis, known_component(self.name, entry))
        way, points = f"dir_{self.axis}", np.full((2 * len(positions), 3), np.nan)
        points[:, AXES.index(self.axis)] = np.tile(positions, 2)
        rows = design(model, points, {way: np.repeat([1.0, -1.0], len(positions))})
        blocks = component_blocks(model, rows.J, rows.levers)
        covariance = np.sum([block.G @ block.C @ block.G.T for block in blocks], axis=0)
        return rows.mean.reshape(2, -1), covariance, way in model.covariates()


def known_names(machine: LoadedMachine) -> list[str]:
    """What a table may be made of: components and effects."""
    return [*machine.machine.components, *(each.name for each in machine.machine.effects)]


def stated(machine: LoadedMachine, name: str) -> Stated:
    """The component or effect of this name; raises InputError for none along one axis."""
    names_known = known_names(machine)
    if name not in names_known:
        near = suggestion(name, names_known)
        raise error("unknown-name", path="--component", what="component", value=name, **near)
    axis, angle, component = "", False, machine.machine.components.get(name)
    if component is not None:
        if component.of is None:
            raise error("not-applicable", reason=f"{name} is a constant: no table of an axis")
        angle, axis, at = UNITS[component.unit].dimension != LENGTH, component.of, component.at_mm
        equations = [key for key, form in machine.forms.items() if name in form.coefficients]
    else:
        i = names_known.index(name) - len(machine.machine.components)
        model, components = effect_alone(machine, i), machine.machine.effects[i].components
        used = {*model.covariates(), *(x for k in model.axes for x in coordinates_of(model, k))}
        axes = {x.removeprefix("dir_") for x in used} & {*AXES}
        rest = used - {*axes, *(f"dir_{x}" for x in axes)}
        if len(model.axes) > 1 or len(axes) != 1 or rest or any(model.remainders.values()):
            depends = ", ".join(sorted(rest | axes)) or "several axes"
            reason = f"the effect {name} depends on {depends}: no table of one axis holds it"
            raise error("not-applicable", reason=reason)
        axis, equations = axes.pop(), [f"E{model.axes[0]}"]
        at = next((x.at_mm for x in components.values() if x.at_mm), None)
    return Stated(
        name=name,
        axis=axis,
        output=equations[0][1:] if len(equations) == 1 else axis,
        angle=angle,
        at_mm=None if at is None else np.array(at, float),
    )
