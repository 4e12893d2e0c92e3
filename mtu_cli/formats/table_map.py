"""Any table by a mapping profile (``mtu/import/1``): what its columns are, and how they change."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from mtu_cli.files.contract import Contract, Faults, check_contract, optional
from mtu_cli.files.headers import TIMES, TableSpec
from mtu_cli.files.yaml_file import read_yaml
from mtu_cli.findings import suggestion
from mtu_cli.formats.base import (
    FORWARD,
    POINTS,
    READINGS,
    REVERSE,
    Ask,
    Imported,
    RawFile,
    unit_of,
)
from mtu_cli.formats.grid import Columns, Row, grid_of, number, said
from mtu_cli.formats.grid import Faults as Cells
from mtu_cli.formats.wide import way_of
from mtu_cli.units import UNITS, plain_unit

WORDS = {"tab": "\t", "blank": " ", "space": " "}
NUMBERS = ("error", "position_mm", "x_mm", "y_mm", "z_mm", "nominal_x_mm", "nominal_y_mm",
           "nominal_z_mm", "time_min")  # fmt: skip


class Unpivot(Contract):
    """Columns that become rows: their cells go `into` one column, their names into `names`."""

    into: str = "error"
    columns: Annotated[list[str], Field(min_length=1)]
    names: str = optional("Column that the names or numbers go into", "pass")
    directions: Literal["alternate", "forward", "reverse", "headings"] | None = None


class Cycles(Contract):
    """Cycles that are counted: a new one where the set-point returns to its first value."""

    from_: str = Field(alias="from")


class Profile(Contract):
    """How a table is read as the contract's CSV."""

    schema_: Literal["mtu/import/1"] = Field(alias="schema")
    format: Literal["table"] = "table"
    says: str | None = optional("What it reads, in words")
    skip_rows: Annotated[int, Field(ge=0)] = optional("Lines above the header", 0)
    separator: str | None = optional("Such as ';' or tab; found by itself without it")
    decimal: Literal[".", ","] | None = optional("Decimal sign")
    columns: dict[str, str | int] = optional(
        "Column of the contract: heading, or number from 1", {}
    )
    constants: dict[str, str | float] = optional("Columns with one value", {})
    scale: dict[str, float] = optional("Factors of columns", {})
    subtract: dict[str, str] = optional("Columns less another: error: target", {})
    unpivot: Unpivot | None = None
    cycles: Cycles | None = None
    units: dict[str, str] = optional("Unit of a column that is read as mm, or of error", {})


def read_profile(path: Path) -> Profile:
    """A checked mapping profile; raises InputError with all its faults."""

    def check(profile: Profile, faults: Faults) -> None:
        for name, unit in profile.units.items():
            if plain_unit(unit) not in UNITS:
                faults.add(("units", name), "unknown-name", value=unit, what="unit",
                           **suggestion(unit, UNITS))  # fmt: skip

    return check_contract(read_yaml(path, "map"), Profile, "import", check)


def read_with(
    file: RawFile, ask: Ask, profile: Profile, specs: Mapping[str, TableSpec]
) -> Imported:
    """The table of a file as its profile says; every bad cell at once."""
    kind = str(ask.kind if ask.kind in specs else READINGS)
    skip, unpivot = profile.skip_rows, profile.unpivot
    sign = WORDS.get(profile.separator or "", profile.separator)
    grid = grid_of(file.lines[skip:], skip + 1, sign)
    if len(grid.rows) < 2:
        raise file.error("empty-file", what="rows", expected="a header and rows below it")
    header, rows = grid.rows[0].cells, grid.rows[1:]
    result, faults = Imported(format="table", kind=kind), Cells(file)
    place = _places(file, grid.rows[0], profile, faults)
    table = Columns(faults, header, rows, ask.decimal or profile.decimal, grid.separator)
    columns, others = dict[str, list[Any]](), [*profile.subtract.values()]
    for name in [*profile.columns, *(name for name in others if name not in profile.columns)]:
        index, known = place[name], specs[kind].columns.get(name)
        numeric = name in (*NUMBERS, *profile.scale, *others)
        if numeric or (known and known.kind == "number" and name not in TIMES):
            columns[name] = table.numbers(index)
        elif known:
            columns[name] = table.texts[index]
        else:
            columns[name] = [cell if (value := number(cell, table.signs[index])) is None else value
                             for cell in table.texts[index]]  # fmt: skip
    if profile.cycles:
        columns["cycle"] = _cycles(table.texts[place[profile.cycles.from_]])
    made_rows: list[dict[str, Any]] = [{}]
    turned: list[list[Any]] = [[0.0] * len(rows)]
    if unpivot:
        turned = [table.numbers(place[name], may_be_empty=True) for name in unpivot.columns]
        made_rows = _turned(unpivot, ask)
    faults.raise_if_any()
    for i, row in enumerate(rows):
        base = {**profile.constants, **{name: values[i] for name, values in columns.items()}}
        for named, values in zip(made_rows, turned, strict=True):
            if unpivot and values[i] is None:
                result.drop("empty cells")
                continue
            own = base | ({unpivot.into: values[i]} if unpivot else {}) | named
            result.add(row.line, **_worked(profile, own))
    unused = [cell for i, cell in enumerate(header) if i not in place.values()]
    result.drop(f"columns ({', '.join(unused[:6])})" if unused else "columns", len(unused))
    result.drop("lines above the header", skip)
    if kind != POINTS and result.rows:
        _complete(file, ask, result)
    less = [f"{name} less {other}" for name, other in profile.subtract.items()]
    times = [f"{name} times {by:g}" for name, by in profile.scale.items()]
    result.says[:0] = [said(grid, table.signs), *less, *times]
    return result


