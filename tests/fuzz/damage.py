"""Cases by their number: which sample, and what is done to its bytes, its table or its values."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from math import isfinite
from pathlib import Path
from random import Random
from typing import Any

import yaml

from fuzz.extremes import EQUATION_PIECES, NO_NUMBERS, NUMBERS, SIGNS, TEXTS, UNITS
from fuzz.samples import Kind, Sample, Sheet, sheet_of
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import parse_yaml

SHARES: Mapping[Kind, int] = {
    "readings": 13, "drift": 8, "points": 14, "machine": 11, "part": 6, "study": 5, "effects": 7,
    "budget": 8, "graph": 4, "components": 2, "thermal": 2, "instrument": 10,
    "control": 7, "map": 3,
}  # fmt: skip
"""Of a hundred cases; a graph takes longest."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A damaged sample; `rng` goes on with what the reader or the command is asked for."""

    number: int
    sample: Sample
    content: bytes
    rng: Random


def generator(seed: int, task: str, number: int) -> Random:
    """The random numbers of one case, of their own whatever ran before."""
    return Random(f"{seed} {task} {number}")


def drawn_case(
    samples: Mapping[Kind, Sequence[Sample]], seed: int, number: int, kinds: Sequence[Kind] = ()
) -> Case:
    """Case `number` of the readers, of some `kinds` alone where they are given."""
    rng = generator(seed, "readers", number)
    known = kinds or [*SHARES]
    kind = rng.choices(known, [SHARES[each] for each in known])[0]
    sample = rng.choice(samples[kind])
    return Case(number=number, sample=sample, content=damaged(sample, rng), rng=rng)


def damaged(sample: Sample, rng: Random, mild: float = 0.2) -> bytes:
    """The content of a sample with its structure, its bytes, or both damaged.

    `mild` is the share of those that are damaged but little. Files of other programs have bytes
    alone.
    """
    content = sample.content
    if sample.kind in ("instrument", "control"):
        if rng.random() < 0.6:
            return nudged(content, rng)
        for _ in range(rng.choice((1, 1, 2, 4))):
            content = rng.choice(DAMAGES)(content, rng)
        return content
    little, draw = rng.random() < mild, rng.random()
    if little or draw < 0.75:
        change = damaged_table if sample.form == "csv" else damaged_tree
        content = change(sample, rng, little).encode("utf-8", "surrogatepass")
    if not little and draw > 0.6:
        for _ in range(rng.choice((1, 1, 1, 2, 4))):
            content = rng.choice(DAMAGES)(content, rng)
    return content


# Bytes, whatever they mean.


def flip(content: bytes, rng: Random) -> bytes:
    found = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 3, 20)) if found else 0):
        found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
    return bytes(found)


def splice(content: bytes, rng: Random) -> bytes:
    """A piece, mostly a short one, is gone, another, repeated, or has something before it."""
    start = rng.randrange(len(content) + 1)
    stop = min(len(content), start + rng.choice((1, 1, 1, 1, 2, 4, 16, 64, 512)))
    piece, new = content[start:stop], rng.choice(SIGNS)
    put = (b"", new, new + piece, rng.randbytes(2) + piece, piece * rng.choice((2, 2, 3, 50)))
    return content[:start] + rng.choice(put) + content[stop:]


def cut_off(content: bytes, rng: Random) -> bytes:
    at = rng.randrange(len(content) + 1)
    return rng.choice((content[:at], content[at:]))


def change_lines(content: bytes, rng: Random) -> bytes:
    """A line in another's place, repeated, gone, or with something before it."""
    lines = content.splitlines(keepends=True) or [b""]
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(4):
        case 0:
            lines[i], lines[j] = lines[j], lines[i]
        case 1:
            lines[i:i] = [lines[i]] * rng.choice((1, 1, 2, 9))
        case 2:
            del lines[i]
        case _:
            lines[i] = rng.choice((b" ", b"  ", b"\t", b"- ", b"# ", b"\n")) + lines[i]
    return b"".join(lines)


def change_ends(content: bytes, rng: Random) -> bytes:
    ends = (b"\r\n", b"\r", b"\n\n", b"\n\r", b"\x85", b"\xe2\x80\xa8", b"", b",\n", b" \n")
    return content.replace(b"\n", rng.choice(ends))


