"""Readings: units, directions, times, and what only the machine can tell."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np
import pytest

from mtu_cli.errors import InputError
from mtu_cli.files import csv_file
from mtu_cli.files.readings import Readings, read_readings


@dataclass(frozen=True)
class Component:
    of: str | None
    unit: str
    degree: int


MACHINE = {
    "dx_x": Component("x", "um", 1),
    "ez_x": Component("x", "arcsec", 1),
    "axy": Component(None, "arcsec", 0),
}
HEAD = "component,position_mm,error,unit"


def read(tmp_path: Path, *contents: str, for_fit: bool = False, machine: bool = True) -> Readings:
    files = []
    for index, content in enumerate(contents):
        path = tmp_path / f"r{index}.csv"
        path.write_text(content)
        files.append((path, "lbb" if index == 0 else "laser"))
    return read_readings(files, MACHINE if machine else None, for_fit=for_fit)


def faults(
    tmp_path: Path, *contents: str, for_fit: bool = False, machine: bool = True
) -> list[str]:
    with pytest.raises(InputError) as caught:
        read(tmp_path, *contents, for_fit=for_fit, machine=machine)
    return [str(problem) for problem in caught.value.findings]


def test_readings_of_two_files(tmp_path: Path) -> None:
    first = (
        f"{HEAD},pass,direction,cycle,T_a_degC,setup\n"
        "axy,5,3600,arcsec,1,,w1,20,a\n"
        "dx_x,0,1.5,um,1,forward,w1,20.5,a\n"
        "dx_x,100,2,um,2,-,w2,,b\n"
    )
    second = "unit,error,component,position_mm,note\n# laser\nmrad,2,ez_x,10,7\n"
    found = read(tmp_path, first, second)
    assert found.components == ("dx_x", "ez_x", "axy")
    assert found.code.tolist() == [2, 0, 0, 1]
    np.testing.assert_array_equal(found.position_mm, [np.nan, 0, 100, 10])
    np.testing.assert_allclose(found.error, [pi / 180, 1.5e-3, 2e-3, 2e-3], rtol=1e-15)
    assert found.pass_number.tolist() == [1, 1, 2, -1]
    assert found.has_pass.tolist() == [True, True, True, False]
    assert found.direction.tolist() == [0, 1, -1, 0]
    assert found.direction.dtype == np.int8
    assert (found.cycles, found.cycle.tolist()) == (("w1", "w2"), [0, 0, 1, -1])
    assert np.isnan(found.time_min).all()
    np.testing.assert_array_equal(found.covariates["T_a_degC"], [20, 20.5, np.nan, np.nan])
    assert found.covariates["setup"].tolist() == ["a", "a", "b", ""]
    np.testing.assert_array_equal(found.covariates["note"], [np.nan] * 3 + [7])
    assert found.file_index.tolist() == [0, 0, 0, 1]
    assert found.row.tolist() == [2, 3, 4, 3]
    assert found.roles == ("lbb", "laser")
    assert [source.rows for source in found.sources] == [3, 1]
    assert len(found) == 4


def test_every_way_to_write_a_direction(tmp_path: Path) -> None:
    ways = ["forward", "Reverse", "+", "-", "1", "-1", "+1", "1.0", "-1.0", "FORWARD", ""]
    rows = "".join(f"dx_x,{i},1,um,{way}\n" for i, way in enumerate(ways))
    found = read(tmp_path, f"{HEAD},direction\n{rows}")
    assert found.direction.tolist() == [1, -1, 1, -1, 1, -1, 1, 1, -1, 1, 0]


def test_dates_count_from_the_earliest_of_all_files(tmp_path: Path) -> None:
    head = f"{HEAD},time\n"
    found = read(
        tmp_path,
        head + "dx_x,0,1,um,2024-05-03T10:01:00\ndx_x,1,1,um,2024-05-03T10:02:30\n",
        head + "dx_x,0,1,um,2024-05-03T10:00:00\n",
    )
    assert found.time_min.tolist() == [1.0, 2.5, 0.0]
    found = read(tmp_path, f"{HEAD},time_min\ndx_x,0,1,um,3.5\n")
    assert found.time_min.tolist() == [3.5]


def test_a_covariate_that_is_a_text_in_one_file_is_one_in_all(tmp_path: Path) -> None:
    found = read(tmp_path, f"{HEAD},shift\ndx_x,0,1,um,1\n", f"{HEAD},shift\ndx_x,0,1,um,night\n")
    assert found.covariates["shift"].tolist() == ["1", "night"]


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("dx_y,0,1,um", ", row 3, column 'component': unknown component: 'dx_y'; did you"),
        ("dx_x,0,1,um.", ", row 3, column 'unit': unknown unit: 'um.'; did you mean 'um"),
        ("dx_x,0,1,arcsec", "column 'unit': wrong kind of unit for 'dx_x': 'arcsec'; expected a l"),
        ("ez_x,0,1,um", "wrong kind of unit for 'ez_x': 'um'; expected an angle or ratio (rad)"),
        ("dx_x,,1,um", "column 'position_mm': empty cell; expected a number: dx_x is a function"),
    ],
)
def test_faulty_readings(tmp_path: Path, row: str, words: str) -> None:
    found = faults(tmp_path, f"{HEAD}\ndx_x,0,1,um\n{row}\n")
    assert len(found) == 1
    assert found[0].startswith("r0.csv, row 3")
    assert words in found[0]


def test_all_faults_of_all_files(tmp_path: Path) -> None:
    head = f"{HEAD},direction,pass\n"
    found = faults(
        tmp_path,
        head + "dx_x,0,1,um,up,1\nq,0,1,um,+,1.5\n",
        head + "dx_x,0,1,m,backward,1\n",
    )
    assert [line.split(": ")[0] for line in found] == [
        "r0.csv, row 2, column 'direction'",
        "r0.csv, row 3, column 'component'",
        "r0.csv, row 3, column 'pass'",
        "r1.csv, row 2, column 'unit'",
        "r1.csv, row 2, column 'direction'",
    ]
    assert "unknown direction: 'up'; expected forward or reverse, + or -, 1 or -1" in found[0]
    assert "not a whole number: '1.5'; expected a whole number" in found[2]
    # Cells that cannot be read are told for all files, too.
    found = faults(tmp_path, f"{HEAD}\ndx_x,0,a,um\n", f"{HEAD}\ndx_x,0,b,um\n")
    assert [line.split(", column")[0] for line in found] == ["r0.csv, row 2", "r1.csv, row 2"]


@pytest.mark.parametrize(
    "count", ["99999999999999999999", "9007199254740993", "9007199254740992", "-9007199254740992"]
)
@pytest.mark.parametrize("small", [csv_file.SMALL, 0])
def test_a_count_that_is_too_large_is_shown_as_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small: int, count: str
) -> None:
    """2^53 + 1 is read as 2^53: neither is told from the other."""
    monkeypatch.setattr(csv_file, "SMALL", small)
    found = faults(tmp_path, f"{HEAD},pass\ndx_x,0,1,um,{count}\n")
    assert found == [
        f"r0.csv, row 2, column 'pass': too large: '{count}'; expected a whole "
        "number, at most 9007199254740991 in size"
    ]
    assert (
        read(tmp_path, f"{HEAD},pass\ndx_x,0,1,um,9007199254740991\n").pass_number[0] == 2**53 - 1
    )


def test_position_is_required_where_a_component_has_an_axis(tmp_path: Path) -> None:
    assert read(tmp_path, "component,error,unit\naxy,1,arcsec\n").components == ("axy",)
    assert faults(tmp_path, "component,error,unit,location_mm\naxy,1,arcsec,\ndx_x,1,um,3\n") == [
        "r0.csv, row 1: the column 'position_mm' is missing; "
        "expected 'location_mm' renamed to 'position_mm'"
    ]


def test_without_a_machine_any_component_is_read(tmp_path: Path) -> None:
    found = read(tmp_path, f"{HEAD}\nq,,1,um\nr,3,1,rad\n", machine=False)
    assert found.components == ("q", "r")
    np.testing.assert_array_equal(found.position_mm, [np.nan, 3])


def test_equal_rows_are_one_reading_twice_where_passes_are_told_apart(tmp_path: Path) -> None:
    """One instant has one reading; a pass may have several, which a coarse display makes equal."""
    rows = "dx_x,0,1,um,1\ndx_x,5,1,um,1\n\ndx_x,0,1.0,um,1\ndx_x,0,1,um,2\n"
    assert faults(tmp_path, f"{HEAD},time_min\n{rows}") == [
        "r0.csv, row 5: the same as row 2 in every column; expected each reading once"
    ]
    found = read(tmp_path, f"{HEAD},pass\n{rows}")
    assert len(found) == 4
    assert [(note.code, note.message) for note in found.notes] == [
        (
            "readings-equal",
            "r0.csv, row 5: the same as row 2 in every column; 1 reading is equal to an earlier "
            "one of the same file: read as repeats; remove them where they were pasted twice",
        )
    ]
    found = read(tmp_path, f"{HEAD},other\n{rows}")
    assert (len(found), found.notes) == (4, ())
    with_covariate = "dx_x,0,1,um,1,20.1\ndx_x,0,1,um,1,20.2\n"
    assert len(read(tmp_path, f"{HEAD},pass,T_a_degC\n{with_covariate}")) == 2
    assert read(tmp_path, f"{HEAD},pass,T_a_degC\n{with_covariate}").notes == ()
    empty = "dx_x,0,1,um,1,\ndx_x,0,1,um,1,\n"
    found = read(tmp_path, f"{HEAD},pass,T_a_degC\n{empty}", f"{HEAD},pass\n{rows}axy,1,1,deg,1\n")
    assert ["2 readings are equal" in note.message for note in found.notes] == [True]


@pytest.mark.parametrize(("equal", "told"), [(1, False), (2, True)])
def test_a_few_equal_repeats_among_others_are_chance(
    equal: int, told: bool, tmp_path: Path
) -> None:
    """Of four that repeat an earlier one half may be pasted, fewer are a coarse display's."""
    rows = "".join(f"dx_x,{x},{x + 1},um,1\n" for x in range(4))
    again = "".join(f"dx_x,{x},{x + 1 + 9 * (x >= equal)},um,1\n" for x in range(4))
    notes = read(tmp_path, f"{HEAD},pass\n{rows}{again}").notes
    assert [note.code for note in notes] == ["readings-equal"] * told


