"""Tables through their readers: what was written is read, and what must not matter does not."""

import csv
import gzip
import io
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any, Literal

import numpy as np
import pytest
from fuzz.messages import unclean
from fuzz.readers import READERS, within_time
from fuzz.samples import KINDS, Kind, Sample
from hypothesis import given
from hypothesis import strategies as st
from property_settings import plain_values, texts, tried

from mtu_cli.files.machine import Component
from mtu_cli.files.readings import Readings, read_points, read_readings
from mtu_cli.files.reports_read import read_json
from mtu_cli.files.source import report_bytes
from mtu_cli.findings import InputError
from mtu_cli.units import UNITS

HEADER = ("component", "position_mm", "pass", "direction", "error", "unit", "note", "load")
LENGTHS, ANGLES = ("um", "mm", "nm"), ("arcsec", "urad", "mrad", "rad", "deg")
COMPONENTS = {
    "px": Component.model_validate({"of": "x", "unit": "um"}),
    "yaw": Component.model_validate({"of": "y", "unit": "arcsec"}),
    "ort": Component.model_validate({"unit": "arcsec"}),
}
Rows = list[tuple[str, ...]]

finite = st.floats(-1e3, 1e3, allow_subnormal=False)
# A text has a letter at either end: blanks around a cell mean nothing, and 007 is a number.
notes = st.text(
    st.characters(exclude_categories=("Cs", "Cc"), include_characters='"\n\t,;#'), max_size=6
).map(lambda text: f"n{text}n")
row = st.tuples(
    st.sampled_from([*COMPONENTS]), st.integers(-5, 5), st.integers(1, 3),
    st.sampled_from(["forward", "-", "+1", ""]), finite, st.sampled_from([0, 1, 2]), notes,
    st.one_of(st.just(""), finite.map(repr)),
)  # fmt: skip


def cells(drawn: tuple[str, int, int, str, float, int, str, str]) -> tuple[str, ...]:
    name, position, number, direction, error, unit, note, load = drawn
    units = LENGTHS if name == "px" else ANGLES
    return (
        name, str(position * 12.5), str(number), direction, repr(error), units[unit], note, load,
    )  # fmt: skip


# Rows that are equal in all but their note are copies: one of each.
tables: st.SearchStrategy[Rows] = st.lists(
    row.map(cells), min_size=1, max_size=12, unique_by=lambda item: (*item[:4], item[6])
)


@dataclass(frozen=True)
class Layout:
    """How a table is written."""

    separator: str
    end: str
    mark: bool
    packed: bool
    quoted: bool
    comment: str


layouts = st.builds(
    Layout,
    separator=st.sampled_from([",", ";"]),
    end=st.sampled_from(["\n", "\r\n"]),
    mark=st.booleans(),
    packed=st.booleans(),
    quoted=st.booleans(),
    comment=st.sampled_from(["", '# a, b; "c\n', "#\n\n"]),
)
PLAIN = Layout(",", "\n", False, False, False, "")


def saved(folder: Path, header: Sequence[str], rows: Rows, layout: Layout = PLAIN) -> Path:
    out = io.StringIO()
    quoting: Literal[0, 1] = csv.QUOTE_ALL if layout.quoted else csv.QUOTE_MINIMAL
    writer = csv.writer(out, delimiter=layout.separator, lineterminator=layout.end, quoting=quoting)
    comma = layout.separator == ";"
    writer.writerow(header)
    writer.writerows(
        [cell.replace(".", ",") if comma and number(cell) else cell for cell in item]
        for item in rows
    )
    text = layout.comment.replace("\n", layout.end) + out.getvalue()
    content = text.encode("utf-8-sig" if layout.mark else "utf-8")
    path = folder / ("t.csv.gz" if layout.packed else "t.csv")
    path.write_bytes(gzip.compress(content) if layout.packed else content)
    return path


def number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def read(path: Path) -> Readings:
    return read_readings([(path, "lbb")], COMPONENTS, for_fit=False)


@tried(60)
@given(rows=tables, layout=layouts)
def test_what_was_written_is_read(tmp_path: Path, rows: Rows, layout: Layout) -> None:
    found = read(saved(tmp_path, HEADER, rows, layout))
    assert len(found) == len(rows)
    line = 2 + layout.comment.count("\n")
    for i, (name, position, count, direction, error, unit, note, load) in enumerate(rows):
        assert found.components[found.code[i]] == name
        assert name == "ort" or found.position_mm[i] == float(position)
        assert found.pass_number[i] == int(count)
        assert found.direction[i] == {"forward": 1, "-": -1, "+1": 1, "": 0}[direction]
        assert found.error[i] == float(error) * UNITS[unit].to_internal
        assert found.covariates["note"][i] == note.strip()
        np.testing.assert_equal(found.covariates["load"][i], float(load or "nan"))
        assert found.row[i] == line
        line += 1 + note.count("\n")


PLACES = {"1": (0.0, 0.0, None), "2": (50.0, 0.0, None), "B 3": (0.0, 50.0, 7.5)}
point = st.tuples(
    st.sampled_from(["7", "007", "p"]), st.sampled_from([*PLACES]), st.integers(1, 3),
    finite, finite, st.sampled_from(["-1", "1", ""]),
)  # fmt: skip