def encode_anew(content: bytes, rng: Random) -> bytes:
    coding = rng.choice(("utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "cp037"))
    return content.decode("utf-8", "replace").encode(coding, "replace")


def pack(content: bytes, rng: Random) -> bytes:
    """Packed as it is, in two members, cut short, damaged, or with padding behind."""
    whole, one, two = (
        gzip.compress(part, mtime=0) for part in (content, content[:50], content[50:])
    )
    padded = whole + rng.randbytes(rng.choice((1, 2, 30)))
    return rng.choice((whole, one + two, cut_off(whole, rng), flip(whole, rng), padded))


def nudged(content: bytes, rng: Random) -> bytes:
    """A few places changed."""
    for _ in range(rng.randint(1, 4)):
        content = rng.choice((flip, splice))(content, rng)
    return content


Damage = Callable[[bytes, Random], bytes]
DAMAGES: tuple[Damage, ...] = (
    flip, flip, splice, splice, splice, splice, splice, cut_off, change_lines, change_lines,
    change_ends, encode_anew, pack,
)  # fmt: skip


# Tables that stay tables: what bytes and lines above do to them is not done here again.


def damaged_table(sample: Sample, rng: Random, little: bool) -> str:
    """Some damages; `little`: mostly a table that can be read, for what is calculated of it."""
    sheet = sheet_of(sample.content.decode())
    if not little and rng.random() < 0.7:
        # Small tables, of which more rows are out of place.
        start = rng.randrange(len(sheet.rows))
        sheet.rows = sheet.rows[start : start + rng.choice((2, 5, 20))]
    for _ in range(rng.choice((1, 1, 2)) if little else rng.choice((1, 1, 1, 2, 3))):
        rng.choice(MILD if little else (*MILD, *ODD))(sheet, rng)
    return sheet.text()


def some_rows(sheet: Sheet, rng: Random) -> None:
    """In another order, the first, without a part or component or pass, or a share of them."""
    match rng.randrange(4):
        case 0:
            rng.shuffle(sheet.rows)
        case 1:
            del sheet.rows[rng.choice((1, 1, 2, 3, 10)) :]
        case 2:
            column = rng.randrange(min(4, len(sheet.header)))
            gone = rng.choice(sheet.rows)[column : column + 1]
            kept = [row for row in sheet.rows if row[column : column + 1] != gone]
            sheet.rows = kept or sheet.rows[:1]
        case _:
            share = rng.choice((0.02, 0.3, 0.9))
            sheet.rows = [row for row in sheet.rows if rng.random() > share] or sheet.rows[:1]


def change_columns(sheet: Sheet, rng: Random) -> None:
    """One is gone, another twice, two in each other's place; or only in the header."""
    order = [*range(len(sheet.header))]
    i, j = rng.choice(order), rng.choice(order)
    match rng.randrange(3):
        case 0 if len(order) > 1:
            del order[i]
        case 1:
            order.append(i)
        case _:
            order[i], order[j] = order[j], order[i]
    sheet.header = [sheet.header[k] for k in order]
    if rng.random() < 0.8:
        sheet.rows = [[row[k] for k in order if k < len(row)] for row in sheet.rows]


def change_numbers(sheet: Sheet, rng: Random) -> None:
    """Numbers of a column that stay numbers: in another unit, rounded, all equal, one far away."""
    column, factor = rng.randrange(len(sheet.header)), 10.0 ** rng.randint(-12, 12)
    way, only = rng.randrange(5), rng.randrange(len(sheet.rows))
    for i, row in enumerate(sheet.rows):
        try:
            value = float(row[column])
        except (ValueError, IndexError):
            continue
        if isfinite(value) and (way != 4 or i == only):
            noise, far = rng.gauss(0, 0.01), 10.0 ** rng.randint(-3, 5)
            row[column] = repr((value * factor, round(value), 1, value + noise, value + far)[way])


def dates(sheet: Sheet, rng: Random) -> None:
    """A column of times in place of one of minutes, one of them perhaps no time."""
    name = "time_min" if "time_min" in sheet.header else rng.choice(sheet.header)
    column, ending = sheet.header.index(name), rng.choice(("", "", "Z", "+02:00"))
    sheet.header[column] = "time"
    for i, row in enumerate(sheet.rows):
        if column < len(row):
            row[column] = f"2024-05-03T{i // 60 % 24:02d}:{i % 60:02d}:00{ending}"
    if rng.random() < 0.4:
        set_cells(sheet, rng)


def _any_cell(rng: Random) -> str:
    return rng.choice(rng.choice((NUMBERS, NUMBERS, NO_NUMBERS, TEXTS, UNITS)))


def set_cells(sheet: Sheet, rng: Random) -> None:
    for _ in range(rng.choice((1, 1, 2, 5))):
        row = rng.choice(sheet.rows)
        if row:
            row[rng.randrange(len(row))] = _any_cell(rng)


def set_column(sheet: Sheet, rng: Random) -> None:
    column = rng.randrange(len(sheet.header))
    value = rng.choice(UNITS) if sheet.header[column] == "unit" else _any_cell(rng)
    for row in sheet.rows:
        if column < len(row) and rng.random() < 0.95:
            row[column] = value


NAMES = """time time_min cycle sequence repeat operation pass direction dir_x nominal_x_mm T_1_degC
x pi T__degC z_mm part error"""


def rename_column(sheet: Sheet, rng: Random) -> None:
    name = rng.choice((*NAMES.split(), rng.choice(TEXTS), rng.choice(sheet.header)))
    sheet.header[rng.randrange(len(sheet.header))] = name


def other_length(sheet: Sheet, rng: Random) -> None:
    row = rng.choice(sheet.rows)
    more = [_any_cell(rng) if rng.random() < 0.5 else ""] * rng.choice((1, 1, 2, 300))
    row[:] = rng.choice(([*row, *more], row[: rng.randrange(len(row) + 1)]))


def other_signs(sheet: Sheet, rng: Random) -> None:
    sheet.quoted = rng.random() < 0.5
    sheet.separator = rng.choice((",", ";", ";", "\t", "|", " ", ",,", ", "))
    if sheet.separator != "," and rng.random() < 0.6:
        sheet.rows = [[cell.replace(".", ",") for cell in row] for row in sheet.rows]


TableDamage = Callable[[Sheet, Random], None]
MILD: tuple[TableDamage, ...] = (
    some_rows, some_rows, change_columns, change_numbers, change_numbers, dates,
)  # fmt: skip
ODD: tuple[TableDamage, ...] = (
    set_cells, set_cells, set_cells, set_cells, set_column, set_column, rename_column,
    rename_column, other_length, other_signs,
)  # fmt: skip


# Trees of values: YAML and JSON.


class Bare(str):
    """A text that goes into the file as it stands, without quotes."""


@cache
def _values(text: str) -> Any:
    source = Source(role="sample", path=Path(), shown="sound", sha256="")
    return parse_yaml(text, source).data


def places(data: Any) -> Iterator[tuple[Any, Any]]:
    """Every value by the list or mapping that holds it, and its index or key there."""
    if isinstance(data, dict | list):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield data, key
            yield from places(value)


def damaged_tree(sample: Sample, rng: Random, little: bool) -> str:
    """Some values and keys changed; `little`: a number or two, or an entry less or twice."""
    top = [deepcopy(_values(sample.content.decode()))]
    for _ in range(rng.choice((1, 1, 2)) if little else rng.choice((1, 1, 1, 2, 3))):
        found = [*places(top if rng.random() < 0.02 else top[0])]
        numbers = [place for place in found if type(place[0][place[1]]) in (int, float)]
        if little and numbers and rng.random() < 0.7:
            holder, key = rng.choice(numbers)
            holder[key] *= rng.choice((-1, 0, 10.0 ** rng.randint(-9, 9), 1 + 1e-9, 1.5))
        elif found:
            holder, key = rng.choice(found)
            if rng.random() < (0.0 if little else 0.7):
                holder[key] = other_value(holder[key], rng)
            elif holder is not top:
                change_entry(holder, key, rng, keep_names=little)
    return _written(top[0], rng, sample.form)


def change_entry(holder: Any, key: Any, rng: Random, *, keep_names: bool) -> None:
    """An entry is gone, in another's place, repeated, or has another name."""
    other = rng.choice([*(holder if isinstance(holder, dict) else range(len(holder)))])
    match rng.randrange(3 if keep_names else 4):
        case 0:
            del holder[key]
        case 1:
            holder[key], holder[other] = holder[other], holder[key]
        case 2 if isinstance(holder, list):
            holder[key:key] = [holder[key]] * rng.choice((1, 1, 2, 30))
        case 2:
            # The key a second time, with the same value or with another.
            twice = Bare(json.dumps(key))
            holder[twice] = holder[key] if rng.random() < 0.5 else odd_value(rng)
        case _ if isinstance(holder, dict):
            own = str(key)
            near = (own[:-1], own + "s", own.upper(), own.replace("_", "-"), own + " ")
            more = (*TEXTS[:40], "x", "pi", "sin", "z", "notes", "says", "u", "dof", "unit", "id")
            new = rng.choice((rng.choice(near), rng.choice(more), other))
            entries = [(new if name == key else name, value) for name, value in holder.items()]
            holder.clear()
            holder.update(entries)


def other_value(value: Any, rng: Random) -> Any:
    """What stands in a value's place: something odd, of another type, a number times another."""
    wrapped = value
    for _ in range(rng.choice((1, 1, 2, 80))):
        wrapped = rng.choice(([wrapped], {"a": wrapped}))
    choices = [odd_value(rng), odd_value(rng), wrapped]
    if isinstance(value, bool | int | float):
        choices += [str(value), float(value), bool(value), int(value)]
        factors = (-1, 0, 10.0 ** rng.randint(-9, 9), 1 + 1e-9, 1.5)
        choices += [value * rng.choice(factors) for _ in range(3)]
    elif isinstance(value, str):
        choices += [edited(value, rng) for _ in range(6)] + [value * rng.choice((2, 50, 2000))]
    elif isinstance(value, list | dict) and value:
        inner = [*value.values()] if isinstance(value, dict) else value
        mixed = rng.sample([*value], len(value))
        choices += [str(value), [*value], inner, inner[0], {str(i): v for i, v in enumerate(inner)}]
        choices += [{key: value[key] for key in mixed} if isinstance(value, dict) else mixed]
    return rng.choice(choices)


PLAIN: tuple[Any, ...] = (
    None, True, False, 0, -1, 1.5, "", [], {}, [[]], [None], {"": 1},
)  # fmt: skip
MARKUP = ("&a [1]", "*a", "!!int 3", "!!float 1", "!!str 1", "!x y", "? a", "- 1")


def odd_value(rng: Random) -> Any:
    bare = Bare(rng.choice(rng.choice((NUMBERS, NUMBERS, NO_NUMBERS, MARKUP))))
    number = rng.choice((rng.uniform(-2, 2), 10.0 ** rng.randint(-30, 30)))
    plain = deepcopy(rng.choice(PLAIN))
    return rng.choice((bare, bare, number, plain, rng.choice(TEXTS), rng.choice(UNITS)))


def edited(text: str, rng: Random) -> str:
    """Equations and names, with pieces put in, taken out or doubled."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        start = rng.randrange(len(text) + 1)
        stop = min(len(text), start + rng.choice((0, 0, 1, 2, 6)))
        piece = rng.choice(EQUATION_PIECES) if rng.random() < 0.8 else rng.choice(TEXTS)
        text = text[:start] + rng.choice((piece, "", text[start:stop] * 2)) + text[stop:]
    return text


def _written(data: Any, rng: Random, form: str) -> str:
    bare: list[str] = []

    def marked(value: Any) -> Any:
        if isinstance(value, Bare):
            bare.append(value)
            return f"@bare{len(bare) - 1}@"
        if isinstance(value, dict):
            return {marked(key): marked(item) for key, item in value.items()}
        return [marked(item) for item in value] if isinstance(value, list) else value

    data = marked(data)
    if form == "json" or rng.random() < 0.3:
        text = json.dumps(data, ensure_ascii=rng.random() < 0.5, indent=rng.choice((None, 1)))
    else:
        flow = rng.choice((False, None, True))
        text = yaml.dump(
            data, Dumper=_NoAliases, sort_keys=False, allow_unicode=True, default_flow_style=flow
        )
    for i, value in enumerate(bare):
        for mark in (f'"@bare{i}@"', f"'@bare{i}@'", f"@bare{i}@"):
            text = text.replace(mark, value)
    return text


class _NoAliases(yaml.CSafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True
