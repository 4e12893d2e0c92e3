"""Any table by a mapping profile (``mtu/import/1``): what its columns are, and how they change."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from mtu_cli.files.contract import (
    A_NAME,
    Contract,
    Faults,
    check_contract,
    is_name,
    must,
    optional,
)
from mtu_cli.files.headers import Column
from mtu_cli.files.yaml_file import read_yaml
from mtu_cli.formats.base import SPECS, Import
from mtu_cli.formats.grid import Columns, Row, grid_of, number, summary
from mtu_cli.formats.wide import directed
from mtu_cli.units import UNITS, Unit, plain_unit

if TYPE_CHECKING:
    from pandas import DataFrame

CELL = must(lambda x: not isinstance(x, str) or is_name(x), A_NAME, "wrong-type", kind="a name")
"""What can stand in a cell: a number, or a text on one line."""
WORDS = {"tab": "\t", "blank": " ", "space": " "}


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
    constants: dict[str, Annotated[str | float, CELL]] = optional("Columns with one value", {})
    scale: dict[str, float] = optional("Factors of columns", {})
    subtract: dict[str, str] = optional("Columns less another: error: target", {})
    unpivot: Unpivot | None = None
    cycles: Cycles | None = None
    units: dict[str, str] = optional("Unit of a column that is read as mm, or of error", {})

    @property
    def made(self) -> list[str]:
        """The columns of its table, but for those that are only subtracted."""
        rows = [self.unpivot.into, self.unpivot.names] if self.unpivot else []
        return [*self.columns, *self.constants, *rows, *(["cycle"] if self.cycles else [])]

    @property
    def operands(self) -> list[str]:
        """The columns of the file that are only subtracted, by their headings."""
        return [name for name in self.subtract.values() if name not in self.made]

    def unit_of(self, name: str) -> Unit | None:
        """The unit of a column by its name or, converted to it, by `units`; None if unknown."""
        by_name = [UNITS[unit] for unit in ("mm", "deg") if name.endswith(f"_{unit}")]
        if name not in self.units:
            return next(iter(by_name), None)
        dimension = UNITS[plain_unit(self.units[name])].dimension
        internal = (unit for unit in UNITS.values() if unit.to_internal == 1.0)
        return next((unit for unit in (*by_name, *internal) if unit.dimension == dimension), None)

    @property
    def calculated(self) -> list[str]:
        """The columns that it calculates with: each holds numbers."""
        units = [name for name in self.units if name != "error"]
        return [*self.scale, *units, *self.subtract, *self.subtract.values()]

    def check(self, faults: Faults) -> None:
        """Units that are known, columns that it makes or reads."""
        for name, unit in self.units.items():
            if plain_unit(unit) not in UNITS:
                faults.at("units", name).unknown(unit, UNITS, "unit")
        columns = [*self.made, *self.operands]
        for key in ("scale", "subtract", "units"):
            for name in getattr(self, key):
                if name not in columns and (key, name) != ("units", "error"):
                    faults.at(key, name).unknown(name, columns, "column")


def read_with(result: Import) -> None:
    """The table of a file as the profile asked for says; every bad cell at once."""
    import numpy as np
    import pandas as pd

    file, ask = result.file, result.ask
    if isinstance(ask.profile, Path):
        profile = check_contract(read_yaml(ask.profile, "map"), Profile, "import")
    else:
        profile = Profile(**(ask.profile or {}))
    skip, sign = profile.skip_rows, WORDS.get(profile.separator or "", profile.separator)
    grid = grid_of(file.lines[skip:], skip + 1, sign)
    if len(grid.rows) < 2:
        raise file.error("empty-file", what="rows", expected="a header and rows below it")
    header, rows = grid.rows[0].cells, grid.rows[1:]
    place = _places(result, grid.rows[0], profile)
    result.ask = replace(ask, decimal=ask.decimal or profile.decimal)
    cells = Columns(result, header, rows, grid.separator)
    table = pd.DataFrame(profile.constants, index=[row.line for row in rows])
    columns = {name: SPECS[result.kind].column(name) for name in profile.made}
    columns |= dict.fromkeys(profile.calculated, Column())
    for name in dict.fromkeys([*profile.columns, *profile.operands]):
        index, column = place[name], columns[name]
        if column.kind == "number":
            values = cells.numbers(index, may_be_empty=column.may_be_empty)
            table[name] = np.array(values, float)
        elif column.kind != "free":
            table[name] = cells.texts[index]
        else:
            pairs = ((number(x, cells.signs[index]), x) for x in cells.texts[index])
            table[name] = pd.Series([x if v is None else v for v, x in pairs], table.index, object)
    if profile.cycles:
        level = pd.Series(cells.texts[place[profile.cycles.from_]], table.index)
        first = level == level.iloc[0]
        # A cycle begins where the set-point returns to its first value.
        table["cycle"] = (first & ~first.shift(fill_value=False)).cumsum().astype(str)
    if unpivot := profile.unpivot:
        runs = {
            x: np.array(cells.numbers(place[x], may_be_empty=True), float) for x in unpivot.columns
        }
        result.faults.raise_if_any()
        line = grid.rows[0].line
        rows_of = _row_labels(profile, cells, line, place, columns[unpivot.names])
        parts = [table.assign(**{unpivot.into: runs[labels.pop("")]}, **labels)
                 for labels in rows_of]  # fmt: skip
        result.faults.raise_if_any()
        stack = pd.concat(parts).sort_index(kind="stable")
        table = stack.dropna(subset=[unpivot.into])
        result.drop("empty cells", len(stack) - len(table))
    result.faults.raise_if_any()
    table = _calculated(result, profile, table)
    if result.kind != "points" and len(table):
        if ask.component:
            table["component"] = ask.component
        elif "component" not in table:
            expected = "--component NAME, or constants: {component: NAME} in the profile"
            raise file.error("missing-input", what="the component", expected=expected)
        if "unit" not in table:
            names = dict.fromkeys(table["component"])
            units = {name: result.unit_of(None, name) for name in names}
            table["unit"] = table["component"].map(units)
    cell_values = table.astype(object).where(table.notna(), None)
    result.columns = {str(name): cell_values[name].tolist() for name in table}
    result.rows = table.index.tolist()
    result.headings = {name: header[place[name]] for name in profile.columns}
    unused = [cell for i, cell in enumerate(header) if i not in place.values()]
    result.drop(f"columns ({', '.join(unused[:6])})" if unused else "columns", len(unused))
    result.drop("lines above the header", skip)
    less = [f"{name} less {reference}" for name, reference in profile.subtract.items()]
    times = [f"{name} times {by:g}" for name, by in profile.scale.items()]
    result.says[:0] = [summary(grid, cells.signs), *less, *times]


def _calculated(result: Import, profile: Profile, table: DataFrame) -> DataFrame:
    """The table scaled, converted and less what is subtracted, without the operands.

    Raises InputError for a column that is calculated with and holds no numbers.
    """
    factors = dict(profile.scale)
    for name, text in profile.units.items():
        if name == "error":
            table = table.assign(unit=plain_unit(text))
        else:
            converted = profile.unit_of(name)
            to = 1.0 if converted is None else converted.to_internal
            factors[name] = factors.get(name, 1.0) * UNITS[plain_unit(text)].to_internal / to
    for name in profile.calculated:
        if table[name].dtype.kind not in "if":
            expected = "numbers, as the profile calculates with it"
            raise result.file.error("wrong-type", column=name, kind="numbers", expected=expected)
    for name, by in factors.items():
        table[name] = table[name] * by
    for name, reference in profile.subtract.items():
        operand, unit = table[reference], profile.unit_of(reference)
        if name == "error" and unit is not None:
            if "unit" not in table:
                table["unit"] = result.ask.unit or unit.name
                result.says.append(f"errors in {result.ask.unit or unit.name}")
            ratios = {}
            for text in {*table["unit"]}:
                # One that is not known is none of the contract's.
                other = UNITS.get(plain_unit(str(text)), unit)
                if other.dimension != unit.dimension:
                    reason = f"{reference} is in {unit.name}, and what it is subtracted from in "
                    raise result.file.error("not-applicable", reason=f"{reason}{text}")
                ratios[text] = unit.to_internal / other.to_internal
            operand = operand * table["unit"].map(ratios)
        table[name] = table[name] - operand
    return table.drop(columns=profile.operands)


def _places(result: Import, header: Row, profile: Profile) -> dict[str, int]:
    """The index of each column that the profile names; headings are compared without case."""

    def plain(text: object) -> str:
        return re.sub(r"\s+", " ", str(text)).casefold()

    names, places = [plain(cell) for cell in header.cells], dict[str, int]()
    operands = [*profile.operands, *([profile.cycles.from_] if profile.cycles else [])]
    operands += profile.unpivot.columns if profile.unpivot else []
    headings = {name: name for name in operands} | profile.columns
    for name, heading in headings.items():
        if isinstance(heading, int) and 1 <= heading <= len(names):
            places[name] = heading - 1
        elif names.count(plain(heading)) == 1:
            places[name] = names.index(plain(heading))
        else:
            twice = plain(heading) in names
            code = "appears-twice" if twice else "missing-column"
            facts = {"what": f"the column {heading!r}"} if twice else {}
            facts |= {"expected": f"one of: {', '.join(header.cells[:12])}"}
            result.fault(code, row=header.line, column=str(heading), **facts)
    result.faults.raise_if_any()
    return places


def _row_labels(
    profile: Profile, cells: Columns, line: int, place: Mapping[str, int], column: Column
) -> Iterator[dict[str, Any]]:
    """What the rows of each column have (its name under ""): its heading as the `column` that takes
    it has it, or the number of its pass, counted in each direction; a direction.

    Raises InputError where directions are stated in a column, too.
    """
    unpivot = profile.unpivot
    assert unpivot is not None
    how, target = cells.result.ask.directions or unpivot.directions, unpivot.names
    if how and "direction" in {*profile.columns, *profile.constants}:
        names = "directions of the unpivoted columns and a column 'direction'"
        raise cells.result.file.error("exclusive", names=names, expected="one of them")
    ways, passes = directed(unpivot.columns, how)
    for name, way, number_of in zip(unpivot.columns, ways, passes, strict=True):
        heading = cells.header[place[name]]
        value = number(heading, cells.signs[place[name]])
        label: object = name if value is None or column.kind not in ("number", "free") else value
        if target == "pass":
            label = number_of
        elif value is None and column.numeric:
            cells.result.bad_cell(line, heading, heading)
        yield {"": name, target: label} | ({"direction": way} if way else {})
