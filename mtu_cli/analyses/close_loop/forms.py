"""Candidate effects on a table: from the library's families to forms with levers and margins."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from mtu_cli.analyses.close_loop.strata import Levers
from mtu_cli.files.effects import EffectLibrary, LoadedFamily, filled
from mtu_cli.language import names
from mtu_cli.model.effect_library import (
    Binding,
    BoundTemplate,
    NoMember,
    TableData,
    bound,
    check_column,
    check_excluded,
    choices,
    of_candidates,
    of_members,
)
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

SCATTER, OFFSET, OUTLIER = "scatter", "offset", "outlier"
NOTHING_LEFT = "this data cannot tell it from an offset"
CONSTANT = "a parameter of it is a constant, which every effect has beside it: leave it out"


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """One form of a candidate: its equations with all names bound, and those of its margins.

    Of a candidate `over` features, parts or operations one member each is `chosen`.
    """

    bound: BoundTemplate
    margins: tuple[BoundTemplate, ...]
    chosen: tuple[str, ...] | None

    @property
    def grid(self) -> FloatArray | None:
        """The values (G,) of what is searched (None: nothing is)."""
        return self.bound.grid

    @property
    def continuous(self) -> bool:
        """Whether members lie between those of the grid."""
        search = self.bound.template.search
        return search is not None and search.grid != "between"

    def own(self, values: FloatArray | None) -> list[Levers]:
        """Levers of the effect's parameters: by axis (G or 1, P or 1, H or 1)."""
        return list(self.bound.columns(values))

    def lower(self, values: FloatArray | None) -> list[Levers]:
        """The same of its margins."""
        return [lever for item in self.margins for lever in item.columns(values)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """An effect that may be lacking; `unavailable` says why the table cannot test it."""

    name: str
    family: str
    axis: str | None
    says: str
    separates: str | None
    sentence: str
    kind: str
    forms: tuple[Form, ...]
    unavailable: str | None = None


def candidates_of(
    table: ResidualTable, library: EffectLibrary, exclude: Collection[str] = ()
) -> tuple[Candidate, ...]:
    """All candidates of a library on a table, in the library's order, but those of `exclude`.

    Raises InputError for a name in `exclude` that the library does not have.
    """
    check_excluded(exclude, library)
    data = TableData.of(table)
    found = []
    for family in library.families:
        if family.family.family in exclude or len(table.axes) < family.family.least_axes:
            continue
        for binding in of_candidates(family, data):
            candidate = _candidate(family, binding, data)
            if candidate is not None and candidate.name not in exclude:
                found.append(candidate)
    return tuple(found)


def _candidate(family: LoadedFamily, binding: Binding, data: TableData) -> Candidate | None:
    own, reasons = family.family, dict[str, None]()
    forms: list[Form] = []
    over = own.over
    # Of two neither is the outlier.
    least = 3 if own.kind == OUTLIER else 2
    if over is not None and (there := len(choices(data.table, over))) < least:
        reasons[f"there {'is one' if there == 1 else f'are {there}'} {over} only"] = None
    elif own.kind == SCATTER:
        reasons = dict.fromkeys(_lacks(family, data))
    else:
        for template in family.templates:
            for item in of_members(template, binding, data):
                if isinstance(item, str):
                    reasons[item] = None
                    continue
                try:
                    whole, *lower = (
                        bound(own, one, item, data) for one in (template, *family.margins)
                    )
                    levers = [node for each in whole.levers.values() for node in each.values()]
                    if own.kind != OFFSET and not all(any(names(node)) for node in levers):
                        raise NoMember(CONSTANT)
                    chosen = None if over is None else tuple(choices(data.table, over))
                    forms.append(Form(bound=whole, margins=tuple(lower), chosen=chosen))
                except NoMember as lack:
                    if str(lack):
                        reasons[str(lack)] = None
        if not forms and not reasons:
            return None
    readings = data.table.component is not None
    separates = (readings and own.separates_readings) or own.separates
    missing = not forms if own.kind != SCATTER else bool(reasons)
    return Candidate(
        name=filled(family.name, binding),
        family=own.family,
        axis=binding.get("n") or binding.get("a", "") + binding.get("b", "") or None,
        says=filled(own.says, binding),
        separates=None if separates is None else filled(separates, binding),
        sentence=(readings and own.sentence_readings) or own.sentence,
        kind=own.kind,
        forms=tuple(forms),
        unavailable="; ".join(reasons) or NOTHING_LEFT if missing else None,
    )


def _lacks(family: LoadedFamily, data: TableData) -> Iterator[str]:
    for name in family.family.needs:
        try:
            check_column(name, data)
        except NoMember as lack:
            yield str(lack) or f"no column {name}"
