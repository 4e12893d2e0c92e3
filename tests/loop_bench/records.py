"""Draws sets, runs each through the command and appends what it says to a file.

Sets that stand in the file are not run again. All kinds come in turns, so that a part of a run
says something of each. Several processes may share a file: each has its shard.
"""

import argparse
import gzip
import hashlib
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import mtu_cli
from loop_bench.command import judged, rounded
from loop_bench.rows import table
from loop_bench.sets import JUDGING, KINDS, TUNING, Kind, drawn

SEED = 1
"""Of the command."""
Record = dict[str, Any]


def planned(*, judging: bool, only: str = "", scale: float = 1.0) -> list[tuple[Kind, int]]:
    """All sets; the n-th of m of a kind comes at n/m of the way."""
    places = [
        ((index + 0.5) / count, number, kind, index)
        for number, kind in enumerate(KINDS)
        if kind.name.startswith(only)
        for count in [max(1, round(kind.counts[judging] * scale))]
        for index in range(count)
    ]
    return [(kind, index) for _, _, kind, index in sorted(places, key=lambda place: place[:2])]


def state(folder: Path) -> str:
    """Of the package's code in a folder: that of another says other things."""
    code = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.suffix in (".py", ".yaml")):
        code.update(path.read_bytes())
    return code.hexdigest()[:12]


def record(kind: Kind, base: int, index: int) -> Record:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        turn, made = drawn(kind, base, index, folder)
        report = judged(made, folder, SEED)
    return {
        "kind": kind.name,
        "base": base,
        "index": index,
        "design": turn.design,
        "day": turn.day,
        "scatter_known": turn.scatter_known,
        "noise": kind.noise,
        "amplitude": kind.amplitude,
        "truth": rounded(made.truth()),
        "report": report,
    }


def read(path: Path) -> Iterator[Record]:
    """Of a file of lines, gzipped or not; a line that was cut is left out."""
    with gzip.open(path, "rt") if path.suffix == ".gz" else path.open() as lines:
        for line in lines:
            if line.endswith("}\n"):
                yield json.loads(line)


def identity(item: Record) -> tuple[str, int, int]:
    return item["kind"], item["base"], item["index"]


def draw(given: argparse.Namespace) -> None:
    """Appends what is missing of a shard."""
    shard, of = map(int, given.shard.split("/"))
    base, folder = JUDGING if given.judging else TUNING, Path(mtu_cli.__file__).parent
    code = state(folder)
    held = list(read(given.out)) if given.out.exists() else []
    if given.out.exists() and not given.out.read_bytes().endswith(b"\n"):
        # The last line of a run that was stopped: it ends here, and is not read.
        with given.out.open("a") as lines:
            lines.write("\n")
    if {item.get("state", code) for item in held} - {code}:
        raise SystemExit(f"{given.out} holds records of another state of the package")
    there = {identity(item) for item in held}
    plan = planned(judging=given.judging, only=given.only, scale=given.scale)
    left = [(k, i) for k, i in plan[shard::of] if (k.name, base, i) not in there][: given.most]
    print(f"{len(left)} sets to {folder}", file=sys.stderr, flush=True)
    start = time.monotonic()
    # A command is made for one call: what many leave behind ends with their process.
    with get_context("fork").Pool(1, maxtasksperchild=50) as pool:
        tasks = [(kind.name, base, index) for kind, index in left]
        for done, line in enumerate(pool.imap(_named, tasks), 1):
            with given.out.open("a") as lines:
                lines.write(json.dumps(line | {"state": code}, separators=(",", ":")) + "\n")
            if done % 20 == 0 or done == len(left):
                spent = time.monotonic() - start
                print(f"{spent:6.0f} s  {done} of {len(left)} sets", file=sys.stderr, flush=True)


def _named(task: tuple[str, int, int]) -> Record:
    name, base, index = task
    return record(next(kind for kind in KINDS if kind.name == name), base, index)


def main() -> None:
    parser = argparse.ArgumentParser(prog="loop_bench")
    parser.add_argument("out", type=Path, help="lines of JSON; .gz only with --table")
    parser.add_argument("--judging", action="store_true", help="full counts on judging days")
    parser.add_argument("--only", default="", help="kinds whose name starts with this")
    parser.add_argument("--scale", type=float, default=1.0, help="this share of the counts")
    parser.add_argument("--most", type=int, default=10**9, help="stop after so many sets")
    parser.add_argument("--shard", default="0/1", help="i/n: every n-th set from the i-th on")
    parser.add_argument("--table", action="store_true", help="draw nothing, only the table")
    parser.add_argument("--design", default="", help="the table of A or B alone")
    given = parser.parse_args()
    if not given.table:
        draw(given)
    records = [item for item in read(given.out) if given.design in ("", item["design"])]
    print("\n".join(table(records)))