@tried(40)
@given(
    drawn=st.lists(point, min_size=1, max_size=9, unique_by=lambda item: item[:3]),
    layout=layouts,
    data=st.data(),
)
def test_points_are_read_as_written_in_any_order(
    tmp_path: Path,
    drawn: list[tuple[str, str, int, float, float, str]],
    layout: Layout,
    data: st.DataObject,
) -> None:
    order = data.draw(st.permutations(range(len(drawn))))
    header = ("part", "feature", "repeat", "x_mm", "y_mm", "dir_x")
    rows = [(p, f, str(n), repr(x), repr(y), sign) for p, f, n, x, y, sign in drawn]
    path = saved(tmp_path, header, [rows[i] for i in order], layout)
    found = read_points([(path, "cmm")], PLACES)
    for i, place in enumerate(order):
        part, feature, repeat, x, y, sign = drawn[place]
        assert found.parts[found.part[i]] == part
        assert found.features[found.feature[i]] == feature
        assert found.repeat[i] == repeat
        assert (found.measured[i, 0], found.measured[i, 1]) == (x, y)
        assert tuple(found.nominal[i, :2]) == PLACES[feature][:2]
        np.testing.assert_equal(found.direction[i, 0], float(sign or "nan"))


WORDS = (
    "component,error,unit\n", "a,1,um\n", "part,feature,x_mm,y_mm\n", "schema: mtu/machine/1\n",
    "name: m\n", "components: {a: {unit: um}}\n", "equations: {Ex: a}\n", "- ", "? ", "&a ", "*a",
    "[", "{", "]", "}", ": ", '"', "'", ",", ";", "\n", "\r", "\t", "#", "nan", "1e999", "\x00",
    "\ufeff", "\x85", "!!int", "|\n", "---\n", "mtu/part/1", "features:\n", '{"schema": "mtu/',
    "fit-components/1", "results", "effects:\n", "inputs:\n", "places:\n", "\\", "\ud800",
)  # fmt: skip
contents = st.one_of(
    st.binary(max_size=200),
    st.text(max_size=100).map(str.encode),
    st.lists(st.sampled_from(WORDS), max_size=20).map(
        lambda words: "".join(words).encode("utf-8", "surrogatepass")
    ),
)


# A table of a control is read by its control, a map together with the file that it maps.
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("control", "map")])
@tried(40)
@given(content=contents, seed=st.randoms(use_true_random=False))
def test_any_bytes_are_a_file_or_an_input_error(
    tmp_path: Path, kind: Kind, content: bytes, seed: Random
) -> None:
    path = tmp_path / "any"
    path.write_bytes(content)
    message = "read"
    try:
        with within_time():
            READERS[kind](path, Sample(kind=kind, path=path, content=content), seed)
    except InputError as error:
        message = str(error)
    assert unclean(message) is None


# Values written as JSON are read back as they were, whatever they are.


mappings = st.dictionaries(texts, plain_values(texts), min_size=1, max_size=5)


@tried(150)
@given(data=mappings)
def test_reports_are_read_back(tmp_path: Path, data: dict[str, Any]) -> None:
    content = report_bytes(data)
    assert content.endswith(b"}\n")
    (tmp_path / "r.json").write_bytes(content)
    # Equal in kind too: 1 is neither 1.0 nor true.
    assert repr(read_json(tmp_path / "r.json", "report")[1]) == repr(data)


# Writing that is killed: every file is the old one or the new one, at whatever step.


OLD = {"a.json": b"old a\n" * 100, "b.csv": b"old b\n" * 100}
NEW = {"a.json": b"new a\n" * 40_000, "b.csv": b"new b\n" * 40_000, "c.svg": b"new c\n"}
STEP_BY_STEP = """
import os, sys
from pathlib import Path
from mtu_cli.files.source import files_written
folder = Path(sys.argv[1])
new = {folder / name: (name[0].join(("new ", "\\n")) * count).encode()
       for name, count in (("a.json", 40_000), ("b.csv", 40_000), ("c.svg", 1))}
def killed_at(last):
    done = 0
    def step(frame, event, call):
        nonlocal done
        done += event == "c_call"
        if done > last:
            os.kill(os.getpid(), 9)
    sys.setprofile(step)
    with files_written(new):
        pass
    os._exit(0)
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        killed_at(int(line))
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


def whole(folder: Path) -> set[str]:
    """Which of the files are new, all of them being whole."""
    new = set()
    for name, content in NEW.items():
        path = folder / name
        if not path.exists():
            assert name not in OLD, f"{name} is gone"
            continue
        found = path.read_bytes()
        assert found in (OLD.get(name), content), f"{name} has {len(found)} bytes"
        if found == content:
            new.add(name)
    return new


def fresh(folder: Path) -> None:
    for path in folder.iterdir():
        path.unlink()
    for name, content in OLD.items():
        (folder / name).write_bytes(content)


def test_killed_before_every_step(tmp_path: Path) -> None:
    """A kill before the first call of what is written in C, before the second, and so on."""
    process = subprocess.Popen(
        [sys.executable, "-c", STEP_BY_STEP, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    seen: list[int] = []
    code = -signal.SIGKILL
    for last in range(3000):
        fresh(tmp_path)
        assert process.stdin is not None
        assert process.stdout is not None
        print(last, file=process.stdin, flush=True)
        code = int(process.stdout.readline())
        seen.append(len(whole(tmp_path)))
        if code != -signal.SIGKILL:
            break
    process.communicate(timeout=30)
    assert code == 0
    assert len(seen) > 20
    assert seen[0] == 0
    assert seen[-1] == len(NEW)
    assert seen == sorted(seen)
    assert not [path for path in tmp_path.iterdir() if path.name not in NEW]
