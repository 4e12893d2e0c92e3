"""Draws the cells day by day in two processes; pieces on disk are not drawn again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import get_args

from shop_day.day import Kind

import mtu_cli
from loop_bench.cells import CELLS, Cell, Record, record
from loop_bench.days import BenchDay
from mtu_cli.stats.threads import one_blas_thread

ROOT = Path(__file__).parents[2]
DAYS = 8
FIRST_DAY = {False: 5000, True: 0}
"""Of judging, and of tuning. Judging days move on when the engine was changed after a judgement."""
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What to draw: `scale` of the full counts, on tuning or judging seeds."""

    scale: float
    tuning: bool
    folder: Path
    only: str = ""

    def count(self, cell: Cell) -> int:
        """No family is left out of a small run."""
        return max(1, len(cell.families), round(cell.count * self.scale))

    def cells(self) -> list[Cell]:
        return [cell for cell in CELLS if cell.name.startswith(self.only)]

    def path(self, kind: Kind, cell: Cell, day: int) -> Path:
        return self.folder / f"{kind}-{cell.name}-{day}-{self.count(cell)}.json"


def folder_of(tuning: bool) -> Path:
    """Where pieces are kept: apart for every state of the code that draws and judges them."""
    code = hashlib.sha256()
    ours = ("close_loop_sealed/*/*.py", "close_loop_sealed/*/*/*.py", "model/*.py", "stats/*.py")
    package = Path(mtu_cli.__file__).parent
    files = [path for pattern in ours for path in package.glob(pattern)]
    files += Path(__file__).parent.glob("[cdijl]*.py")
    files += (Path(__file__).parents[1] / "shop_day").glob("*.py")
    files.append(Path(__file__).parents[1] / "model_examples.py")
    for path in sorted(files):
        code.update(path.read_bytes())
    state = code.hexdigest()[:12]
    return ROOT / "out" / "loop-bench" / f"{state}-{'tuning' if tuning else 'judging'}"


def draw(plan: Plan, workers: int) -> Iterator[str]:
    """Draws what is missing; yields a line a piece."""
    plan.folder.mkdir(parents=True, exist_ok=True)
    days = [
        (plan, kind, FIRST_DAY[plan.tuning] + day)
        for day in range(DAYS)
        for kind in KINDS
        if any(
            not plan.path(kind, cell, FIRST_DAY[plan.tuning] + day).exists()
            for cell in plan.cells()
        )
    ]
    if workers == 1:
        for item in days:
            yield _of_day(item)
        return
    with get_context("fork").Pool(workers) as pool:
        yield from pool.imap_unordered(_of_day, days)


def _of_day(item: tuple[Plan, Kind, int]) -> str:
    plan, kind, day = item
    with one_blas_thread():
        return f"design {kind}, day {day}: {_drawn_of(plan, kind, day)} data sets"


def _drawn_of(plan: Plan, kind: Kind, day: int) -> int:
    bench: BenchDay | None = None
    drawn = 0
    for cell in plan.cells():
        path = plan.path(kind, cell, day)
        if path.exists():
            continue
        own = indices(cell, plan.count(cell), day - FIRST_DAY[plan.tuning])
        found: list[Record] = []
        if own:
            bench = bench or BenchDay(kind, day)
            found = [record(bench, cell, int(plan.tuning), index) for index in own]
        part = path.with_suffix(".part")
        part.write_text(json.dumps(found))
        part.replace(path)
        drawn += len(found)
    return drawn


def indices(cell: Cell, count: int, day: int) -> Sequence[int]:
    """The data sets of a day; every family comes on every day."""
    turn = max(len(cell.families), 1)
    return [i for i in range(count) if (i // turn + i % turn) % DAYS == day]


def drawn(plan: Plan) -> dict[tuple[Kind, str], list[Record]]:
    """The records of all pieces that are there, by design and cell."""
    found: dict[tuple[Kind, str], list[Record]] = {}
    for kind in KINDS:
        for cell in plan.cells():
            own = found.setdefault((kind, cell.name), [])
            for day in range(DAYS):
                path = plan.path(kind, cell, FIRST_DAY[plan.tuning] + day)
                if path.exists():
                    own += json.loads(path.read_text())
    return found
