"""Readings for a fit: columns, layout, what effects and drifts take off them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding, finding
from mtu_cli.language import Node, evaluate, names
from mtu_cli.language.linear import LinearForm
from mtu_cli.model.effect_parameters import declared_effects
from mtu_cli.model.effect_ranges import outside_seen
from mtu_cli.model.machine_model import AXES, TIME
from mtu_cli.model.passes import Passes, passes_of
from mtu_cli.model.visits import Cells, IntArray, cells_of
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS


def reading_columns(
    readings: Readings, rows: IntArray, layout: ReadingLayout, of: str | None
) -> dict[str, np.ndarray]:
    """Columns (n,) of the readings `rows` of a component that is a function of the axis `of`;
    `sequence` counts passes.
    """
    found: dict[str, np.ndarray] = {"sequence": layout.cells.part + 1.0}
    sign = readings.direction[rows].astype(np.float64)
    if of is not None and sign.any():
        found[f"dir_{of}"] = np.where(sign == 0, np.nan, sign)
    times = readings.time_min[rows]
    if not np.isnan(times).all():
        found[TIME] = times
    for name, column in readings.covariates.items():
        own = column[rows]
        if own.dtype == object or not np.isnan(own).all():
            found.setdefault(name, own)
    return found


def reading_places(readings: Readings, rows: IntArray, of: str | None) -> FloatArray:
    """Places (n, 3) mm: the positions along the axis, nan beside it."""
    places = np.full((len(rows), 3), np.nan)
    if of is not None:
        places[:, AXES.index(of)] = readings.position_mm[rows]
    return places


SAME = 1e-4
"""Positions within this share of the travel are one target, recorded as it was reached."""
SIGNS = {1: "+", -1: "-", 0: ""}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingLayout:
    """`passes` in order of time, `columns` named by target and direction, whose sign is
    `direction` (H,). `pairs` are those of the passes that are two, one there and one back.
    """

    passes: tuple[str, ...]
    pairs: tuple[str, ...]
    columns: tuple[str, ...]
    direction: IntArray
    cells: Cells


def reading_layout(readings: Readings, rows: IntArray, of: str | None, name: str) -> ReadingLayout:
    """The readings `rows` (n,) of the component `name`, a function of the axis `of`.

    A pass is one number of one file, in one direction where it is not a run there and back.
    Without an axis every reading without a number is a pass of its own; with one they are
    repeats of pass 0.
    """
    sign = np.zeros(len(rows), np.int64) if of is None else readings.direction[rows].astype(int)
    has = readings.has_pass[rows]
    numbers = np.where(has, readings.pass_number[rows], 0)
    if of is None and not has.all():
        numbers = np.arange(1, len(rows) + 1)
    group, passes = passes_of(readings, rows, numbers, sign)
    target, labels = _targets(readings, rows, of, name)
    # Forward first, as the passes of a fit are.
    columns, column = np.unique(target * 3 + (1 - sign), return_inverse=True)
    signs = 1 - columns % 3
    several = len(np.unique(signs)) > 1
    names = _row_names(readings, passes)
    # Runs, in their order, that two numbers of passes are of.
    numbered = {(int(run), key[:2]) for run, key in zip(passes.runs, passes.keys, strict=True)}
    of_two = [a for (a, _), (b, _) in pairwise(sorted(numbered)) if a == b]
    return ReadingLayout(
        passes=names,
        pairs=tuple(names[run] for run in of_two),
        columns=tuple(
            f"{labels[k // 3]} {SIGNS[int(sign)]}".rstrip() if several else labels[k // 3]
            for k, sign in zip(columns.tolist(), signs, strict=True)
        ),
        direction=signs,
        cells=cells_of(passes.runs[group], column.reshape(-1), len(names), len(columns)),
    )


def _row_names(readings: Readings, passes: Passes) -> tuple[str, ...]:
    """The passes of each run by their numbers, in their order; with their file where two files
    have the same, and their direction where that alone tells two runs apart.
    """
    numbered = list(dict.fromkeys(key[:2] for key in passes.keys))
    twice = len({number for _, number in numbered}) < len(numbered)
    shown = {
        key: f"{readings.sources[key[0]].shown} {key[1]}" if twice else str(key[1])
        for key in numbered
    }
    found: list[dict[str, None]] = [{} for _ in range(int(passes.runs.max(initial=-1)) + 1)]
    ways: list[int] = [0] * len(found)
    for g in np.argsort(passes.order).tolist():
        run, key = passes.runs[g], passes.keys[g]
        found[run][shown[key[:2]]] = None
        ways[run] = key[2]
    names = ["/".join(own) for own in found]
    if len(set(names)) < len(names):
        names = [f"{name} {SIGNS[way]}".rstrip() for name, way in zip(names, ways, strict=True)]
    return tuple(names)


def _targets(
    readings: Readings, rows: IntArray, of: str | None, name: str
) -> tuple[IntArray, list[str]]:
    """The target of each reading, ascending, and the targets' names."""
    if of is None:
        return np.zeros(len(rows), np.int64), [name]
    position = readings.position_mm[rows]
    distinct, code = np.unique(position, return_inverse=True)
    group = _groups(distinct)
    target = group[code.reshape(-1)]
    count = np.bincount(target)
    means = np.bincount(target, position) / count
    labels = _labels(means)
    return target, labels


