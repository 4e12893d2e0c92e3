"""The library of effects that a machine's equations may lack, bound to a table of residuals.

Families are data (``effects.yaml``, and users' own files; `files.effects` says what their names in
braces mean). Here these names become axes, columns and numbers of a table: a `BoundTemplate` is
one form of a family with its equations, the levers of its parameters, and the grid of what is
searched.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import combinations, product
from pathlib import Path

import numpy as np

from mtu_cli.files.contract import is_identifier
from mtu_cli.files.covariates import COVARIATES, is_temperature
from mtu_cli.files.effects import (
    CHOSEN,
    COLUMN_MARKS,
    EffectLibrary,
    Family,
    MemberTemplate,
    Search,
    filled,
    load_effects,
    number_of,
)
from mtu_cli.files.source import Source
from mtu_cli.findings import InputError, finding, nearest
from mtu_cli.language import Node, evaluate, linear_form, names
from mtu_cli.language.functions import MACHINE_FUNCTIONS
from mtu_cli.language.tree import filled_text, filled_tree
from mtu_cli.model.effect_parameters import grid_of
from mtu_cli.model.machine_model import AXES, LARGEST, TIME
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS, internal, parameter_units_of

BUILT_IN = Path(__file__).with_name("effects.yaml")
Binding = Mapping[str, str]
Levers = dict[int, FloatArray]
"""By index of the axis what one unit of a parameter gives, (G or 1, P or 1, H or 1)."""

# Families.

_built_in = cache(partial(load_effects, BUILT_IN))


def effect_library(paths: Sequence[Path] = ()) -> EffectLibrary:
    """The built-in families and those of the users' own files, which are the `sources`.

    Raises InputError with all problems of a file; the name of a family may be used once.
    """
    families, sources = _built_in().families, list[Source]()
    owners = dict.fromkeys((x.family for x in families), "a built-in family")
    for path in paths:
        file = load_effects(path, owners)
        owner = f"a family of {file.sources[0].shown}"
        owners |= dict.fromkeys((x.family for x in file.families), owner)
        families += file.families
        sources += file.sources
    return EffectLibrary(families=families, sources=tuple(sources))


# Columns of a table.

STEADY_K = 0.05
"""Range of a temperature that does not change: the scatter of a thermometer reaches it."""
FEW_RESETS = 0.4
"""Of the steps of a column that counts, at most this share may be resets."""
FEWEST_PLACES = 3
"""Positions from which on one may be an outlier in both directions."""
MISSING = {
    "T": "no column T_..._degC without gaps",
    "c": "no column counts parts",
    "v": "no other numeric column that an equation can name",
}


class NoMember(Exception):  # noqa: N818  # no fault: the reason why the data has no such member
    """Why the data has no such member; empty where it could not have one."""


class TableData:
    """Of a table positions and columns by name as `values` in compact shapes, those that are
    `changing`, and by mark the `columns` that ``{T}``, ``{c}`` and ``{v}`` may be.
    """

    def __init__(self, table: ResidualTable) -> None:
        values = {axis: _compact(table.places[..., i]) for i, axis in enumerate(AXES)}
        language = {"pi", CHOSEN, *AXES, *MACHINE_FUNCTIONS}
        named = {n for n in table.covariates if is_identifier(n)} - language
        values |= {name: v for name, v in table.covariates.items() if name in named}
        values = {name: v for name, v in values.items() if v.size and np.isfinite(v).all()}
        columns = [name for name in values if name not in AXES]
        sensors = tuple(name for name in columns if is_temperature(name))
        plain = [name for name in columns if name not in (*COVARIATES, *sensors)]
        counts = [name for name in ("sequence",) if name in columns]
        counts += [name for name in plain if _counts(values[name])]
        variables = tuple(name for name in plain if name not in counts)
        counts += [name for name in (TIME,) if name in columns and table.component is not None]
        # A range of printed values is rounded: 26.05 - 26.
        steady = dict.fromkeys(sensors, STEADY_K + 1e-9)
        self.table, self.values = table, values
        self.changing = {n for n, v in values.items() if np.ptp(v) > steady.get(n, 0.0)}
        self.columns = {"T": sensors, "c": tuple(counts), "v": variables}

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes of the errors and axes along which the places differ; x, y, z first."""
        axes = {*self.table.axes, *(axis for axis in AXES if axis in self.changing)}
        return (*(axis for axis in AXES if axis in axes), *sorted(axes - {*AXES}))

    def number(self, name: str, kind: str) -> float:
        """A number of a column over the measured cells, to 12 digits.

        ``0`` is its mean, ``_low`` its lowest value and ``3`` sum d^4 / sum d^2, d from the mean:
        d^3 less this times d is orthogonal to d.
        """
        measured = self.table.there
        values = np.broadcast_to(self.values[name], measured.shape)[measured]
        if kind == "_low":
            return float(values.min())
        mean = float(f"{values.mean():.12g}")
        if kind == "0":
            return mean
        square = (values - mean) ** 2
        total = float(square.sum())
        return float(f"{(square**2).sum() / total:.12g}") if total else 0.0


