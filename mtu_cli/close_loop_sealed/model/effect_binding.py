"""Which axes and columns the names in braces of a family stand for, one binding after another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

from mtu_cli.close_loop_sealed.files.effect_templates import (
    COLUMN_MARKS,
    LoadedFamily,
    Template,
    marks,
    number_of,
)
from mtu_cli.close_loop_sealed.model.effect_data import POSITIONS, TableData

CYCLIC = (("x", "y", "z"), ("y", "z", "x"), ("z", "x", "y"))
"""(a, b, n) such that a turn about n takes a to b."""

MISSING = {
    "T": "no column T_..._degC without gaps",
    "c": "no column counts parts",
    "v": "no other numeric column",
}

Binding = Mapping[str, str]


def filled(text: str, binding: Binding) -> str:
    """A text with its names in braces filled in, numbers of the data left as they are."""
    for mark, name in binding.items():
        text = text.replace("{" + mark + "}", name)
    return text


@dataclass(frozen=True, slots=True)
class Resolved:
    """A name of a template: a column or position, or a number (`kind`) of it."""

    name: str
    kind: str | None


def resolved(raw: str, binding: Binding) -> Resolved:
    """What a name of a template stands for: ``{a0}`` is a number of the axis of ``{a}``."""
    number = number_of(raw)
    if number is None:
        return Resolved(filled(raw, binding), None)
    base, kind = number
    return Resolved(binding.get(base, base), kind)


def of_candidates(family: LoadedFamily, data: TableData) -> Iterator[Binding]:
    """A binding of axes for each candidate of a family."""
    named, used = marks(family.name), family.marks()
    allowed = family.family.axes
    for binding in _axes(named, used, data):
        if allowed is None or binding.get("a", allowed[0]) in allowed:
            yield binding


def of_members(
    family: LoadedFamily, template: Template, binding: Binding, data: TableData
) -> Iterator[Binding | str]:
    """Bindings of what the candidate's name leaves open; or the reason why there are none."""
    if template.readings and data.table.component is None:
        return
    used = {mark for text in (*template.raw_names, *template.forms) for mark in marks(text)}
    named = marks(family.name)
    columns = {"T": data.temperatures, "c": data.counts, "v": data.others}
    open_columns = [mark for mark in COLUMN_MARKS if mark in used]
    for mark in open_columns:
        if not columns[mark]:
            named_so = " that an equation can name" if mark == "v" and data.unusable else ""
            yield MISSING[mark] + named_so
            return
    for axes in _left_open(named, used, binding, data):
        for names in product(*(columns[mark] for mark in open_columns)):
            yield {**axes, **dict(zip(open_columns, names, strict=True))}


def _axes(named: set[str], used: set[str], data: TableData) -> Iterator[dict[str, str]]:
    known = _known_axes(data)
    if "n" in named or "b" in named:
        # An angle to an axis that was not measured is a tilt: `abbe` and `straightness` say it.
        known = tuple(axis for axis in known if axis in data.table.axes)
    if "n" in named:
        for a, b, n in CYCLIC:
            if a in known and b in known:
                yield {"a": a, "b": b, "n": n}
    elif "b" in named:
        yield from ({"a": a, "b": b} for a, b in _pairs(known))
    elif "a" in named:
        yield from ({"a": a} for a in known)
    else:
        yield {}


def _left_open(
    named: set[str], used: set[str], binding: Binding, data: TableData
) -> Iterator[dict[str, str]]:
    known = _known_axes(data)
    if "b" in used and "b" not in binding:
        if "a" in binding:
            yield from ({**binding, "b": b} for b in known if b != binding["a"])
        else:
            yield from ({"a": a, "b": b} for a, b in _pairs(known))
    elif "a" in used and "a" not in binding:
        yield from ({**binding, "a": a} for a in known)
    else:
        yield dict(binding)


def _known_axes(data: TableData) -> tuple[str, ...]:
    """Axes of the errors and axes along which the places differ; x, y, z first, in this order."""
    own = {*data.table.axes, *data.varying_axes()}
    return (*(axis for axis in POSITIONS if axis in own), *sorted(own - {*POSITIONS}))


def _pairs(axes: tuple[str, ...]) -> list[tuple[str, str]]:
    return [(a, b) for i, a in enumerate(axes) for b in axes[i + 1 :]]
