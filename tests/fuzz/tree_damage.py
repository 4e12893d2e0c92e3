"""Damage to the values of YAML and JSON files: keys, types, numbers, equations, lists."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from random import Random
from typing import Any

import yaml

from fuzz.extremes import EQUATION_PIECES, NO_NUMBERS, NUMBERS, TEXTS, UNITS

Place = tuple[Any, Any]
"""A list or mapping, and the index or key of a value in it."""


class _Raw:
    """Texts that go into the file as they are, without quotes."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def put(self, text: str) -> str:
        self.texts.append(text)
        return f"@raw{len(self.texts) - 1}@"

    def filled(self, written: str) -> str:
        for index, text in enumerate(self.texts):
            mark = f"@raw{index}@"
            for form in (f'"{mark}"', f"'{mark}'", mark):
                written = written.replace(form, text)
        return written


def places(data: Any) -> Iterator[Place]:
    """Every value with the list or mapping that holds it."""
    if isinstance(data, dict | list):
        items = data.items() if isinstance(data, dict) else enumerate(data)
        for key, value in items:
            yield data, key
            yield from places(value)


def _value(rng: Random, raw: _Raw) -> Any:
    match rng.randrange(8):
        case 0 | 1:
            return raw.put(rng.choice(NUMBERS))
        case 2:
            return raw.put(rng.choice(NO_NUMBERS))
        case 3:
            return rng.choice(TEXTS)
        case 4:
            return rng.choice((None, True, False, 0, -1, 1.5, "", [], {}, [[]], [None], {"": 1}))
        case 5:
            return rng.choice(
                (rng.uniform(-2, 2), 10.0 ** rng.randint(-30, 30), rng.randint(-9, 99))
            )
        case 6:
            return rng.choice(UNITS)
    return raw.put(
        rng.choice(("&a [1]", "*a", "!!int 3", "!!float 1", "!!str 1", "!x y", "? a", "- 1"))
    )


def replace(place: Place, rng: Random, raw: _Raw) -> None:
    holder, key = place
    holder[key] = _value(rng, raw)


def remove(place: Place, rng: Random, raw: _Raw) -> None:
    holder, key = place
    del holder[key]


def rename(place: Place, rng: Random, raw: _Raw) -> None:
    holder, key = place
    if isinstance(holder, dict):
        near = (key[:-1], key + "s", key.upper(), key.replace("_", "-"), key + " ")
        new = rng.choice((*near, *TEXTS[:12], "x", "pi", "sin", "z", rng.choice([*holder])))
        entries = [(new if name == key else name, value) for name, value in holder.items()]
        holder.clear()
        holder.update(entries)


def add(place: Place, rng: Random, raw: _Raw) -> None:
    holder, key = place
    if isinstance(holder, dict):
        holder[rng.choice((*TEXTS[:40], "notes", "says", "u", "dof", "unit", "id"))] = holder[key]
    else:
        holder.insert(key, holder[key])


def twice(place: Place, rng: Random, raw: _Raw) -> None:
    """The key a second time, with the same value or with another."""
    holder, key = place
    if isinstance(holder, dict):
        value = holder[key] if rng.random() < 0.5 else _value(rng, raw)
        holder[raw.put(json.dumps(key))] = value


def wrap(place: Place, rng: Random, raw: _Raw) -> None:
    holder, key = place
    for _ in range(rng.choice((1, 1, 2, 80))):
        holder[key] = [holder[key]] if rng.random() < 0.5 else {"a": holder[key]}


def unwrap(place: Place, rng: Random, raw: _Raw) -> None:
    holder, key = place
    inner = holder[key]
    if isinstance(inner, dict | list) and inner:
        holder[key] = next(iter(inner.values())) if isinstance(inner, dict) else inner[0]


def change_type(place: Place, rng: Random, raw: _Raw) -> None:
    holder, key = place
    value = holder[key]
    if isinstance(value, bool | int | float):
        holder[key] = rng.choice((str(value), [value], float(value), bool(value), int(value)))
    elif isinstance(value, dict):
        holder[key] = rng.choice(([*value.values()], [*value], str(value)))
    elif isinstance(value, list):
        holder[key] = rng.choice(({str(i): v for i, v in enumerate(value)}, str(value)))
    else:
        holder[key] = _value(rng, raw)


