"""Streams of readings hold what reading in one piece holds, and fail with the same words."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path

import numpy as np
import pytest

from mtu_cli.errors import InputError
from mtu_cli.files import csv_stream, readings_stream
from mtu_cli.files.in_order import in_order
from mtu_cli.files.readings import Readings, read_readings
from mtu_cli.files.readings_stream import stream_readings


@dataclass(frozen=True)
class Component:
    of: str | None
    unit: str
    degree: int


MACHINE = {
    "dx_x": Component("x", "um", 1),
    "ez_x": Component("x", "arcsec", 1),
    "unread": Component("x", "um", 1),
    "axy": Component(None, "arcsec", 0),
}
HEAD = "component,position_mm,error,unit"
ROWS = [
    f"{('axy', 'dx_x', 'ez_x')[i % 3]},{i % 7},{i / 8},{'um' if i % 3 == 1 else 'arcsec'}"
    for i in range(120)
]


def table(head: str, *more: str) -> str:
    """The rows above with further columns; `{i}` stands for the row."""
    cells = [",".join(text.format(i=i, h=i // 60) for text in more) for i in range(len(ROWS))]
    return "\n".join([f"{HEAD},{head}", *(f"{r},{c}" for r, c in zip(ROWS, cells, strict=True))])


TIMED = table("time_min,cycle,T_a_degC,T_b_degC", "{i}", "c{h}", "20.{i}", "21.{h}")
PASSES = table("pass", "{i}")
LATE_TEXT = table("pass,note", "{i}", "{i}").replace("100,100\n", "100,a\n")
SOUND = {
    "timed": [TIMED],
    "comments": ['# 12" machine\n#\n\n' + TIMED.replace("\ndx_x,4", '\n# "\n\ndx_x,4')],
    "windows": [TIMED.replace("\n", "\r\n")],
    "old-mac": [TIMED.replace("\n", "\r")],
    "byte-order-mark": ["\ufeff" + TIMED],
    "decimal-comma": [TIMED.replace(",", ";").replace(".", ",")],
    "decimals-late": [
        "component;position_mm;error;unit;T_a_degC\n"
        + "dx_x;1;1;um;20\n" * 600
        + "dx_x;1;1,5;um;20,5\n" * 20
    ],
    "quoted": [table("pass,note", "{i}", '"line {i}\n# {i}, ""next"""')],
    "empty-cells": [table("pass,dir_x,note", "{i}", "", "{h}").replace(",1\n", ",\n")],
    "dates": [
        table("time,n", "2024-05-03T10:00:00.{i:03d}", "x"),
        table("time", "2024-05-03T09:00:00.{i:03d}"),
    ],
    "text-covariate-late": [LATE_TEXT],
    "leading-zeros": [table("pass,batch", "{i}", "00{i}").replace(",00119", ",x")],
    "truth-values": [table("pass,wet", "{i}", "True")],
    "files-of-different-columns": [TIMED, LATE_TEXT, "component,error,unit\naxy,1,deg\n"],
    "number-here-text-there": [
        table("time_min,shift", "{i}", "{i}.5"),
        table("time_min,shift", "0.5{i}", "s{h}"),
        table("time_min,other", "-{i}", "1"),
    ],
    "no-line-end": [TIMED.rstrip("\n")],
    "blank-tail": [TIMED + "\n\n  \n\n"],
    "one-row": [f"{HEAD}\ndx_x,1,2,um\n"],
}  # fmt: skip


def written(tmp_path: Path, contents: list[str]) -> list[tuple[Path, str]]:
    files = []
    for index, content in enumerate(contents):
        path = tmp_path / f"r{index}.csv"
        path.write_bytes(content.encode())
        files.append((path, "drift"))
    return files


