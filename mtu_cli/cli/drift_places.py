"""Where `mtu simulate` reads the drift of a component, from its options."""

from __future__ import annotations

import numpy as np

from mtu_cli.cli.option_values import no_number
from mtu_cli.cli.options import Options
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.findings import InputError, error, suggestion
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray


def read_at(
    options: Options, machine: LoadedMachine, drifts: tuple[ThermalEstimate, ...]
) -> dict[str, FloatArray]:
    """Where each component's drift is read, as asked for or as its model says."""
    asked = by_component(
        "--drift-positions", options.drift_positions, [drift.component for drift in drifts]
    )
    for drift in drifts:
        if drift.component in asked:
            _check_positions(machine, drift, asked[drift.component])
    return {
        drift.component: asked.get(drift.component, _positions(machine, drift)) for drift in drifts
    }


def _check_positions(machine: LoadedMachine, drift: ThermalEstimate, positions: FloatArray) -> None:
    """Refuses places that an axis cannot reach, and places read twice."""
    shown = f"{drift.component}: {' '.join(f'{position:g}' for position in positions)}"
    if len(np.unique(positions)) < len(positions):
        raise error(
            "appears-twice", what="--drift-positions", value=shown, expected="every position once"
        )
    travel = _travel(machine, drift)
    if travel is None:
        return
    low, high = travel
    outside = positions[(positions < low) | (positions > high)]
    if len(outside):
        raise error(
            "outside-travel",
            path=f"--drift-positions {drift.component}",
            axis=drift.of,
            value=f"{outside[0]:g} mm",
            expected=f"from {low:g} to {high:g} mm",
        )


def _positions(machine: LoadedMachine, drift: ThermalEstimate) -> FloatArray:
    """Where a component is read: the positions of its gradients, else the middle of its axis."""
    entry = machine.machine.components[drift.component]
    if entry.thermal is not None and entry.thermal.positions_mm is not None:
        return np.array(entry.thermal.positions_mm)
    if drift.of is None:
        return np.array([np.nan])
    if drift.position_range is not None:
        return np.linspace(*drift.position_range, drift.degree + 1)
    travel = _travel(machine, drift)
    return np.array([np.mean(travel) if travel else 0.0])


def _travel(machine: LoadedMachine, drift: ThermalEstimate) -> tuple[float, float] | None:
    return None if drift.of is None else machine.machine.travels.get(drift.of)


def by_component(option: str, texts: list[str] | None, names: list[str]) -> dict[str, FloatArray]:
    """'NAME: NUMBERS' of several components, in their own units."""
    found: dict[str, FloatArray] = {}
    for text in texts or ():
        name, colon, numbers = (item.strip() for item in text.partition(":"))
        items = numbers.replace(",", " ").split()
        if not colon or not items:
            example = "'pos_y: 0 75 200'"
            raise error(
                "option-form", path=option, form="NAME: NUMBERS", value=text, expected=example
            )
        if name not in names:
            kind = "component with a thermal model"
            near = suggestion(name, names)
            raise error("unknown-name", path=option, what=kind, value=name, **near)
        if name in found:
            raise error("appears-twice", what=f"{option} {name}", value=text)
        for item in items:
            if bad := no_number(f"{option} {name}", item):
                raise InputError(bad)
        found[name] = np.array(list(map(float, items)))
    return found
