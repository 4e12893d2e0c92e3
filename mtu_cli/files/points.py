"""Measured points (``--cmm``) from all files at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.csv_file import check_sensor_names, read_tables
from mtu_cli.files.csv_table import CellFaults, Flags, Floats, Ints, Table, cell_text
from mtu_cli.files.headers import POINTS
from mtu_cli.files.source import Source
from mtu_cli.findings import finding, listed

Place = tuple[float, float, float | None]
"""Nominal x, y, z in mm; z None where nothing states it."""

AXES = ("x", "y", "z")
SAME_MM = 1e-6
"""Coordinates that differ by less are one: a nanometre, which nobody measures."""


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

    def __len__(self) -> int:
        return len(self.part)


def read_points(files: Sequence[tuple[Path, str]], features: Mapping[str, Place] | None) -> Points:
    """Reads all files of measured points; `files` are (path, role).

    `features` are the part file's nominal places; without them the files must give
    nominal_x_mm, nominal_y_mm. Where both do, they must agree within 1e-6 mm.

    Raises InputError with all problems of all files: of headers and of every cell first,
    then, where those are sound, of what the rows mean together.
    """
    faults = CellFaults()
    table = read_tables(files, POINTS.knowing("feature", features), faults)
    for file in table.files:
        check_sensor_names(table, file, faults)
    faults.raise_if_any()
    nominal, sequence = _nominal(table, features, faults), _sequence(table, faults)
    faults.raise_if_any()
    parts, part = table.labelled("part")
    names, feature = table.labelled("feature", tuple(features or ()))
    operations, operation = table.labelled("operation")
    return Points(
        parts=parts,
        part=part,
        features=names,
        feature=feature,
        operations=operations,
        operation=operation,
        measured=_side_by_side(table, "{}_mm"),
        nominal=nominal,
        repeat=table.whole("repeat"),
        time_min=table.minutes(),
        sequence=sequence,
        direction=_side_by_side(table, "dir_{}"),
        covariates=table.covariates(POINTS),
        file_index=table.file_index,
        row=table.rows,
        sources=table.sources,
    )


def _side_by_side(table: Table, name: str) -> Floats:
    """The columns of x, y and z (n, 3), each contiguous in memory."""
    return np.array([table.number(name.format(axis)) for axis in AXES]).T


def _sequence(table: Table, faults: CellFaults) -> Ints:
    """The order of manufacture as all files give it, or that of first appearance (n,).

    A part is made once in each operation: its rows there have one number.
    """
    parts, part = table.labelled("part")
    given = [file for file in table.files if "sequence" in file.header]
    if not given:
        return part + 1
    expected = f"it in all files, or in none: {given[0].source.shown} has it"
    for file in table.files:
        if file not in given:
            place = {**file.place, "column": "sequence", "expected": expected}
            faults.add(finding("missing-column", **place))
    sequence, operation = table.whole("sequence"), table.labelled("operation")[1]
    run = part * (operation.max() + 2) + operation + 1
    _, first, code = np.unique(run, return_index=True, return_inverse=True)
    before = sequence[first][code.reshape(-1)]

    def of_row(i: int) -> dict[str, str]:
        name = f"part {parts[part[i]]!r}"
        expected = f"{before[i]}, as before of {name}: a part is made once"
        return {"value": str(sequence[i]), "expected": expected}

    bad = table.has("sequence") & (sequence != before)
    faults.cells(table, bad, "sequence", "out-of-range", of_row)
    return sequence


def _nominal(table: Table, features: Mapping[str, Place] | None, faults: CellFaults) -> Floats:
    """Nominal places (n, 3) of the part file, or else of the columns; both must agree."""
    nominal = _side_by_side(table, "nominal_{}_mm")
    column = table.texts["feature"]
    if features is None:
        _check_known(table, np.isnan(nominal[:, 0] + nominal[:, 1]), faults)
        return nominal
    places = np.array([features[name] for name in column.labels], np.float64).reshape(-1, 3)
    stated = places[column.codes]
    for axis, letter in enumerate(AXES):
        apart = np.flatnonzero(np.abs(nominal[:, axis] - stated[:, axis]) > SAME_MM)
        # What is wrong of a feature is mostly wrong in every part: that is one finding a file.
        cells = np.column_stack([table.file_index, column.codes, nominal[:, axis]])[apart]
        for i in np.sort(apart[np.unique(cells, axis=0, return_index=True)[1]]).tolist():
            expected = f"{stated[i, axis]:.9g}, as in the part file"
            facts = {"value": cell_text(float(nominal[i, axis])), "expected": expected}
            place = {**table.place(i), "column": f"nominal_{letter}_mm"}
            other = f"the nominal place of {column.labels[column.codes[i]]!r}"
            faults.add(finding("contradicts", other=other, **place, **facts))
    return np.where(np.isnan(stated), nominal, stated)


def _check_known(table: Table, bad: Flags, faults: CellFaults) -> None:
    """One finding a file of all features in the `bad` rows (n,), without a nominal place."""
    column = table.texts["feature"]
    for i in np.unique(table.file_index[bad]).tolist():
        rows = np.flatnonzero(bad & (table.file_index == i))
        names = [column.labels[code] for code in dict.fromkeys(column.codes[rows].tolist())]
        expected = "it in a part file (--part), or nominal_x_mm and nominal_y_mm"
        what = f"the nominal place of {listed(names, 3)}"
        place = {**table.place(rows[0]), "column": "feature"}
        faults.add(finding("missing-input", what=what, expected=expected, **place))
