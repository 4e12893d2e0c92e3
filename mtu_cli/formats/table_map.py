"""Any table by a mapping profile (``mtu/import/1``): what its columns are, and how they change."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from mtu_cli.files.contract import Contract, Faults, check_contract, optional
from mtu_cli.files.csv_table import Decimal
from mtu_cli.files.headers import TIMES, TableSpec
from mtu_cli.files.yaml_file import read_yaml
from mtu_cli.findings import suggestion
from mtu_cli.formats.base import FORWARD, READINGS, REVERSE, Ask, Imported, RawFile, unit_of
from mtu_cli.formats.grid import Faults as Cells
from mtu_cli.formats.grid import Row, decimals, grid_of, number, said
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
    kind = ask.kind if ask.kind in specs else READINGS
    sign = WORDS.get(profile.separator or "", profile.separator)
    skip = profile.skip_rows
    grid = grid_of(file.lines[skip:], skip + 1, sign)
    if len(grid.rows) < 2:
        raise file.error("empty-file", what="rows", expected="a header and rows below it")
    header, rows = grid.rows[0], grid.rows[1:]
    found, cells = Imported(format="table", kind=str(kind)), Cells(file)
    for row in rows:
        if len(row.cells) != len(header.cells):
            facts = {"cells": f"{len(row.cells)} cells", "expected": f"{len(header.cells)} cells"}
            cells.found.append(file.finding("row-length", row=row.line, **facts))
    place = _places(file, header, profile, cells)
    cells.raise_if_any()
    signs = decimals(file, ([row.cells[i] for row in rows] for i in range(len(header.cells))),
                     ask.decimal or profile.decimal, grid.separator)  # fmt: skip
    table = _Table(file, profile, header.cells, place, signs, cells)
    spec = specs[str(kind)]
    ways = _ways(profile, ask)
    cycle, start, left = 1, None, False
    for row in rows:
        base = table.cells_of(row, spec)
        if profile.cycles:
            level = row.cells[place[profile.cycles.from_]]
            start = level if start is None else start
            cycle += left and level == start
            left = level != start
            base["cycle"] = str(cycle)
        for name, index, nth in table.unpivoted():
            made = dict(base)
            if name:
                text = row.cells[index]
                if not text:
                    found.drop("empty cells")
                    continue
                made[name] = table.value(row, name, index)
                made |= _named(profile, header.cells[index], nth, ways)
            found.add(row.line, **table.worked(made, row))
    cells.raise_if_any()
    used = {*place.values(), *(i for name, i, _ in table.unpivoted() if name)}
    unused = [cell for i, cell in enumerate(header.cells) if i not in used]
    found.drop(f"columns ({', '.join(unused[:6])})" if unused else "columns", len(unused))
    found.drop("lines above the header", skip)
    _complete(file, ask, found, kind == READINGS or kind == "drift")
    found.says[:0] = [said(grid, signs), *(f"{a} less {b}" for a, b in profile.subtract.items()),
                      *(f"{name} times {by:g}" for name, by in profile.scale.items())]  # fmt: skip
    return found


def _places(file: RawFile, header: Row, profile: Profile, cells: Cells) -> dict[str, int]:
    """The index of each column that the profile names; headings are compared without case."""
    names = [re.sub(r"\s+", " ", cell).casefold() for cell in header.cells]
    wanted = dict(profile.columns)
    own = {*wanted, *profile.constants}
    others = [*profile.subtract.values(), *([profile.cycles.from_] if profile.cycles else [])]
    others += profile.unpivot.columns if profile.unpivot else []
    wanted |= {name: name for name in others if name not in own}
    found = dict[str, int]()
    for name, heading in wanted.items():
        if isinstance(heading, int) and 1 <= heading <= len(names):
            found[name] = heading - 1
            continue
        plain = re.sub(r"\s+", " ", str(heading)).casefold()
        if names.count(plain) == 1:
            found[name] = names.index(plain)
            continue
        code = "appears-twice" if plain in names else "missing-column"
        facts = {"what": f"the column {heading!r}"} if plain in names else {}
        hint = {"expected": f"one of: {', '.join(header.cells[:12])}"}
        cells.found.append(
            file.finding(code, row=header.line, column=str(heading), **facts, **hint)
        )
    return found


class _Table:
    """The cells of a row under the names of the contract."""

    def __init__(self, file: RawFile, profile: Profile, header: list[str], place: dict[str, int],
                 signs: list[Decimal], cells: Cells) -> None:  # fmt: skip
        self.profile, self.header, self.place = profile, header, place
        self.signs, self.cells = signs, cells

    def unpivoted(self) -> list[tuple[str, int, int]]:
        """Target column, index and number of each column that becomes rows; one of "" without."""
        unpivot = self.profile.unpivot
        if unpivot is None:
            return [("", 0, 0)]
        return [(unpivot.into, self.place[name], n) for n, name in enumerate(unpivot.columns)]

    def value(self, row: Row, name: str, index: int) -> float | None:
        """A number of a row; what is none is a fault."""
        cell = row.cells[index]
        value = number(cell, self.signs[index])
        if value is None:
            self.cells.cell(row.line, self.header[index], cell)
        return value

    def cells_of(self, row: Row, spec: TableSpec) -> dict[str, Any]:
        """Constants and columns of a row."""
        found: dict[str, Any] = dict(self.profile.constants)
        subtracted = {*self.profile.subtract.values()}
        for name, index in self.place.items():
            if name not in self.profile.columns and name not in subtracted:
                continue
            cell = row.cells[index]
            column = spec.columns.get(name)
            numeric = name in NUMBERS or name in self.profile.scale or name in subtracted
            if not numeric and column is None:
                found[name] = number(cell, self.signs[index])
                found[name] = cell if found[name] is None else found[name]
            elif numeric or (column and column.kind == "number" and name not in TIMES):
                found[name] = self.value(row, name, index)
            else:
                found[name] = cell
        return found

    def worked(self, made: dict[str, Any], row: Row) -> dict[str, Any]:
        """Scaled to the units of the contract, and less what is subtracted."""
        for name, by in self.profile.scale.items():
            if isinstance(made.get(name), float):
                made[name] *= by
        for name, text in self.profile.units.items():
            unit = plain_unit(text)
            if name == "error":
                made["unit"] = unit
            elif isinstance(made.get(name), float):
                made[name] *= UNITS[unit].to_internal
        for name, other in self.profile.subtract.items():
            if isinstance(made.get(name), float) and isinstance(made.get(other), float):
                made[name] -= made[other]
        hidden = {*self.profile.subtract.values()} - {*self.profile.columns}
        return {name: value for name, value in made.items() if name not in hidden}


def _ways(profile: Profile, ask: Ask) -> list[str]:
    """The direction of each column that becomes rows; "" where none is stated."""
    unpivot = profile.unpivot
    if unpivot is None:
        return []
    how = ask.directions or unpivot.directions
    if how == "headings":
        return [way_of(name) or "" for name in unpivot.columns]
    if how == "alternate":
        return [(FORWARD, REVERSE)[n % 2] for n in range(len(unpivot.columns))]
    return [how or ""] * len(unpivot.columns)


def _named(profile: Profile, heading: str, nth: int, ways: list[str]) -> dict[str, Any]:
    """Name and direction of an unpivoted cell; passes are counted in each direction."""
    unpivot = profile.unpivot
    assert unpivot is not None
    numbered = unpivot.names == "pass"
    made: dict[str, Any] = {unpivot.names: ways[:nth].count(ways[nth]) + 1 if numbered else heading}
    return made | ({"direction": ways[nth]} if ways[nth] else {})


def _complete(file: RawFile, ask: Ask, found: Imported, readings: bool) -> None:
    """Component and unit of readings, from the caller where the profile has none."""
    if not readings or not found.rows:
        return
    if ask.component:
        found.columns["component"] = [ask.component] * len(found.rows)
    elif "component" not in found.columns:
        expected = "--component NAME, or constants: {component: NAME} in the profile"
        raise file.error("missing-input", what="the component", expected=expected)
    if "unit" not in found.columns:
        found.columns["unit"] = [unit_of(file, ask, found, None)] * len(found.rows)
