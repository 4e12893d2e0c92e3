"""Measured points: nominal places, order of manufacture, approach directions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mtu_cli.files.part import Place
from mtu_cli.files.points import Points, read_points
from mtu_cli.findings import InputError

PART: dict[str, Place] = {"h2": (10.0, 20.0, None), "h1": (0.0, 0.0, 5.0), "h10": (1.0, 1.0, None)}
HEAD = "part,feature,x_mm,y_mm"


def read(tmp_path: Path, *contents: str, features: dict[str, Place] | None = PART) -> Points:
    files = []
    for index, content in enumerate(contents):
        path = tmp_path / f"p{index}.csv"
        path.write_text(content)
        files.append((path, "cmm"))
    return read_points(files, features)


def faults(tmp_path: Path, *contents: str, features: dict[str, Place] | None = PART) -> list[str]:
    with pytest.raises(InputError) as caught:
        read(tmp_path, *contents, features=features)
    return [str(problem) for problem in caught.value.findings]


def test_points_of_two_files(tmp_path: Path) -> None:
    first = (
        f"{HEAD},z_mm,repeat,operation,dir_x,T_a_degC,shift\n"
        "007,h1,0.01,0.02,5.01,1,drilled,-1,20,day\n"
        "007,h2,10.01,20,5,1,milled,,20,day\n"
        "A,h1,0,0,5,2,drilled,1,21,\n"
    )
    second = f"{HEAD}\n7,h2,10,20\n007,h2,10,20.5\n"
    found = read(tmp_path, first, second)
    assert (found.parts, found.part.tolist()) == (("007", "A", "7"), [0, 0, 1, 2, 0])
    assert (found.features, found.feature.tolist()) == (("h2", "h1"), [1, 0, 1, 0, 0])
    assert (found.operations, found.operation.tolist()) == (
        ("drilled", "milled"),
        [0, 1, 0, -1, -1],
    )
    nan = np.nan
    np.testing.assert_array_equal(
        found.measured,
        [[0.01, 0.02, 5.01], [10.01, 20, 5], [0, 0, 5], [10, 20, nan], [10, 20.5, nan]],
    )
    np.testing.assert_array_equal(
        found.nominal,
        [[0, 0, 5], [10, 20, nan], [0, 0, 5], [10, 20, nan], [10, 20, nan]],
    )
    assert found.repeat.tolist() == [1, 1, 2, -1, -1]
    assert found.sequence.tolist() == [1, 1, 2, 3, 1]
    np.testing.assert_array_equal(found.direction[:, 0], [-1, nan, 1, nan, nan])
    assert np.isnan(found.direction[:, 1:]).all()
    assert np.isnan(found.time_min).all()
    assert found.covariates["shift"].tolist() == ["day", "day", "", "", ""]
    np.testing.assert_array_equal(found.covariates["T_a_degC"], [20, 20, 21, nan, nan])
    assert found.file_index.tolist() == [0, 0, 0, 1, 1]
    assert found.row.tolist() == [2, 3, 4, 2, 3]
    assert len(found) == 5


def test_nominal_columns_stand_in_for_a_part_file(tmp_path: Path) -> None:
    content = f"{HEAD},nominal_x_mm,nominal_y_mm,nominal_z_mm\na,f,1,2,1.5,2.5,3.5\n"
    found = read(tmp_path, content, features=None)
    assert found.nominal.tolist() == [[1.5, 2.5, 3.5]]
    rows = faults(tmp_path, f"{HEAD}\na,f,1,2\na,e,1,2\n", features=None)
    assert rows == [
        f"p0.csv, row {row}, column 'feature': the nominal place is missing; "
        "expected it in a part file (--part), or nominal_x_mm and nominal_y_mm"
        for row in (2, 3)
    ]
    assert (
        "column 'nominal_y_mm': the column is missing"
        in faults(tmp_path, f"{HEAD},nominal_x_mm\na,f,1,2,3\n", features=None)[0]
    )


def test_nominal_columns_must_agree_with_the_part_file(tmp_path: Path) -> None:
    """Within a nanometre; z where the part file says nothing is that of the columns."""
    head = f"{HEAD},nominal_x_mm,nominal_y_mm,nominal_z_mm\n"
    found = read(tmp_path, head + "a,h2,1,2,10.0000009,20,7\n")
    assert found.nominal.tolist() == [[10.0, 20.0, 7.0]]
    assert faults(tmp_path, head + "a,h1,1,2,0,0,5\na,h2,1,2,10.00001,20,7\n") == [
        "p0.csv, row 3, column 'nominal_x_mm': contradicts the nominal place of 'h2': "
        "'10.00001'; expected 10, as in the part file"
    ]


def test_sequence_is_as_given(tmp_path: Path) -> None:
    found = read(tmp_path, f"{HEAD},sequence\nb,h1,0,0,7\na,h1,0,0,3\n")
    assert found.sequence.tolist() == [7, 3]
    found_faults = faults(tmp_path, f"{HEAD},sequence\nb,h1,0,0,7\n", f"{HEAD}\na,h1,0,0\n")
    assert found_faults == [
        "p1.csv, row 1, column 'sequence': the column is missing; "
        "expected it in all files, or in none: p0.csv has it"
    ]


def test_dates_are_minutes_from_the_first(tmp_path: Path) -> None:
    content = f"{HEAD},time\na,h1,0,0,2024-05-03 10:30\na,h2,0,0,2024-05-03 10:00\n"
    assert read(tmp_path, content).time_min.tolist() == [30.0, 0.0]


def test_directions_are_written_as_those_of_readings(
    tmp_path: Path,
) -> None:
    """In words, signs or numbers, by either reader, and mixed from file to file."""
    first = f"{HEAD},dir_x,dir_y\na,h1,0,0,+,forward\na,h2,0,0,,Reverse\nb,h1,0,0,-,+1\n"
    second = f"{HEAD},dir_x\nc,h1,0,0,1.0\nc,h2,0,0,-1\n"
    found = read(tmp_path, first, second).direction
    np.testing.assert_array_equal(found[:, 0], [1, np.nan, -1, 1, -1])
    np.testing.assert_array_equal(found[:3, 1], [1, -1, 1])
    bad = f"{HEAD},dir_x,dir_y\na,h1,0,0,+,1\na,h2,0,0,forwrd,0.5\n"
    assert faults(tmp_path, bad) == [
        "p0.csv, row 3, column 'dir_x': not a direction: 'forwrd'; did you mean 'forward'?",
        "p0.csv, row 3, column 'dir_y': not a direction: '0.5'; expected forward or reverse, + or "
        "-, 1 or -1",
    ]
    german = f"{HEAD};dir_x".replace(",", ";") + "\na;h1;0,5;0;1,0\na;h2;0;0;−\n"
    assert read(tmp_path, german).direction[:, 0].tolist() == [1, -1]


def test_equal_rows_where_repeats_are_told_apart(tmp_path: Path) -> None:
    rows = "a,h1,0,0,1\na,h1,-0.0,0,1\na,h1,0,0,2\n"
    assert faults(tmp_path, f"{HEAD},repeat\n{rows}") == [
        "p0.csv, row 3: the same as row 2; expected each row once"
    ]
    assert len(read(tmp_path, f"{HEAD},other\n{rows}")) == 3


def test_repeats_are_counted_from_zero(tmp_path: Path) -> None:
    """Also where all of a file are -1, which stands for a file without repeats."""
    rows = f"{HEAD},repeat\n7,h1,0,0,-1\n7,h2,10,20,-1\n"
    expected = "'repeat': out of range: '-1'; expected a whole number from 0 on"
    found = faults(tmp_path, rows, f"{HEAD}\n8,h1,0,0\n")
    assert found == [f"p0.csv, row {row}, column {expected}" for row in (2, 3)]
    assert read(tmp_path, f"{HEAD},sequence\n7,h1,0,0,-4\n").sequence.tolist() == [-4]


def test_names_stand_on_one_line(tmp_path: Path) -> None:
    content = f'{HEAD},note\n1\x1b[31m,h1,0,0,a\n2,"h\n1",0,0,"b\nc"\n2,h2,0,0,d\n'
    expected = "expected a text on one line that is not empty, without control characters"
    assert faults(tmp_path, content, features=None)[:2] == [
        f"p0.csv, row 2, column 'part': not a name that a table can show: '1\\x1b[31m'; {expected}",
        f"p0.csv, row 3, column 'feature': not a name that a table can show: 'h\\n1'; {expected}",
    ]
    assert faults(tmp_path, f"{HEAD},T\x07\n1,h1,0,0,1\n") == [
        f"p0.csv, row 1: not a name that a table can show at column 5: 'T\\x07'; {expected}"
    ]
