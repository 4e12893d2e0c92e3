"""Draws the data sets and prints the table; see the package."""

from __future__ import annotations

import argparse
import os
import time

from loop_bench.best import with_best
from loop_bench.pieces import KINDS, Plan, draw, drawn, folder_of
from loop_bench.rows import in_words, rows


def main() -> None:
    parser = argparse.ArgumentParser(prog="loop_bench")
    parser.add_argument("--tuning", action="store_true", help="days 0-7, not the judging days")
    parser.add_argument("--scale", type=float, default=float(os.environ.get("LOOP_SCALE", "1")))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", default="", help="cells whose name starts with this")
    given = parser.parse_args()
    plan = Plan(
        scale=given.scale, tuning=given.tuning, folder=folder_of(given.tuning), only=given.only
    )
    start = time.monotonic()
    for line in draw(plan, given.workers):
        print(f"{time.monotonic() - start:6.0f} s  {line}", flush=True)
    found = drawn(plan)
    for cell in plan.cells():
        if cell.measure == "library":
            for kind in KINDS:
                own = found[kind, cell.name]
                found[kind, cell.name] = with_best(cell, kind, int(plan.tuning), own)
    for kind in KINDS:
        print(f"\ndesign {kind}, {'tuning' if plan.tuning else 'judging'} days")
        print("\n".join(in_words(list(rows(found, kind)))))


if __name__ == "__main__":
    main()
