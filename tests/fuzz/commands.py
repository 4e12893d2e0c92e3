"""One damaged file through an installed command: its end, its words, and what it leaves."""

from __future__ import annotations

import csv
import io
import json
import os
import resource
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cli_runner import MTU, Listing, environment, listing

from fuzz.calls import OLD, Call
from fuzz.messages import unclean, warned
from fuzz.readers import LIMIT_S, Verdict

WALL_S = 120.0
LARGEST_KB = 2_000_000
CODES = (0, 2, 3)


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a process ended; `seconds` of processor time, `kilobytes` of memory at most."""

    code: int
    output: str
    error: str
    seconds: float
    kilobytes: int


def run(arguments: list[str], folder: Path) -> Ended:
    """The installed command in a folder, stopped after two minutes."""
    with (folder.parent / "out").open("w+b") as out, (folder.parent / "err").open("w+b") as err:
        process = subprocess.Popen(
            [MTU, *arguments],
            cwd=folder,
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
        )
        code, usage = _waited(process)
        texts = []
        for stream in (out, err):
            stream.seek(0)
            texts.append(stream.read().decode("utf-8", "replace"))
    return Ended(
        code=code,
        output=texts[0],
        error=texts[1],
        seconds=usage.ru_utime + usage.ru_stime,
        kilobytes=usage.ru_maxrss,
    )


def _waited(process: subprocess.Popen[bytes]) -> tuple[int, resource.struct_rusage]:
    end = time.monotonic() + WALL_S
    pause = 0.002
    while True:
        found, status, usage = os.wait4(process.pid, os.WNOHANG)
        if found:
            process.returncode = os.waitstatus_to_exitcode(status)
            return process.returncode, usage
        if time.monotonic() > end:
            process.send_signal(signal.SIGKILL)
        time.sleep(pause)
        pause = min(0.02, pause * 1.5)


def judged_call(call: Call, folder: Path) -> Verdict:
    """The verdict on one call in its folder."""
    before = listing(folder)
    ended = run(call.arguments, folder)
    failure = failure_of(ended, before, listing(folder), call)
    outcome = {0: "done", 2: "refused", 3: "gate"}.get(ended.code, "failed")
    return Verdict(
        outcome=outcome, seconds=ended.seconds, failure=failure, message=ended.error.strip()
    )


def failure_of(ended: Ended, before: Listing, after: Listing, call: Call) -> str | None:
    """Why a call ended badly, or None; `before` and `after` are the files of its folder."""
    words = ended.error
    if ended.code not in CODES:
        return f"exit code {ended.code}: {words[-3000:]}"
    if "Traceback" in words:
        return f"a traceback: {words[-3000:]}"
    if ended.seconds > LIMIT_S:
        return f"{ended.seconds:.1f} s of processor time"
    if ended.kilobytes > LARGEST_KB:
        return f"{ended.kilobytes} kB of memory"
    if found := warned(words):
        return found
    if ended.code == 2:
        return _failure_of_refusal(ended, before, after)
    return _failure_of_outputs(ended, before, after, call)


def _failure_of_refusal(ended: Ended, before: Listing, after: Listing) -> str | None:
    if ended.output:
        return f"exit code 2 with output: {ended.output[:300]!r}"
    if after != before:
        return f"exit code 2, but files changed: {_changes(before, after)}"
    if not ended.error.startswith("mtu: "):
        return f"exit code 2 without words of its own: {ended.error[:300]!r}"
    return unclean(ended.error.removeprefix("mtu: ").removesuffix("\n"))


def _changes(before: Listing, after: Listing) -> list[str]:
    return sorted(
        name for name in {*before, *after} if before.get(name, b"-") != after.get(name, b"-")
    )


def _failure_of_outputs(ended: Ended, before: Listing, after: Listing, call: Call) -> str | None:
    changed = _changes(before, after)
    # What cannot stand in a table stands beside it.
    if not set(changed) <= {*call.outputs, *(f"{name}.txt" for name in call.outputs)}:
        return f"files changed that are no outputs: {changed}"
    for name in call.outputs:
        content = after.get(name)
        if content is None:
            return f"exit code {ended.code} without {name}"
        if fault := whole(name, content):
            return f"{name}: {fault}"
        if content == OLD:
            return f"exit code {ended.code}, but {name} is the old one"
    return None


def whole(name: str, content: bytes) -> str | None:
    """What is wrong with an output, or None: reports, tables and pictures must be complete."""
    ending = name.rpartition(".")[2]
    try:
        text = content.decode()
        if ending == "json":
            document = json.loads(text, parse_constant=_refused)
            return None if str(document["schema"]).startswith("mtu/") else "no report"
        if ending == "csv":
            lines = [line for line in text.splitlines(keepends=True) if line[0] != "#"]
            rows = [*csv.reader(io.StringIO("".join(lines), newline=""), strict=True)]
            sound = text.endswith("\n") and len({len(row) for row in rows}) == 1
            return None if sound else "no whole table"
        end = {"svg": "</svg>", "dot": "}", "pl": "."}.get(ending, "")
        return None if text.strip() and text.rstrip().endswith(end) else "no whole text"
    except (ValueError, KeyError, TypeError, IndexError, csv.Error) as error:
        return f"cannot be read: {error}"


def _refused(name: str) -> Any:
    raise ValueError(f"{name} in a report")
