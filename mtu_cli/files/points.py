"""Measured points (``--cmm``) from all files at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mtu_cli.files.covariates import POSITIONS as AXES
from mtu_cli.files.csv_file import Convert, read_tables
from mtu_cli.files.csv_table import CellFaults, Floats, Ints, Measured, Table, cell_text
from mtu_cli.files.headers import POINTS
from mtu_cli.files.part import Place
from mtu_cli.findings import finding

SAME_MM = 1e-6
"""Coordinates that differ by less are one: a nanometre, which nobody measures."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Points(Measured):
    """Measured points of all files.

    `parts[part[i]]`, `features[feature[i]]`, `operations[operation[i]]` (-1: not given);
    `measured` and `nominal` (n, 3) mm, nan where z is not given; `repeat` -1 where not given;
    `sequence` the order of manufacture, as given or counted from 1 in the order in which parts
    first appear; `direction` (n, 3) -1, +1, or nan where not given.
    """

    parts: tuple[str, ...]
    part: Ints
    features: tuple[str, ...]
    feature: Ints
    operations: tuple[str, ...]
    operation: Ints
    measured: Floats
    nominal: Floats
    repeat: Ints
    sequence: Ints
    direction: Floats

    def __len__(self) -> int:
        return len(self.part)


def read_points(
    files: Sequence[tuple[Path, str]],
    features: Mapping[str, Place] | None,
    convert: Convert | None = None,
) -> Points:
    """Reads all files of measured points; `files` are (path, role).

    `features` are the part file's nominal places; without them the files must give
    nominal_x_mm, nominal_y_mm. Where both do, they must agree within 1e-6 mm.

    Raises InputError with all problems of all files: of headers and of every cell first,
    then, where those are sound, of the rows as a whole.
    """
    faults = CellFaults()
    table = read_tables(files, POINTS.with_texts("feature", features), faults, convert)
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
        sequence=sequence,
        direction=_side_by_side(table, "dir_{}"),
        **table.fields(POINTS),
    )


def _side_by_side(table: Table, name: str) -> Floats:
    """The columns of x, y and z (n, 3), each contiguous in memory; not to be written to."""
    names = [name.format(axis) for axis in AXES]
    if not any(column in table.numbers for column in names):
        return np.broadcast_to(np.nan, (len(table), len(AXES)))
    return np.array([table.number(column) for column in names]).T


def _sequence(table: Table, faults: CellFaults) -> Ints:
    """The order of manufacture (n,) as stated, one a part and operation, or of first appearance."""
    parts, part = table.labelled("part")
    ordered_files = [file for file in table.files if "sequence" in file.header]
    if not ordered_files:
        return part + 1
    expected = f"it in all files, or in none: {ordered_files[0].source.shown} has it"
    for file in table.files:
        if file not in ordered_files:
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
    faults.cells(table, bad, "sequence", of_row, code="out-of-range")
    return sequence


def _nominal(table: Table, features: Mapping[str, Place] | None, faults: CellFaults) -> Floats:
    """Nominal places (n, 3) of the part file, or else of the columns; both must agree."""
    nominal = _side_by_side(table, "nominal_{}_mm")
    column = table.texts["feature"]
    if features is None:
        bad = np.isnan(nominal[:, 0] + nominal[:, 1])
        expected = "it in a part file (--part), or nominal_x_mm and nominal_y_mm"
        facts: dict[str, Any] = {"what": "the nominal place", "expected": expected}
        faults.cells(table, bad, "feature", code="missing-input", **facts)
        return nominal
    places = np.array([features[name] for name in column.labels], np.float64).reshape(-1, 3)
    reference = places[column.codes]
    for axis, letter in enumerate(AXES):

        def of_row(i: int, axis: int = axis) -> dict[str, str]:
            other = f"the nominal place of {column.labels[column.codes[i]]!r}"
            expected = f"{reference[i, axis]:.9g}, as in the part file"
            return {"other": other, "value": cell_text(nominal[i, axis]), "expected": expected}

        bad = np.abs(nominal[:, axis] - reference[:, axis]) > SAME_MM
        faults.cells(table, bad, f"nominal_{letter}_mm", of_row, code="contradicts")
    return np.where(np.isnan(reference), nominal, reference)