def test_a_table_that_was_pasted_twice_is_refused(tmp_path: Path) -> None:
    """Every row of a component stands equally often, whatever the others do."""
    own = "".join(f"dx_x,{x},{x % 3},um,1\n" for x in range(4))
    other = "ez_x,1,5,arcsec,1\nez_x,2,5,arcsec,1\n"
    assert faults(tmp_path, f"{HEAD},pass\n{own}{other}{own}") == [
        "r0.csv, row 8: each of the 4 readings of 'dx_x' stands twice, as in a table that was "
        "pasted again; expected each reading once"
    ]
    (found,) = faults(tmp_path, f"{HEAD},pass\n{other}{own * 3}")
    assert "row 8: each of the 4 readings of 'dx_x' stands 3 times" in found
    once_more = "dx_x,9,1,um,1\n"
    found_rows = read(tmp_path, f"{HEAD},pass\n{own}{own}{once_more}")
    assert "4 readings are equal" in found_rows.notes[0].message
    few = own.removesuffix("dx_x,3,0,um,1\n")
    assert len(read(tmp_path, f"{HEAD},pass\n{few}{few}")) == 6
    # Two readings at each dwell, which a display shows alike.
    dwell = "".join(f"dx_x,{x},{x % 3},um,1\n" * 2 for x in range(30))
    assert "30 readings are equal" in read(tmp_path, f"{HEAD},pass\n{dwell}").notes[0].message
    # A display that shows the same again and again.
    steady = "axy,,5,arcsec,1\n" * 9
    assert "8 readings are equal" in read(tmp_path, f"{HEAD},pass\n{steady}").notes[0].message


