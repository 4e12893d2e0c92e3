"""Members of candidates: columns over a table, and equations with all numbers in place."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.close_loop_sealed.files.effect_templates import (
    CHOSEN,
    Template,
    equation_text,
    filled_tree,
    number_of,
    with_number,
)
from mtu_cli.close_loop_sealed.model.effect_binding import Binding, filled, resolved
from mtu_cli.close_loop_sealed.model.effect_candidate import (
    Column,
    FloatArray,
    Member,
    centred_axes,
)
from mtu_cli.close_loop_sealed.model.effect_data import POSITIONS, TableData, indicators, labels
from mtu_cli.close_loop_sealed.model.effect_grid import (
    coarseness,
    grid_of,
    has_many_places,
    is_continuous,
)
from mtu_cli.close_loop_sealed.model.effect_lacks import NoMember, check_column
from mtu_cli.close_loop_sealed.model.effect_slopes import slopes
from mtu_cli.files.effects import Family
from mtu_cli.language import Node, evaluate, names
from mtu_cli.language.tree import Call, Name
from mtu_cli.language.unit_algebra import Algebra
from mtu_cli.model.machine_model import LARGEST
from mtu_cli.units import PARAMETER_UNITS, internal, parameter_units_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """Members that differ in the searched value alone, or in what is chosen.

    `columns` are those of k parameters: by axis an array (G or 1, P or 1, H or 1). `used` are
    the columns of the data in the equations.
    """

    bound: BoundTemplate
    members: tuple[Member, ...]
    columns: tuple[Column, ...]
    used: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundTemplate:
    """A template of a family whose names are bound to a table's axes and columns."""

    family: Family
    template: Template
    binding: Binding
    data: TableData

    def batch(self) -> Batch:
        """All its members.

        Raises NoMember where the data has none.
        """
        used, searched = self.checked_names(), self.searched()
        columns = self.columns(searched)
        members = tuple(self.members(columns, self.tangent(searched), searched, used))
        return Batch(bound=self, members=members, columns=columns, used=used)

    def tangent(self, searched: FloatArray | None) -> tuple[Column, ...]:
        """Derivatives of the columns by the logarithm of what is searched, where it has one; of a
        wave over many places the second ones, too: half a step of the grid off, a strong one
        would leave another wave beside the first.
        """
        search = self.template.search
        if searched is None or search is None or not is_continuous(search):
            return ()
        along = None if search.of is None else self.data.values.get(filled(search.of, self.binding))
        twice = self.is_periodic and along is not None and has_many_places(along)
        return slopes(self.columns, searched, twice=twice)

    @property
    def is_periodic(self) -> bool:
        """Whether periods are searched: columns are of the same size for all of them."""
        return self.template.search is not None and self.template.search.grid == "frequency"

    def not_searched(self, members: Sequence[Member]) -> tuple[str, ...]:
        """What lies between the values that are searched, where the data would tell it."""
        search = self.template.search
        if search is None or search.of is None:
            return ()
        along = self.data.values[resolved(search.of, self.binding).name]
        grid = np.array([value for m in members for value in m.searched.values()])
        told = coarseness(search, along, grid)
        if told is None:
            return ()
        return (f"{len(grid)} values of {self.template.searched} were searched, {told}",)

    def narrowed(self, member: Member, kept: Sequence[int]) -> Member:
        """The member with these of its parameters alone."""
        parameters = tuple(member.parameters[i] for i in kept)
        texts = self.texts({name for name, _ in parameters})
        for name, value in member.searched.items():
            texts = with_number(texts, name, value)
        return replace(
            member,
            columns=tuple(member.columns[i] for i in kept),
            tangent=tuple(member.tangent[i] for i in kept if member.tangent),
            parameters=parameters,
            equations=texts,
        )

    def equations(self) -> Iterator[tuple[str, int, str, Binding]]:
        """Key in the file, index and name of the axis, binding of each equation."""
        axes = self.data.table.axes
        for key in self.template.forms:
            own = axes if "{each}" in key else (filled(key, self.binding)[1:],)
            for axis in own:
                if axis not in axes:
                    raise NoMember
                yield key, axes.index(axis), axis, {**self.binding, "each": axis}

    def checked_names(self) -> tuple[str, ...]:
        """The columns of the data that the equations and `needs` name."""
        wanted = {
            resolved(raw, bound).name
            for _, _, _, bound in self.equations()
            for raw in self.template.raw_names
        }
        wanted |= {filled(raw, self.binding) for raw in self.family.needs}
        for name in sorted(wanted):
            check_column(name, self.data)
        return tuple(sorted(wanted - {*POSITIONS}))

    def searched(self) -> FloatArray | None:
        """The grid of the searched parameter, (G,)."""
        if self.template.search is None:
            return None
        of = self.template.search.of
        along = None
        if of is not None:
            name = resolved(of, self.binding).name
            check_column(name, self.data)
            along = self.data.values[name]
        size = 1
        for _, _, _, bound in self.equations():
            found = [self.value(raw, bound) for raw in self.template.raw_names]
            size = max(size, np.broadcast(*found, 0.0).size)
        grid = grid_of(self.template.search, along, size)
        if not len(grid):
            told = of if of is None else resolved(of, self.binding).name
            raise NoMember(f"too few values of {told} to search {self.template.searched}")
        return grid

    def value(self, raw: str, bound: Binding) -> FloatArray | float:
        """The value of a name of the file: a column of the data, or a number of it."""
        found = resolved(raw, bound)
        if found.kind is not None:
            return self.data.number(found.name, found.kind)
        return self.data.values[found.name]

    def parameter(self, name: str, bound: Binding) -> str:
        """The name of a parameter, which no column of the equations has."""
        own = filled(name, bound)
        while own in {resolved(raw, bound).name for raw in self.template.raw_names}:
            own = f"own_{own}"
        return own

    def parameters(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each parameter; for angular components um is arcsec."""
        angular = self.data.table.unit == "arcsec"
        found: dict[str, str] = {}
        for name, unit in self.template.units.items():
            shown = re.sub("^um", "arcsec", unit) if angular else unit
            if self.binding.get("c") == "time_min":
                shown = self._beside_time(name, shown)
            axes = self.data.table.axes if "{each}" in name else ("",)
            each = ({**self.binding, "each": axis} for axis in axes)
            found |= {self.parameter(name, bound): shown for bound in each}
        return tuple(found.items())

    def _beside_time(self, parameter: str, unit: str) -> str:
        """The unit of a parameter where the time stands for {c}, a plain count: um/min for um.

        Raises NoMember where there is no such unit, or a count is added to {c}.
        """
        forms = self.template.forms.values()
        levers = [form.coefficients[parameter] for form in forms if parameter in form.coefficients]
        held = {own for item in levers for own in names(item)}
        counts = {own: internal(minute=own == "{c}") for own in held}
        written = {own for own in held if number_of(own) is not None}
        literal = dict.fromkeys(written | held & {self.template.searched}, 1.0)
        algebra = Algebra(units=counts)
        timed = [algebra.of(filled_tree(item, literal)).minute == 1 for item in levers]
        if algebra.faults:
            raise NoMember(f"time_min in place of {{c}}: {algebra.faults[0].text}")
        if not all(timed):
            return unit
        per = parameter_units_of(PARAMETER_UNITS[unit].powers / internal(minute=1), unit)
        if not per or PARAMETER_UNITS[unit].per is not None:
            raise NoMember(f"{unit} of {parameter} has no unit per minute")
        return per[0]

    def columns(self, searched: FloatArray | None) -> tuple[Column, ...]:
        """Levers of the parameters by axis, each (G or 1, P or 1, H or 1)."""
        found: dict[str, Column] = {name: {} for name, _ in self.parameters()}
        for key, index, _, bound in self.equations():
            values: dict[str, FloatArray | float] = {}
            for name in names(self.template.trees[key]):
                if name == self.template.searched and searched is not None:
                    values[name] = searched[:, None, None]
                elif name == CHOSEN and self.family.over is not None:
                    values[name] = indicators(self.data.table, self.family.over)
                elif name not in self.template.units:
                    values[name] = self.value(name, bound)
            for name, node in self.template.forms[key].coefficients.items():
                lever = np.asarray(evaluate(node, values), float)
                if not (np.abs(lever) < LARGEST).all():
                    raise NoMember("its equation has no finite value in some places")
                full = lever.reshape((1,) * (3 - lever.ndim) + lever.shape)
                found[self.parameter(name, bound)][index] = full
        return tuple(found.values())

    def members(
        self,
        columns: tuple[Column, ...],
        tangent: tuple[Column, ...],
        searched: FloatArray | None,
        used: tuple[str, ...],
    ) -> Iterator[Member]:
        """One member for each value of the grid, or for each that may be chosen."""
        over, name = self.family.over, self.template.searched
        chosen = None if over is None else labels(self.data.table, over)
        texts = {} if over is not None else self.texts()
        parameters, covariate = self.parameters(), self.covariate(used)
        count = len(chosen) if chosen is not None else 1 if searched is None else len(searched)
        there = self.data.table.there
        complete = bool(there.all())
        for g in range(count):
            at = None if searched is None or name is None else float(searched[g])
            own = _taken(columns, g)
            yield Member(
                columns=own,
                centred=frozenset() if complete else centred_axes(own, there),
                parameters=parameters,
                equations=texts if at is None else with_number(texts, str(name), at),
                searched={} if at is None else {str(name): at},
                covariate=covariate,
                tangent=_taken(tangent, g),
                chosen=None if chosen is None else chosen[g],
            )

    def texts(self, only: Collection[str] | None = None) -> dict[str, str]:
        """Equations by key (``Ex``) with all numbers but the searched one; with the terms of
        `only` these parameters.
        """
        found = {}
        for key, _, axis, bound in self.equations():
            tree: Node | None = self.template.trees[key]
            if only is not None:
                tree = self._of_terms(key, bound, only)
            if tree is None:
                continue
            numbers: dict[str, float | str] = {}
            for name in names(self.template.trees[key]):
                own = resolved(name, bound)
                if name in self.template.units:
                    numbers[name] = self.parameter(name, bound)
                elif own.kind is not None:
                    numbers[name] = self.data.number(own.name, own.kind)
                else:
                    numbers[name] = own.name
            found[f"E{axis}"] = equation_text(tree, numbers)
        return found

    def _of_terms(self, key: str, bound: Binding, only: Collection[str]) -> Node | None:
        """The terms of these parameters in an equation; None where it has none."""
        tree: Node | None = None
        for name, lever in self.template.forms[key].coefficients.items():
            if self.parameter(name, bound) in only:
                term = Call("*", (Name(name, 0), lever), 0)
                tree = term if tree is None else Call("+", (tree, term), 0)
        return tree

    def covariate(self, used: tuple[str, ...]) -> str | None:
        """The column that the effect goes with: that of {T}, {c} or {v}, else the first used."""
        bound = [self.binding[mark] for mark in ("T", "c", "v") if mark in self.binding]
        return next(iter([*bound, *used]), None)


def _taken(columns: tuple[Column, ...], g: int) -> tuple[Column, ...]:
    return tuple(
        {axis: value[g if len(value) > 1 else 0] for axis, value in column.items()}
        for column in columns
    )
