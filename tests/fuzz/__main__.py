"""Draws cases, counts what became of them, and ends with code 1 where any failed."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from support import ROOT

from fuzz.calls import PATTERNS, drawn_call, sound_call
from fuzz.cases import drawn_case
from fuzz.commands import judged_call
from fuzz.readers import judged
from fuzz.samples import KINDS, Kind, prepared_folder, samples_of
from fuzz.tally import Tally

KEPT = ROOT / "out" / "fuzz"
EVERY = 2000
"""Cases of readers between two lines of progress; a tenth of calls."""


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="fuzz")
    parser.add_argument("--readers", type=int, default=0, metavar="N", help="files read")
    parser.add_argument("--commands", type=int, default=0, metavar="M", help="commands called")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="the number of the first case")
    parser.add_argument("--kinds", nargs="*", default=[], choices=KINDS, help="of files read")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="mtu-fuzz-") as name:
        prepared = prepared_folder(Path(name) / "sound")
        # Messages name files as a user in that folder would.
        os.chdir(prepared)
        numbers = range(given.first, given.first + given.readers)
        found = [read_cases(prepared, given.seed, numbers, given.kinds)] if given.readers else []
        numbers = range(given.first, given.first + given.commands)
        if given.commands:
            found.append(call_cases(prepared, Path(name) / "calls" / "work", given.seed, numbers))
        os.chdir(ROOT)
    sys.exit(1 if any(tally.failures for tally in found) else 0)


def read_cases(prepared: Path, seed: int, numbers: range, kinds: Sequence[Kind]) -> Tally:
    """Damaged files through their readers."""
    samples = samples_of(prepared)
    tally = Tally("readers", seed, KEPT)
    for number in _told(numbers, EVERY, tally):
        case = drawn_case(samples, seed, number, kinds)
        name = f"damaged.{case.sample.form}"
        tally.add(number, case.sample.kind, case.content, name, judged(case))
    print("\n".join(tally.lines()), flush=True)
    return tally


def call_cases(prepared: Path, folder: Path, seed: int, numbers: range) -> Tally:
    """Commands on damaged files, after those on sound ones, which must end well."""
    tally = Tally("commands", seed, KEPT)
    for pattern in PATTERNS if numbers.start == 0 else ():
        verdict = judged_call(sound_call(pattern, prepared, folder), folder)
        if verdict.outcome != "done" or verdict.failure is not None:
            sys.exit(f"mtu {pattern.words} on sound files: {verdict.failure or verdict.message}")
    for number in _told(numbers, EVERY // 10, tally):
        call = drawn_call(prepared, folder, seed, number)
        content = (folder / call.damaged).read_bytes()
        verdict = judged_call(call, folder)
        tally.add(number, " ".join(call.command), content, call.damaged, verdict)
    print("\n".join(tally.lines()), flush=True)
    return tally


def _told(numbers: range, every: int, tally: Tally) -> Iterator[int]:
    start = time.monotonic()
    for done, number in enumerate(numbers):
        if done and done % every == 0:
            seconds = time.monotonic() - start
            failed = len(tally.failures)
            print(f"{seconds:6.0f} s  {tally.task}: {done} cases, {failed} failures", flush=True)
        yield number


if __name__ == "__main__":
    main()
