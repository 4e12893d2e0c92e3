"""The places where a machine is judged: features of a part, or a grid over its volume."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import Finding, InputError, error, finding
from mtu_cli.model.machine_model import (
    AXES,
    MachineModel,
    coordinates_of,
    of_feature,
    without_coordinate,
)
from mtu_cli.model.prediction import Prediction
from mtu_cli.stats.least_squares import FloatArray

FEW_DOF = 3.0
BELOW_THREE = "fewer than 3 effective ones"
NO_U = "a source with two or fewer, so that no standard uncertainty exists"


def feature_points(
    part: LoadedPart, model: MachineModel, chosen: Iterable[str] | None = None
) -> tuple[tuple[str, ...], FloatArray, list[Finding]]:
    """Ids, nominal coordinates (n, 3) in mm (nan: not given) and warnings.

    A coordinate that a constant of the machine fixes (its effective z) is the machine's.

    Raises InputError for features without a coordinate that an equation needs.
    """
    places = part.part.places()
    ids = tuple(places) if chosen is None else tuple(dict.fromkeys(chosen))
    points = np.array(
        [[np.nan if value is None else value for value in places[i]] for i in ids],
        dtype=np.float64,
    ).reshape(len(ids), 3)
    found = without_coordinate(model, points)
    if found is not None:
        lacking, problem = found
        name = ids[lacking[0]]
        place = {"file": part.source.shown, "line": part.line_of("features", name)}
        place |= {"path": f"features.{name}"}
        raise InputError(of_feature(problem, name, len(lacking) - 1, **place))
    warnings: list[Finding] = []
    for axis, value in model.position_constants().items():
        column = points[:, AXES.index(axis)]
        if (np.isfinite(column) & (np.abs(column - value) > 1e-9)).any():
            reason = f"the machine fixes {axis} at {value:g} mm; nominal lengths have it"
            facts = {"what": f"the part's {axis}", "names": [f"{axis}_mm"], "reason": reason}
            warnings.append(finding("not-used", **facts))
    return ids, points, warnings


def outside_warnings(prediction: Prediction) -> list[Finding]:
    """One warning for all components whose measured range the features leave alike."""
    by_component: dict[tuple[str, float, float], list[tuple[str, float]]] = {}
    for point, component, position, low, high in prediction.outside:
        by_component.setdefault((component, low, high), []).append((point, position))
    alike: dict[tuple[float, float, tuple[str, ...]], list[str]] = {}
    for (component, low, high), found in by_component.items():
        alike.setdefault((low, high, tuple(point for point, _ in found)), []).append(component)
    warnings = []
    for (low, high, points), names in alike.items():
        others = f" (and {len(points) - 1} more)" if len(points) > 1 else ""
        at = by_component[names[0], low, high][0][1]
        what = f"feature {points[0]!r} at {at:g} mm{others}"
        facts = {"low": low, "high": high, "unit": "mm"}
        warnings.append(finding("outside-measured-range", what=what, names=names, **facts))
    return warnings


def dof_warnings(what: Sequence[str], dof: FloatArray) -> list[Finding]:
    """Fewer than three effective degrees of freedom: Student's t has no variance there."""
    few = [name for name, value in zip(what, dof, strict=True) if value < FEW_DOF]
    return [finding("few-degrees-of-freedom", names=few, how=BELOW_THREE)] if few else []


MOST_PLACES = 3000
"""The covariance of all places is calculated: its side is this times the axes."""


def grid_of(
    machine: LoadedMachine, model: MachineModel, text: str
) -> tuple[tuple[str, ...], FloatArray]:
    """Ids and coordinates (n, 3) in mm of a grid over the travels that the machine file states.

    `text` is a count an axis, such as 5 or 7,5,3; an axis that a constant fixes, or that no
    equation and component needs, has one place (nan where nothing fixes it).

    Raises InputError for a count that is none, or an axis without travel.
    """
    counts = _counts(text)
    fixed = model.position_constants()
    needed = _needed(model)
    travels = machine.machine.travels
    levels: list[FloatArray] = []
    problems = []
    for axis, count in zip(AXES, counts, strict=True):
        if axis in fixed:
            levels.append(np.array([fixed[axis]]))
        elif axis not in needed:
            levels.append(np.array([np.nan]))
        elif axis not in travels:
            problems.append(
                finding(
                    "missing-key",
                    key=f"{axis}.travel_mm",
                    file=machine.source.shown,
                    line=machine.line_of("axes"),
                    path="axes",
                    expected=f"axes: {{{axis}: {{travel_mm: [LOW, HIGH]}}}}",
                )
            )
        else:
            low, high = travels[axis]
            middle = [(low + high) / 2]
            levels.append(np.array(middle) if count == 1 else np.linspace(low, high, count))
    if problems:
        raise InputError(problems)
    count = int(np.prod([len(level) for level in levels]))
    if count > MOST_PLACES:
        expected = f"at most {MOST_PLACES} places, not {count}"
        raise error("out-of-range", path="--grid", value=text, expected=expected)
    points = np.array(list(product(*levels)))
    names = tuple(",".join(f"{value:g}" for value in row if np.isfinite(value)) for row in points)
    return names, points


def grid_warnings(machine: LoadedMachine, model: MachineModel, text: str) -> list[Finding]:
    """Of axes that have another count of places than `text` asks for, or one place because it
    gives none.
    """
    given = text.split(",")
    if len(given) == 1:
        return []
    counts, fixed, needed = _counts(text), model.position_constants(), _needed(model)
    many = [axis for axis, count in zip(AXES, counts, strict=True) if count > 1]
    unused = [axis for axis in many if axis not in fixed and axis not in needed]
    found = []
    if unused:
        enter, have = ("enters", "has") if len(unused) == 1 else ("enter", "have")
        found.append(f"{' and '.join(unused)} {enter} no equation and {have} no places in the grid")
    found += [
        f"{axis} has one place, {fixed[axis]:g} mm, at which a constant of the machine fixes it"
        for axis in many
        if axis in fixed
    ]
    travel = machine.machine.travels.get("z")
    if len(given) == 2 and "z" in needed and "z" not in fixed and travel is not None:
        found.append(
            f"z has one place, the middle of its travel, {sum(travel) / 2:g} mm: --grid "
            f"{text.strip()},N gives it N"
        )
    return [finding("grid-of-fewer-axes", grid=text, reason=reason) for reason in found]


def _counts(text: str) -> tuple[int, int, int]:
    try:
        counts = [int(part) for part in text.split(",")]
    except ValueError:
        counts = []
    if len(counts) == 1:
        counts *= 3
    if len(counts) == 2:
        counts.append(1)
    if len(counts) != 3 or min(counts) < 1:
        form, expected = "a count an axis", "5 or 7,5,3, say"
        raise error("wrong-type", path="--grid", kind=form, value=text, expected=expected)
    if max(counts) > MOST_PLACES:
        expected = f"at most {MOST_PLACES} places in all"
        raise error("out-of-range", path="--grid", value=text, expected=expected)
    return counts[0], counts[1], counts[2]


def _needed(model: MachineModel) -> set[str]:
    """Axes that a component or a lever arm depends on."""
    return {name for axis in model.axes for name in coordinates_of(model, axis)}
