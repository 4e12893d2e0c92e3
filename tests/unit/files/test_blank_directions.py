"""Directions that are forgotten in some rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_readings_file import MACHINE

from mtu_cli.errors import InputError
from mtu_cli.files.readings import read_readings

PLACES = (0, 75, 150, 225, 300, 375)
HEAD = "component,position_mm,pass,direction,error,unit"


def table(passes: int = 3, name: str = "dx_x") -> list[list[str]]:
    """Rows of passes there and back."""
    rng = np.random.default_rng(1)
    return [
        [name, str(place), str(number), way, f"{rng.normal():.3f}", "um"]
        for number in range(1, passes + 1)
        for way, places in (("forward", PLACES), ("reverse", PLACES[::-1]))
        for place in places
    ]


def told(tmp_path: Path, rows: list[list[str]]) -> list[str]:
    path = tmp_path / "r.csv"
    path.write_text("\n".join([HEAD, *map(",".join, rows)]) + "\n")
    try:
        notes = read_readings([(path, "lbb")], MACHINE, for_fit=True).notes
    except InputError as error:
        return [str(problem) for problem in error.findings]
    return [note.message for note in notes]


@pytest.mark.parametrize("whole", [False, True])
def test_a_direction_that_was_forgotten(whole: bool, tmp_path: Path) -> None:
    rows = table()
    blank = range(6) if whole else [3]
    for i in blank:
        rows[i][3] = ""
    found = told(tmp_path, rows)
    assert len(found) == len(blank)
    assert found[0] == (
        f"r.csv, row {2 + blank[0]}, column 'direction': empty cell; expected forward or reverse, "
        "as in the other rows of dx_x"
    )


def test_components_that_have_no_direction_at_all(tmp_path: Path) -> None:
    rows = table()
    rows += [["axy", "", str(number), "", f"{number}.1", "arcsec"] for number in (1, 2, 3)]
    assert told(tmp_path, rows) == []
    assert (
        told(tmp_path, [[*row[:3], "", *row[4:]] for row in table() if row[3] == "forward"]) == []
    )
