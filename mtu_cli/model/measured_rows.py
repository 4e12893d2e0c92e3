"""Rows of measured points that contradict each other or stand twice, names that look alike."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mtu_cli.errors import InputError, Problem, Warned
from mtu_cli.files.points import Points
from mtu_cli.files.row_marks import row_marks
from mtu_cli.findings import Finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.visits import operations_of

TWICE = "rows-stand-twice"
LARGEST_MM = 1e6
"""No machine is a kilometre long."""
MOST_TOLD = 1000
SAMPLE = 24
FEWEST_ROWS = 8
NEARLY_ALL = 0.9
_BLOCK = 1 << 15


def check_rows(points: Points) -> list[Finding]:
    """Warnings on rows that stand twice and on names that differ by case or blanks only.

    Raises InputError for a negative `repeat`, a part with two numbers of `sequence`, and a
    coordinate beyond `LARGEST_MM`.
    """
    problems = [
        *_negative_repeats(points),
        *_two_sequences(points),
        *_too_large(points),
    ]
    if problems:
        raise InputError(problems)
    return [*_twins(points), *_alike(points)]


def _negative_repeats(points: Points) -> Iterator[Finding]:
    negative = points.repeat < 0
    if not negative.any():
        return
    # -1 stands for a file without the column, all of whose rows have it.
    told = np.zeros(len(points.sources), bool)
    told[points.file_index[points.repeat != -1]] = True
    for i in np.flatnonzero(negative & told[points.file_index])[:MOST_TOLD]:
        yield _problem(
            points, int(i), "repeat", "a negative repeat", int(points.repeat[i]), "0, 1, 2, ..."
        )


def _two_sequences(points: Points) -> Iterator[Finding]:
    # Parts may go through each operation in an order of their own.
    operations, operation = operations_of(points)
    run = operation.astype(np.int64) * len(points.parts) + points.part
    first = np.zeros(len(operations) * len(points.parts), np.int64)
    first[run[::-1]] = points.sequence[::-1]
    moved = np.flatnonzero(first[run] != points.sequence)
    seen: set[int] = set()
    for i in moved.tolist():
        part = int(points.part[i])
        if part not in seen:
            seen.add(part)
            yield _problem(
                points, i, "sequence", f"part {points.parts[part]!r} has two numbers of sequence",
                int(points.sequence[i]), f"{first[run[i]]}, as before: a part is made once",
            )  # fmt: skip
        if len(seen) >= MOST_TOLD:
            return


def _too_large(points: Points) -> Iterator[Finding]:
    for axis, letter in enumerate(AXES):
        for column, values in (
            (f"{letter}_mm", points.measured[:, axis]),
            (f"nominal_{letter}_mm", points.nominal[:, axis]),
        ):
            for i in np.flatnonzero(np.abs(values) > LARGEST_MM)[:MOST_TOLD].tolist():
                expected = f"at most {LARGEST_MM:g} mm"
                yield _problem(points, i, column, "too large", float(values[i]), expected)


def _problem(
    points: Points, i: int, column: str, what: str, value: float, expected: str
) -> Finding:
    return Problem(
        what=what,
        file=points.sources[points.file_index[i]].shown,
        row=int(points.row[i]),
        column=column,
        value=f"{value:g}" if isinstance(value, float) else str(value),
        expected=expected,
    )


def _twins(points: Points) -> list[Finding]:
    """Repeats that are one measurement twice: then nearly every row has an exact twin.

    Rows whose repeats are all numbered say themselves that they are different measurements.
    """
    n = len(points)
    if n < FEWEST_ROWS or (points.repeat >= 0).all():
        return []
    marks = _marks(points)
    chosen = np.unique(np.linspace(0, n - 1, SAMPLE).astype(np.int64))
    # Of nearly all rows with a twin a handful tells; only then all are compared.
    if (_counts(marks, marks[chosen]) > 1).mean() < NEARLY_ALL / 2:
        return []
    _, first, code, count = np.unique(
        marks, return_index=True, return_inverse=True, return_counts=True
    )
    code = code.reshape(-1)
    twin = count[code] > 1
    if twin.mean() < NEARLY_ALL:
        return []
    i = int(np.flatnonzero(twin & (first[code] != np.arange(n)))[0])
    places = [
        f"{points.sources[points.file_index[k]].shown}, row {points.row[k]}"
        for k in (int(first[code[i]]), i)
    ]
    text = (
        f"{int(twin.sum())} of {n} points stand twice with the same values (first: {places[0]} "
        f"and {places[1]}): a copy counts as a repeat without scatter, so that the CMM seems "
        "better and the mean surer than they are"
    )
    return [Warned(code=TWICE, message=text)]


def _marks(points: Points) -> NDArray[np.uint64]:
    columns = [points.part, points.feature, points.operation]
    columns += [column for column in points.measured.T if not np.isnan(column[0])]
    return row_marks(columns)


def _counts(marks: NDArray[np.uint64], wanted: NDArray[np.uint64]) -> NDArray[np.int64]:
    """How often each of `wanted` stands among the marks."""
    found = np.zeros(len(wanted), np.int64)
    for start in range(0, len(marks), _BLOCK):
        block = marks[start : start + _BLOCK]
        found += [int(np.count_nonzero(block == mark)) for mark in wanted]
    return found


def _alike(points: Points) -> list[Finding]:
    found = []
    for what, names in (
        ("part", points.parts),
        ("feature", points.features),
        ("operation", points.operations),
    ):
        first: dict[str, str] = {}
        pairs = []
        for name in names:
            other = first.setdefault("".join(name.split()).casefold(), name)
            if other != name:
                pairs.append(f"{other!r} and {name!r}")
        if pairs:
            more = f" and {len(pairs) - 3} more" if len(pairs) > 3 else ""
            text = (
                f"{what}s whose names differ by case or blanks only are taken as different: "
                f"{', '.join(pairs[:3])}{more}; did you mean the same?"
            )
            found.append(Warned(code="names-alike", message=text))
    return found