def test_the_same_file_twice(tmp_path: Path) -> None:
    content = f"{HEAD}\ndx_x,0,1,um\n"
    assert faults(tmp_path, content, content) == [
        "r1.csv: the same bytes as 'r0.csv': its rows would count twice; expected each file once"
    ]


def test_times_that_do_not_go_together(tmp_path: Path) -> None:
    both = faults(tmp_path, f"{HEAD},time,time_min\ndx_x,0,1,um,2024-05-03,1\n")
    assert both == ["r0.csv, row 1: both 'time' and 'time_min' are given; expected one of them"]
    first = f"{HEAD},time\ndx_x,0,1,um,2024-05-03\n"
    found = faults(tmp_path, first, f"{HEAD},time_min\ndx_x,0,1,um,3\n")
    assert found == [
        "r1.csv: 'time_min' here, but 'time' in r0.csv; expected one of them in all files"
    ]
    found = faults(tmp_path, first, f"{HEAD},time\ndx_x,0,1,um,2024-05-03T10:00Z\n")
    assert (
        "r1.csv, column 'time': times with an offset from UTC, unlike those of r0.csv" in found[0]
    )


def test_without_passes_a_table_that_was_pasted_twice_is_refused_by_its_many_values(
    tmp_path: Path,
) -> None:
    """Equal readings are legitimate there, but not of every place in the same order."""
    own = "".join(f"dx_x,{x},{x % 9}.{x},um\n" for x in range(12))
    (found,) = faults(tmp_path, f"{HEAD}\n{own}{own}")
    assert found.startswith("r0.csv, row 14: each of the 12 readings of 'dx_x' stands twice, as")
    half = "".join(own.splitlines(keepends=True)[:6])
    assert len(read(tmp_path, f"{HEAD}\n{own}{half}")) == 18
    coarse = "".join(f"dx_x,{x},{x // 2},um\n" for x in range(12))
    assert read(tmp_path, f"{HEAD}\n{coarse}{coarse}").notes == ()


