"""Cases by their number: which sample, and what is done to its bytes, its table or its values."""

import gzip
import json
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import yaml

from fuzz.extremes import EQUATION_PIECES, NO_NUMBERS, NUMBERS, SIGNS, TEXTS, UNITS
from fuzz.samples import Kind, Sample, Sheet, sheet_of
from mtu_cli.files.headers import number
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import parse_yaml

SHARES: Mapping[Kind, int] = {
    "readings": 13, "drift": 8, "points": 14, "machine": 11, "part": 6, "study": 5, "effects": 7,
    "budget": 8, "graph": 4, "components": 2, "thermal": 2, "instrument": 10,
    "control": 7, "map": 3,
}  # fmt: skip
"""Of a hundred cases; a graph takes longest."""
OFTEN_ONE = (1, 1, 1, 2, 4)
"""How many damages a file has."""


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
    sample = rng.choice(samples[rng.choices(known, [SHARES[each] for each in known])[0]])
    return Case(number=number, sample=sample, content=damaged(sample, rng), rng=rng)


def damaged(sample: Sample, rng: Random, mild: float = 0.2) -> bytes:
    """The content of a sample with its structure, its bytes, or both damaged.

    `mild` is the share of those that are damaged but little, so that they can mostly be read.
    Files of other programs have bytes alone.
    """
    content, foreign = sample.content, sample.kind in ("instrument", "control")
    if foreign and rng.random() < 0.6:
        return nudged(content, rng)
    little, draw = rng.random() < mild, rng.random()
    if not foreign and (little or draw < 0.75):
        change = damaged_table if sample.form == "csv" else damaged_tree
        content = change(sample, rng, little).encode("utf-8", "surrogatepass")
    if foreign or (not little and draw > 0.6):
        for _ in range(rng.choice(OFTEN_ONE)):
            content = damaged_bytes(content, rng)
    return content


def nudged(content: bytes, rng: Random) -> bytes:
    for _ in range(rng.randint(1, 4)):
        content = damaged_bytes(content, rng, spliced=True)
    return content