def check_column(name: str, data: TableData) -> None:
    """Raises NoMember, with the reason, unless a column or position is there and changes."""
    if name in data.changing:
        return
    if name in data.values:
        more = f" by more than {STEADY_K:g} K" if np.ptp(data.values[name]) else ""
        raise NoMember(f"{name} does not change{more}")
    if name in AXES:
        raise NoMember(f"the position along {name} is not known")
    if name in data.table.axes:
        # A component without an axis: no position of it is missing.
        raise NoMember
    raise NoMember(f"{name} has gaps" if name in data.table.covariates else f"no column {name}")


def _compact(value: FloatArray) -> FloatArray:
    """An array (P, H) in the smallest shape that broadcasts to it without loss."""
    for axis in (0, 1):
        first = value.take([0], axis=axis) if value.size else value
        value = first if (value == first).all() else value
    return np.ascontiguousarray(value)


def _counts(value: FloatArray) -> bool:
    """Whether a column counts parts: whole numbers that rise, with a few falls to the start."""
    steps = np.diff(value, axis=0)
    if len(steps) < 2 or (value != np.round(value)).any() or not (steps > 0).any(axis=0).all():
        return False
    falls, rise = steps < 0, np.median(steps[steps > 0])
    back = (value[1:] <= value.min(axis=0, keepdims=True) + rise) | ~falls
    return bool(back.all() and (falls.mean(axis=0) <= FEW_RESETS).all())


def choices(table: ResidualTable, over: str) -> dict[str, FloatArray]:
    """The indicator of each feature, part or operation: 1 on it, else 0, (P or 1, H or 1).

    For readings there and back those of the positions follow, as a fault of a screw or scale shows
    in both directions; not for two positions, where neither is the outlier.
    """
    if over == "part":
        return dict(zip(table.parts, np.eye(len(table.parts))[:, :, None], strict=True))
    if over == "operation":
        codes = enumerate(table.operations)
        return {name: (table.operation == code)[None] * 1.0 for code, name in codes}
    result = dict(zip(table.features, np.eye(len(table.features))[:, None], strict=True))
    places: dict[str, list[FloatArray]] = {}
    for name in table.features if table.component is not None else ():
        place, _, sign = name.partition(" ")
        if sign:
            places.setdefault(place, []).append(result[name])
    both = {place: np.sum(ways, axis=0) for place, ways in places.items() if len(ways) > 1}
    return result | (both if len(both) >= FEWEST_PLACES else {})


# Names in braces.

CYCLIC = (("x", "y", "z"), ("y", "z", "x"), ("z", "x", "y"))
"""(a, b, n) such that a turn about n takes a to b."""


def of_candidates(family: Family, data: TableData) -> Iterator[Binding]:
    """A binding of the axes in its name for each candidate of a family."""
    named, allowed, axes = family.name_axes, family.axes, data.axes
    if len(named) > 1:
        # An angle to an axis that was not measured is a tilt, as of `abbe` and `straightness`.
        axes = tuple(axis for axis in axes if axis in data.table.axes)
    groups: Iterable[tuple[str, ...]] = combinations(axes, len(named))
    if "n" in named:
        groups = (group for group in CYCLIC if {*group[:2]} <= {*axes})
    for group in groups:
        if allowed is None or not group or group[0] in allowed:
            yield dict(zip(named, group, strict=True))


