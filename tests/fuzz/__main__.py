"""Draws cases, counts what became of them, and ends with code 1 where any failed."""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from support import ROOT

from fuzz.commands import PATTERNS, drawn_call, judged_call, sound_call
from fuzz.damage import drawn_case
from fuzz.readers import judged
from fuzz.samples import KINDS, prepared_folder, samples_of
from fuzz.tally import Tally, Verdict

Found = Iterator[tuple[int, str, bytes, str, Verdict]]


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="fuzz")
    parser.add_argument("--readers", type=int, default=0, metavar="N", help="files read")
    parser.add_argument("--commands", type=int, default=0, metavar="M", help="commands called")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="the number of the first case")
    parser.add_argument("--kinds", nargs="*", default=[], choices=KINDS, help="of files read")
    given = parser.parse_args()
    failures = 0
    with tempfile.TemporaryDirectory(prefix="mtu-fuzz-") as name:
        prepared, folder = prepared_folder(Path(name) / "sound"), Path(name) / "calls" / "work"
        # Messages name files as a user in that folder would.
        os.chdir(prepared)
        for task, count, every, cases_of in (
            ("readers", given.readers, 2000, read_cases),
            ("commands", given.commands, 200, call_cases),
        ):
            cases = cases_of(given, prepared, range(given.first, given.first + count), folder)
            tally, start = Tally(task, given.seed, ROOT / "out" / "fuzz"), time.monotonic()
            for done, case in enumerate(cases, 1):
                tally.add(*case)
                if done % every == 0:
                    spent, failed = time.monotonic() - start, len(tally.failures)
                    print(f"{spent:6.0f} s  {task}: {done} cases, {failed} failures", flush=True)
            print(*tally.lines() if count else (), sep="\n", flush=True)
            failures += len(tally.failures)
        os.chdir(ROOT)
    sys.exit(1 if failures else 0)


def read_cases(given: argparse.Namespace, prepared: Path, numbers: range, _: Path) -> Found:
    """Damaged files through their readers."""
    samples = samples_of(prepared)
    for number in numbers:
        case = drawn_case(samples, given.seed, number, given.kinds)
        yield number, case.sample.kind, case.content, f"damaged.{case.sample.form}", judged(case)


def call_cases(given: argparse.Namespace, prepared: Path, numbers: range, folder: Path) -> Found:
    """Commands on damaged files, after those on sound ones, which must end well."""
    for pattern in PATTERNS if numbers and numbers.start == 0 else ():
        verdict = judged_call(sound_call(pattern, prepared, folder), folder)
        if verdict.outcome != "done" or verdict.failure is not None:
            sys.exit(f"mtu {pattern.words} on sound files: {verdict.failure or verdict.message}")
    for number in numbers:
        call = drawn_call(prepared, folder, given.seed, number)
        content, name = (folder / call.damaged).read_bytes(), Path(call.damaged).name
        yield number, call.arguments[0], content, name, judged_call(call, folder)


if __name__ == "__main__":
    main()