@pytest.fixture(params=[1, 200, 3000], ids=lambda size: f"block{size}")
def small_blocks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    size: int = request.param
    monkeypatch.setattr(csv_stream, "_BLOCK", size)
    monkeypatch.setattr(csv_stream, "_PIECE", max(1, size // 2))
    return size


def labels(found: Readings) -> tuple[list[str], list[str]]:
    components = [found.components[code] for code in found.code]
    cycles = ["" if code < 0 else found.cycles[code] for code in found.cycle]
    return components, cycles


def check_same(blocks: list[Readings], whole: Readings) -> None:
    """Every field of the blocks, end to end, is that of the whole."""
    assert sum(map(len, blocks)) == len(whole)
    last = blocks[-1]
    for block in blocks:
        # A code never changes its meaning.
        assert last.components[: len(block.components)] == block.components
        assert last.cycles[: len(block.cycles)] == block.cycles
        assert list(block.covariates) == list(whole.covariates)
        assert block.roles == whole.roles
        assert [s.shown for s in block.sources] == [s.shown for s in whole.sources]
    pairs = [labels(block) for block in blocks]
    assert [name for names, _ in pairs for name in names] == labels(whole)[0]
    assert [name for _, names in pairs for name in names] == labels(whole)[1]
    for name in (
        "position_mm", "error", "pass_number", "has_pass", "direction", "time_min", "file_index",
        "row",
    ):  # fmt: skip
        joined = np.concatenate([getattr(block, name) for block in blocks])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)
    for name, column in whole.covariates.items():
        parts = [block.covariates[name] for block in blocks]
        assert {part.dtype for part in parts} == {column.dtype}
        np.testing.assert_array_equal(np.concatenate(parts), column, err_msg=name)


@pytest.mark.parametrize("case", SOUND)
def test_a_stream_holds_what_one_piece_holds(tmp_path: Path, case: str, small_blocks: int) -> None:
    files = written(tmp_path, SOUND[case])
    whole = read_readings(files, MACHINE, for_fit=False)
    stream = stream_readings(files, MACHINE)
    blocks = list(stream)
    check_same(blocks, whole)
    assert stream.sources == whole.sources
    assert {block.components for block in blocks} == {tuple(MACHINE)}


@pytest.mark.parametrize("case", ["timed", "comments", "windows", "quoted", "dates"])
def test_sound_files_are_never_read_as_a_whole(
    tmp_path: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = written(tmp_path, SOUND[case])
    whole = read_readings(files, MACHINE, for_fit=False)

    def refuse(*_: object, **__: object) -> Readings:
        raise AssertionError("read as a whole")

    monkeypatch.setattr(csv_stream, "_BLOCK", 1000)
    monkeypatch.setattr(csv_stream, "_PIECE", 100)
    monkeypatch.setattr(readings_stream, "read_readings", refuse)
    blocks = list(stream_readings(files, MACHINE))
    assert len(blocks) > 2
    check_same(blocks, whole)


def test_without_a_machine_components_come_as_they_are_met(
    tmp_path: Path, small_blocks: int
) -> None:
    files = written(tmp_path, [TIMED.replace("axy,4", "late,4")])
    whole = read_readings(files, None, for_fit=False)
    blocks = list(stream_readings(files, None))
    check_same(blocks, whole)
    assert blocks[-1].components == whole.components


def test_packed_files(tmp_path: Path, small_blocks: int) -> None:
    packed = [gzip.compress(part.encode()) for part in (TIMED[:1000], TIMED[1000:])]
    path = tmp_path / "r.csv.gz"
    path.write_bytes(b"".join(packed) + b"\0\0padding")
    whole = read_readings([(path, "drift")], MACHINE, for_fit=False)
    stream = stream_readings([(path, "drift")], MACHINE)
    check_same(list(stream), whole)
    assert stream.sources == whole.sources


NEARLY = table("pass,load", "{i}", "{i}").replace("119,119", "119,nan")
FAULTY = {
    "cell": [TIMED.replace("20.97", "20,97")],
    "first-cell": [TIMED.replace("axy,0,0.0", "axy,0,x", 1)],
    "temperatures": [TIMED.replace("20.97", "").replace(",20.98", ",2098").replace("21.0", "-")],
    "name-of-a-temperature": [TIMED.replace("T_b_degC", "T_öl_degC")],
    "component": [TIMED.replace("dx_x,1", "dx_y,1")],
    "unit": [TIMED.replace("14.5,arcsec", "14.5,arcsecs")],
    "kind-of-unit": [TIMED.replace("14.5,arcsec", "14.5,um")],
    "pass": [table("pass", "{i}").replace(",90", ",90.5")],
    "position": [TIMED.replace("dx_x,4", "dx_x,")],
    "short-row": [TIMED + "\ndx_x,1\n"],
    "long-row": [TIMED.replace(",c1,20.99", ",c1,20.99,")],
    "doubled-row": [TIMED + "\n" + TIMED.splitlines()[7] + "\n"],
    "doubled-row-written-differently": [
        table("time_min,dir_x,note", "{i}", "", '"a,{i}"') + '\n"axy",0.0,0,arcsec,0.0,," a,0 "\n'
    ],
    "pasted-twice": ["\n".join([PASSES, *PASSES.splitlines()[1:]])],
    "open-quote": [TIMED.replace("c1,20.70", '"c1,20.70')],
    "no-text": [TIMED.replace("c1,20.80", "c\0,20.80")],
    "not-finite-late": [NEARLY],
    "not-finite-early": [table("pass,load", "{i}", "{i}").replace(",0,0\n", ",0,inf\n")],
    "other-decimal": [table("pass;load", "{i}", "{i};5").replace(",", ";").replace(";5", ".5")
                      .replace("118.5", "118,5")],
    "mixed-offsets": [table("time", "2024-05-03T10:00:00.{i:03d}").replace(".100", ".100Z")],
    "not-a-time": [table("time", "2024-05-03T10:00:00.{i:03d}").replace("00.100", "61.100")],
    "times-of-two-kinds": [TIMED, table("time", "2024-05-03T10:00:00.{i:03d}")],
    "offsets-in-one-file": [
        table("time", "2024-05-03T10:00:00.{i:03d}"), table("time", "2024-05-03T10:00:00.{i:03d}Z")
    ],
    "same-bytes": [TIMED, TIMED],
    "copied-file": [TIMED, "\n".join(TIMED.splitlines()[:1] + TIMED.splitlines()[50:60])],
    "header": ["component,eror,unit\naxy,1,um\n"],
    "position-column": ["component,error,unit\naxy,1,arcsec\ndx_x,1,um\ndx_x,2,um\n"],
    "no-rows": [HEAD + "\n"],
    "empty": [""],
    "blank": ["\n \n"],
    "several-files": [TIMED.replace("20.97", "x"), TIMED.replace("dx_x,1", "dx_y,1")],
    "web-page": ["<!doctype html>\n" + TIMED],
}  # fmt: skip


def problems(blocks: Iterator[Readings]) -> list[str]:
    with pytest.raises(InputError) as caught:
        for _ in blocks:
            pass
    return [str(problem) for problem in caught.value.findings]


@pytest.mark.parametrize("case", FAULTY)
def test_faults_are_told_in_the_same_words(tmp_path: Path, case: str, small_blocks: int) -> None:
    files = written(tmp_path, FAULTY[case])
    with pytest.raises(InputError) as caught:
        read_readings(files, MACHINE, for_fit=False)
    expected = [str(problem) for problem in caught.value.findings]
    assert problems(stream_readings(files, MACHINE)) == expected


@pytest.mark.parametrize("content", [b"caf\xe9\n", b"\xff\xfea"])
def test_bytes_that_are_no_text(tmp_path: Path, content: bytes, small_blocks: int) -> None:
    path = tmp_path / "r.csv"
    path.write_bytes(TIMED.encode() + b"\n" + content)
    found = problems(stream_readings([(path, "drift")], MACHINE))
    assert found == problems(in_one_piece(path))
    assert found[0].startswith("r.csv:122: not UTF-8")


def in_one_piece(path: Path) -> Iterator[Readings]:
    yield read_readings([(path, "drift")], MACHINE, for_fit=False)


@pytest.mark.parametrize("name", ["missing.csv", ".", "packed.csv.gz", "cut.csv.gz"])
def test_files_that_cannot_be_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "packed.csv.gz").write_text(TIMED)
    (tmp_path / "cut.csv.gz").write_bytes(gzip.compress(TIMED.encode())[:-9])
    path = tmp_path / name
    found = problems(stream_readings([(path, "drift")], MACHINE))
    assert found == problems(in_one_piece(path))
    assert len(found) == 1


def test_rows_before_a_late_fault_are_given_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_stream, "_BLOCK", 300)
    monkeypatch.setattr(csv_stream, "_PIECE", 100)
    stream = stream_readings(written(tmp_path, FAULTY["doubled-row"]), MACHINE)
    assert len(next(stream)) > 0
    assert problems(stream) == [
        "r0.csv, row 122: the same as row 8 in every column; expected each reading once"
    ]


