"""A matrix of targets x runs, as spreadsheets and evaluation programs have it: the target first,
then one column a run; directions from the headings. Aerotech's laser text holds one below
``Raw Data:``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from mtu_cli.formats.base import (
    FORWARD,
    READINGS,
    REVERSE,
    Ask,
    Format,
    Imported,
    RawFile,
    need_component,
    refuse_positions,
    unit_in,
    unit_of,
)
from mtu_cli.formats.grid import Columns, Faults, Grid, Row, evidence, grid_of, number, said

_FORWARD = "+ f fw fwd forward forwards fwrd pos hin vor vorw vorwaerts vorw\u00e4rts \u2191"
_REVERSE = "- \u2212 b r bw bwd rev reverse back backward backwards neg rueck r\u00fcck her \u2193"
WAYS = dict.fromkeys(_FORWARD.split(), FORWARD) | dict.fromkeys(_REVERSE.split(), REVERSE)
SUMMARY = re.compile(
    r"mean|average|avg|mittel|std|sigma|stdev|^s$|^b$|reversal|range|max|min", re.I
)
"""Headings of columns that were calculated from the runs."""
DIRECTIONS = ("alternate", FORWARD, REVERSE)


@dataclass(frozen=True, slots=True)
class Block:
    """The numeric part of a text table: rows that begin with a number, and the rows about it."""

    above: list[Row]
    rows: list[Row]
    below: list[Row]
    separator: str

    @property
    def width(self) -> int:
        """Columns of most of its rows."""
        return Grid(self.separator, self.rows).width

    @property
    def names(self) -> list[str]:
        """The headings: the last row above that has as many cells; else numbers."""
        for row in reversed(self.above):
            if len(row.cells) == self.width and not row.cells[0].replace(".", "").isdigit():
                return row.cells
        return [str(i) for i in range(1, self.width + 1)]


def block_of(grid: Grid) -> Block | None:
    """The rows from the first to the last that begin with a number; None of fewer than two."""

    def numeric(cell: str) -> bool:
        return bool(evidence(cell)) or any(number(cell, sign) is not None for sign in (".", ","))

    found = [i for i, row in enumerate(grid.rows) if len(row.cells) > 1
             and numeric(row.cells[0]) and any(map(numeric, row.cells[1:]))]  # fmt: skip
    if len(found) < 2:
        return None
    first, last = found[0], found[-1] + 1
    return Block(grid.rows[:first], grid.rows[first:last], grid.rows[last:], grid.separator)


def way_of(heading: str) -> str | None:
    """The direction that a heading names.

    >>> way_of("Run 1 +"), way_of("R2"), way_of("rev 3"), way_of("Run 4"), way_of("F1")
    ('forward', 'reverse', 'reverse', None, 'forward')
    """
    plain = re.sub(r"[\[(](?!\s*[+-])[^\])]*[\])]", " ", heading.casefold())
    words = re.findall(r"[^\W\d_]+|[+\-\u2212\u2191\u2193]", plain)
    # A single letter counts where no word does: "r1 forward" is the first run.
    known = [word for word in words if word in WAYS]
    result = {WAYS[word] for word in known if len(word) > 1} or {WAYS[word] for word in known}
    return result.pop() if len(result) == 1 else None


def sniff(file: RawFile) -> bool:
    """Whether most of it is a numeric table with different targets in its first column."""
    if not file.text or file.text.lstrip().startswith(("<", "{")):
        return False
    block = block_of(grid_of(file.lines))
    if block is None or block.width < 2 or len(block.below) > len(block.rows):
        return False
    texts = [row.cells[0] for row in block.rows]
    sign = "," if any(evidence(text) == "," for text in texts) else "."
    known = [x for text in texts if (x := number(text, "," if sign == "," else ".")) is not None]
    return len(set(known)) == len(known) >= 2


def read(file: RawFile, ask: Ask) -> Imported:
    """Each cell below a run as a reading; an empty one is counted and left out."""
    return _read(file, ask, file.lines, Imported(format="wide"))


def read_laser(file: RawFile, ask: Ask) -> Imported:
    """The table below ``Raw Data:``, one column a run; the other blocks are counted."""
    start = next(i for i, line in enumerate(file.lines) if line.startswith("Raw Data:"))
    end = next((i for i in range(start + 1, len(file.lines))
                if re.match(r"[A-Z][\w ]+:\s*$", file.lines[i])), len(file.lines))  # fmt: skip
    result = Imported(format="laser-text")
    others = sum(map(bool, map(str.strip, file.lines[:start] + file.lines[end:])))
    result.drop("lines of the other blocks (comments, environment, statistics)", others)
    # Blank lines keep the numbers of the file's own.
    return _read(file, ask, [""] * (start + 1) + file.lines[start + 1 : end], result)


def _read(file: RawFile, ask: Ask, lines: list[str], found: Imported) -> Imported:
    block, faults = block_of(grid_of(lines)), Faults(file)
    if block is None:
        raise file.error("empty-file", what="table of numbers", expected="targets and runs")
    names, rows, width = block.names, block.rows, block.width
    runs = [i for i in range(1, width) if not SUMMARY.search(names[i])]
    found.drop("calculated columns", width - 1 - len(runs))
    found.drop("lines above the table", max(0, len(block.above) - 1))
    found.drop("lines below the table", len(block.below))
    columns = Columns(faults, names, rows, ask.decimal, block.separator)
    if not runs:
        raise file.error("missing-input", what="a column of a run", expected="one column a run")
    ways, how = _ways(block, runs, ask, found)
    component = need_component(file, ask)
    stated = {unit for i in runs if (unit := unit_in(names[i]))}
    above = {unit for row in block.above for cell in row.cells if (unit := unit_in(cell))}
    stated = stated or (above - {"mm"} if len(above - {"mm"}) == 1 else set())
    if len(stated) > 1:
        raise file.error("undecided", what=f"the unit: {', '.join(sorted(stated))}")
    unit = unit_of(file, ask, found, next(iter(stated), None))
    targets = columns.numbers(0)
    values = [columns.numbers(i, may_be_empty=True) for i in runs]
    faults.raise_if_any()
    for row, target, *cells in zip(rows, targets, *values, strict=True):
        for n, (way, value) in enumerate(zip(ways, cells, strict=True)):
            if value is None:
                found.drop("empty cells")
                continue
            found.add(row.line, component=component, position_mm=target,
                      **{"pass": ways[:n].count(way) + 1}, direction=way, error=value,
                      unit=unit)  # fmt: skip
    if not found.rows:
        raise file.error("empty-file", what="readings", expected="numbers below the runs")
    refuse_positions(file, found.columns["position_mm"], found.columns["error"], rows[0].line)
    read = said(Grid(block.separator, rows), columns.signs)
    found.says[:0] = [read, how, f"{len(rows)} targets x {len(runs)} runs"]
    found.facts = {"targets": sorted(set(targets)), "runs": len(runs), "unit": unit}
    return found


def _ways(block: Block, runs: list[int], ask: Ask, found: Imported) -> tuple[list[str], str]:
    """The direction of each run, and where it was read."""
    if ask.directions in (FORWARD, REVERSE):
        return [ask.directions] * len(runs), f"all runs {ask.directions}, as given"
    for row in reversed(block.above):
        if len(row.cells) == block.width:
            ways = [way_of(row.cells[i]) for i in runs]
            if None not in ways:
                return [way or "" for way in ways], "directions from the headings"
    alternating = [(FORWARD, REVERSE)[n % 2] for n in range(len(runs))]
    if ask.directions:
        return alternating, "directions alternating, as given"
    found.doubts.append("directions are not stated: taken as alternating")
    return alternating, "directions not stated, taken as alternating"


FORMATS = (
    Format("laser-text", "Aerotech laser text", (READINGS,),
           lambda file: "\nRaw Data:" in f"\n{file.text}" and "Target Position" in file.text,
           read_laser),
    Format("wide", "a matrix of targets x runs", (READINGS,), sniff, read),
)  # fmt: skip