def change_number(place: Place, rng: Random, raw: _Raw) -> None:
    holder, key = place
    value = holder[key]
    if isinstance(value, int | float) and not isinstance(value, bool):
        factor = rng.choice((-1, 0, 10.0 ** rng.randint(-9, 9), 1 + 1e-9, 1.5))
        holder[key] = value * factor
    else:
        replace(place, rng, raw)


def change_text(place: Place, rng: Random, raw: _Raw) -> None:
    """Equations and names, with pieces put in, taken out or doubled."""
    holder, key = place
    value = holder[key]
    if not isinstance(value, str):
        return replace(place, rng, raw)
    for _ in range(rng.choice((1, 1, 2, 4))):
        start = rng.randrange(len(value) + 1)
        stop = min(len(value), start + rng.choice((0, 0, 1, 2, 6)))
        piece = rng.choice(EQUATION_PIECES) if rng.random() < 0.8 else rng.choice(TEXTS)
        value = value[:start] + rng.choice((piece, "", value[start:stop] * 2)) + value[stop:]
    holder[key] = value
    return None


def shuffle(place: Place, rng: Random, raw: _Raw) -> None:
    holder, key = place
    inner = holder[key]
    if isinstance(inner, list):
        rng.shuffle(inner)
    elif isinstance(inner, dict):
        entries = [*inner.items()]
        rng.shuffle(entries)
        inner.clear()
        inner.update(entries)


def swap_with_other(place: Place, rng: Random, raw: _Raw) -> None:
    holder, _ = place
    keys = [*(holder if isinstance(holder, dict) else range(len(holder)))]
    one, two = rng.choice(keys), rng.choice(keys)
    holder[one], holder[two] = holder[two], holder[one]


def repeat(place: Place, rng: Random, raw: _Raw) -> None:
    holder, key = place
    inner = holder[key]
    if isinstance(inner, list) and inner:
        inner += inner[: rng.choice((1, 1, len(inner)))] * rng.choice((1, 2, 30))
    elif isinstance(inner, str):
        holder[key] = inner * rng.choice((2, 50, 2000))


DAMAGES: tuple[Callable[[Place, Random, _Raw], None], ...] = (
    replace, replace, replace, remove, remove, rename, rename, add, twice, wrap, unwrap,
    change_type, change_type, change_number, change_number, change_number, change_text,
    change_text, change_text, shuffle, swap_with_other, repeat,
)  # fmt: skip


def mildly_damaged_tree(data: Any, rng: Random, form: str) -> str:
    """The text of a file with a number or two of it changed, or an entry less."""
    raw = _Raw()
    for _ in range(rng.choice((1, 1, 2))):
        found = [*places(data)]
        numbers = [(holder, key) for holder, key in found if isinstance(holder[key], float | int)]
        if numbers and rng.random() < 0.7:
            change_number(rng.choice(numbers), rng, raw)
        elif found:
            rng.choice((remove, shuffle, swap_with_other, add))(rng.choice(found), rng, raw)
    return raw.filled(_written(data, rng, form))


def damaged_tree(data: Any, rng: Random, form: str) -> str:
    """The text of a file of damaged values; `form` is "yaml" or "json". Changes `data`."""
    raw = _Raw()
    top = [data]
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        found = [*places(top[0])]
        whole = not found or rng.random() < 0.02
        place = (top, 0) if whole else rng.choice(found)
        if whole:
            replace(place, rng, raw)
        else:
            rng.choice(DAMAGES)(place, rng, raw)
    return raw.filled(_written(top[0], rng, form))


def _written(data: Any, rng: Random, form: str) -> str:
    if form == "json" or rng.random() < 0.3:
        return json.dumps(data, ensure_ascii=rng.random() < 0.5, indent=rng.choice((None, 1)))
    flow = rng.choice((False, None, True))
    written: str = yaml.dump(
        data, Dumper=_NoAliases, sort_keys=False, allow_unicode=True, default_flow_style=flow
    )
    return written


class _NoAliases(yaml.CSafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True
