"""What faulty sensors show, temperatures of another name and in Fahrenheit, in measured points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.points import Points, read_points

ROWS, PARTS = 4, 10
N = ROWS * PARTS
HEAD = "part,feature,nominal_x_mm,nominal_y_mm,x_mm,y_mm"
Cells = dict[int, float]


def points_of(
    folder: Path,
    values: Sequence[object] | np.ndarray,
    minutes: Sequence[float] | np.ndarray | None = None,
    files: int = 1,
    sensor: str = "T_02_degC",
) -> Points:
    """Points of parts of `ROWS` features each, with a sensor's values, in so many files."""
    lines = []
    for i, value in enumerate(values):
        time = "" if minutes is None else f",{minutes[i]:g}"
        x = 10 * (i % ROWS)
        lines.append(f"{i // ROWS},h{i % ROWS},{x},0,{x + i / 1000},0,{value}{time}")
    head = f"{HEAD},{sensor}{'' if minutes is None else ',time_min'}\n"
    paths = []
    for k in range(files):
        own = lines[k * len(lines) // files : (k + 1) * len(lines) // files]
        paths.append(folder / f"p{k}.csv")
        paths[-1].write_text(head + "\n".join(own) + "\n")
    return read_points([(path, "cmm") for path in paths], None)


def told(
    folder: Path, values: Sequence[object] | np.ndarray, minutes: np.ndarray | None
) -> tuple[list[int], list[str]]:
    """Rows that are refused, and codes of what is noted otherwise."""
    try:
        found = points_of(folder, values, minutes)
    except InputError as error:
        return [problem.row or 0 for problem in error.findings], []
    return [], [note.code for note in found.notes]


def each(cells: Cells) -> np.ndarray:
    """A sensor that warms up, read at every point, with these cells instead."""
    values = np.round(np.linspace(20.0, 24.0, N), 3)
    values[list(cells)] = list(cells.values())
    return values


def by_part(cells: Cells) -> np.ndarray:
    """A sensor that is read once a part, with these parts instead."""
    values = np.round(np.linspace(20.0, 24.0, PARTS), 3)
    values[list(cells)] = list(cells.values())
    return np.repeat(values, ROWS)


def rows_of(*parts: int) -> list[int]:
    return [2 + ROWS * part + k for part in parts for k in range(ROWS)]


@pytest.mark.parametrize("minutes", [None, np.arange(N), np.arange(N) % ROWS, 7.0 * np.arange(N)])
@pytest.mark.parametrize(
    ("values", "rows"),
    [
        (each({7: 85.0}), [9]),
        (each({7: 85.0, 8: 85.0, 30: -127.0}), [9, 10, 32]),
        (each({0: 85.0, N - 1: 85.0}), [2, N + 1]),
        (each(dict.fromkeys(range(N), -127.0)), list(range(2, N + 2))),
        (by_part({3: 85.0}), rows_of(3)),
        (by_part({3: -127.0, 5: -127.0}), rows_of(3, 5)),
    ],
)
def test_codes_of_faulty_sensors_are_told_by_row(
    tmp_path: Path, values: np.ndarray, rows: list[int], minutes: np.ndarray | None
) -> None:
    assert told(tmp_path, values, minutes) == (rows, [])


@pytest.mark.parametrize("minutes", [None, np.arange(N), 7.0 * np.arange(N)])
def test_a_lone_zero_between_temperatures_is_told(
    tmp_path: Path, minutes: np.ndarray | None
) -> None:
    assert told(tmp_path, each({7: 0.0, 20: 0.0}), minutes) == ([9, 22], [])


def test_a_code_is_told_with_its_place_and_what_the_sensor_shows_else(tmp_path: Path) -> None:
    with pytest.raises(InputError) as found:
        points_of(tmp_path, by_part({5: 85.0}), files=PARTS)
    first, *rest = found.value.findings
    assert str(first).endswith(
        "p5.csv, row 2, column 'T_02_degC': a fault of the sensor, no temperature: '85'; expected "
        "a temperature in degC, 20 to 24 as in other rows: 85 degC exactly is what a DS18B20 gives "
        "before it has measured; leave out such rows, or the column"
    )
    assert [problem.row for problem in rest] == [3, 4, 5]


DAYS = np.repeat([0.0, 30, 60, 90, 120, 1440, 1470, 1500, 1530, 1560], ROWS)


@pytest.mark.parametrize(
    ("values", "minutes", "notes"),
    [
        (by_part({}), None, []),
        (["", *each({})[1:]], None, []),
        (by_part({k: 70.0 + 5 * k for k in range(10)}), None, []),
        (by_part({k: 20.0 + 65.0 * (k % 2) for k in range(10)}), None, ["sensor-doubtful"]),
        (np.repeat([0.0, 20.0, 40.0], ROWS), None, ["sensor-doubtful"]),
        # The rise over the cold machine: 0 at the start, and again on the next morning.
        (by_part({k: 18.0 + k for k in range(1, 10)} | {0: 0.0}), None, ["sensor-doubtful"]),
        (by_part({k: 18.0 + k for k in range(10)} | {5: 0.0}), DAYS, ["sensor-doubtful"]),
        (by_part({k: k - 4.0 for k in range(10)}), None, []),
        (by_part({k: 68.0 + 0.16 * k for k in range(10)}), None, ["looks-like-fahrenheit"]),
        (by_part({k: 40.0 + 4.0 * k for k in range(10)}), None, []),
        (by_part({k: 73.0 + 0.5 * k for k in range(6, 10)}), None, ["looks-like-fahrenheit"]),
    ],
)
def test_what_may_be_a_temperature_is_not_refused(
    tmp_path: Path, values: np.ndarray, minutes: np.ndarray | None, notes: list[str]
) -> None:
    assert told(tmp_path, values, minutes) == ([], notes)


def test_the_note_of_a_sensor_in_fahrenheit_says_what_it_would_be(tmp_path: Path) -> None:
    (note,) = points_of(tmp_path, np.linspace(68.0, 69.6, 8)).notes
    assert note.message == (
        "T_02_degC is 68 to 69.6 degC; in Fahrenheit it would be 20 to 20.89 degC: check its unit"
    )


def test_the_note_of_a_part_in_fahrenheit_names_its_first_row(tmp_path: Path) -> None:
    values = each({k: 71.0 + 0.1 * k for k in range(25, N)})
    (note,) = points_of(tmp_path, values, files=2).notes
    assert note.message == (
        "p1.csv, column 'T_02_degC': from row 7 on it is 73.5 to 74.9 degC in 15 of 40 rows, else "
        "20 to 22.46 degC; in Fahrenheit it would be 23.06 to 23.83 degC: check its unit"
    )


def test_notes_name_the_files_where_there_are_several(tmp_path: Path) -> None:
    (odd,) = points_of(tmp_path, by_part({1: 0.0, 5: 0.0, 8: 0.0}), files=PARTS).notes
    assert odd.message.startswith("p1.csv, p5.csv, p8.csv, column 'T_02_degC': 12 of 40 rows")
    (hot,) = points_of(tmp_path, np.linspace(68.0, 69.6, 8), files=5).notes
    assert hot.message.startswith("p0.csv, p1.csv, p2.csv and 2 more: T_02_degC is 68 to 69.6")


def test_a_code_long_after_the_readings_beside_it_is_noted(tmp_path: Path) -> None:
    """It stands apart from them, and not from all that the sensor reads."""
    values = np.r_[np.linspace(20.0, 24.0, 20), 85.0, np.linspace(24.0, 70.0, 19)].round(3)
    assert told(tmp_path, values, 1.0 * np.arange(N)) == ([22], [])
    assert told(tmp_path, values, 61.0 * np.arange(N)) == ([], ["sensor-doubtful"])


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("T_table_C", "rename 'T_table_C' to 'T_table_degC' (in degC), or"),
        ("table [\u00b0C]", "rename 'table [\u00b0C]' to 'T_table_degC' (in degC), or"),
        ("Temp 2", "rename 'Temp 2' to 'T_2_degC' (in degC), or"),
        ("Temperatur", "alone, or"),
    ],
)
def test_a_column_of_numbers_that_seems_to_be_a_sensor_is_refused(
    tmp_path: Path, name: str, words: str
) -> None:
    with pytest.raises(InputError) as found:
        points_of(tmp_path, np.linspace(20.0, 21.0, 8), sensor=name)
    (problem,) = found.value.findings
    assert (problem.row, problem.column) == (1, name)
    assert words in str(problem)
    assert points_of(tmp_path, ["new", "old"] * 4, sensor="T_slot").notes == ()


@pytest.mark.parametrize(
    "name", ["T_number", "T1", "T-slot", "temp_class", "TEMP_ID", "temperature_rank", "T_02", "T_c"]
)
def test_a_number_of_a_tool_is_a_covariate_of_points(tmp_path: Path, name: str) -> None:
    """T is the tool's letter: what states no unit is told, and kept."""
    found = points_of(tmp_path, np.arange(8.0), files=2, sensor=name)
    np.testing.assert_array_equal(found.covariates[name], np.arange(8.0))
    assert [note.message for note in found.notes] == [
        f"p{k}.csv: column {name!r} is not used as temperature: a temperature is T_<sensor>_degC"
        for k in range(2)
    ]
