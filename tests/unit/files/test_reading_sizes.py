"""Readings and positions of no machine: one message with what would explain them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.readings import Readings, read_readings


@dataclass(frozen=True)
class Component:
    of: str | None
    unit: str
    degree: int


MACHINE = {
    "dx_x": Component("x", "um", 1),
    "dy_x": Component("x", "um", 1),
    "ez_x": Component("x", "urad", 1),
    "axy": Component(None, "urad", 0),
}
TRAVELS = {"x": (0.0, 1000.0)}
HEAD = "component,position_mm,pass,error,unit\n"

Cell = tuple[float, float, str]
"""Position, error and unit of a reading."""


def table(change: Callable[[str, int, Cell], Cell] = lambda name, i, cell: cell) -> str:
    """Five passes of ten positions of two components, changed by name and number."""
    rows = []
    for name, unit in (("dx_x", "um"), ("ez_x", "urad")):
        for i in range(50):
            place, error = 20.0 * (i % 10), 4.0 + 0.1 * (i % 10) + 0.01 * i
            position, error, own = change(name, i, (place, error, unit))
            rows.append(f"{name},{position:.10g},{i // 10},{error:.10g},{own}\n")
    return HEAD + "".join(rows) + "axy,,1,-30,urad\naxy,,2,-31,urad\n"


def read(folder: Path, text: str, travels: dict[str, tuple[float, float]] | None) -> Readings:
    path = folder / "lbb.csv"
    path.write_text(text, "utf-8")
    return read_readings([(path, "lbb")], MACHINE, for_fit=True, travels=travels)


@pytest.mark.parametrize("travels", [TRAVELS, None])
def test_what_machines_have_passes(
    tmp_path: Path, travels: dict[str, tuple[float, float]] | None
) -> None:
    """Also errors just below the limit, and positions in a frame far from the machine's."""

    def edge(name: str, i: int, cell: Cell) -> Cell:
        return cell[0] - 1900.0, (990.0 if name == "dx_x" else 49900.0) + 0.01 * i, cell[2]

    assert read(tmp_path, table(), travels).notes == ()
    assert len(read(tmp_path, table(edge), travels)) == 102


def grown(slope: float, length: float, zero: float = 0.0) -> Callable[[str, int, Cell], Cell]:
    """Lengths that grow by `slope` um/m from `zero` on, over so many mm; angles of 0.64 deg."""

    def change(name: str, i: int, cell: Cell) -> Cell:
        place = length * (i % 10) / 9
        error = slope * (place - zero) / 1000 if name == "dx_x" else 11170.0
        return place, error + 0.3 * (i % 7), cell[2]

    return change


