"""What a contract states of the columns of a CSV table, and the check of a header against it."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal

from mtu_cli.files.contract import A_NAME, is_name
from mtu_cli.files.covariates import SIGN_EXPECTED, is_covariate
from mtu_cli.files.source import SYNTHETIC, Source
from mtu_cli.findings import Finding, InputError, error, finding, listed
from mtu_cli.units import UNITS

Kind = Literal["number", "whole", "count", "free", "sign", "time", "text"]
LARGEST_READING = 1e12
"""Beyond it no cell is a measurement, and squares would overflow."""
LARGEST_INTEGER = 2.0**53 - 1.0
"""2^53 and 2^53 + 1 are one float, and so are whole numbers beyond."""
TIME_EXPECTED = "an ISO 8601 time such as 2024-05-03T14:30:00"
WANTED = {
    "text": ("a name that a table can show", A_NAME),
    "time": ("a time", TIME_EXPECTED),
    "sign": ("a direction", SIGN_EXPECTED),
}
"""What a cell of a kind is, and how it is written; those of other kinds are numbers."""
SAYS_NOTHING = {"no", "nr", "number", "num", "id", "name", "mm", "s"}
"""Words of a column's name that tell it from no other."""
LIKE = 0.6
"""Likeness of the name of a column that has to be there."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column that a contract names.

    A `whole` number may be negative, a `count` is not; a `free` column holds numbers or texts; a
    `sign` is -1 or +1 and may be written in words. `largest` bounds a number in size. `texts` are
    what its cells may be (None: any name). `says`: what a cell should be, where the kind
    does not say it.
    """

    kind: Kind = "number"
    required: bool = False
    may_be_empty: bool = False
    largest: float = LARGEST_READING
    texts: Collection[str] | None = None
    says: str = ""

    @property
    def numeric(self) -> bool:
        """Whether its cells are numbers and nothing else."""
        return self.kind in ("number", "whole", "count")

    @property
    def whole(self) -> bool:
        """Whether its numbers are whole."""
        return self.kind in ("whole", "count")


