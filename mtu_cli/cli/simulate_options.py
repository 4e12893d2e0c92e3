"""Positions, places and equations of `mtu simulate`, as options give them."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.option_values import no_number
from mtu_cli.cli.options import Options
from mtu_cli.files.covariates import (
    PLACE,
    as_temperature,
    column_dimensions,
    looks_like_temperature,
    own_columns,
)
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.findings import InputError, error, suggestion
from mtu_cli.language import Node, check_dimension, names, parse
from mtu_cli.model.effect_parameters import EFFECT_MARK
from mtu_cli.model.features import feature_points
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray

DEFAULT_POSITIONS = 8
MAX_POSITIONS = 10_000


def read_positions(inputs: Inputs, model: MachineModel) -> dict[str, FloatArray]:
    """Positions (n,) in mm by axis: of --positions, else over the part's extent."""
    read = [term.estimate for term in model.terms if EFFECT_MARK not in term.estimate.name]
    needed = {estimate.of for estimate in read if estimate.of is not None}
    text = inputs.options.positions
    given = {} if text is None else _given(text)
    _check_travel(inputs, {axis: given.get(axis, given.get("")) for axis in needed})
    if "" in given:
        return dict.fromkeys(needed, given[""])
    unknown = [axis for axis in given if axis not in AXES]
    if unknown:
        raise error(
            "unknown-name",
            path="--positions",
            what="axis",
            value=unknown[0],
            expected="x, y or z",
        )
    rest = needed - set(given)
    return given | (_extents(inputs, model, rest) if rest else {})


def _check_travel(inputs: Inputs, asked: Mapping[str, FloatArray | None]) -> None:
    """Refuses positions that an axis cannot reach."""
    travels = inputs.machine.machine.travels
    for axis, positions in sorted(asked.items()):
        if positions is None or axis not in travels:
            continue
        low, high = travels[axis]
        if positions.min() < low or positions.max() > high:
            raise error(
                "outside-travel",
                path="--positions",
                axis=axis,
                value=f"{positions.min():g} to {positions.max():g} mm",
                expected=f"from {low:g} to {high:g} mm",
            )


def _extents(inputs: Inputs, model: MachineModel, axes: set[str]) -> dict[str, FloatArray]:
    _, points, _ = feature_points(inputs.part, model)
    found: dict[str, FloatArray] = {}
    for axis in axes:
        column = points[:, AXES.index(axis)]
        low, high = np.nanmin(column), np.nanmax(column)
        if not np.isfinite(low) or low == high:
            raise error("no-extent", axis=axis, expected="--positions LOW:HIGH:COUNT")
        found[axis] = np.linspace(low, high, DEFAULT_POSITIONS)
    return found


def _given(text: str) -> dict[str, FloatArray]:
    """LOW:HIGH:COUNT for all axes (under ""), or AXIS=LOW:HIGH:COUNT, ... for some."""
    if "=" not in text:
        return {"": _range(text, text)}
    parts = (item.partition("=") for item in text.split(","))
    return {axis.strip(): _range(values, text) for axis, _, values in parts}


def _range(part: str, text: str) -> FloatArray:
    ends = part.split(":")
    if len(ends) != 3 or not all(end.strip() for end in ends):
        raise error(
            "option-form",
            path="--positions",
            form="LOW:HIGH:COUNT",
            value=text,
            expected="0:140:8, say, or x=0:140:8,y=0:90:5",
        )
    for place, end in enumerate(ends):
        if bad := no_number("--positions", end, whole=place == 2):
            raise InputError(bad)
    low, high, count = float(ends[0]), float(ends[1]), int(ends[2])
    if low >= high:
        raise error("out-of-range", path="--positions", value=text, expected="LOW below HIGH")
    if not 2 <= count <= MAX_POSITIONS:
        expected = f"a COUNT from 2 to {MAX_POSITIONS}"
        raise error("out-of-range", path="--positions", value=text, expected=expected)
    return np.linspace(low, high, count)


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


_NAMED = re.compile(r"\s*([A-Za-z_][A-Za-z_0-9]*)\s*:(.*)", re.DOTALL)

EXAMPLES = {False: "'Ex: 0.004*dir_x'", True: "'T_spindle_degC: 20 + 2*(sequence - 1)'"}
"""Of an error and of a column."""


def named_equation(option: str, text: str, *, column: bool = False) -> tuple[str, Node]:
    """Name and equation of an error in mm, or of a `column` in the unit that its name tells.

    The numbers of an equation may have units: ``0.004*dir_x`` are mm. Without a number in it a
    term must be what the equation is, as in a machine file.

    Raises InputError for what is no such text, for a column that looks like a sensor's and is
    none, and for terms of another dimension.
    """
    match = _NAMED.fullmatch(text)
    if match is None:
        raise error(
            "option-form",
            path=option,
            form="NAME: EQUATION",
            value=text,
            expected=EXAMPLES[column],
        )
    name = match[1]
    if column and looks_like_temperature(name):
        # What reads the points would refuse the column.
        meant = as_temperature(name) or "T_<sensor>_degC"
        raise error("not-a-temperature", path=option, value=name, expected=meant)
    try:
        # Blanks for the name: columns count from the start of the option's text.
        tree = parse(" " * match.start(2) + match[2])
        wanted = column_dimensions(name) if column else PLACE
        check_dimension(tree, wanted, own_columns(names(tree), ()), free=True)
    except InputError as fault:
        raise InputError(
            each.at(path=f"{option} {name}", value=text) for each in fault.findings
        ) from None
    return name, tree
