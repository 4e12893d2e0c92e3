"""What faulty temperature sensors give is told by row; what warms up is left alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.readings import read_readings
from mtu_cli.files.readings_stream import stream_readings
from mtu_cli.files.sensor_faults import CODES

N = 40


def refused(folder: Path, values: np.ndarray, minutes: float | None = 1.0) -> list[tuple[int, str]]:
    """(row, column) of every cell that is refused, read as a whole and block by block."""
    time = "" if minutes is None else ",time_min"
    lines = [f"component,cycle,error,unit,T_01_degC,T_02_degC{time}"]
    for i, value in enumerate(values):
        own = "" if minutes is None else f",{minutes * i:g}"
        lines.append(f"d,{i // N},{0.1 * i},um,{20 + 0.01 * i:g},{value:g}{own}")
    path = folder / "drift.csv"
    path.write_text("\n".join(lines) + "\n")
    files = [(path, "drift")]
    told = [_told(lambda: read_readings(files, None, for_fit=False))]
    told.append(_told(lambda: list(stream_readings(files, None))))
    assert told[0] == told[1]
    return told[0]


def doubted(folder: Path) -> bool:
    """Whether a note tells of the sensor, of the file as a whole and of its blocks."""
    files = [(folder / "drift.csv", "drift")]
    try:
        whole = read_readings(files, None, for_fit=False).notes
    except InputError:
        return False
    (block,) = stream_readings(files, None)
    assert block.notes == whole
    assert {note.code for note in whole} <= {"sensor-doubtful"}
    return any("column 'T_02_degC': " in note.message for note in whole)


def _told(read: Callable[[], object]) -> list[tuple[int, str]]:
    try:
        read()
    except InputError as error:
        return [(problem.row or 0, str(problem.column)) for problem in error.findings]
    return []


def slow(high: float = 30.0, n: int = N) -> np.ndarray:
    """A sensor that warms up from 20 degC in one cycle."""
    return np.round(np.linspace(20.0, high, n), 3)


@pytest.mark.parametrize(
    ("cells", "rows"),
    [
        ({7: 85.0}, [9]),
        ({0: 85.0, 1: 85.0}, [2, 3]),
        ({N - 1: 85.0}, [N + 1]),
        ({7: -127.0}, [9]),
        (dict.fromkeys(range(N), -127.0), list(range(2, N + 2))),
        ({7: 0.0, 20: 85.0}, [9, 22]),
        ({7: 66.2}, [9]),
        ({7: 66.2, 8: 66.0, 9: -20.0}, [9, 10, 11]),
        ({7: -15.0, 8: -14.0}, [9, 10]),
    ],
)
def test_codes_and_jumps_of_a_sensor_are_told(
    tmp_path: Path, cells: dict[int, float], rows: list[int]
) -> None:
    values = slow()
    values[list(cells)] = list(cells.values())
    assert refused(tmp_path, values) == [(row, "T_02_degC") for row in rows]
    untimed = [row for row in rows if cells[row - 2] in CODES]
    assert refused(tmp_path, values, None) == [(row, "T_02_degC") for row in untimed]
    assert doubted(tmp_path) == (len(untimed) < len(rows))


@pytest.mark.parametrize(
    "values",
    [
        np.minimum(slow(95.0), 85.0),
        np.round(slow(85.0)),
        np.concatenate([slow(85.0), slow(85.0), slow(85.0)]),
        np.where(np.arange(N) < 20, 20.0, 71.0),
        np.full(N, 85.0),
        slow(-8.0).round(),
    ],
    ids=["saturated", "whole degrees", "cycles", "moved", "still", "cold"],
)
def test_what_warms_up_or_stays_is_left_alone(tmp_path: Path, values: np.ndarray) -> None:
    assert refused(tmp_path, values) == []


@pytest.mark.parametrize("minutes", [12.0, 60.0, 61.0])
@pytest.mark.parametrize(
    ("value", "count"), [(66.2, 1), (85.0, 1), (85.0, 3), (85.0, 4), (0.0, 1), (0.0, 4)]
)
def test_a_sensor_that_is_read_rarely_may_jump(
    tmp_path: Path, value: float, count: int, minutes: float
) -> None:
    """But to no code, within an hour for a moment; what may be so hot, or so cold, is told."""
    values = slow()
    values[7 : 7 + count] = value
    rows = range(9, 9 + count) if value in CODES and minutes <= 60.0 and count < 4 else ()
    assert refused(tmp_path, values, minutes) == [(row, "T_02_degC") for row in rows]
    assert doubted(tmp_path) == (value in CODES and not rows)


@pytest.mark.parametrize(("minutes", "low", "told"), [(10.0, 50.0, True), (30.0, 50.0, False),
                                                      (30.0, 24.0, True)])  # fmt: skip
def test_a_spindle_may_cool_from_85_within_the_hour(
    tmp_path: Path, minutes: float, low: float, told: bool
) -> None:
    values = np.r_[85.0, np.linspace(low, low - 4.0, N - 1).round(3)]
    assert refused(tmp_path, values, minutes) == ([(2, "T_02_degC")] if told else [])
    assert doubted(tmp_path) != told


def test_a_code_that_is_alone_in_its_cycle_is_told(tmp_path: Path) -> None:
    values = slow(30.0, N + 1)
    values[N] = 85.0
    assert refused(tmp_path, values) == []
    assert doubted(tmp_path)


def test_the_rise_over_a_cold_machine_begins_with_0(tmp_path: Path) -> None:
    """In every cycle; within a cycle 0 is the code of a sensor that is not read."""
    rise = np.concatenate([[0.0], np.linspace(13.6, 28.0, N - 1)])
    values = np.concatenate([rise, rise, rise])
    for minutes in (1.0, 20.0, None):
        assert refused(tmp_path, values, minutes) == []
    values[N + 9] = 0.0
    assert refused(tmp_path, values) == [(N + 11, "T_02_degC")]


@pytest.mark.parametrize(
    ("high", "minutes", "told"),
    [
        *((high, minutes, True) for high in (62.0, 85.0) for minutes in (1.0, None)),
        (62.0, 60.0, False),
        (85.0, 60.0, True),
        (85.0, 61.0, True),
    ],
)
def test_what_comes_again_and_again_is_warned_of(
    tmp_path: Path, high: float, minutes: float | None, told: bool
) -> None:
    """A spindle that is switched on and off: a fault is rare."""
    values = np.where(np.arange(N) % 2 == 0, 22.0, high)
    assert refused(tmp_path, values, minutes) == []
    assert doubted(tmp_path) == told
    values[6] = -127.0
    assert refused(tmp_path, values, minutes) == [(8, "T_02_degC")]


def test_the_message_says_what_was_expected(tmp_path: Path) -> None:
    values = slow()
    values[7] = 85.0
    path = tmp_path / "drift.csv"
    refused(tmp_path, values)
    with pytest.raises(InputError) as caught:
        read_readings([(path, "drift")], None, for_fit=False)
    (problem,) = caught.value.findings
    assert str(problem).endswith(
        "drift.csv, row 9, column 'T_02_degC': a fault of the sensor, no temperature: '85'; "
        "expected a temperature in degC near 21.54 and 22.05: 85 degC exactly is what a DS18B20 "
        "gives before it has measured; leave out such rows, or the column"
    )
