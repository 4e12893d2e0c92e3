"""Measured points (``--cmm``) from all files at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Problem, did_you_mean, shorten
from mtu_cli.files import doubled, joined
from mtu_cli.files.column_twins import column_twins
from mtu_cli.files.column_words import nominal_by_sign
from mtu_cli.files.csv_table import ProblemList, Table, TableSpec
from mtu_cli.files.drift_notes import negative_times
from mtu_cli.files.features_alike import features_alike
from mtu_cli.files.mixed_cells import mixed_cells
from mtu_cli.files.names_alike import names_alike
from mtu_cli.files.odd_rows import is_total
from mtu_cli.files.point_temperatures import check_temperatures_of_points, temperature_notes
from mtu_cli.files.sensor_names import check_temperature_names, sensor_name_notes
from mtu_cli.files.source import Source
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

Place = tuple[float, float, float | None]
"""Nominal x, y, z in mm; z None where nothing states it."""

AXES = ("x", "y", "z")
NOMINAL_TOLERANCE_MM = 1e-6
SHOWN_FEATURES = 3

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
    vectors=(
        tuple(f"{axis}_mm" for axis in AXES),
        tuple(f"nominal_{axis}_mm" for axis in AXES),
    ),
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
    text editor in the file `sources[file_index[i]]`. Arrays may be read-only. `notes` say which
    sensors look odd, which columns are none, and which features stand at one place.
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
    problems = ProblemList()
    tables = joined.read_tables(files, SPEC, problems)
    for table in tables:
        _check_table(table, features, problems)
    if problems.listed:
        for name in ("repeat", "sequence"):
            joined.integers(tables, name, problems)
        problems.raise_if_any()
    points = _assemble(tables, features, problems)
    problems.raise_if_any()
    check_temperatures_of_points(tables, points, problems)
    problems.raise_if_any()
    notes = (*temperature_notes(tables, points), *sensor_name_notes(tables))
    notes = (*features_alike(points), *names_alike(points), *negative_times(tables), *notes)
    notes = (*column_twins(tables, SPEC), *mixed_cells(tables, SPEC), *notes)
    return replace(points, notes=notes)


def _check_table(table: Table, features: Mapping[str, Place] | None, problems: ProblemList) -> None:
    for axis in AXES:
        joined.check_magnitude(table, f"{axis}_mm", problems)
        joined.check_magnitude(table, f"nominal_{axis}_mm", problems)
    joined.check_names(table, ("part", "operation"), problems)
    joined.check_labels(
        table, "part", "a row that sums up others",
        lambda label: "rows of measured parts alone" if is_total(label) else None, problems,
    )  # fmt: skip
    if features is None:
        joined.check_names(table, ("feature",), problems)
    else:
        joined.check_labels(
            table, "feature", "unknown feature",
            lambda label: None if label in features else did_you_mean(label, features), problems,
        )  # fmt: skip
    check_temperature_names(table, problems)
    names = {*table.columns.numbers, *table.columns.times}
    if names & {"repeat", "time", "time_min"} and not doubled.told_apart(table, "repeat"):
        doubled.check_doubled_rows(table, problems)


def _assemble(
    tables: Sequence[Table], features: Mapping[str, Place] | None, problems: ProblemList
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
    tables: Sequence[Table], part: NDArray[np.int64], problems: ProblemList
) -> NDArray[np.int64]:
    with_it = [table for table in tables if "sequence" in table.columns.numbers]
    if not with_it:
        # Codes are given in the order of first appearance.
        return part + 1
    for table in tables:
        if table not in with_it:
            what = f"no column 'sequence', which {with_it[0].source.shown} has"
            expected = "it in all files, or in none"
            problems.add(Problem(what=what, file=table.source.shown, expected=expected))
    return joined.integers(tables, "sequence", problems)


def _nominal(
    tables: Sequence[Table],
    names: Sequence[str],
    feature: NDArray[np.int64],
    features: Mapping[str, Place] | None,
    problems: ProblemList,
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
    problems: ProblemList,
) -> None:
    apart = np.flatnonzero(np.abs(own - nominal) > NOMINAL_TOLERANCE_MM)
    if len(apart):
        features = table.columns.texts["feature"]
        # What is wrong of a feature is mostly wrong in every part: that is one finding.
        cells = np.column_stack([features.codes[apart], own[apart]])
        _, first, counts = np.unique(cells, axis=0, return_index=True, return_counts=True)
        found = sorted(zip(apart[first].tolist(), counts.tolist(), strict=True))
        for index, count in found[:1000]:
            name = features.labels[features.codes[index]]
            more = f" (and {count - 1} more row{'s' if count > 2 else ''})" if count > 1 else ""
            expected = f"{nominal[index]:.9g}, as the part file has it for {name!r}{more}"
            column = f"nominal_{letter}_mm"
            what = f"the nominal {letter} of {name!r} is not the part file's"
            problems.add(table.problem(index, column, what, float(own[index]), expected))
        problems.uncounted += max(0, len(found) - 1000)
    np.copyto(nominal, own, where=np.isnan(nominal))


def _report_unknown(table: Table, nominal: NDArray[np.float64], problems: ProblemList) -> None:
    unknown = np.isnan(nominal[:, 0]) | np.isnan(nominal[:, 1])
    if not unknown.any():
        return
    column = table.columns.texts["feature"]
    codes, first = np.unique(column.codes[unknown], return_index=True)
    rows = np.flatnonzero(unknown)[first]
    names = [column.labels[code] for code in codes[np.argsort(rows)]]
    one, first_row = len(names) == 1, int(rows.min())
    expected = "the feature" if one else "them"
    expected += " in a part file (--part), or nominal_x_mm and nominal_y_mm" + _meant(table)
    if one:
        what = "no nominal place is known for the feature"
        problems.add(table.problem(first_row, "feature", what, names[0], expected))
        return
    shown = ", ".join(map(shorten, names[:SHOWN_FEATURES]))
    left = len(names) - SHOWN_FEATURES
    more = f" and {left} more" if left > 0 else ""
    what = f"no nominal place is known of {len(names)} features: {shown}{more}"
    problems.add(table.problem(first_row, "feature", what, "", expected))


def _meant(table: Table) -> str:
    """The columns that look like nominal places under another name."""
    found = [
        name
        for name in table.covariates
        if name.casefold().startswith("nom") or nominal_by_sign(name)
    ]
    return f"; rename {', '.join(map(repr, found))}" if found else ""
