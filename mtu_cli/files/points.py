"""Measured points (``--cmm``) from all files at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files import joined
from mtu_cli.files.csv_table import CellFaults, Table, TableSpec
from mtu_cli.files.headers import check_sensor_names
from mtu_cli.files.source import Source
from mtu_cli.findings import Finding, InputError, finding, listed

Place = tuple[float, float, float | None]
"""Nominal x, y, z in mm; z None where nothing states it."""

AXES = ("x", "y", "z")
NOMINAL_TOLERANCE_MM = 1e-6

SPEC = TableSpec(
    required=("part", "feature", "x_mm", "y_mm"),
    numbers=frozenset(
        {"x_mm", "y_mm", "z_mm", "repeat", "sequence", "time_min"}
        | {f"nominal_{axis}_mm" for axis in AXES}
    ),
    texts=frozenset({"part", "feature", "operation"}),
    times=frozenset({"time"}),
    signs=frozenset({"dir_x", "dir_y", "dir_z"}),
    may_be_empty=frozenset({"dir_x", "dir_y", "dir_z", *(f"nominal_{axis}_mm" for axis in AXES)}),
    exclusive=(("time", "time_min"),),
    together=(("nominal_x_mm", "nominal_y_mm"),),
    says={
        "part": "the serial number or name of the part",
        "feature": "the name of a feature of the part",
        "operation": "a name such as drilled in every row, or no column 'operation'",
    },
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Points:
    """Measured points of all files, end to end; every array has one entry a point.

    `parts[part[i]]`, `features[feature[i]]`, `operations[operation[i]]` (-1: not given);
    `measured` and `nominal` (n, 3) mm, nan where z is not given; `repeat` -1 where not
    given; `time_min` in minutes, from the earliest of all files where those are dates, nan
    where not given; `sequence` the order of manufacture, as given or counted from 1 in the
    order in which parts first appear; `direction` (n, 3) -1, +1, or nan where not given;
    `covariates` floats (nan where not given) or texts ("" where not given); `row` counts as a
    text editor in the file `sources[file_index[i]]`. Arrays may be read-only.
    """

    parts: tuple[str, ...]
    part: NDArray[np.int64]
    features: tuple[str, ...]
    feature: NDArray[np.int64]
    operations: tuple[str, ...]
    operation: NDArray[np.int64]
    measured: NDArray[np.float64]
    nominal: NDArray[np.float64]
    repeat: NDArray[np.int64]
    time_min: NDArray[np.float64]
    sequence: NDArray[np.int64]
    direction: NDArray[np.float64]
    covariates: dict[str, NDArray[np.float64] | NDArray[np.object_]]
    file_index: NDArray[np.int64]
    row: NDArray[np.int64]
    sources: tuple[Source, ...]
    notes: tuple[Finding, ...] = ()

    def __len__(self) -> int:
        return len(self.part)


def read_points(files: Sequence[tuple[Path, str]], features: Mapping[str, Place] | None) -> Points:
    """Reads all files of measured points; `files` are (path, role).

    `features` are the part file's nominal places; without them the files must give
    nominal_x_mm, nominal_y_mm. Where both do, they must agree within 1e-6 mm.

    Raises InputError with all problems of all files: of headers and of every cell first,
    then, where those are sound, of what the rows mean together.
    """
    problems = CellFaults()
    tables = joined.read_tables(files, SPEC, problems)
    for table in tables:
        _check_table(table, features, problems)
    if problems.listed:
        for name in ("repeat", "sequence"):
            joined.integers(tables, name, problems)
        problems.raise_if_any()
    points = _assemble(tables, features, problems)
    problems.raise_if_any()
    if found := [*_negative_repeats(points, tables), *_second_sequences(points)]:
        raise InputError(found)
    return points


def _negative_repeats(points: Points, tables: Sequence[Table]) -> Iterator[Finding]:
    counted = np.array(["repeat" in table.header for table in tables], bool)
    for i in np.flatnonzero((points.repeat < 0) & counted[points.file_index]).tolist():
        yield _cell(points, i, "repeat", int(points.repeat[i]), "0, 1, 2, ...")


def _second_sequences(points: Points) -> Iterator[Finding]:
    """A part is made once in each operation: where its rows have two numbers of sequence."""
    run = points.part * (len(points.operations) + 1) + points.operation + 1
    _, first, code = np.unique(run, return_index=True, return_inverse=True)
    before = points.sequence[first][code.reshape(-1)]
    for i in np.flatnonzero(points.sequence != before).tolist():
        name = points.parts[points.part[i]]
        expected = f"{before[i]}, as before of part {name!r}: a part is made once"
        yield _cell(points, i, "sequence", int(points.sequence[i]), expected)


def _cell(points: Points, i: int, column: str, value: int, expected: str) -> Finding:
    file, row = points.sources[points.file_index[i]].shown, int(points.row[i])
    place = {"file": file, "row": row, "column": column}
    return finding("out-of-range", **place, value=str(value), expected=expected)


def _check_table(table: Table, features: Mapping[str, Place] | None, problems: CellFaults) -> None:
    for axis in AXES:
        joined.check_magnitude(table, f"{axis}_mm", problems)
        joined.check_magnitude(table, f"nominal_{axis}_mm", problems)
    joined.check_names(table, ("part", "operation"), problems)
    joined.check_known(table, "feature", features, problems)
    check_sensor_names(table, problems)
    joined.check_equal_rows(table, problems)


def _assemble(
    tables: Sequence[Table], features: Mapping[str, Place] | None, problems: CellFaults
) -> Points:
    parts, part = joined.labelled(tables, "part")
    names, feature = joined.labelled(tables, "feature", tuple(features or ()))
    operations, operation = joined.labelled(tables, "operation")
    directions = [f"dir_{axis}" for axis in AXES]
    return Points(
        parts=parts,
        part=part,
        features=names,
        feature=feature,
        operations=operations,
        operation=operation,
        measured=joined.columns_of(tables, [f"{axis}_mm" for axis in AXES]),
        nominal=_nominal(tables, names, feature, features, problems),
        repeat=joined.integers(tables, "repeat", problems),
        time_min=joined.minutes(tables, problems),
        sequence=_sequence(tables, part, problems),
        direction=joined.columns_of(tables, directions),
        covariates=joined.covariates(tables),
        file_index=joined.file_indices(tables),
        row=joined.end_to_end([table.rows for table in tables]),
        sources=tuple(table.source for table in tables),
    )


def _sequence(
    tables: Sequence[Table], part: NDArray[np.int64], problems: CellFaults
) -> NDArray[np.int64]:
    with_it = [table for table in tables if "sequence" in table.columns.numbers]
    if not with_it:
        # Codes are given in the order of first appearance.
        return part + 1
    for table in tables:
        if table not in with_it:
            expected = f"it in all files, or in none: {with_it[0].source.shown} has it"
            place = {"file": table.source.shown, "row": table.header_row}
            problems.add(finding("missing-column", name="sequence", expected=expected, **place))
    return joined.integers(tables, "sequence", problems)


def _nominal(
    tables: Sequence[Table],
    names: Sequence[str],
    feature: NDArray[np.int64],
    features: Mapping[str, Place] | None,
    problems: CellFaults,
) -> NDArray[np.float64]:
    """Nominal places of the part file, or else of the columns; both must agree."""
    columns = [f"nominal_{letter}_mm" for letter in AXES]
    if features is None:
        nominal = joined.columns_of(tables, columns)
    else:
        places = np.array([_place(features, name) for name in names], np.float64).reshape(-1, 3)
        nominal = np.empty((len(feature), 3), order="F")
        for axis in range(3):
            nominal[:, axis] = places[:, axis][feature]
    start = 0
    for table in tables:
        rows = slice(start, start + len(table))
        start += len(table)
        if features is None:
            _report_unknown(table, nominal[rows], problems)
            continue
        for axis, column in enumerate(columns):
            own = table.columns.numbers.get(column)
            if own is not None:
                _merge(table, nominal[rows, axis], own, AXES[axis], problems)
    return nominal


def _place(features: Mapping[str, Place] | None, name: str) -> tuple[float, float, float]:
    x, y, z = (features or {}).get(name, (np.nan, np.nan, None))
    return x, y, np.nan if z is None else z


def _merge(
    table: Table,
    nominal: NDArray[np.float64],
    own: NDArray[np.float64],
    letter: str,
    problems: CellFaults,
) -> None:
    """Fills in nominal coordinates (n,) from the columns' `own`, with which they must agree."""
    apart = np.flatnonzero(np.abs(own - nominal) > NOMINAL_TOLERANCE_MM)
    features = table.columns.texts["feature"]
    # What is wrong of a feature is mostly wrong in every part: that is one finding.
    cells = np.column_stack([features.codes[apart], own[apart]])
    for index in np.sort(apart[np.unique(cells, axis=0, return_index=True)[1]]).tolist():
        name = features.labels[features.codes[index]]
        expected = f"{nominal[index]:.9g}, as in the part file"
        column, value = f"nominal_{letter}_mm", [float(own[index])]
        problems.add_cells(table, [index], column, "other-nominal", value, expected, feature=name)
    np.copyto(nominal, own, where=np.isnan(nominal))


def _report_unknown(table: Table, nominal: NDArray[np.float64], problems: CellFaults) -> None:
    """One problem of all features without a nominal place."""
    rows = np.flatnonzero(np.isnan(nominal[:, 0]) | np.isnan(nominal[:, 1]))
    if not len(rows):
        return
    column = table.columns.texts["feature"]
    names = [column.labels[code] for code in dict.fromkeys(column.codes[rows].tolist())]
    meant = [name for name in table.covariates if name.casefold().startswith("nom")]
    expected = "them in a part file (--part), or nominal_x_mm and nominal_y_mm"
    expected += f"; rename {', '.join(map(repr, meant))}" if meant else ""
    place = {"file": table.source.shown, "row": int(table.rows[rows[0]]), "column": "feature"}
    features = listed(names, 3)
    problems.add(finding("no-nominal", features=features, expected=expected, **place))