def of_members(form: MemberTemplate, binding: Binding, data: TableData) -> Iterator[Binding | str]:
    """Bindings of the marks that the candidate's name leaves open, or why there are none."""
    if form.readings and data.table.component is None:
        return
    kinds = [mark for mark in COLUMN_MARKS if mark in form.placeholders]
    if lacking := [MISSING[mark] for mark in kinds if not data.columns[mark]]:
        yield lacking[0]
        return
    unbound = [mark for mark in "ab" if mark in form.placeholders and mark not in binding]
    axes = (ab for ab in combinations(data.axes, len(unbound)) if not {*ab} & {*binding.values()})
    for ab, chosen in product(axes, product(*(data.columns[mark] for mark in kinds))):
        yield {**binding, **dict(zip((*unbound, *kinds), (*ab, *chosen), strict=True))}


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundTemplate:
    """A form of a family whose names are bound to a table's axes, columns and numbers.

    `parameters` by name their units; by index of the axis `equations`, and of these the `levers`
    of each parameter; `used` are the columns and positions that these, `needs` and a search name,
    `covariate` the column that the effect depends on, `grid` (G,) the values of what is `searched`,
    nan where nothing is, its `scale` that of the library, and `ends` (D,) the data's values that it
    lies between. With it its `margins`; of a family `over` features, parts or operations one member
    each is `chosen`.
    """

    family: Family
    data: TableData
    parameters: dict[str, str]
    equations: dict[int, Node]
    levers: dict[int, dict[str, Node]]
    used: tuple[str, ...]
    covariate: str | None
    searched: str
    scale: str
    grid: FloatArray
    ends: FloatArray | None
    margins: tuple[BoundTemplate, ...] = ()
    chosen: tuple[str, ...] | None = None

    def columns(self, searched: FloatArray) -> tuple[Levers, ...]:
        """The levers of each parameter at values (G,) of the searched one.

        Raises NoMember where they are no finite numbers.
        """
        values = self.data.values | {self.searched: searched[:, None, None]}
        if self.family.over is not None:
            values[CHOSEN] = np.stack([*choices(self.data.table, self.family.over).values()])
        result: dict[str, Levers] = {name: {} for name in self.parameters}
        for axis, levers in self.levers.items():
            for name, node in levers.items():
                lever = np.asarray(evaluate(node, values), float)
                if not (np.abs(lever) < LARGEST).all():
                    raise NoMember("its equation has no finite value in some places")
                result[name][axis] = lever.reshape((1,) * (3 - lever.ndim) + lever.shape)
        return tuple(result.values())

    def texts(
        self, value: float = math.nan, sizes: Mapping[str, float] | None = None
    ) -> dict[str, str]:
        """Equations by key (``Ex``) with all numbers in place: `value` for the searched one, and
        `sizes` for the parameters.
        """
        filling, axes = {self.searched: value, **(sizes or {})}, self.data.table.axes
        return {f"E{axes[a]}": filled_text(tree, filling) for a, tree in self.equations.items()}


def bound(
    family: Family,
    form: MemberTemplate,
    searching: Mapping[str, Search],
    binding: Binding,
    data: TableData,
) -> BoundTemplate:
    """A form of a family, or a margin of one, with what is searched.

    Raises NoMember where the data has none: no such axis or column, or no finite values.
    """
    axes = data.table.axes
    searched, search = next(iter(searching.items()), ("", None))
    entries: list[tuple[int, str, Binding]] = []
    for key in form.trees:
        for axis in axes if "{each}" in key else (filled(key, binding)[1:],):
            if axis not in axes:
                raise NoMember
            entries.append((axes.index(axis), key, {**binding, "each": axis}))
    symbols = [x for x in form.symbols if x not in {*form.parameters, searched, CHOSEN}]
    columns = {_column(raw, scope, data)[0] for _, _, scope in entries for raw in symbols}
    along = "" if search is None or search.of is None else _column(search.of, binding, data)[0]
    needed = {_column(raw, binding, data)[0] for raw in family.needs} | ({along} - {""})
    used = sorted(columns | needed)
    for name in used:
        check_column(name, data)

    def fill(raw: str, scope: Binding) -> str | float:
        name, number = _column(raw, scope, data)
        # No column of the equations has the name of a parameter.
        while raw in form.parameters and name in columns:
            name = f"own_{name}"
        return name if number is None else data.number(name, number)

    equations, levers, fillings = dict[int, Node](), dict[int, dict[str, Node]](), []
    for a, key, scope in entries:
        filling = {raw: fill(raw, scope) for raw in (*symbols, *form.parameters)}
        fillings.append(filling)
        equations[a] = filled_tree(form.trees[key], filling)
        own = [str(filling[raw]) for raw in form.parameters]
        levers[a] = linear_form(equations[a], own).coefficients
    units = {
        str(filling[raw]): re.sub("^um", "arcsec", unit) if data.table.unit == "arcsec" else unit
        for raw, unit in form.parameters.items()
        for filling in fillings
    }
    if binding.get("c") == TIME:
        pairs = (pair for by_name in levers.values() for pair in by_name.items())
        # The time stands for {c}, a plain count: um/min for um.
        for name in dict.fromkeys(name for name, lever in pairs if TIME in names(lever)):
            powers = PARAMETER_UNITS[units[name]].powers / internal(minute=1)
            if not (per := parameter_units_of(powers, units[name])):
                raise NoMember(f"{units[name]} of {name} has no unit per minute")
            units[name] = per[0]
    grid, ends = np.array([np.nan]), None
    if search is not None:
        size = math.prod(np.broadcast_shapes(*(data.values[name].shape for name in columns)))
        grid = grid_of(search, data.values.get(along), size)
        if not len(grid):
            raise NoMember(f"too few values {f'of {along} ' if along else ''}to search {searched}")
        if search.grid == "between":
            ends = np.unique(data.values[along])
    goes_with = [binding[mark] for mark in COLUMN_MARKS if mark in binding]
    goes_with += [name for name in used if name not in AXES]
    whole = BoundTemplate(
        family=family,
        data=data,
        parameters=units,
        equations=equations,
        levers=levers,
        used=tuple(used),
        covariate=next(iter(goes_with), None),
        searched=searched,
        scale="" if search is None else search.grid,
        grid=grid,
        ends=ends,
    )
    whole.columns(grid)
    return whole