SENSOR = Column(may_be_empty=True, largest=math.inf)
FREE = Column("free", may_be_empty=True, largest=math.inf)
"""What no contract names: covariates of every machine, and any other column."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableSpec:
    """The `columns` that a contract names; every other column is a covariate.

    What the table `holds`, and the `option` that takes it. Of each of `pairs` both columns must be
    there, or none.
    """

    columns: Mapping[str, Column]
    holds: str = "a table"
    option: str = ""
    pairs: tuple[tuple[str, str], ...] = ()

    @property
    def required(self) -> list[str]:
        """The columns that every table has."""
        return [name for name, column in self.columns.items() if column.required]

    def column(self, name: str) -> Column:
        """How the cells of a column are read."""
        return self.columns.get(name) or (SENSOR if is_covariate(name) else FREE)

    def with_texts(self, name: str, texts: Collection[str] | None) -> TableSpec:
        """The same contract where the cells of a column are one of `texts` (None: any)."""
        column = replace(self.columns[name], texts=texts)
        return replace(self, columns={**self.columns, name: column})


EXCLUSIVE = ("time", "time_min")
"""Columns of which a table has one at most."""
TIMES = {
    "time": Column("time"),
    # Minutes since 1970 are within a century, seconds are not.
    "time_min": Column(largest=5.3e7, says="minutes, at most a century (5.3e+07) from the start"),
}
PASS = Column("count", largest=LARGEST_INTEGER, says="a whole number from 0 to 2^53 - 1")
READINGS = TableSpec(
    holds="readings of components",
    option="--lbb, --laser or --drift",
    columns={
        "component": Column("text", required=True, says="the name of a component of the machine"),
        "error": Column(required=True),
        "unit": Column("text", required=True, texts=UNITS, says=f"one of: {', '.join(UNITS)}"),
        "position_mm": Column(may_be_empty=True),
        "pass": PASS,
        "direction": Column("sign", may_be_empty=True),
        "cycle": Column(
            "text", says="the name of a warm-up or cool-down in every row, or no column 'cycle'"
        ),
        **TIMES,
    },
)
"""Of ``--lbb``, ``--laser`` and ``--drift``: one row per reading of one error component."""
POINTS = TableSpec(
    holds="measured points",
    option="--cmm",
    pairs=(("nominal_x_mm", "nominal_y_mm"),),
    columns={
        "part": Column("text", required=True, says="the serial number or name of the part"),
        "feature": Column("text", required=True, says="the name of a feature of the part"),
        "operation": Column(
            "text", says="a name such as drilled in every row, or no column 'operation'"
        ),
        "repeat": Column("count"),
        "sequence": Column(
            "whole", largest=LARGEST_INTEGER, says="a whole number, at most 2^53 - 1 in size"
        ),
        **{f"{axis}_mm": Column(required=axis != "z") for axis in "xyz"},
        **{f"nominal_{axis}_mm": Column(may_be_empty=True) for axis in "xyz"},
        **{f"dir_{axis}": Column("sign", may_be_empty=True) for axis in "xyz"},
        **TIMES,
    },
)
"""Of ``--cmm``: one row per measured point."""
SYNONYMS = {
    "component": "error component, error name, parameter, komponente",
    "error": "value, reading, deviation, abweichung",
    "unit": "units, einheit",
    "position_mm": "position, pos, target, target position, nominal position",
    "pass": "run, repeat, repetition, durchlauf",
    "direction": "dir, approach, richtung",
    "cycle": "warm up, zyklus",
    "time": "timestamp, date, datetime, zeit",
    "time_min": "minutes, elapsed min",
    "part": "workpiece, piece, serial, serial number, sn, teil, werkst\u00fcck",
    "feature": "hole, bore, point, element, characteristic, merkmal, bohrung",
    "operation": "process",
    "repeat": "repetition, replicate, run, trial, measurement, wiederholung",
    "sequence": "order, reihenfolge",
    **{f"{a}_mm": f"{a}, actual {a}, measured {a}, act {a}, ist {a}" for a in "xyz"},
    **{f"nominal_{a}_mm": f"nominal {a}, nom {a}, soll {a}" for a in "xyz"},
    **{f"dir_{a}": f"direction {a}, approach {a}" for a in "xyz"},
}
"""What other programs call a column: words in any order, without unit, number and accents."""


def measured_in(path: Path) -> str | None:
    """What a file holds by its header: readings or points; None of anything else."""
    header = next((line for line in filled_lines(path) if line[0] != "#"), "")
    names = {name.strip(' "\n') for name in re.split("[,;]", header)}
    return next((x.holds for x in (READINGS, POINTS) if {*x.required} <= names), None)


def is_made(path: Path) -> bool:
    """Whether a file is empty, or says that it is synthetic."""
    return next(filled_lines(path), SYNTHETIC).lstrip().startswith(SYNTHETIC)


def filled_lines(path: Path) -> Iterator[str]:
    """The lines of a text file that are not empty, as far as it can be read."""
    with suppress(OSError), path.open(encoding="utf-8-sig", errors="replace") as file:
        yield from (line for line in file if line.strip())


def check_header(source: Source, row: int, header: Sequence[str], spec: TableSpec) -> None:
    """Raises InputError for columns that are missing, doubled, without a name or at odds, and for
    a table of another contract.
    """
    place = {"file": source.shown, "row": row}
    if not {*spec.required} & {*header}:
        for contract in (READINGS, POINTS):
            if {*contract.required} <= {*header}:
                expected = f"{spec.holds} ({contract.option} takes {contract.holds})"
                raise error("other-table", kind=contract.holds, expected=expected, **place)
    if faults := [*_faults(header, spec)]:
        raise InputError([item.at(**place) for item in faults])


def _faults(header: Sequence[str], spec: TableSpec) -> Iterator[Finding]:
    for i, name in enumerate(header, 1):
        if not is_name(name):
            expected = A_NAME if name else "a name, or no such column"
            facts: dict[str, Any] = {"value": name, "column": i, "expected": expected}
            yield finding("wrong-type", kind="a name that a table can show", **facts)
        elif name in header[: i - 1]:
            expected = f"one of the columns {header.index(name) + 1} and {i}"
            yield finding("appears-twice", what="the column", column=name, expected=expected)
    required_names = {*spec.required}
    required_names |= {name for pair in spec.pairs if {*pair} & {*header} for name in pair}
    extras = [name for name in header if name and name not in spec.columns]
    for name in spec.columns:
        if name not in required_names or name in header:
            continue
        match = meant_by(name, extras, LIKE)
        extras = [column for column in extras if column != match]
        hint = f"a column {name!r} (the columns are {listed(header, 12)})"
        unit = name.rpartition("_")[2]
        values = f", its values in {unit}" if unit in UNITS and unit not in f"{match}" else ""
        expected = f"{match!r} renamed to {name!r}{values}" if match else hint
        yield finding("missing-column", column=name, expected=expected)
    if {*EXCLUSIVE} <= {*header}:
        yield finding("exclusive", names=EXCLUSIVE, expected="one of them")


def meant_by(name: str, columns: Sequence[str], likeness: float) -> str | None:
    """The one of `columns` that is probably meant as `name` of a contract: by a synonym, by
    its words in another order or case, or by letters that are alike.
    """
    words = {_words(text) for text in (name, *SYNONYMS.get(name, name).split(", "))}
    if same := [column for column in columns if _words(column) in words]:
        return same[0] if len(same) == 1 else None
    letters = {column[:200].casefold(): column for column in columns}
    matches = get_close_matches(name, letters, 1, likeness)
    return letters[matches[0]] if matches else None


def _words(name: str) -> frozenset[str]:
    """The words of a name in lower case, without units in brackets and plain numbers."""
    plain = re.sub(r"[\[(/].*$", "", name[:200].casefold())
    words = frozenset(re.findall(r"[^\W\d_]+", plain))
    return words - SAYS_NOTHING or words