def _places(file: RawFile, header: Row, profile: Profile, faults: Cells) -> dict[str, int]:
    """The index of each column that the profile names; headings are compared without case."""

    def plain(text: object) -> str:
        return re.sub(r"\s+", " ", str(text)).casefold()

    names, result = [plain(cell) for cell in header.cells], dict[str, int]()
    others = [*profile.subtract.values(), *([profile.cycles.from_] if profile.cycles else [])]
    others += profile.unpivot.columns if profile.unpivot else []
    wanted = {name: name for name in others if name not in profile.constants} | profile.columns
    for name, heading in wanted.items():
        if isinstance(heading, int) and 1 <= heading <= len(names):
            result[name] = heading - 1
        elif names.count(plain(heading)) == 1:
            result[name] = names.index(plain(heading))
        else:
            twice = plain(heading) in names
            code = "appears-twice" if twice else "missing-column"
            facts = {"what": f"the column {heading!r}"} if twice else {}
            facts |= {"expected": f"one of: {', '.join(header.cells[:12])}"}
            faults.add(file.finding(code, row=header.line, column=str(heading), **facts))
    faults.raise_if_any()
    return result


def _cycles(levels: list[str]) -> list[str]:
    """Cycles are counted where the set-point returns to its first value."""
    result, cycle, left = list[str](), 1, False
    for level in levels:
        cycle += left and level == levels[0]
        left = level != levels[0]
        result.append(str(cycle))
    return result


def _turned(unpivot: Unpivot, ask: Ask) -> list[dict[str, Any]]:
    """Name and direction of each column that becomes rows; passes are counted in each direction."""
    how, ways = ask.directions or unpivot.directions, list[str]()
    for n, name in enumerate(unpivot.columns):
        alternating = (FORWARD, REVERSE)[n % 2]
        ways.append({"headings": way_of(name), "alternate": alternating}.get(how or "", how) or "")
    numbered = unpivot.names == "pass"
    return [
        {unpivot.names: ways[:n].count(ways[n]) + 1 if numbered else name}
        | ({"direction": ways[n]} if ways[n] else {})
        for n, name in enumerate(unpivot.columns)
    ]


def _worked(profile: Profile, made: dict[str, Any]) -> dict[str, Any]:
    """Scaled to the units of the contract, and less what is subtracted."""
    factors = dict(profile.scale)
    for name, text in profile.units.items():
        unit = plain_unit(text)
        if name == "error":
            made["unit"] = unit
        else:
            factors[name] = factors.get(name, 1.0) * UNITS[unit].to_internal
    for name, by in factors.items():
        if isinstance(made.get(name), float):
            made[name] *= by
    for name, other in profile.subtract.items():
        if isinstance(made.get(name), float) and isinstance(made.get(other), float):
            made[name] -= made[other]
    hidden = {*profile.subtract.values()} - {*profile.columns}
    return {name: value for name, value in made.items() if name not in hidden}


def _complete(file: RawFile, ask: Ask, found: Imported) -> None:
    """Component and unit of readings, from the caller where the profile has none."""
    if ask.component:
        found.columns["component"] = [ask.component] * len(found.rows)
    elif "component" not in found.columns:
        expected = "--component NAME, or constants: {component: NAME} in the profile"
        raise file.error("missing-input", what="the component", expected=expected)
    if "unit" not in found.columns:
        found.columns["unit"] = [unit_of(file, ask, found, None)] * len(found.rows)
