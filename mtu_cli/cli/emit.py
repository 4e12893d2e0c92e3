"""What a run gives: its result, tables, files (all or none), warnings, and the exit code of its
gates.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from mtu_cli.cli import silence
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.options import BESIDE, MADE, WRITTEN, Options
from mtu_cli.files.headers import is_made, measured_in, number
from mtu_cli.files.source import files_written, given_path, same, target_faults
from mtu_cli.findings import EXIT_GATE, SUSPICIOUS, Finding, InputError, finding, warning_lines
from mtu_cli.reports.document import plain_text
from mtu_cli.result import Result
from mtu_cli.stats.monte_carlo import Progress

STANDARD_OUTPUT = Path("-")
DELAY_S, EVERY_S = 1.0, 0.1
"""After what time, and how often, progress is shown."""


def execute(options: Options, run: Callable[[Inputs], Result]) -> None:
    """Runs one command and writes its files: all, or none.

    Tables go to standard output, warnings and progress to standard error; with `-o -` the
    report is alone on standard output. Ends with EXIT_GATE where a gate is met.
    """
    inputs = Inputs(options)
    try:
        limits = asked_gates(options)
        check_outputs(inputs)
        with late_bar(options.command) as progress:
            inputs.settings = replace(inputs.settings, progress=progress)
            result = run(inputs)
            reasons = result.gates_met(limits)
            files = result.outputs()
    except InputError as fault:
        raise InputError(inputs.with_paths(fault.findings), fault.uncounted) from None
    report = files.pop(STANDARD_OUTPUT, None)
    warnings = [each for each in result.warnings if not (options.quiet and each.severity == "note")]
    lines = [
        *warning_lines(inputs.with_paths(warnings)),
        *(f"mtu: gate {name}: {why}" for name, why in reasons.items()),
    ]
    # Files get their names last: none is written where the output fails.
    with files_written(files):
        try:
            if report is not None and hasattr(sys.stdout, "buffer"):
                sys.stdout.buffer.write(report)
            elif report is not None:
                # A notebook's, or `io.StringIO`, takes text.
                sys.stdout.write(report.decode())
            elif not options.quiet:
                show(result.document.blocks(detail=options.detail))
            sys.stdout.flush()
        except BrokenPipeError:
            # The reader has left (``| head``): nothing is wrong.
            silence(sys.stdout)
        with suppress(BrokenPipeError):
            print(*lines, sep="\n", end="\n" if lines else "", file=sys.stderr, flush=True)
    if reasons:
        sys.exit(EXIT_GATE)


def show(tables: Iterable[object]) -> None:
    """Tables and lines on standard output: with colour on a terminal, plain text in a pipe."""
    for table in tables:
        if isinstance(table, str):
            print(table)
        elif sys.stdout.isatty():
            Console(highlight=False).print(table, crop=False)
        else:
            sys.stdout.write(plain_text([table]))


def asked_gates(options: Options) -> dict[str, float]:
    """The gates of --fail-if with their limits, 0 of a gate without one; `options.gates` are as
    help has them: ``drift``, ``nonconforming=0.01``.

    Raises InputError with every gate that is unknown or lacks its limit.
    """
    choices = (SUSPICIOUS, *options.gates)
    limited = {name.partition("=")[0]: "=" in name for name in choices}
    result: dict[str, float] = {}
    problems = []
    for text in (part.strip() for item in options.fail_if or () for part in item.split(",")):
        name, equals, limit = text.partition("=")
        share = number(limit) if equals else 0.0
        if limited.get(name) != bool(equals):
            expected = " or ".join(choices)
            problems.append(finding("unknown-name", what="gate", value=text, expected=expected))
        elif share is None or not 0 <= share < 1:
            expected = "a probability from 0 to below 1, such as 0.01 for 1 %"
            place = {"path": f"--fail-if {name}", "value": text}
            problems.append(finding("out-of-range", **place, expected=expected))
        elif equals and name in result:
            problems.append(finding("appears-twice", what=f"--fail-if {name}", value=text))
        result[name] = share or 0.0
    if problems:
        raise InputError(problems)
    return result


def check_outputs(inputs: Inputs) -> None:
    """Raises InputError for files that cannot be made, or would overwrite measured data or inputs
    that the call, its study or that of this folder names, except those that the command is to
    make. All at once, before anything is calculated.
    """
    options, outputs = inputs.options, inputs.options.written
    sources = [(role, path) for role, path in inputs.input_files() if os.path.exists(path)]
    problems, files = list[Finding](), list[Path]()
    for name, path in outputs.items():
        option, place = WRITTEN[name].names(name)[0], {"file": given_path(path)}
        if path == STANDARD_OUTPUT:
            if name not in ("out", "to_csv") and (name != "csv" or outputs.get("out") == path):
                reason = f"{option} cannot go to standard output"
                problems.append(finding("output-form", reason=reason, expected="a file"))
            continue
        makes = MADE.get(options.command, {}).get(name, ())
        roles = [role for role in makes if not options.values.get(role)]
        group = [path, *(path.with_name(path.name + x) for x in BESIDE.get(name, ()))]
        files += group
        for file in group:
            why: str | None = None
            if any(role not in roles and same(file, source) for role, source in sources):
                why = "it is an input"
            elif file.is_file() and name == "csv":
                why = (content := measured_in(file)) and f"it holds {content}"
            elif file.is_file() and options.command == "simulate" and not is_made(file):
                why = f"it holds {measured_in(file) or 'what simulate has not made'}"
            if why:
                facts = {"reason": why, "expected": "another name"}
                problems.append(finding("not-overwritten", file=given_path(file), **facts))
        ending, endings = path.suffix.lower(), WRITTEN[name].endings
        if endings and ending not in endings and (path.is_file() or not os.path.exists(path)):
            reason = f"{option} does not write {ending or 'a file without an ending'}"
            expected = f"a name that ends in {' or '.join(endings)}"
            problems.append(finding("output-form", reason=reason, expected=expected, **place))
    # The first problem of each file.
    first = {x.file or x.message: x for x in reversed([*problems, *target_faults(files)])}
    if first:
        raise InputError(reversed(first.values()))


@contextmanager
def late_bar(text: str) -> Iterator[Progress]:
    """The progress of a calculation, on a terminal's standard error, where it takes more than
    DELAY_S. It is written when the calculation reports progress, by no thread of its own.
    """
    due, drawn = time.monotonic() + DELAY_S, False

    def progress(done: int, total: int | None) -> None:
        nonlocal due, drawn
        if time.monotonic() >= due and sys.stderr.isatty():
            share = f"{done / total:.0%}" if total else f"{done}"
            print(f"\r{text}: {share} ", end="", file=sys.stderr, flush=True)
            due, drawn = time.monotonic() + EVERY_S, True

    try:
        yield progress
    finally:
        if drawn:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
