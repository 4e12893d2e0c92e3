"""Drift readings that look odd as they are read: times out of order, cycles under another name."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.points import read_points
from mtu_cli.files.readings import read_readings
from mtu_cli.files.readings_stream import stream_readings

HEAD = "component,position_mm,cycle,time_min,error,unit,T_a_degC"


def notes(tmp_path: Path, times: dict[str, list[object]], header: str = HEAD) -> list[str]:
    """What is told of drifts at two positions, row by row in turn, the first of which has other
    `times` than the second.
    """
    lines = [header]
    for cycle, own in times.items():
        for i, time in enumerate(own):
            at = f"2024-05-03T{10 + i // 60}:{i % 60:02}" if isinstance(time, str) else 10 * i
            lines += [
                f"pz,0,{cycle},{time},1.{i},um,2{i % 5}",
                f"pz,9,{cycle},{at},2.{i},um,20.{i}",
            ]
    path = tmp_path / "d.csv"
    path.write_text("\n".join(lines) + "\n")
    found = read_readings([(path, "drift")], None, for_fit=False).notes
    streamed = [note for block in stream_readings([(path, "drift")], None) for note in block.notes]
    assert tuple(streamed) == found
    return [f"{note.code}: {note.message}" for note in found]


def ascending(n: int = 20) -> list[object]:
    return [10 * i for i in range(n)]


@pytest.mark.parametrize(
    ("index", "time", "beside"),
    [(2, -500, [1, 3]), (5, 900, [4, 6]), (0, 900, [1]), (19, 5, [18]), (18, 900, [17, 19]),
     (7, 95, [6, 8])],
)  # fmt: skip
def test_one_time_out_of_order_is_told(
    index: int, time: int, beside: list[int], tmp_path: Path
) -> None:
    own = ascending()
    own[index] = time
    near = " and ".join(f"{10 * i} (row {42 + 2 * i})" for i in beside)
    assert notes(tmp_path, {"a": ascending(), "b": own}) == [
        f"time-out-of-order: d.csv, row {42 + 2 * index}, column 'time_min': {time} lies outside "
        f"the times beside it, {near}, in a file whose times ascend: look whether it is mistyped"
    ]


def test_several_and_dates(tmp_path: Path) -> None:
    own = ascending(40)
    own[5], own[30] = 0, 999
    (found,) = notes(tmp_path, {"a": own})
    assert "row 12" in found
    assert "in a file whose times ascend; so does 1 more: look" in found
    dates: list[object] = [f"2024-05-03T10:{i:02}:00" for i in range(40)]
    dates[7] = "2023-05-03T10:07:00"
    (found,) = notes(tmp_path, {"a": dates}, HEAD.replace("time_min", "time"))
    assert "row 16, column 'time': 2023-05-03T10:07:00.000 lies outside" in found


def test_what_is_in_no_order_stays_silent(tmp_path: Path) -> None:
    """Shuffled, descending, restarting times, too many slips, and rows too few to tell."""
    shuffled = [(70 * i) % 200 + i / 100 for i in range(20)]
    four = ascending(20)
    for index in (2, 6, 10, 14):
        four[index] = -1
    restarting = [*ascending(10), *[i + 0.5 for i in ascending(10) if isinstance(i, int)]]
    for own in (ascending(), shuffled, ascending()[::-1], four, restarting, [0] * 12, [0, 9, 5, 7]):
        assert notes(tmp_path, {"a": [*own]}) == []


@pytest.mark.parametrize(
    ("column", "told"),
    [("cyc", True), ("Cycl", True), ("cycle_s", True), ("cyc_time", False), ("load", False)],
)
def test_a_column_that_may_be_the_cycle_is_named(column: str, told: bool, tmp_path: Path) -> None:
    found = notes(tmp_path, {"1": ascending(), "2": ascending()}, HEAD.replace("cycle", column))
    text = (
        f"no-cycles: d.csv: no column 'cycle', so that no cycles are told apart: did you mean the "
        f"column {column!r}? Rename it to 'cycle'"
    )
    assert found == [text] * told


def test_times_too_large_to_be_added_are_refused_without_another_word(tmp_path: Path) -> None:
    """Read piece by piece, they are looked at before they are refused."""
    times = ascending()
    times[-3:] = [1.2e308, 1.1e308, 1.3e308]
    with pytest.raises(InputError, match="no time"):
        notes(tmp_path, {"1": times})
    with pytest.raises(InputError, match="no time"):
        list(stream_readings([(tmp_path / "d.csv", "drift")], None))


MINUTES = [2.0 * i for i in range(40)]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({7: -14.0}, "row 9, column 'time_min': -14 lies outside the times beside it, 12 (row 8) "
         "and 16 (row 10), in a file whose times ascend: look whether it is mistyped"),
        ({7: -14.0, 39: -78.0}, "whose times ascend; so does 1 more: look whether they are mist"),
        # Before the time that counts as 0, or in files in another order, they mean what they say.
        ({0: -10.0}, None), ({}, None), ({7: -14.0, 20: 3.0}, None),
        ({i: -2.0 * i for i in range(5, 15)}, None),
    ],
)  # fmt: skip
def test_single_negative_minutes_of_readings_and_points_are_told(
    changed: dict[int, float], words: str | None, tmp_path: Path
) -> None:
    times = [changed.get(i, own) for i, own in enumerate(MINUTES)]
    lbb, cmm = tmp_path / "t.csv", tmp_path / "c.csv"
    rows = "".join(f"a,{i},{i % 7},um,{t}\n" for i, t in enumerate(times))
    lbb.write_text(f"component,position_mm,error,unit,time_min\n{rows}", "utf-8")
    rows = "".join(f"{i},A,1,2,1,2,{t}\n" for i, t in enumerate(times))
    cmm.write_text(f"part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm,time_min\n{rows}", "utf-8")
    for notes in (
        read_readings([(lbb, "lbb")], None, for_fit=False).notes,
        read_points([(cmm, "cmm")], None).notes,
    ):
        found = [note.message for note in notes if note.code == "time-out-of-order"]
        assert len(found) == (words is not None)
        assert all(str(words) in message for message in found)


@pytest.mark.parametrize(
    ("changed", "sequence", "words"),
    [
        ({("P3", "B"): -13.0}, False, "-13 lies outside the times beside it, 10 (row 44) and 12 "
         "(row 5), where the times of parts ascend: look whether it is mistyped"),
        ({("P3", "A"): -12.0, ("P3", "B"): -13.0, ("P3", "C"): -14.0}, True, "; so do 2 more:"),
        # What is known of no part's time, or stands before all others, may be as it is.
        ({("P3", "A"): -12.0, ("P3", "B"): -13.0, ("P3", "C"): -14.0}, False, None),
        ({("P0", "A"): -2.0, ("P0", "B"): -1.0}, False, None),
        ({("P0", "A"): -2.0, ("P0", "B"): -1.0}, True, None),
        ({("P3", "B"): -13.0, ("P1", "A"): 9.0}, False, None),
    ],
)  # fmt: skip
def test_negative_minutes_are_told_in_files_sorted_by_feature(
    changed: dict[tuple[str, str], float], sequence: bool, words: str | None, tmp_path: Path
) -> None:
    lines = ["part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm,time_min,number"]
    lines[0] = lines[0].replace("number", "sequence" if sequence else "number")
    for f, feature in enumerate("ABC"):
        for p in range(20):
            time = changed.get((f"P{p}", feature), 4 * p + f)
            lines.append(f"P{p},{feature},1.00{p:02},2.00{f},1,2,{time},{p}")
    path = tmp_path / "c.csv"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    notes = read_points([(path, "cmm")], None).notes
    found = [note.message for note in notes if note.code == "time-out-of-order"]
    assert len(found) == (words is not None)
    assert all(str(words) in message for message in found)