def test_a_position_that_is_everywhere_the_same_slip_tells_the_travel(tmp_path: Path) -> None:
    """No position can be judged by the others then."""
    path = tmp_path / "r.csv"
    for value, told in ((9999, "; x travels 400 mm"), (40, "")):
        path.write_text(f"{HEAD}\ndx_x,{value},1,um\ndx_x,{value},2,um\n")
        travels = {"x": (0.0, 400.0)}
        with pytest.raises(InputError) as caught:
            read_readings([(path, "laser")], MACHINE, for_fit=True, travels=travels)
        expected = f"only: '{value} mm'; expected at least 2 positions{told}"
        assert str(caught.value).endswith(expected)
        assert ", column 'position_mm': 'dx_x' of degree 1 is measured at one" in str(caught.value)


def test_a_fit_needs_as_many_positions_as_coefficients(tmp_path: Path) -> None:
    content = f"{HEAD}\naxy,,1,arcsec\ndx_x,7,1,um\ndx_x,7,2,um\nez_x,1,1,rad\nez_x,2,1,rad\n"
    assert len(read(tmp_path, content)) == 5
    assert faults(tmp_path, content, for_fit=True) == [
        "r0.csv, row 3, column 'position_mm': 'dx_x' of degree 1 is measured at one position "
        "only: '7 mm'; expected at least 2 positions"
    ]


@pytest.mark.parametrize("sign", ["\u00b5", "\u03bc"])
def test_both_signs_for_micro_are_a_u(sign: str, tmp_path: Path) -> None:
    """Beside each other and beside the plain letter, as of several instruments."""
    rows = ["dx_x,0,1,um", "dx_x,1,2,um", "ez_x,0,1,urad", "ez_x,1,2,um/m"]
    plain = read(tmp_path, "\n".join([HEAD, *rows]) + "\n")
    signed = [rows[0], *(row.replace(",u", f",{sign}") for row in rows[1:])]
    found = read(tmp_path, "\n".join([HEAD, *signed]) + "\n")
    assert found.error.tolist() == plain.error.tolist()
    assert found.dimension.tolist() == plain.dimension.tolist()
    assert found.notes == plain.notes
