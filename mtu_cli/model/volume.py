"""Places all over a machine's volume, for maps of its error and uncertainty."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.findings import Finding, InputError, error, finding
from mtu_cli.language import names
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from mtu_cli.files.machine import LoadedMachine

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
            problems.append(_no_travel(machine, axis))
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


def _no_travel(machine: LoadedMachine, axis: str) -> Finding:
    return finding(
        "missing-key",
        key=f"{axis}.travel_mm",
        file=machine.source.shown,
        line=machine.line_of("axes"),
        path="axes",
        expected=f"axes: {{{axis}: {{travel_mm: [LOW, HIGH]}}}}",
    )


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
    found: set[str] = set()
    for term in model.terms:
        found |= {term.estimate.of} if term.estimate.of else set()
        for lever in term.levers.values():
            found |= set(names(lever))
    for nodes in model.remainders.values():
        for node in nodes:
            found |= set(names(node))
    return found & set(AXES)