def test_a_few_equal_readings_of_two_files_are_no_copy(tmp_path: Path) -> None:
    lines = TIMED.splitlines()
    files = written(tmp_path, [TIMED, "\n".join([*lines[:1], *lines[5:8]])])
    assert sum(map(len, stream_readings(files, MACHINE))) == 123


def test_equal_readings_are_told_of_with_the_last_block(tmp_path: Path, small_blocks: int) -> None:
    """That rows are equal shows at the end of a file, when the blocks were given but for one."""
    files = written(tmp_path, ["\n".join([PASSES, *PASSES.splitlines()[3:6]])])
    whole = read_readings(files, MACHINE, for_fit=False)
    blocks = list(stream_readings(files, MACHINE))
    check_same(blocks, whole)
    assert [note.code for block in blocks for note in block.notes] == ["readings-equal"]
    assert "r0.csv, row 122: the same as row 4" in whole.notes[0].message
    assert blocks[-1].notes == whole.notes


def test_times_out_of_order_are_told_once_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_stream, "_BLOCK", 2000)
    monkeypatch.setattr(csv_stream, "_PIECE", 1000)
    rows = [f"axy,,1.{i},arcsec,{-1 if i % 50 == 9 else i}" for i in range(500)]
    files = written(tmp_path, ["\n".join([f"{HEAD},time_min", *rows])])
    blocks = list(stream_readings(files, MACHINE))
    assert len(blocks) > 3
    (note,) = [note for block in blocks for note in block.notes]
    assert note.code == "time-out-of-order"
    assert "r0.csv, row 11, column 'time_min': -1 lies outside" in note.message


def test_no_files(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no files"):
        stream_readings([], MACHINE)


@pytest.mark.parametrize("threads", [1, 3])
def test_pieces_are_taken_few_ahead_of_their_use(
    threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: threads)
    taken = 0

    def pieces() -> Iterator[int]:
        nonlocal taken
        for number in count():
            taken += 1
            yield number

    assert list(islice(in_order(lambda n: n * n, pieces()), 50)) == [n * n for n in range(50)]
    assert taken <= 50 + 2 * threads + 1