ENDS = (b"\r\n", b"\r", b"\n\n", b"\n\r", b"\x85", b"\xe2\x80\xa8", b"", b",\n", b" \n")
CODINGS = ("utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "cp037")
BEFORE = (b" ", b"  ", b"\t", b"- ", b"# ", b"\n")


def damaged_bytes(content: bytes, rng: Random, *, spliced: bool = False) -> bytes:
    """A piece or line that is gone, another, repeated or elsewhere; other line ends, another code
    page; packed, and perhaps damaged then.
    """
    start = rng.randrange(len(content) + 1)
    piece = content[start : start + rng.choice((1, 1, 1, 1, 2, 4, 16, 64, 512))]
    lines, new = content.splitlines(keepends=True) or [b""], rng.choice(SIGNS)
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match 0 if spliced else rng.choice((0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7)):
        case 0:
            flipped = bytes(byte ^ 1 << rng.randrange(8) for byte in piece[:20])
            put = (b"", new, new + piece, flipped, flipped, piece * rng.choice((2, 2, 3, 50)))
            return content[:start] + rng.choice(put) + content[start + len(piece) :]
        case 1:
            return rng.choice((content[:start], content[start:]))
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case 3:
            lines[i : i + 1] = [lines[i]] * rng.choice((0, 2, 3, 9))
        case 4:
            lines[i] = rng.choice(BEFORE) + lines[i]
        case 5:
            return content.replace(b"\n", rng.choice(ENDS))
        case 6:
            return content.decode("utf-8", "replace").encode(rng.choice(CODINGS), "replace")
        case _:
            whole, *two = (gzip.compress(x, mtime=0) for x in (content, content[:50], content[50:]))
            broken = damaged_bytes(whole, rng, spliced=True)
            return rng.choice((whole, b"".join(two), whole[:start], broken, whole + b"padding"))
    return b"".join(lines)


# Tables that stay tables.

NAMES = """time time_min cycle sequence repeat operation pass direction dir_x nominal_x_mm T_1_degC
x pi T__degC z_mm part error"""
MILD, ODD = (0, 1, 2, 3, 4, 4, 5, 5, 6), (7, 7, 7, 7, 8, 8, 9, 9, 10, 11)
"""Ways to damage a table."""


def damaged_table(sample: Sample, rng: Random, little: bool) -> str:
    """Some damages; `little`: mostly a table that can be read, for what is calculated of it."""
    sheet = sheet_of(sample.content.decode())
    if not little and rng.random() < 0.7:
        # Small tables, of which more rows are out of place.
        start = rng.randrange(len(sheet.rows))
        sheet.rows = sheet.rows[start : start + rng.choice((2, 5, 20))]
    for _ in range(rng.choice((1, 1, 2))):
        change_table(sheet, rng, rng.choice(MILD if little else (*MILD, *ODD)))
    return sheet.text()


def change_table(sheet: Sheet, rng: Random, way: int) -> None:
    """Rows, columns, numbers, cells, names and signs that are others."""
    order, rows = [*range(len(sheet.header))], sheet.rows
    i, j = rng.choice(order), rng.choice(order)
    match way:
        case 0:
            rng.shuffle(rows)
        case 1:
            del rows[rng.choice((1, 1, 2, 3, 10)) :]
        case 2:  # without a part, component or pass
            i, gone = min(i, 3), rng.choice(rows)
            sheet.rows = [row for row in rows if row[i : i + 1] != gone[i : i + 1]] or rows[:1]
        case 3:
            share = rng.choice((0.02, 0.3, 0.9))
            sheet.rows = [row for row in rows if rng.random() > share] or rows[:1]
        case 4:  # a column is gone, twice, or elsewhere; or only in the header
            order[i : i + 1] = rng.choice(([], [i, i], [j]))
            order = order or [0]
            sheet.header = [sheet.header[k] for k in order]
            if rng.random() < 0.8:
                sheet.rows = [[row[k] for k in order if k < len(row)] for row in rows]
        case 5:  # numbers in another unit, rounded, all equal, noisy, one far away
            factor, how, far = 10.0 ** rng.randint(-12, 12), rng.randrange(5), rng.choice(rows)
            for row in (row for row in rows if i < len(row) and (how != 4 or row is far)):
                if (value := number(row[i])) is not None and abs(value) < 1e300:
                    noise, off = rng.gauss(0, 0.01), 10.0 ** rng.randint(-3, 5)
                    new = (value * factor, round(value), 1, value + noise, value + off)
                    row[i] = repr(new[how])
        case 6:  # dates for minutes
            i = sheet.header.index("time_min") if "time_min" in sheet.header else i
            sheet.header[i], ending = "time", rng.choice(("", "", "Z", "+02:00"))
            for n, row in enumerate(rows):
                row[i : i + 1] = [f"2024-05-03T{n // 60 % 24:02d}:{n % 60:02d}:00{ending}"]
        case 7:
            for _ in range(rng.choice((1, 1, 2, 5))):
                rng.choice(rows)[j : j + 1] = [any_cell(rng)]
                j = rng.choice(order)
        case 8:
            same = rng.choice(UNITS) if sheet.header[i] == "unit" else any_cell(rng)
            for row in (row for row in rows if i < len(row) and rng.random() < 0.95):
                row[i] = same
        case 9:
            sheet.header[i] = rng.choice((*NAMES.split(), rng.choice(TEXTS), sheet.header[j]))
        case 10:
            row = rng.choice(rows)
            more = [any_cell(rng)] * rng.choice((1, 1, 2, 300))
            row[:] = rng.choice(([*row, *more], row[: rng.randrange(len(row) + 1)]))
        case _:
            sheet.quoted = rng.random() < 0.5
            sheet.separator = rng.choice((",", ";", ";", "\t", "|", " ", ",,", ", "))
            if sheet.separator != "," and rng.random() < 0.6:
                sheet.rows = [[cell.replace(".", ",") for cell in row] for row in rows]


def any_cell(rng: Random) -> str:
    return rng.choice(rng.choice((NUMBERS, NUMBERS, NO_NUMBERS, TEXTS, UNITS)))


# Trees of values: YAML and JSON.

PLAIN: tuple[Any, ...] = (None, True, False, 0, -1, 1.5, "", [], {}, [[]], [None], {"": 1})
MARKUP = ("&a [1]", "*a", "!!int 3", "!!float 1", "!!str 1", "!x y", "? a", "- 1")


class Bare(str):
    """A text that goes into the file as it stands, without quotes."""


class _NoAliases(yaml.CSafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


@cache
def _values(text: str) -> Any:
    return parse_yaml(text, Source(role="sample", path=Path(), shown="sound", sha256="")).data


def places(data: Any) -> Iterator[tuple[Any, Any]]:
    """Every value by the list or mapping that holds it, and its index or key there."""
    if isinstance(data, dict | list):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield data, key
            yield from places(value)


def damaged_tree(sample: Sample, rng: Random, little: bool) -> str:
    """Some values and keys changed; `little`: a number or two, or an entry less or twice."""
    top = [deepcopy(_values(sample.content.decode()))]
    for _ in range(rng.choice((1, 1, 2))):
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
    return written(top[0], rng, sample.form)


def change_entry(holder: Any, key: Any, rng: Random, *, keep_names: bool) -> None:
    """An entry is gone, in another's place, repeated, or has another name."""
    other = rng.choice([*(holder if isinstance(holder, dict) else range(len(holder)))])
    match rng.randrange(3 if keep_names or isinstance(holder, list) else 4):
        case 0:
            del holder[key]
        case 1:
            holder[key], holder[other] = holder[other], holder[key]
        case 2 if isinstance(holder, list):
            holder[key:key] = [holder[key]] * rng.choice((1, 1, 2, 30))
        case 2:  # the key a second time, with the same value or with another
            holder[Bare(json.dumps(key))] = rng.choice((holder[key], odd_value(rng)))
        case _:
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
        factors = (-1, 0, 10.0 ** rng.randint(-9, 9), 1 + 1e-9, 1.5)
        choices += [str(value), bool(value), *(value * rng.choice(factors) for _ in range(4))]
    elif isinstance(value, str):
        choices += [edited(value, rng) for _ in range(6)] + [value * rng.choice((2, 50, 2000))]
    elif isinstance(value, list | dict) and value:
        inner = [*value.values()] if isinstance(value, dict) else value
        choices += [str(value), [*value], inner, inner[::-1], inner[0], dict(enumerate(inner))]
    return rng.choice(choices)


def odd_value(rng: Random) -> Any:
    bare = Bare(rng.choice(rng.choice((NUMBERS, NUMBERS, NO_NUMBERS, MARKUP))))
    size = rng.choice((rng.uniform(-2, 2), 10.0 ** rng.randint(-30, 30)))
    plain = deepcopy(rng.choice(PLAIN))
    return rng.choice((bare, bare, size, plain, rng.choice(TEXTS), rng.choice(UNITS)))


def edited(text: str, rng: Random) -> str:
    """Equations and names, with pieces put in, taken out or doubled."""
    for _ in range(rng.choice(OFTEN_ONE)):
        start = rng.randrange(len(text) + 1)
        stop = min(len(text), start + rng.choice((0, 0, 1, 2, 6)))
        piece = rng.choice(EQUATION_PIECES if rng.random() < 0.8 else TEXTS)
        text = text[:start] + rng.choice((piece, "", text[start:stop] * 2)) + text[stop:]
    return text


def written(data: Any, rng: Random, form: str) -> str:
    """YAML in one of its styles, or JSON."""
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
