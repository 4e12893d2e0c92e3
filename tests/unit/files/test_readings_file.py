"""Readings: units, directions, times, and what only the machine can tell."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np
import pytest

from mtu_cli.files.readings import Readings, read_readings
from mtu_cli.findings import InputError


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


def test_equal_rows_are_one_reading_twice_where_passes_are_told_apart(tmp_path: Path) -> None:
    rows = "dx_x,0,1,um,1\ndx_x,5,1,um,1\n\ndx_x,0,1.0,um,1\ndx_x,0,1,um,2\n"
    assert faults(tmp_path, f"{HEAD},time_min\n{rows}") == [
        "r0.csv, row 5: the same as row 2; expected each row once"
    ]
    found = read(tmp_path, f"{HEAD},other\n{rows}")
    assert len(found) == 4
    with_covariate = "dx_x,0,1,um,1,20.1\ndx_x,0,1,um,1,20.2\n"
    assert len(read(tmp_path, f"{HEAD},pass,T_a_degC\n{with_covariate}")) == 2
    empty = "dx_x,0,1,um,1,\ndx_x,0,1,um,1,\n"
    assert len(faults(tmp_path, f"{HEAD},pass,T_a_degC\n{empty}")) == 1
