"""Where `mtu simulate` reads the components."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.option_values import no_number
from mtu_cli.findings import InputError, error
from mtu_cli.model.effect_parameters import EFFECT_MARK
from mtu_cli.model.features import feature_points
from mtu_cli.model.machine_model import AXES, MachineModel
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
