"""The header of a CSV table: columns that are missing, doubled, or named a little differently."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Sequence

from mtu_cli.files.covariates import as_temperature, looks_like_temperature
from mtu_cli.files.csv_table import CellFaults, Table, TableSpec
from mtu_cli.files.names import EXPECTED, is_name
from mtu_cli.files.source import Source
from mtu_cli.findings import Finding, InputError, closest, error, finding, listed

SYNONYMS: dict[str, tuple[str, ...]] = {
    "part": ("workpiece", "piece", "serial", "serial number", "sn", "teil", "werkstuck"),
    "feature": ("hole", "bore", "point", "element", "characteristic", "merkmal", "bohrung"),
    "repeat": ("repetition", "replicate", "run", "trial", "measurement", "wiederholung"),
    "operation": ("process",),
    "sequence": ("order", "reihenfolge"),
    "component": ("error component", "error name", "parameter", "komponente"),
    "error": ("value", "reading", "deviation", "abweichung"),
    "unit": ("units", "einheit"),
    "position_mm": ("position", "pos", "target", "target position", "nominal position"),
    "pass": ("run", "repeat", "repetition", "durchlauf"),
    "direction": ("dir", "approach", "richtung"),
    "cycle": ("warm up", "zyklus"),
    "time": ("timestamp", "date", "datetime", "zeit"),
    "time_min": ("minutes", "elapsed min"),
    **{
        f"{axis}_mm": (axis, *(f"{word} {axis}" for word in ("actual", "measured", "act", "ist")))
        for axis in "xyz"
    },
    **{
        f"nominal_{axis}_mm": tuple(f"{word} {axis}" for word in ("nominal", "nom", "soll"))
        for axis in "xyz"
    },
    **{f"dir_{axis}": (f"direction {axis}", f"approach {axis}") for axis in "xyz"},
}
"""What other programs call a column: words in any order, without unit, number and accents."""
OF_NUMBERS = {"no", "nr", "number", "num", "id", "name", "mm", "s"}
"""Words that say nothing more."""
SLIP = 0.9
KINDS = {
    ("component", "error", "unit"): ("readings of components", "--lbb, --laser or --drift"),
    ("part", "feature", "x_mm", "y_mm"): ("measured points", "--cmm"),
}
"""What a table is that requires these columns, and the options that take it."""


def check_header(source: Source, row: int, header: Sequence[str], spec: TableSpec) -> None:
    """Raises InputError for columns that are missing, doubled, without a name or at odds."""
    _refuse_other_table(source, row, header, spec)
    place = {"file": source.shown, "row": row}
    found = [each.at(**place) for each in _names(header)]
    wanted = [*spec.required]
    wanted += [b for a, b in spec.together if a in header]
    wanted += [a for a, b in spec.together if b in header]
    absent = [name for name in dict.fromkeys(wanted) if name not in header]
    free = [name for name in header if name and not spec.named(name)]
    taken: set[str] = set()
    for name in absent:
        near = meant_by(name, [other for other in free if other not in taken])
        taken |= {near} if near else set()
        known = f"a column {name!r} (the columns are {listed(header, 12)})"
        expected = f"{near!r} renamed to {name!r}" if near else known
        found.append(finding("missing-column", name=name, expected=expected, **place))
    shut = set(header) | {b for pair in spec.exclusive for b in pair if set(pair) & set(header)}
    for name in (name for name in spec.names if name not in shut and name not in absent):
        other = meant_by(name, [other for other in free if other not in taken], slips=True)
        if other is not None:
            taken.add(other)
            expected = f"{other!r} renamed to {name!r}, or to a name of its own"
            facts = {"other": other, "name": name, "expected": expected}
            found.append(finding("misnamed-column", column=other, **facts, **place))
    for first, second in spec.exclusive:
        if first in header and second in header:
            facts = {"first": first, "second": second, "expected": "one of them"}
            found.append(finding("exclusive-columns", **facts, **place))
    if found:
        raise InputError(found)


def _names(header: Sequence[str]) -> Iterator[Finding]:
    places: dict[str, int] = {}
    for index, name in enumerate(header):
        if not name:
            yield finding("nameless-column", place=index + 1, expected="a name, or no such column")
        elif not is_name(name):
            yield finding("not-printable", value=name, expected=EXPECTED)
        elif places.setdefault(name, index) != index:
            first = places[name] + 1
            yield finding("doubled-column", column=name, first=first, second=index + 1)


def meant_by(name: str, others: Sequence[str], slips: bool = False) -> str | None:
    """The column among `others` that is probably meant as `name`: by a synonym, by its words in
    another order or case, or with a slip of a letter.

    >>> meant_by("x_mm", ["Actual X [mm]", "Nominal X [mm]"])
    'Actual X [mm]'
    """
    words = {_words(each) for each in (name, *SYNONYMS.get(name, ()))}
    same = [other for other in others if _words(other) in words]
    if len(same) == 1:
        return same[0]
    if same:
        return next((other for other in same if _words(other) == _words(name)), None)
    if slips:
        near = closest(name, others)
        own, other = (re.sub(r"\W|_", "", each or "").casefold() for each in (name, near))
        return near if near and _likeness(own, other) >= SLIP else None
    known = {word for each in SYNONYMS if each != name for word in (each, *SYNONYMS[each])}
    free = [other for other in others if _words(other) not in map(_words, known)]
    return closest(name, free)


def _likeness(name: str, other: str) -> float:
    from difflib import SequenceMatcher

    return SequenceMatcher(None, name, other).ratio()


def _words(name: str) -> frozenset[str]:
    """The words of a name in lower case, without accents, units in brackets and plain numbers."""
    plain = unicodedata.normalize("NFKD", name[:200].casefold())
    plain = "".join(sign for sign in plain if not unicodedata.combining(sign))
    plain = re.sub(r"[\[(/].*$", "", plain)
    words = re.findall(r"[a-z]+", plain)
    return frozenset(words) - OF_NUMBERS or frozenset(words)


def _refuse_other_table(source: Source, row: int, header: Sequence[str], spec: TableSpec) -> None:
    if any(name in header for name in spec.required):
        return
    for names, (kind, options) in KINDS.items():
        if names != spec.required and all(name in header for name in names):
            own = KINDS.get(spec.required, ("a table", ""))[0]
            expected = f"a file of {own} (this one goes to {options})"
            raise error("other-table", file=source.shown, row=row, kind=kind, expected=expected)


def check_sensor_names(table: Table, problems: CellFaults) -> None:
    """Columns of numbers whose names say that they are temperatures, but not as `T_<sensor>_degC`:
    nothing would read them. In points ``T_12`` may be a tool.
    """
    drift = "component" in table.header
    for name in filter(looks_like_temperature, table.columns.numbers):
        if not drift and re.fullmatch(r"[Tt][\W_]*[0-9]*\W*", name):
            continue
        better = as_temperature(name)
        expected = "T_<sensor>_degC of letters a to z, digits and _"
        expected += f", such as {better}" if better else ""
        place = {"file": table.source.shown, "row": table.header_row, "column": name}
        problems.add(finding("not-a-temperature", expected=expected, **place))
