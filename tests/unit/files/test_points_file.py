"""Measured points: nominal places, order of manufacture, approach directions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mtu_cli.files.part import Place
from mtu_cli.files.readings import Points, read_points
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


NOMINAL = f"{HEAD},nominal_x_mm,nominal_y_mm,nominal_z_mm"
LINE = "expected a text on one line that is not empty, without control characters"
WAY = "expected forward or reverse, + or -, 1 or -1"
FAULTS: dict[str, tuple[list[str], dict[str, Place] | None, list[str]]] = {
    "no nominal": (
        [f"{HEAD}\na,f,1,2\n"],
        None,
        ["p0.csv, row 2, column 'feature': the nominal place is missing; expected it in a part "
         "file (--part), or nominal_x_mm and nominal_y_mm"],
    ),
    "another nominal": (
        [f"{NOMINAL}\na,h1,1,2,0,0,5\na,h2,1,2,10.00001,20,7\n"],
        PART,
        ["p0.csv, row 3, column 'nominal_x_mm': contradicts the nominal place of 'h2': '10.00001'; "
         "expected 10, as in the part file"],
    ),
    "sequence in one file": (
        [f"{HEAD},sequence\nb,h1,0,0,7\n", f"{HEAD}\na,h1,0,0\n"],
        PART,
        ["p1.csv, row 1, column 'sequence': the column is missing; expected it in all files, or in "
         "none: p0.csv has it"],
    ),
    "directions": (
        [f"{HEAD},dir_x,dir_y\na,h1,0,0,+,1\na,h2,0,0,forwrd,0.5\n"],
        PART,
        ["p0.csv, row 3, column 'dir_x': not a direction: 'forwrd'; did you mean 'forward'?",
         f"p0.csv, row 3, column 'dir_y': not a direction: '0.5'; {WAY}"],
    ),
    "equal rows": (
        [f"{HEAD},repeat\na,h1,0,0,1\na,h1,-0.0,0,1\na,h1,0,0,2\n"],
        PART,
        ["p0.csv, row 3: the same as row 2; expected each row once"],
    ),
    "repeat below 0, in all of a file": (
        [f"{HEAD},repeat\n7,h1,0,0,-1\n", f"{HEAD}\n8,h1,0,0\n"],
        PART,
        ["p0.csv, row 2, column 'repeat': out of range: '-1'; expected a whole number from 0 on"],
    ),
    "control characters": (
        [f'{HEAD}\n1\x1b[31m,h1,0,0\n2,"h\n1",0,0\n'],
        None,
        ["p0.csv, row 2, column 'part': not a name that a table can show: '1\\x1b[31m'; " + LINE,
         "p0.csv, row 3, column 'feature': not a name that a table can show: 'h\\n1'; " + LINE],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", FAULTS)
def test_faults_have_their_place(tmp_path: Path, case: str) -> None:
    contents, features, expected = FAULTS[case]
    with pytest.raises(InputError) as caught:
        read(tmp_path, *contents, features=features)
    assert [str(problem) for problem in caught.value.findings][: len(expected)] == expected


def test_columns_that_stand_in_for_others(tmp_path: Path) -> None:
    """Nominal places without a part file, or within a nanometre of it; dates and a sequence;
    directions in words, signs or numbers, in a decimal comma, too.
    """
    alone = read(tmp_path, f"{NOMINAL}\na,f,1,2,1.5,2.5,3.5\n", features=None)
    assert alone.nominal.tolist() == [[1.5, 2.5, 3.5]]
    near = read(tmp_path, f"{NOMINAL}\na,h2,1,2,10.0000009,20,7\n")
    assert near.nominal.tolist() == [[10.0, 20.0, 7.0]]
    dated = f"{HEAD},time,sequence\na,h1,0,0,2024-05-03 10:30,7\nb,h2,0,0,2024-05-03 10:00,-4\n"
    found = read(tmp_path, dated)
    assert (found.time_min.tolist(), found.sequence.tolist()) == ([30.0, 0.0], [7, -4])
    first = f"{HEAD},dir_x,dir_y\na,h1,0,0,+,forward\na,h2,0,0,,Reverse\nb,h1,0,0,-,+1\n"
    found = read(tmp_path, first, f"{HEAD},dir_x\nc,h1,0,0,1.0\nc,h2,0,0,-1\n")
    np.testing.assert_array_equal(found.direction[:, 0], [1, np.nan, -1, 1, -1])
    np.testing.assert_array_equal(found.direction[:3, 1], [1, -1, 1])
    german = f"{HEAD};dir_x".replace(",", ";") + "\na;h1;0,5;0;1,0\na;h2;0;0;−\n"
    assert read(tmp_path, german).direction[:, 0].tolist() == [1, -1]
