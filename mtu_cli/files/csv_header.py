"""The header of a CSV table: columns that are missing, doubled, or named a little differently."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from difflib import get_close_matches
from itertools import pairwise

from mtu_cli.errors import InputError, Problem
from mtu_cli.files.column_lengths import in_other_unit, renaming
from mtu_cli.files.column_words import AXES, direction_along, meant_by, nominal_by_sign, plain
from mtu_cli.files.covariates import looks_like_temperature
from mtu_cli.files.csv_cells import is_text, number
from mtu_cli.files.csv_first_line import LOOKED_AT
from mtu_cli.files.csv_missing import (
    COORDINATES,
    CYCLES,
    IN_MM,
    MEASUREMENTS,
    OTHER_WORDS,
    REPEATS,
    RUNS,
    UNIT,
    meant_columns,
    missing_column,
    squeezed,
)
from mtu_cli.files.csv_mistaken import refuse_other_table, row_per_axis
from mtu_cli.files.csv_table import TableSpec
from mtu_cli.files.csv_text import CsvText, Decimal, first_rows
from mtu_cli.files.names import EXPECTED, NO_NAME, is_name
from mtu_cli.files.sensor_names import may_be_tool, no_sensor
from mtu_cli.files.source import DRIFT
from mtu_cli.findings import Finding

NUMBER = ("no", "nr", "number", "num", "id")
KEY = "id"
"""What a run or a measurement has of a data base is no count."""
NUMBERED = ("part", "feature", "cycle", "pass", "repeat", "sequence")
"""Columns that others tell as a number; one of a time or an operation is no time or name."""
SLIP = 0.9
"""Likeness of two names from which on one is the other with a slip: sequence and squence."""
SHOWN_RUNS = 6
"""Columns without a name, or runs of them, that are told one by one."""


def check_header(text: CsvText, spec: TableSpec) -> None:
    """Raises InputError for columns that are missing, doubled, without name or at odds."""
    refuse_other_table(text, spec)
    shown, row, header = text.source.shown, text.header_row, text.header
    problems: list[Finding] = []
    places: dict[str, int] = {}
    for index, name in enumerate(header):
        if name and not is_name(name):
            problems.append(
                Problem(what=NO_NAME, file=shown, row=row, value=name, expected=EXPECTED)
            )
        elif name and places.setdefault(name, index) != index:
            what = f"the column stands twice, as column {places[name] + 1} and {index + 1}"
            problems.append(Problem(what=what, file=shown, row=row, column=name))
    problems += _nameless(shown, row, header, text.separator)
    wanted = list(spec.required)
    wanted += [b for a, b in spec.together if a in header]
    wanted += [a for a, b in spec.together if b in header]
    absent = [name for name in dict.fromkeys(wanted) if name not in header]
    meant = meant_columns(absent, header, spec)
    problems += _missing(text, spec, meant)
    for first, second in spec.exclusive:
        if first in header and second in header:
            what = f"both {first!r} and {second!r} are given"
            problems.append(Problem(what=what, file=shown, row=row, expected="one of them"))
    named = [
        problem
        for problem in _named_otherwise(text, spec, wanted)
        # One column is told to be one other.
        if problem.column not in meant.values()
    ]
    # What may be a column of its own is no fault by itself: `column_twins` tells of it.
    if problems or not all(_doubtful(str(problem.column), spec) for problem in named):
        known = {problem.column for problem in problems + named} | {*meant.values()}
        raise InputError(problems + named + list(_told_later(text, spec, known)))


def _nameless(shown: str, row: int, header: tuple[str, ...], separator: str) -> Iterator[Finding]:
    """The one problem of all columns without a name."""
    places = [index for index, name in enumerate(header, 1) if not name]
    if not places:
        return
    starts = [i for i, place in enumerate(places) if i == 0 or place != places[i - 1] + 1]
    runs = [places[a:b] for a, b in pairwise([*starts, len(places)])]
    told = [f"{run[0]} to {run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs[:SHOWN_RUNS]]
    left = len(places) - sum(map(len, runs[:SHOWN_RUNS]))
    several = f"columns {', '.join(told)}{f' and {left} more' if left else ''} have no name"
    what = several if len(places) > 1 else f"column {told[0]} has no name"
    expected = "a name (spreadsheets leave empty columns: delete them)"
    if places == [len(header)]:
        # Of programs that end each row with the sign that stands between columns.
        what += f", as the header ends with {separator!r}"
        expected = f"a name, or rows without {separator!r} at their end"
    yield Problem(what=what, file=shown, row=row, expected=expected)


def _missing(text: CsvText, spec: TableSpec, meant: Mapping[str, str | None]) -> Iterator[Finding]:
    """Of columns that are not there; of a table with a row for each axis that is the one fault."""
    asked = [name for name in spec.required if name in COORDINATES]
    found = any(name not in meant or meant[name] for name in asked)
    by_axis = row_per_axis(text, asked, spec, meant) if asked and not found else None
    place = (text.source.shown, text.header_row, text.header)
    for name in meant:
        if by_axis is None or name not in COORDINATES:
            yield missing_column(name, *place, spec, meant)
    if by_axis is not None:
        yield by_axis


def _told_later(
    text: CsvText, spec: TableSpec, known: Collection[str | int | None]
) -> Iterator[Finding]:
    """What is told of columns that are not `known` once the header is sound, so that all is told at
    once; by the first rows, as far as cells tell.
    """
    header = frozenset(text.header)
    of_points = "feature" in spec.required
    repeats = MEASUREMENTS if of_points and "repeat" not in text.header else ()
    rows = first_rows(text, LOOKED_AT)
    for index, name in enumerate(text.header):
        if spec.named(name) or name in known or not is_name(name):
            continue
        cells = [row[index].strip() for row in rows if index < len(row)]
        if looks_like_temperature(name):
            # By itself that is no fault in points, but warned of.
            fault = not may_be_tool(name) if of_points else text.source.role == DRIFT
            if fault and not any(is_text(cell, text.decimal) for cell in cells):
                yield no_sensor(text, name, header)
        elif plain(name).strip() in repeats and cells and _numbered(cells, text.decimal):
            yield _otherwise(text, name, "repeat", " where it numbers these")


def _numbered(cells: Sequence[str], decimal: Decimal) -> bool:
    """Whether cells are whole numbers from 0 or 1 on."""
    values = [number(cell, decimal) for cell in cells]
    found = [value for value in values if value is not None and value.is_integer()]
    return len(found) == len(cells) and min(found) in (0, 1)


def _doubtful(name: str, spec: TableSpec) -> bool:
    return may_count(name, spec) or bool(direction_along(name) or nominal_by_sign(name))


def may_count(name: str, spec: TableSpec) -> bool:
    """Whether a column counts something, the repeats maybe: `Run`, `run_no`, `measurement no`; of
    points a `Cycle` too, which names a warm-up of readings.
    """
    counts = RUNS + CYCLES if spec.named("repeat") else RUNS
    *before, last = re.split(r"[-_ .]+", plain(name).strip(" ."))
    if before and last in NUMBER and last != KEY:
        return squeezed("_".join(before)) in counts + MEASUREMENTS
    return squeezed(name) in counts or squeezed(name).removesuffix("s") in counts


def _named_otherwise(text: CsvText, spec: TableSpec, wanted: list[str]) -> Iterator[Finding]:
    """Optional columns that only their spelling, or another word, keeps from being read: they
    would be lost.
    """
    header = text.header
    known = {
        squeezed(word): name
        for name in spec.names
        if name not in header + tuple(wanted)
        for word in (name, *OTHER_WORDS.get(name, ()))
        if not (text.source.role == DRIFT and name == "pass" and word in REPEATS)
    }
    lengths = [name for name in known.values() if name.endswith(UNIT)]
    bare = {squeezed(name.removesuffix(UNIT)): name for name in lengths}
    # A z in um beside x and y in mm is a column of its own, beside x and y in um it is not.
    missing = [name for name in wanted if name not in header and name.endswith(UNIT)]
    foreign = any(in_other_unit(other, missing) for other in header if missing)
    converted = [name for name in lengths if foreign or name not in COORDINATES]
    shut = {b for a, b in spec.exclusive if a in header} | {
        a for a, b in spec.exclusive if b in header
    }
    for other in filter(None, header):
        # Without its unit a name is meant as it stands: `nominal` is no slip of `nominal_z`.
        without_unit = IN_MM.sub("", other)
        name = _meant(other, known) or bare.get(squeezed(without_unit))
        if name is None and without_unit != other:
            name = _meant(without_unit, {w: own for w, own in known.items() if own in lengths})
        if name is None:
            by_words = (meant_by(other), direction_along(other))
            name = next((word for word in by_words if word in known.values()), None)
        name = name or _by_a_slip(other, known) or in_other_unit(other, converted)
        if not spec.named(other) and name is not None and name not in shut:
            shut |= {b for pair in spec.exclusive if name in pair for b in pair if b != name}
            yield _otherwise(text, other, name, _minutes(name))


def _otherwise(text: CsvText, other: str, name: str, more: str) -> Finding:
    """The Problem of the column `other` that is likely the column `name`."""
    return Problem(
        what=f"the column {other!r} would not be read as {name!r}",
        file=text.source.shown,
        row=text.header_row,
        column=other,
        expected=f"{renaming(other, name)}{more}, or to a name of its own",
    )


def _minutes(name: str) -> str:
    """What else a column of times may be: only its cells tell dates from minutes."""
    return " ('time_min' where it counts minutes)" if name == "time" else ""


def _meant(name: str, known: Mapping[str, str]) -> str | None:
    """The column that a name means by another word, in the plural, or as a number (`cycle_no`)."""
    folded = squeezed(name)
    if folded in known:
        return known[folded]
    *before, last = re.split(r"[-_ .]+", plain(name).strip(" ."))
    if before and last in (*NUMBER, "s"):
        word = squeezed("_".join(before))
        # Of readings a cycle has a name, and an id is one.
        counts = RUNS + CYCLES if known.get(word) == "repeat" else RUNS
        if last == KEY and word in counts + MEASUREMENTS:
            return None
        if word in MEASUREMENTS and last in NUMBER and "repeat" in known.values():
            return "repeat"
        counted = known.get(word)
        return counted if last in NUMBER and counted in NUMBERED else None
    return known.get(folded.removesuffix("s"))


def _by_a_slip(name: str, known: Mapping[str, str]) -> str | None:
    """The column that a name means with a slip of a letter; one with something else added
    (`direction_x`, `time_s`) is a name of its own, and so is one along another axis.
    """
    folded = squeezed(name)
    own = _axes(name)
    words = [word for word, column in known.items() if _axes(column) == own]
    near = get_close_matches(folded, words, n=1, cutoff=SLIP)
    return known[near[0]] if near and not folded.startswith(near[0]) else None


def _axes(name: str) -> set[str]:
    """The axes that are words of a name."""
    return set(re.findall("[a-z]+", plain(name))) & set(AXES)
