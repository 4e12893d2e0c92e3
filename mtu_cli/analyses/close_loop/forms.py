"""Candidate effects on a table: from the library's families to forms with levers and margins."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

from mtu_cli.files.effects import EffectLibrary, LoadedFamily, Template, filled
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

SCATTER, OFFSET, OUTLIER = "scatter", "offset", "outlier"
NOTHING_LEFT = "not separable from an offset on this data"
CONSTANT = "a parameter of it is a constant, which is estimated with every effect: leave it out"


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """An effect that the model may lack, as the library describes it on one table; `unavailable` is
    the reason why the table cannot test it.
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


def candidates_of(
    table: ResidualTable, library: EffectLibrary, exclude: Collection[str] = ()
) -> tuple[Candidate, ...]:
    """All candidates of a library on a table, in the library's order, but those of `exclude`.

    Raises InputError for a name in `exclude` that the library does not have.
    """
    check_excluded(exclude, library)
    data = TableData.of(table)
    candidates = [
        _candidate(family, binding, data)
        for family in library.families
        if family.family.family not in exclude and len(table.axes) >= family.family.least_axes
        for binding in of_candidates(family, data)
    ]
    return tuple(c for c in candidates if c is not None and c.name not in exclude)


def _candidate(family: LoadedFamily, binding: Binding, data: TableData) -> Candidate | None:
    """None where the table could not have such an effect."""
    own, forms = family.family, list[BoundTemplate]()
    reasons: dict[str, None] = {}
    # Of two neither is the outlier.
    least = 3 if own.kind == OUTLIER else 2
    if own.over is not None and (there := len(choices(data.table, own.over))) < least:
        reasons[f"there {'is one' if there == 1 else f'are {there}'} {own.over} only"] = None
    elif own.kind == SCATTER:
        reasons |= dict.fromkeys(_missing_columns(family, data))
    else:
        for template in family.templates:
            for item in of_members(template, binding, data):
                try:
                    forms.append(_form(family, template, item, data))
                except NoMember as lack:
                    reasons |= {str(lack): None} if str(lack) else {}
        if not forms and not reasons:
            return None
    readings = data.table.component is not None
    separates = (readings and own.separates_readings) or own.separates
    missing = not forms if own.kind != SCATTER else bool(reasons)
    return Candidate(
        name=filled(family.name, binding),
        family=own.family,
        axis=binding.get("n") or binding.get("a", "") + binding.get("b", "") or None,
        kind=own.kind,
        over=own.over,
        says=filled(own.says, binding),
        separates=None if separates is None else filled(separates, binding),
        sentence=(readings and own.sentence_readings) or own.sentence,
        forms=tuple(forms),
        unavailable="; ".join(reasons) or NOTHING_LEFT if missing else None,
    )


def _form(
    family: LoadedFamily, template: Template, item: Binding | str, data: TableData
) -> BoundTemplate:
    """With its margins. Raises NoMember where the table has none."""
    if isinstance(item, str):
        raise NoMember(item)
    own = family.family
    effect, *margins = (bound(own, one, item, data) for one in (template, *family.margins))
    levers = [node for by_name in effect.levers.values() for node in by_name.values()]
    if own.kind != OFFSET and not all(any(names(node)) for node in levers):
        raise NoMember(CONSTANT)
    chosen = None if own.over is None else tuple(choices(data.table, own.over))
    return replace(effect, margins=tuple(margins), chosen=chosen)


def _missing_columns(family: LoadedFamily, data: TableData) -> Iterator[str]:
    for name in family.family.needs:
        try:
            check_column(name, data)
        except NoMember as lack:
            yield str(lack) or f"no column {name}"
