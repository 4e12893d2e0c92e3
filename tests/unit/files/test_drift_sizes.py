"""Drift readings and positions of no machine are refused, read as a whole or block by block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from mtu_cli.errors import InputError
from mtu_cli.files import csv_stream, reading_cells, readings_stream
from mtu_cli.files.readings import read_readings
from mtu_cli.files.readings_stream import stream_readings


@dataclass(frozen=True)
class Component:
    of: str | None
    unit: str
    degree: int = 1


@dataclass(frozen=True)
class Cell:
    """A drift reading of a component, `rise` in K after the start of a cycle."""

    name: str
    place: float
    cycle: int
    rise: float
    error: float
    unit: str


MACHINE = {
    "px": Component("x", "um"),
    "pz": Component("z", "um"),
    "q": Component(None, "arcsec"),
}
Change = Callable[[int, Cell], tuple[float, float, str]]
CYCLES, TIMES = 4, 12


def table(change: Change) -> str:
    """Warm-ups by 5 K: a growth of 12 um/m/K over 500 mm, a spindle's of 2 um/K, an angle."""
    lines = ["component,position_mm,cycle,time_min,error,unit,T_a_degC"]
    for i in range(CYCLES * TIMES):
        cycle, rise = i // TIMES, 5.0 * (i % TIMES) / (TIMES - 1)
        for name, place in (("px", 0.0), ("px", 250.0), ("px", 500.0), ("pz", 300.0), ("q", 0.0)):
            slope = {"px": 1.0 + 0.012 * place, "pz": 2.0, "q": 0.8}[name]
            unit = "arcsec" if name == "q" else "um"
            cell = Cell(name, place, cycle, rise, slope * rise + 0.01 * (i % 5), unit)
            position, error, unit = change(len(lines) - 1, cell)
            where = "" if name == "q" else f"{position:.10g}"
            lines.append(f"{name},{where},{cycle},{10 * i},{error:.10g},{unit},{20 + rise:.6g}")
    return "\n".join(lines) + "\n"


def told(path: Path, components: dict[str, Component] | None, travel: float | None) -> list[str]:
    """What is said of the file, the same of its blocks."""
    travels = None if travel is None else {"x": (0.0, travel), "z": (0.0, travel)}
    files, found = [(path, "drift")], list[list[str]]()
    for read in (
        lambda: read_readings(files, components, for_fit=False, travels=travels),
        lambda: list(stream_readings(files, components, travels)),
    ):
        try:
            read()
            found.append([])
        except InputError as error:
            found.append([str(problem) for problem in error.findings])
    assert found[0] == found[1]
    return found[0]


@pytest.fixture(params=[1500, 4 << 20], ids=["small blocks", "one block"], autouse=True)
def block(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_stream, "_BLOCK", request.param)
    monkeypatch.setattr(csv_stream, "_PIECE", 500)


def lengths(unit: str, scale: float = 1.0, add: float = 0.0) -> Change:
    return lambda i, c: (
        (c.place, c.error, c.unit)
        if c.name == "q"
        else (c.place, scale * c.error + add, unit)
    )  # fmt: skip


SOUND: dict[str, Change] = {
    "as it is": lambda i, c: (c.place, c.error, c.unit),
    "a gantry of 24 m that warms up by 20 K": lambda i, c: (
        48 * c.place,
        4 * 48 * c.error if c.name == "px" else c.error,
        c.unit,
    ),
    "a probe that stands off": lengths("um", add=2345.0),
    "a probe that is set anew for each cycle": lambda i, c: (
        c.place,
        c.error + (0 if c.name == "q" else (2000, 2600, 1500)[c.cycle % 3]),
        c.unit,
    ),
    "a spindle that grows by 0.9 mm": lambda i, c: (
        c.place,
        90 * c.error if c.name == "pz" else c.error,
        c.unit,
    ),
}


@pytest.mark.parametrize("case", SOUND)
@pytest.mark.parametrize("machine", [True, False])
def test_drifts_of_machines_pass(tmp_path: Path, case: str, machine: bool) -> None:
    path = tmp_path / "d.csv"
    path.write_text(table(SOUND[case]))
    known = (MACHINE, 24000.0) if machine else (None, None)
    assert told(path, *known) == []


def test_a_cycle_that_was_broken_off_leaves_the_others_theirs() -> None:
    cycle = np.repeat([0, 1, 2], [12, 12, 3])
    values = np.array([2.0, 2.6, 1.5])[cycle] + 0.04 * np.linspace(0, 1, 27)
    assert reading_cells._moved(values, np.zeros(27), cycle).max() <= 0.02
    # Of three rows in all nothing is known.
    assert reading_cells._moved(values, np.zeros(27), np.arange(27) // 3).max() > 0.5


@pytest.mark.parametrize("case", [case for case in SOUND if "probe" not in case])
def test_drifts_of_machines_are_not_read_as_a_whole(
    tmp_path: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr(readings_stream, "read_readings", refuse)
    path = tmp_path / "d.csv"
    path.write_text(table(SOUND[case]))
    blocks = stream_readings([(path, "drift")], MACHINE, {"x": (0.0, 24000.0)})
    assert sum(map(len, blocks)) == 5 * CYCLES * TIMES


FARTHEST = "the distance to 0 or to the farthest place read"
MM = f"expected errors of at most 1 mm, or 1 % of {FARTHEST}"
MISTAKES: dict[str, tuple[Change, str]] = {
    "um as mm": (lengths("mm"), MM),
    "um as mm in one cycle": (
        lambda i, c: (c.place, c.error, "mm" if c.cycle == 2 and c.name != "q" else c.unit),
        MM,
    ),
    "um as mm in one row": (
        lambda i, c: (c.place, c.error, "mm" if i == 32 else c.unit),
        "row 34, column 'error': does not fit the other readings of 'px': '19.10",
    ),
    "lengths of a bar": (lengths("mm", 1e-3, 80.0), "these look like lengths of a bar of 80.0"),
    "arcsec as rad": (
        lambda i, c: (c.place, c.error, "rad" if c.name == "q" else c.unit),
        "(these look like arcsec or urad in a column of rad): ",
    ),
    "um as positions": (
        lambda i, c: (1000 * c.place, c.error, c.unit),
        "are farther than the machine goes: '250000'; expected positions in mm",
    ),
}


@pytest.mark.parametrize("case", MISTAKES)
@pytest.mark.parametrize("machine", [True, False])
def test_a_mistake_is_told_by_its_cause(tmp_path: Path, case: str, machine: bool) -> None:
    change, words = MISTAKES[case]
    path = tmp_path / "d.csv"
    path.write_text(table(change))
    first = told(path, *((MACHINE, 500.0) if machine else (None, None)))[0]
    assert words in first
    assert "d.csv, row " in first


@pytest.mark.parametrize("cell", ["n/a", "nan"])
def test_an_empty_cell_is_not_offered_where_a_drift_needs_a_temperature(
    tmp_path: Path, cell: str
) -> None:
    text = table(lambda _, own: (own.place, own.error, own.unit)).replace(",25\n", f",{cell}\n")
    (tmp_path / "d.csv").write_text(text, "utf-8")
    with pytest.raises(InputError) as caught:
        read_readings([(tmp_path / "d.csv", "drift")], MACHINE, for_fit=False)
    assert "or an empty cell" not in str(caught.value)
    assert f"'T_a_degC': not {'a number' if cell == 'n/a' else 'finite'}" in str(caught.value)
