"""A matrix of targets x runs, as spreadsheets and evaluation programs have it: the target first,
then one column a run; directions from the headings. Aerotech's laser text holds one below
``Raw Data:``.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from mtu_cli.formats.base import Format, Import, RawFile, unit_in
from mtu_cli.formats.grid import Columns, Grid, evidence, grid_of, number, summary

_FORWARD = "+ f fw fwd forward forwards fwrd pos hin vor vorw vorwaerts vorw\u00e4rts \u2191"
_REVERSE = "- \u2212 b r bw bwd rev reverse back backward backwards neg rueck r\u00fcck her \u2193"
WAYS = dict.fromkeys(_FORWARD.split(), "forward") | dict.fromkeys(_REVERSE.split(), "reverse")
SUMMARY = re.compile(
    r"mean|average|avg|mittel|std|sigma|stdev|^s$|^b$|reversal|range|max|min", re.I
)
"""Headings of columns that were calculated from the runs."""


def numeric_rows(grid: Grid) -> slice | None:
    """The rows from the first to the last that begin with a number; None of fewer than two."""

    def numeric(cell: str) -> bool:
        return bool(evidence(cell)) or any(number(cell, sign) is not None for sign in (".", ","))

    indices = [i for i, row in enumerate(grid.rows) if len(row.cells) > 1
             and numeric(row.cells[0]) and any(map(numeric, row.cells[1:]))]  # fmt: skip
    return slice(indices[0], indices[-1] + 1) if len(indices) > 1 else None


def way_of(heading: str) -> str | None:
    """The direction that a heading names.

    >>> way_of("Run 1 +"), way_of("R2"), way_of("rev 3"), way_of("Run 4"), way_of("F1")
    ('forward', 'reverse', 'reverse', None, 'forward')
    """
    plain = re.sub(r"[\[(](?!\s*[+-])[^\])]*[\])]", " ", heading.casefold())
    words = re.findall(r"[^\W\d_]+|[+\-\u2212\u2191\u2193]", plain)
    # A single letter counts where no word does: "r1 forward" is the first run.
    marks = [word for word in words if word in WAYS]
    result = {WAYS[word] for word in marks if len(word) > 1} or {WAYS[word] for word in marks}
    return result.pop() if len(result) == 1 else None


def runs_of(headings: Sequence[str], ways: Sequence[str | None]) -> list[int]:
    """The numbers of runs: those of the headings, where each has one and they are a run's alike
    there and back; else counted in each direction.

    >>> ways = ["forward", "reverse"] * 2
    >>> runs_of(["Hin 1", "Her 1", "Hin 2", "Her 3"], ways)
    [1, 1, 2, 3]
    >>> runs_of(["1 +", "2 -", "3 +", "4 -"], ways)
    [1, 1, 2, 2]
    """
    plain = (re.sub(r"[\[(].*?[\])]", " ", heading) for heading in headings)
    digits = [re.findall(r"\d+", each) for each in plain]
    if all(len(found) == 1 and len(found[0]) < 4 for found in digits):
        numbers = [int(found[0]) for found in digits]
        pairs = {*zip(numbers, ways, strict=True)}
        both = ({n for n, way in pairs if way == each} for each in ("forward", "reverse"))
        if len(pairs) == len(numbers) and set.intersection(*both):
            return numbers
    return [list(ways[:n]).count(way) + 1 for n, way in enumerate(ways)]


def directed(headings: Sequence[str], how: str | None) -> tuple[list[str | None], list[int]]:
    """The direction of each run and its number: both as the `headings` have them, or of this
    direction or ``alternate``, counted as they come.
    """
    ways: list[str | None] = [how] * len(headings)
    if how == "headings":
        ways = [way_of(heading) for heading in headings]
        return ways, runs_of(headings, ways)
    if how == "alternate":
        ways = [("forward", "reverse")[n % 2] for n in range(len(headings))]
    return ways, runs_of([""] * len(headings), ways)


def sniff(file: RawFile) -> bool:
    """Whether most of it is a numeric table with different targets in its first column."""
    if not file.text or file.text.lstrip().startswith(("<", "{")):
        return False
    grid = grid_of(file.lines)
    place = numeric_rows(grid)
    if place is None or len(grid.rows) - place.stop > place.stop - place.start:
        return False
    texts = [row.cells[0] for row in grid.rows[place]]
    comma = any(evidence(text) == "," for text in texts)
    targets = [x for text in texts if (x := number(text, "," if comma else ".")) is not None]
    return len(set(targets)) == len(targets) >= 2


def read_laser(result: Import) -> None:
    """The table below ``Raw Data:``, one column a run; the other blocks are counted."""
    lines = result.file.lines
    start = next(i for i, line in enumerate(lines) if line.startswith("Raw Data:"))
    end = next((i for i in range(start + 1, len(lines))
                if re.match(r"[A-Z][\w ]+:\s*$", lines[i])), len(lines))  # fmt: skip
    count = sum(map(bool, map(str.strip, lines[:start] + lines[end:])))
    result.drop("lines of the other blocks (comments, environment, statistics)", count)
    # Blank lines keep the numbers of the lines of the file.
    read(result, [""] * (start + 1) + lines[start + 1 : end])


def read(result: Import, lines: list[str] | None = None) -> None:
    """Each cell below a run as a reading, in the `lines` of the file (None: all of them); an empty
    one is counted and left out.

    Raises InputError, too, where values follow their targets with a slope near 1 (or 1000).
    """
    import numpy as np

    file, grid = result.file, grid_of(lines or result.file.lines)
    place = numeric_rows(grid)
    if place is None:
        raise file.error("empty-file", what="table of numbers", expected="targets and runs")
    header_rows, rows = grid.rows[: place.start], grid.rows[place]
    counts = Counter(len(row.cells) for row in rows)
    width = max(counts, key=lambda n: (counts[n], n))
    headings = [row.cells for row in reversed(header_rows) if len(row.cells) == width]
    name_rows = (cells for cells in headings if not cells[0].replace(".", "").isdigit())
    names = next(name_rows, [str(i) for i in range(1, width + 1)])
    runs = [i for i in range(1, width) if not SUMMARY.search(names[i])]
    result.drop("calculated columns", width - 1 - len(runs))
    result.drop("lines above the table", max(0, len(header_rows) - 1))
    result.drop("lines below the table", len(grid.rows) - place.stop)
    columns = Columns(result, names, rows, grid.separator)
    if not runs:
        raise file.error("missing-input", what="a column of a run", expected="one column a run")
    of_runs = [[cells[i] for i in runs] for cells in headings]
    ways, passes, how = _ways(result, of_runs, len(runs))
    stated = {unit for i in runs if (unit := unit_in(names[i]))}
    units = {unit for row in header_rows for cell in row.cells if (unit := unit_in(cell))} - {"mm"}
    stated = stated or (units if len(units) == 1 else set())
    if len(stated) > 1:
        raise file.error("undecided", what=f"the unit: {', '.join(sorted(stated))}")
    unit = result.unit_of(next(iter(stated), None))
    targets = columns.numbers(0)
    values = [columns.numbers(i, may_be_empty=True) for i in runs]
    result.faults.raise_if_any()
    result.drop("empty cells", sum(column.count(None) for column in values))
    result.add_readings(unit, (
        (row.line, target, run, way, value)
        for row, target, *cells in zip(rows, targets, *values, strict=True)
        for run, way, value in zip(passes, ways, cells, strict=True) if value is not None
    ))  # fmt: skip
    x, y = (np.array(result.columns[name], float) for name in ("position_mm", "error"))
    if len(np.unique(x)) > 2 and np.ptp(y) and np.corrcoef(x, y)[0, 1] > 0.9999:
        slope = float(np.polyfit(x, y, 1)[0])
        if any(abs(slope / factor - 1) < 0.02 for factor in (1.0, 1e3, 1e-3)):
            kind = "measured positions, no errors (they follow the targets)"
            expected = "errors, or a --map profile with subtract: {error: position_mm}"
            raise file.error("other-table", row=rows[0].line, kind=kind, expected=expected)
    result.says[:0] = [summary(grid, columns.signs), how, f"{len(rows)} targets x {len(runs)} runs"]
    result.facts = {"targets": sorted(set(targets)), "runs": len(runs), "unit": unit}


def _ways(
    result: Import, headings: Sequence[Sequence[str]], runs: int
) -> tuple[list[str | None], list[int], str]:
    """The direction of each run, its number, and where the direction was read."""
    given = result.ask.directions
    stated = next((cells for cells in headings if all(map(way_of, cells))), None)
    if given in ("forward", "reverse"):
        how, says = given, f"all runs {given}, as given"
    elif stated:
        how, says = "headings", "directions from the headings"
    elif given:
        how, says = "alternate", "directions alternating, as given"
    else:
        how, says = "alternate", "directions not stated, taken as alternating"
        result.doubts.append("directions are not stated: taken as alternating")
    return *directed(stated or [""] * runs, how), says


FORMATS = (
    Format("laser-text", "Aerotech laser text", "readings",
           lambda file: "\nRaw Data:" in f"\n{file.text}" and "Target Position" in file.text,
           read_laser),
    Format("wide", "a matrix of targets x runs", "readings", sniff, read),
)  # fmt: skip
