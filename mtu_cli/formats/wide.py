"""A matrix of targets x runs, as spreadsheets and evaluation programs have it: the target first,
then one column a run; directions from the headings.
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
from mtu_cli.formats.grid import Faults, Grid, Row, decimals, evidence, grid_of, number, said

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
    """The numeric part of a text table: rows that begin with a number, and the rows above."""

    grid: Grid
    above: list[Row]
    rows: list[Row]
    below: list[Row]

    @property
    def width(self) -> int:
        """Columns of most of its rows."""
        return Grid(self.grid.separator, self.rows).width

    @property
    def names(self) -> list[str]:
        """The headings: the last row above that has as many cells; else numbers."""
        for row in reversed(self.above):
            if len(row.cells) == self.width and not row.cells[0].replace(".", "").isdigit():
                return row.cells
        return [str(i) for i in range(1, self.width + 1)]


def is_number(cell: str) -> bool:
    """Whether a cell may be a number, with either decimal sign."""
    return bool(evidence(cell)) or number(cell, ".") is not None or number(cell, ",") is not None


def block_of(grid: Grid) -> Block | None:
    """The rows from the first to the last that begin with a number; None of fewer than two."""
    numeric = [i for i, row in enumerate(grid.rows) if len(row.cells) > 1
               and is_number(row.cells[0]) and any(map(is_number, row.cells[1:]))]  # fmt: skip
    if len(numeric) < 2:
        return None
    first, last = numeric[0], numeric[-1] + 1
    return Block(grid, grid.rows[:first], grid.rows[first:last], grid.rows[last:])


def way_of(heading: str) -> str | None:
    """The direction that a heading names.

    >>> way_of("Run 1 +"), way_of("R2"), way_of("rev 3"), way_of("Run 4"), way_of("F1")
    ('forward', 'reverse', 'reverse', None, 'forward')
    """
    plain = re.sub(r"[\[(](?!\s*[+-])[^\])]*[\])]", " ", heading.casefold())
    words = re.findall(r"[^\W\d_]+|[+\-\u2212\u2191\u2193]", plain)
    # A single letter counts where no word does: "r1 forward" is the first run.
    known = [word for word in words if word in WAYS]
    found = {WAYS[word] for word in known if len(word) > 1} or {WAYS[word] for word in known}
    return found.pop() if len(found) == 1 else None


def sniff(file: RawFile) -> bool:
    """Whether most of it is a numeric table with strictly ordered targets in its first column."""
    if not file.text or file.text.lstrip().startswith(("<", "{")):
        return False
    block = block_of(grid_of(file.lines))
    if block is None or block.width < 2 or len(block.below) > len(block.rows):
        return False
    texts = [row.cells[0] for row in block.rows]
    values = [number(text, "," if any(evidence(t) == "," for t in texts) else ".")
              for text in texts]  # fmt: skip
    known = [value for value in values if value is not None]
    return len(set(known)) == len(known) >= 2


def read(file: RawFile, ask: Ask) -> Imported:
    """Each cell below a run as a reading; an empty one is counted and left out."""
    block = block_of(grid_of(file.lines))
    if block is None:
        raise file.error("empty-file", what="table of numbers", expected="targets and runs")
    found, faults, names = Imported(format="wide"), Faults(file), block.names
    rows = [row for row in block.rows if len(row.cells) == block.width]
    for row in block.rows:
        if len(row.cells) != block.width:
            facts = {"cells": f"{len(row.cells)} cells", "expected": f"{block.width} cells"}
            faults.found.append(file.finding("row-length", row=row.line, **facts))
    runs = [i for i in range(1, block.width) if not SUMMARY.search(names[i])]
    found.drop("calculated columns", block.width - 1 - len(runs))
    found.drop("lines above the table", max(0, len(block.above) - 1))
    found.drop("lines below the table", len(block.below))
    faults.raise_if_any()
    if not runs:
        raise file.error("missing-input", what="a column of a run", expected="one column a run")
    ways, how = _ways(block, runs, ask)
    signs = decimals(file, ([row.cells[i] for row in rows] for i in range(block.width)),
                     ask.decimal, block.grid.separator)  # fmt: skip
    component = need_component(file, ask)
    stated = {unit for i in runs if (unit := unit_in(names[i]))}
    above = {unit for row in block.above for cell in row.cells if (unit := unit_in(cell))}
    stated = stated or (above - {"mm"} if len(above - {"mm"}) == 1 else set())
    if len(stated) > 1:
        raise file.error("undecided", what=f"the unit: {', '.join(sorted(stated))}")
    unit = unit_of(file, ask, found, next(iter(stated), None))
    targets, values = list[float](), list[float]()
    for row in rows:
        target = number(row.cells[0], signs[0])
        if target is None:
            faults.cell(row.line, names[0], row.cells[0])
            continue
        for nth, i in enumerate(runs):
            cell = row.cells[i]
            value = number(cell, signs[i])
            if not cell:
                found.drop("empty cells")
            elif value is None:
                faults.cell(row.line, names[i], cell)
            else:
                before = ways[:nth].count(ways[nth])
                found.add(row.line, component=component, position_mm=target,
                          **{"pass": before + 1}, direction=ways[nth], error=value,
                          unit=unit)  # fmt: skip
                targets.append(target)
                values.append(value)
    faults.raise_if_any()
    if not values:
        raise file.error("empty-file", what="readings", expected="numbers below the runs")
    refuse_positions(file, targets, values, rows[0].line)
    found.says[:0] = [said(block.grid, signs), how, f"{len(rows)} targets x {len(runs)} runs"]
    found.facts = {"targets": sorted(set(targets)), "runs": len(runs), "unit": unit}
    if how.startswith("directions not"):
        found.doubts.append("directions are not stated: taken as alternating")
    return found


def _ways(block: Block, runs: list[int], ask: Ask) -> tuple[list[str], str]:
    """The direction of each run, and where it was read."""
    if ask.directions in (FORWARD, REVERSE):
        return [ask.directions] * len(runs), f"all runs {ask.directions}, as given"
    for row in reversed(block.above):
        if len(row.cells) == block.width:
            ways = [way_of(row.cells[i]) for i in runs]
            if None not in ways:
                return [way or "" for way in ways], "directions from the headings"
    how = "alternating, as given" if ask.directions else "not stated, taken as alternating"
    return [(FORWARD, REVERSE)[n % 2] for n in range(len(runs))], f"directions {how}"


FORMATS = (Format("wide", "a matrix of targets x runs", (READINGS,), sniff, read),)