def _groups(distinct: FloatArray) -> IntArray:
    """The target of each distinct position; each its own where targets would run together."""
    alone = np.arange(len(distinct))
    near = SAME * float(np.ptp(distinct)) if len(distinct) else 0.0
    group = np.cumsum(np.r_[0, np.diff(distinct) > near])
    first = np.searchsorted(group, np.arange(group[-1] + 1))
    last = np.r_[first[1:], len(distinct)] - 1
    return group if (distinct[last] - distinct[first] <= 3 * near).all() else alone


def _labels(means: FloatArray) -> list[str]:
    """Positions with as many digits as tell them apart."""
    for digits in (6, 9, 12, 17):
        found = [f"{value:.{digits}g}" for value in means]
        if len(set(found)) == len(found):
            break
    return found


def without_effects(
    machine: LoadedMachine, readings: Readings
) -> tuple[Readings, tuple[Finding, ...]]:
    """What is left for the components: an effect that was found in readings of one is in its
    readings still, and would be counted again, as its coefficients or its scatter from pass to
    pass. Warns of effects whose columns the readings lack.
    """
    own = {effect.found.get("component") for effect in machine.machine.effects}
    if not own & set(readings.components):
        return readings, ()
    error = readings.error.copy()
    warned: list[Finding] = []
    for code, name in enumerate(readings.components):
        rows = np.flatnonzero(readings.code == code)
        if name not in own or not len(rows):
            continue
        of = machine.machine.components[name].of
        layout = reading_layout(readings, rows, of, name)
        columns = reading_columns(readings, rows, layout, of)
        places = reading_places(readings, rows, of)
        said, told = effects_on_readings(machine, name, places, columns)
        error[rows] -= said
        warned += told
    return replace(readings, error=error), tuple(warned)


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
    warned: list[Finding] = []
    numeric = {n: c.astype(np.float64) for n, c in columns.items() if c.dtype != object}
    own_columns = numeric | {axis: places[:, i] for i, axis in enumerate(AXES)}
    here = {axis: np.nan_to_num(places[:, i], nan=ELSEWHERE) for i, axis in enumerate(AXES)}
    known: dict[str, FloatArray | float] = {
        **here,
        **{name: item.value for name, item in machine.machine.constants.items()},
        **{name: column for name, column in numeric.items() if np.isfinite(column).all()},
    }
    for effect, form, declared in zip(
        machine.machine.effects, machine.effect_forms, declared_effects(machine), strict=True
    ):
        if effect.found.get("component") != component:
            continue
        values = known | {
            name: p.value * PARAMETER_UNITS[p.unit].to_internal
            for name, p in effect.parameters.items()
        }
        # An equation of the effect, and the same of the machine, that hold the component.
        both = [name for name in form if component in _coefficients(machine.forms.get(name))]
        own = _coefficients(form[both[0]]) if both else {}
        needed = {name for node in own.values() for name in names(node)}
        missing = sorted(needed - set(values))
        if not both or missing:
            columns_lacking = f"they have no column {', '.join(missing)}"
            reason = columns_lacking if missing else "no equation holds both"
            facts: dict[str, object] = {"effect": effect.name, "component": component}
            facts |= {"reason": reason}
            read = [f"the readings of {component}"]
            warned.append(
                finding("not-used", what=f"the effect {effect.name}", names=read, **facts)
            )
            continue
        said = np.zeros(len(places))
        for name, node in own.items():
            said = said + np.asarray(values[name]) * evaluate(node, values)
        warned += outside_seen([declared], own_columns)
        total += said / evaluate(machine.forms[both[0]].coefficients[component], values)
    return total, warned


def _coefficients(form: LinearForm | None) -> Mapping[str, Node]:
    return {} if form is None else form.coefficients