def along(error: Callable[[int, float], float]) -> Callable[[str, int, Cell], Cell]:
    """Lengths in mm by pass and position, over 600 mm."""

    def change(name: str, i: int, cell: Cell) -> Cell:
        place = 600.0 * (i % 10) / 9
        return (place, error(i // 10, place), "mm") if name == "dx_x" else (place, *cell[1:])

    return change


@pytest.mark.parametrize(
    "change",
    [
        grown(55.0, 24000.0),
        grown(55.0, 24000.0, 24000.0),
        grown(3000.0, 600.0),
        grown(3000.0, 600.0, 600.0),
        grown(1000.0, 5000.0),
        lambda name, i, c: (c[0], 0.2 * c[1], "mm" if name == "dx_x" else c[2]),
        lambda name, i, c: (c[0], 3e5 * (1 + i % 10) if name == "dx_x" else c[1], c[2]),
        along(lambda run, x: 0.01 * x + 0.3 * math.sin(run + x)),
        along(lambda run, x: 1.0 * (run % 2) + 0.9 * math.sin(x / 150)),
        along(lambda run, x: (run - 2.4) * 0.004 * (x - 600 * (run % 2))),
        along(lambda run, x: round(4 * (x / 200 - 0.3 * run)) / 4),
        along(lambda run, x: 3.4 + 0.02 * math.sin(run + x / 60)),
        along(lambda run, x: 1.5 * math.sin(x / 191) + 0.1 * run),
    ],
    ids=[
        "gantry",
        "its zero at the end",
        "belt",
        "its end",
        "alignment",
        "few",
        "unexplained",
        "a poor belt",
        "backlash of 1 mm",
        "aligned anew",
        "coarse",
        "indicator not set to 0",
        "bow",
    ],
)
def test_large_machines_and_poor_ones_pass(
    tmp_path: Path, change: Callable[[str, int, Cell], Cell]
) -> None:
    """Errors beyond a millimetre that lines explain, and those that no unit does."""
    text = table(change)
    for travels in ({"x": (0.0, 24000.0)}, None):
        assert len(read(tmp_path, text, travels)) == 102


FARTHEST = "the distance to 0 or to the farthest place read"
MISTAKES: dict[str, tuple[Callable[[str, int, Cell], Cell], str]] = {
    "um as mm": (
        lambda name, i, c: (c[0], c[1], "mm" if name == "dx_x" else c[2]),
        "row 2, column 'error': 50 of 50 cells of dx_x are larger than any machine's error "
        "(these look like um in a column of mm): '4 mm'; expected errors of at most 1 mm, or 1 % "
        f"of {FARTHEST}",
    ),
    "nm as um": (
        lambda name, i, c: (c[0], 1000 * c[1] if name == "dx_x" else c[1], c[2]),
        "these look like nm in a column of um",
    ),
    "more than half are beyond": (
        lambda name, i, c: (c[0], 0.4 * c[1], "mm" if name == "dx_x" else c[2]),
        "cells of dx_x are larger than any machine's error (these look like um in a "
        f"column of mm): '1.644 mm'; expected errors of at most 1 mm, or 1 % of {FARTHEST}",
    ),
    "um as mm on a longer axis": (
        along(lambda run, x: 1.5 + 0.005 * x + 3.0 * math.sin(x / 90) + 0.1 * run),
        "44 of 50 cells of dx_x are larger than any machine's error (these look like um in a "
        "column of mm): '6.022453692 mm'; expected errors of at most 1 mm, or 0.1 % of "
        f"{FARTHEST}, off a line as steep as their own (1 % at most) that is 0 somewhere on the "
        "axis",
    ),
    # Those near the zero lie off the line too; what is told is one that is large.
    "2 % far from the origin": (
        lambda name, i, c: (
            2000 + 1000 * (i % 10) / 9,
            *((20 * (i % 10) / 9, "mm") if name == "dx_x" else c[1:]),
        ),
        "row 11, column 'error': 30 of 50 cells of dx_x are larger than any machine's error (these "
        "look like um in a column of mm): '20 ",
    ),
    "waves and a constant of um as mm": (
        along(lambda run, x: 3.0 + 0.6 * math.sin(x / 90 + run)),
        "larger than any machine's error (these look like um in a column of mm): ",
    ),
    "urad as rad": (
        lambda name, i, c: (c[0], c[1], c[2] if name == "dx_x" else "rad"),
        "(these look like arcsec or urad in a column of rad): ",
    ),
    "angles by a thousand": (
        lambda name, i, c: (c[0], c[1] if name == "dx_x" else 20000 * c[1], c[2]),
        "these look 1000 times too large",
    ),
    "lengths of the bar": (
        lambda name, i, c: (c[0], 3e5 + c[1] if name == "dx_x" else c[1], c[2]),
        "these look like lengths of a bar of 300.005 mm, not errors",
    ),
    "positions that were reached": (
        lambda name, i, c: (c[0], 1000 * c[0] + c[1] if name == "dx_x" else c[1], c[2]),
        "these look like the positions that were reached, not their errors",
    ),
    "positions in um": (
        lambda name, i, c: (1000 * c[0], *c[1:]),
        "cells of dx_x, ez_x are farther than the machine goes: '20000'; expected positions in mm "
        "(x travels from 0 to 1000 mm): these look like um in a column of mm",
    ),
    "one reading": (
        lambda name, i, c: (c[0], 4300.0 if (name, i) == ("dx_x", 22) else c[1], c[2]),
        "row 24, column 'error': does not fit the other readings of 'dx_x': '4300'; expected what "
        "the others have, 4 to 5.39 um",
    ),
    "one position": (
        lambda name, i, c: (40000.0 if (name, i) == ("ez_x", 2) else c[0], *c[1:]),
        "row 54, column 'position_mm': does not fit the other positions of 'ez_x': '40000'; "
        "expected what the others have, 0 to 180 mm",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_message(tmp_path: Path, mistake: str) -> None:
    change, words = MISTAKES[mistake]
    with pytest.raises(InputError) as caught:
        read(tmp_path, table(change), TRAVELS)
    (problem,) = caught.value.findings
    assert words in str(problem)
    assert problem.file is not None
    assert problem.row is not None


@pytest.mark.parametrize("names", [("dx_x", "dy_x"), ("dy_x", "dx_x")])
@pytest.mark.parametrize("size", [24.0, 31.0])
def test_the_cell_that_is_told_is_beyond_the_limit_that_is_told(
    tmp_path: Path, names: tuple[str, str], size: float
) -> None:
    """One component beyond 1 % of the way, and one within it that is off its line."""
    cells = [
        (name, x, 9 * math.sin(x / 70) if name == "dy_x" else size + 2 * math.cos(x / 90))
        for name in names
        for x in (2000 * i / 49 for i in range(50))
    ]
    text = HEAD + "".join(f"{name},{x:.6f},1,{error:.6f},mm\n" for name, x, error in cells)
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, {"x": (0.0, 2000.0)})
    (problem,) = caught.value.findings
    name, x, error = cells[(problem.row or 0) - 2]
    share = 0.001 if "0.1 %" in str(problem) else 0.01
    assert abs(error) > share * max(x, 2000 - x)
    assert name == ("dy_x" if share < 0.01 else "dx_x")


@pytest.mark.parametrize(
    ("travels", "limit"),
    [({"x": (0.0, 3000.0)}, "1 mm, or 1 % of the longest travel"), ({}, "1 mm")],
)
def test_a_component_without_an_axis_has_no_way(
    tmp_path: Path, travels: dict[str, tuple[float, float]], limit: str
) -> None:
    """A position that is given there has no meaning."""
    rows = "".join(f"dz_n,500,{i},{40 + i % 3},mm\n" for i in range(12))
    machine = MACHINE | {"dz_n": Component(None, "um", 0)}
    path = tmp_path / "lbb.csv"
    path.write_text(HEAD + rows, "utf-8")
    with pytest.raises(InputError) as caught:
        read_readings([(path, "lbb")], machine, for_fit=True, travels=travels)
    assert f"'; expected errors of at most {limit}" in str(caught.value)


def test_positions_without_a_travel_have_a_limit_too(tmp_path: Path) -> None:
    text = table(lambda name, i, c: (1000 * c[0], *c[1:]))
    with pytest.raises(InputError, match=r"expected positions in mm: these look like um in a col"):
        read(tmp_path, text, None)


def test_a_position_of_a_constant_is_told_unless_it_is_0(tmp_path: Path) -> None:
    assert read(tmp_path, table().replace("axy,,", "axy,0,"), TRAVELS).notes == ()
    (note,) = read(tmp_path, table().replace("axy,,", "axy,75,"), TRAVELS).notes
    assert note.code == "position-not-used"
    assert "row 102, column 'position_mm': 75 mm of axy" in note.message
    assert "(2 rows)" in note.message


@pytest.mark.parametrize("names", ["dx_x", "dx_y"])
def test_drift_readings_are_told_by_what_they_are(tmp_path: Path, names: str) -> None:
    """Not by each of their unknown components, or of their single positions."""
    rows = "".join(f"{names},0,{i},1.5,um,{20 + 0.1 * i}\n" for i in range(5))
    head = "component,position_mm,cycle,error,unit,T_02_degC\n"
    with pytest.raises(InputError, match=r"looks like drift readings \(columns cycle, T_02_degC"):
        read(tmp_path, head + rows, TRAVELS)


@pytest.mark.parametrize(
    ("head", "drift"),
    [
        ("component,position_mm,cycle,error,unit,T_a_degC,T_b_degC", True),
        ("component,position_mm,cycle,error,unit,T_a_degC,load", True),
        ("component,position_mm,pass,error,unit,T_a_degC,T_b_degC", False),
        ("component,position_mm,cycle,error,unit,load,humidity", False),
        ("component,position_mm,batch,error,unit,T_a_degC,T_b_degC", False),
    ],
)
def test_drift_readings_without_a_fault_are_refused_too(
    tmp_path: Path, head: str, drift: bool
) -> None:
    rows = [f"dx_x,{100 * (i % 3)},{i // 3},{1 + i},um,{20 + 0.1 * i},{21 + i}\n" for i in range(9)]
    text = f"{head}\n{''.join(rows)}"
    if not drift:
        assert len(read(tmp_path, text, TRAVELS)) == 9
        return
    with pytest.raises(InputError, match=r"looks like drift readings \(columns cycle, T_a_degC"):
        read(tmp_path, text, TRAVELS)


@pytest.mark.parametrize(
    ("column", "cell", "told"),
    [
        ("error", "abc", "row 4, column 'error': not a number: 'abc'"),
        ("unit", "umm", "row 4, column 'unit': unknown unit: 'umm'"),
        ("component", "dx_xx", "row 4, column 'component': unknown component: 'dx_xx'"),
    ],
)
def test_a_bad_cell_makes_no_drift_readings(
    tmp_path: Path, column: str, cell: str, told: str
) -> None:
    """A laser file with its cycle and a temperature beside it keeps the place of the fault."""
    head = "component,position_mm,cycle,error,unit,T_scale_degC\n"
    rows = [["dx_x", str(100 * (i % 3)), str(i // 3), f"{1 + i}", "um", "20.1"] for i in range(6)]
    rows[2][head.strip().split(",").index(column)] = cell
    text = head + "".join(",".join(row) + "\n" for row in rows)
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, TRAVELS)
    (problem,) = caught.value.findings
    assert told in str(problem)


@pytest.mark.parametrize(("size", "unit"), [(1000.0, "m"), (25.4, "inch")])
def test_positions_in_another_unit_are_not_the_readings_fault(
    size: float, unit: str, tmp_path: Path
) -> None:
    """Errors of 2 mm/m are those of a poor scale, over metres as over mm."""
    long = {"x": (0.0, 9000.0)}

    def poor(name: str, i: int, cell: Cell) -> Cell:
        place = 50.0 * cell[0]
        return place, 2.0 * place + 0.01 * i if name == "dx_x" else cell[1], cell[2]

    def other(name: str, i: int, cell: Cell) -> Cell:
        place, error, own = poor(name, i, cell)
        return place / size, error, own

    read(tmp_path, table(poor), long)
    with pytest.raises(InputError) as caught:
        read(tmp_path, table(other), long)
    message = str(caught.value)
    assert "of 50 cells of dx_x are too near to each other for their errors" in message
    assert f"positions in mm (x travels from 0 to 9000 mm): these look like {unit} in a" in message
    assert f"; or else errors of at most 1 mm, or 1 % of {FARTHEST}: these look" in message


def test_positions_explain_all_errors_or_none(tmp_path: Path) -> None:
    """Of errors beyond 1 % of 9 m too, some rows would be left."""
    long = {"x": (0.0, 9000.0)}

    def told(most: float) -> str:
        def change(name: str, i: int, cell: Cell) -> Cell:
            error = most if i >= 25 else 2000.0
            return cell[0] / 20, error + 0.01 * i if name == "dx_x" else cell[1], cell[2]

        with pytest.raises(InputError) as caught:
            read(tmp_path, table(change), long)
        return str(caught.value)

    assert "these look like m in a column of mm" in told(80_000.0)
    assert "larger than any machine's error" in told(100_000.0)
    assert "column of mm" not in told(100_000.0)


@pytest.mark.parametrize(
    ("travel", "words"),
    [
        (0.5, "(x travels from 0 to 0.5 mm): is travel_mm of the machine file in mm?"),
        (18.0, "(x travels from 0 to 18 mm): are these, and travel_mm of the machine file, in mm?"),
    ],
)
def test_a_travel_in_another_unit_is_asked_about(travel: float, words: str, tmp_path: Path) -> None:
    """450 mm of positions are a travel of 0.5 m, or of 18 in."""
    text = table(lambda name, i, cell: (2.5 * cell[0], *cell[1:]))
    with pytest.raises(InputError, match=re.escape(words)):
        read(tmp_path, text, {"x": (0.0, travel)})
