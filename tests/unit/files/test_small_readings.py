"""Readings that no machine has, as those in mm of which the file says um, are asked about."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.files import csv_stream
from mtu_cli.files.readings import read_readings
from mtu_cli.files.readings_stream import stream_readings

PLACES = (0, 50, 100, 150, 200)


def told(tmp_path: Path, errors: list[float], unit: str, places: tuple[float, ...]) -> list[str]:
    path = tmp_path / "l.csv"
    rows = "".join(f"dx,{x},{e},{unit}\n" for x, e in zip(places, errors, strict=True))
    path.write_text(f"component,position_mm,error,unit\n{rows}", "utf-8")
    whole = read_readings([(path, "laser")], None, for_fit=False)
    *_, last = stream_readings([(path, "laser")], None)
    assert last.notes == whole.notes
    return [item.message for item in whole.notes if item.code == "readings-small"]


@pytest.mark.parametrize(
    ("unit", "largest", "likely"),
    [("um", 0.012, ", or in mm?"), ("nm", 12.0, ", or in um?"),
     ("arcsec", 1e-3, ", or in mrad or rad or deg?"), ("arcsec", 5e-5, ", or in rad or deg?"),
     ("um", 1e-6, "?"), ("urad", 0.04, ", or in mrad or deg?")],
)  # fmt: skip
def test_readings_in_a_larger_unit_are_asked_about(
    tmp_path: Path, unit: str, largest: float, likely: str
) -> None:
    errors = [0.0, largest / 4, largest / 2, -largest, largest / 3]
    (text,) = told(tmp_path, errors, unit, PLACES)
    assert text.startswith(
        "l.csv, row 2, column 'unit': smaller than any machine's are the errors of dx (at most "
        f"{largest:.2g} {unit} along 200 mm): "
    )
    assert text.endswith(f"are they in {unit}{likely}")


@pytest.mark.parametrize(
    ("unit", "errors", "places"),
    [
        ("um", [0.01, 0.01, 0.06, 0.01, 0.01], PLACES),
        ("um", [0.0] * 5, PLACES),
        ("um", [0.01] * 5, (0, 20, 40, 60, 80)),
        ("um", [0.01] * 4, (0, 50, 100, 150)),
        ("mm", [0.001] * 5, PLACES),
        ("arcsec", [0.02] * 5, PLACES),
        ("um", [0.06] * 5, tuple(1.5 * x for x in PLACES)),
        ("um", [0.25] * 5, tuple(6.0 * x for x in PLACES)),
    ],
    ids=[
        "one is larger",
        "none errs",
        "a short axis",
        "a few",
        "in mm",
        "a good table",
        "a stage",
        "a good long axis",
    ],
)
def test_what_a_machine_may_have_is_not(
    tmp_path: Path, unit: str, errors: list[float], places: tuple[float, ...]
) -> None:
    assert told(tmp_path, errors, unit, places) == []


def test_an_axis_that_errs_much_in_mm_called_um(tmp_path: Path) -> None:
    """110 um along 1200 mm, as nobody has them who did not compensate."""
    errors, places = [0.0, 0.03, 0.06, 0.09, 0.13], (0, 300, 600, 900, 1200)
    (text,) = told(tmp_path, errors, "um", places)
    assert "dx (at most 0.13 um along 1200 mm): are they in um, or in mm?" in text
    assert told(tmp_path, errors, "um", tuple(x / 2 for x in places)) == []


def test_several_components_are_told_together_and_blocks_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "l.csv"
    rows = "".join(f"{name},{x},0.0{x % 4},um\n" for name in ("dx", "dy") for x in PLACES)
    path.write_text(f"component,position_mm,error,unit\n{rows}dz,0,3,um\n", "utf-8")
    (note,) = read_readings([(path, "laser")], None, for_fit=False).notes
    one = "(at most 0.02 um along 200 mm)"
    assert f"the errors of dx {one}, dy {one}: are they" in note.message


def test_files_of_one_name_are_two(tmp_path: Path) -> None:
    """The folders above the one one works in are not shown."""
    files = []
    for folder, size in (("a", 0.01), ("b", 10.0)):
        (tmp_path / folder).mkdir()
        path = tmp_path / folder / "l.csv"
        rows = "".join(f"dx,{x},{size + x * size / 500},um\n" for x in PLACES)
        path.write_text(f"component,position_mm,error,unit\n{rows}", "utf-8")
        files.append((path, "laser"))
    assert len(read_readings(files, None, for_fit=False).notes) == 1
    *_, last = stream_readings(files, None)
    assert len(last.notes) == 1


def test_of_blocks_what_is_larger_or_longer_in_one_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """20 rows are three blocks or more; the range and the largest error are those of all."""
    for size in ("_BLOCK", "_PIECE"):
        monkeypatch.setattr(csv_stream, size, 100)
    small, places = [0.01] * 20, tuple(float(x) for x in range(20))
    for first, last in ((0, 0), (0, 100), (-100, 19), (0, 99)):
        along = (float(first), *places[1:-1], float(last))
        assert len(told(tmp_path, small, "um", along)) == (last - first >= 100)
    along = (*places[:-1], 200.0)
    assert told(tmp_path, [0.06, *small[1:]], "um", along) == []
    assert told(tmp_path, [*small[:-1], 0.06], "um", along) == []
    assert len(told(tmp_path, [0.049, *small[1:]], "um", along)) == 1


def test_the_first_row_of_the_component_is_named(tmp_path: Path) -> None:
    path = tmp_path / "l.csv"
    rows = "".join(f"{name},{x},{e},um\n" for name, e in (("dx", 5), ("dy", 0.01)) for x in PLACES)
    path.write_text(f"component,position_mm,error,unit\n{rows}dy,,0.01,um\n", "utf-8")
    notes = read_readings([(path, "laser")], None, for_fit=False).notes
    (text,) = [item.message for item in notes if item.code == "readings-small"]
    head = "l.csv, row 7, column 'unit': smaller than any machine's are the errors of dy ("
    assert text.startswith(head)
