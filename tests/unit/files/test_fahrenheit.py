"""Sensors in Fahrenheit: all of them, one beside others, and one from some row on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mtu_cli.files.fahrenheit import cycles_words, in_fahrenheit, some_fahrenheit
from mtu_cli.files.readings_stream import stream_readings

WARM = np.linspace(20.0, 26.0, 30)
F = 1.8 * WARM + 32.0


@pytest.mark.parametrize(
    ("extents", "odd"),
    [
        ({"T_a_degC": (67.0, 80.0), "T_b_degC": (20.0, 26.0)}, ["T_a_degC"]),
        ({"T_a_degC": (67.0, 80.0), "T_b_degC": (68.0, 79.0)}, ["T_a_degC", "T_b_degC"]),
        ({"T_a_degC": (85.0, 105.0), "T_b_degC": (30.0, 40.0)}, ["T_a_degC"]),
        # A spindle in degC: as Fahrenheit it would be far from the others too.
        ({"T_a_degC": (55.0, 70.0), "T_b_degC": (24.0, 30.0)}, []),
        ({"T_a_degC": (97.0, 120.0), "T_b_degC": (20.0, 26.0)}, []),
        ({"T_a_degC": (20.0, 26.0), "T_b_degC": (np.nan, np.nan)}, []),
        ({"T_a_degC": (20.0, 26.0), "load": (67.0, 80.0)}, []),
    ],
)
def test_a_sensor_is_judged_by_itself_and_by_the_others(
    extents: dict[str, tuple[float, float]], odd: list[str]
) -> None:
    assert in_fahrenheit(extents) == odd


@pytest.mark.parametrize(
    ("values", "rows"),
    [
        (np.r_[WARM[:15], F[15:]], slice(15, 30)),
        (np.r_[F[:4], WARM], slice(0, 4)),
        (np.r_[WARM, F, np.nan, 85.0, WARM], slice(30, 60)),
        (np.r_[WARM, F[:3]], None),
        (WARM, None),
        (F, None),
        (np.where(np.arange(30) % 10 < 5, WARM, 65.0), None),
        (np.r_[WARM, np.linspace(26.0, 80.0, 30)], None),
        (np.r_[WARM, np.full(9, 94.0)], slice(30, 39)),
        (np.r_[WARM - 14.0, np.full(9, 94.0)], None),
    ],
)
def test_some_readings_are_in_fahrenheit(values: np.ndarray, rows: slice | None) -> None:
    """Not those of a spindle that is switched on and off, nor of one that warms up."""
    found = some_fahrenheit(values)
    if rows is None:
        assert found is None
        return
    wanted = np.zeros(len(values), bool)
    wanted[rows] = True
    assert found is not None
    assert found.tolist() == wanted.tolist()


def test_cycles_in_fahrenheit_are_named() -> None:
    extents = {"1": (20.0, 26.0), "2": (68.0, 78.8), "3": (20.0, 25.0), "4": (69.0, 70.0)}
    assert cycles_words(extents) == (
        "in cycles '2', '4' it is 68 to 78.8 degC, else 20 to 26 degC; in Fahrenheit it would be "
        "20 to 26 degC: check its unit"
    )
    assert cycles_words({"1": (20.0, 26.0), "2": (21.0, 27.0)}) is None


@pytest.mark.parametrize("interleaved", [True, False])
def test_the_first_row_in_fahrenheit_is_told(tmp_path: Path, interleaved: bool) -> None:
    """Also where each component has rows of its own in which the log goes on in Fahrenheit."""
    values = np.r_[WARM[:15], F[15:]]
    rows = [f"{name},0,1,{i},{i}.5,um,{t:.3f}" for i, t in enumerate(values) for name in "ab"]
    rows = rows if interleaved else sorted(rows, key=lambda row: row[0])
    path = tmp_path / "d.csv"
    head = "component,position_mm,cycle,time_min,error,unit,T_a_degC\n"
    path.write_text(head + "\n".join(rows) + "\n")
    (note,) = [note for found in stream_readings([(path, "drift")], None) for note in found.notes]
    assert note.code == "looks-like-fahrenheit"
    row = 32 if interleaved else 17
    assert f"'T_a_degC': from row {row} on it is 73.59 to 78.8 degC in" in note.message
    assert "in 30 of 60 rows, else 20 to 22.9 degC" in note.message