def _column(raw: str, binding: Binding, data: TableData) -> tuple[str, str | None]:
    """The column or position that a name stands for, or is a number of, and the kind of number; the
    direction of a component without an axis is that of the axis whose error it is.
    """
    plain, number = number_of(raw) or (raw, None)
    name, table = filled(plain, binding), data.table
    if table.component is not None and name == f"dir_{table.axes[0]}":
        name = next((key for key in table.covariates if key.startswith("dir_")), name)
    return name, number


# Candidates.

NOTHING_LEFT = "not separable from an offset or from scatter on this data"
CONSTANT = "a parameter of it is a constant, which is estimated with every effect: leave it out"


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """An effect that the model may lack, as the library describes it on one table; `notes` are the
    reasons why the table cannot test some of its forms, `unavailable` those why it can test none.
    """

    name: str
    family: str
    axis: str | None = None
    kind: str = "mean"
    over: str | None = None
    says: str = ""
    separates: str | None = None
    sentence: str = ""
    forms: tuple[BoundTemplate, ...] = ()
    unavailable: str | None = None
    notes: str = ""


def candidates_of(
    table: ResidualTable, library: EffectLibrary, exclude: Collection[str] = ()
) -> tuple[Candidate, ...]:
    """All candidates of a library on a table, in the library's order, but those of `exclude`.

    Raises InputError for a name in `exclude` that the library does not have.
    """
    families = list(dict.fromkeys(family.family for family in library.families))
    expected = f"a family ({', '.join(families)}) or one of its effects, such as backlash-x"
    # backlash-z is no mistake where the data has no z.
    if faults := [
        finding("unknown-name", value=name, meant=nearest(name, families),
                what="effect to exclude", expected=expected)
        for name in exclude
        if not any(f"{name}-".startswith(f"{family}-") for family in families)
    ]:  # fmt: skip
        raise InputError(faults)
    data = TableData(table)
    candidates = (
        _candidate(family, binding, data)
        for family in library.families
        if family.family not in exclude and len(table.axes) >= family.least_axes
        for binding in of_candidates(family, data)
    )
    return tuple(c for c in candidates if c is not None and c.name not in exclude)


def _candidate(family: Family, binding: Binding, data: TableData) -> Candidate | None:
    """None where the table could not have such an effect."""
    forms, reasons = list[BoundTemplate](), dict[str, None]()
    # Of two neither is the outlier.
    least = 3 if family.kind == "outlier" else 2
    chosen = None if family.over is None else tuple(choices(data.table, family.over))
    if chosen is not None and len(chosen) < least:
        reasons[f"fewer than {least} of {family.over}"] = None
    elif family.kind == "scatter":
        for name in family.needs:
            try:
                check_column(name, data)
            except NoMember as lack:
                reasons[str(lack)] = None
    else:
        for form, item in (
            (x, item) for x in family.forms for item in of_members(x, binding, data)
        ):
            try:
                if isinstance(item, str):
                    raise NoMember(item)
                effect = bound(family, form, form.search, item, data)
                margins = [bound(family, x, family.search, item, data) for x in family.margins]
                levers = [node for by_name in effect.levers.values() for node in by_name.values()]
                if family.kind != "offset" and not all(any(names(node)) for node in levers):
                    raise NoMember(CONSTANT)
                forms.append(replace(effect, margins=tuple(margins), chosen=chosen))
            except NoMember as lack:
                reasons |= {str(lack): None} if str(lack) else {}
        if not forms and not reasons:
            return None
    readings, notes = data.table.component is not None, "; ".join(reasons)
    separates = (readings and family.separates_readings) or family.separates
    missing = not forms if family.kind != "scatter" else bool(reasons)
    return Candidate(
        name=filled(family.label, binding),
        family=family.family,
        axis=binding.get("n") or binding.get("a", "") + binding.get("b", "") or None,
        kind=family.kind,
        over=family.over,
        says=filled(family.says, binding),
        separates=None if separates is None else filled(separates, binding),
        sentence=family.sentence,
        forms=tuple(forms),
        unavailable=notes or NOTHING_LEFT if missing else None,
        notes="" if missing else notes,
    )
