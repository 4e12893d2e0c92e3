"""Load, run, emit: the same for every command."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mtu_cli.cli.gates import suspicious
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.options import Options
from mtu_cli.cli.outputs import STANDARD_OUTPUT, check_outputs
from mtu_cli.cli.parameters import FAIL_IF
from mtu_cli.cli.places import placed_text, whole_paths
from mtu_cli.cli.progress import LateBar
from mtu_cli.cli.settings import doubts, read_settings
from mtu_cli.cli.streams import write_bytes
from mtu_cli.findings import EXIT_GATE, Finding, InputError
from mtu_cli.model.settings import Settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_ALIKE = 20
"""Warnings of one code that are shown."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a command has to say, each part made only when it is asked for.

    `gate` is None, or the reason why the gate that the user asked for is met. `settings`: those
    of the report, where the command had to choose some itself. `files`: what the command writes
    beside report, table and picture, by path.
    """

    results: Callable[[], dict[str, Any]]
    tables: Callable[[], Iterable[object]]
    rows: Callable[[], tuple[Sequence[str], Iterable[Sequence[object]]]]
    figure: Callable[[], Figure]
    warnings: Sequence[Finding] = field(default=())
    gate: str | None = None
    settings: Settings | None = None
    files: Callable[[], Mapping[Path, bytes]] = dict


def execute(options: Options, analyse: Callable[[Inputs, Settings], Outcome]) -> None:
    """Runs one command and writes what was asked for: all files, or none.

    Tables go to standard output, warnings and progress to standard error; with `-o -` the
    report is alone on standard output.
    """
    inputs = Inputs(options)
    check_outputs(inputs)
    with LateBar(options.command) as progress:
        settings = read_settings(inputs, progress)
        outcome = analyse(inputs, settings)
        outcome = replace(
            outcome, warnings=[*inputs.suspicions, *doubts(inputs, settings), *outcome.warnings]
        )
    files = _files(options, inputs, settings, outcome)
    report = files.pop(STANDARD_OUTPUT, None)
    gate = None
    met = [outcome.gate, suspicious(options.values.get(FAIL_IF), outcome.warnings)]
    if reasons := [each for each in met if each is not None]:
        gate = f"mtu: gate {options.values[FAIL_IF]}: {'; '.join(reasons)}"

    def say() -> None:
        if report is not None:
            write_bytes(report)
        elif not options.quiet:
            show(outcome.tables())

    told = warning_lines(outcome.warnings, _subject(inputs) if options.quiet else "", options)
    deliver(files, inputs, say, told=[*told, *([gate] if gate else [])])
    if gate is not None:
        sys.exit(EXIT_GATE)


def deliver(
    files: Mapping[Path, bytes],
    inputs: Inputs,
    say: Callable[[], None],
    told: Sequence[str] = (),
) -> None:
    """What a run has made: `say` on standard output and what is `told` on standard error, then
    the files. Where any of it fails no file is there.
    """
    with _made_ready(files, inputs) if files else nullcontext(tuple) as put_in_place:
        say()
        sys.stdout.flush()
        for line in told:
            print(line, file=sys.stderr)
        put_in_place()


def _made_ready(
    files: Mapping[Path, bytes], inputs: Inputs
) -> AbstractContextManager[Callable[[], object]]:
    from mtu_cli.files.write import made_ready

    return made_ready(files, inputs=[source.path for source in inputs.sources])


def _files(
    options: Options, inputs: Inputs, settings: Settings, outcome: Outcome
) -> dict[Path, bytes]:
    files = dict(outcome.files())
    if options.out is not None:
        from mtu_cli.files.json_file import report_bytes
        from mtu_cli.reports.document import envelope

        files[options.out] = report_bytes(
            envelope(
                options.command,
                inputs=inputs.sources,
                settings=settings if outcome.settings is None else outcome.settings,
                results=outcome.results(),
                warnings=outcome.warnings,
                at=inputs.at,
            )
        )
    if options.csv is not None:
        from mtu_cli.reports.csv_text import csv_text

        files[options.csv] = csv_text(*outcome.rows()).encode()
    if options.plot is not None:
        from mtu_cli.reports.figures import figure_bytes

        files[options.plot] = figure_bytes(outcome.figure(), options.plot.suffix)
    if options.report is not None:
        files[options.report] = _report(options, inputs, settings, outcome)
    return files


def _report(options: Options, inputs: Inputs, settings: Settings, outcome: Outcome) -> bytes:
    from mtu_cli.reports.html import Page, report_bytes

    used = settings if outcome.settings is None else outcome.settings
    known: dict[str, Any] = {
        "coverage factor": used.coverage_factor,
        "seed": used.seed,
        "digits": used.digits,
    }
    known |= {"correlation": used.correlation, "trials": used.trials or "adaptive"}
    known |= {f"{name} =": value for name, value in inputs.at.items()}
    page = Page(
        title=f"{options.command.replace('-', ' ').capitalize()}: {inputs.names[0]}",
        subject=inputs.names[1:],
        tables=outcome.tables(),
        figure=_picture(outcome),
        warnings=outcome.warnings,
        inputs=inputs.sources,
        settings=known,
        date=options.date,
    )
    return report_bytes(page, options.report.suffix.lower())


def _picture(outcome: Outcome) -> Figure | None:
    """The picture, where what was asked for can be drawn."""
    try:
        return outcome.figure()
    except InputError:
        return None


def show(tables: Iterable[object]) -> None:
    """Tables on standard output: with colour on a terminal, plain text in a pipe."""
    from mtu_cli.reports.tables import console, plain_text

    if sys.stdout.isatty():
        terminal = console()
        for table in tables:
            terminal.print(table, crop=False)
    else:
        sys.stdout.write(plain_text(tables))


def warning_lines(
    warnings: Iterable[Finding], of: str = "", options: Options | None = None
) -> list[str]:
    """Warnings as lines for standard error, each once, of one code MOST_ALIKE at most; those for
    the report alone left out. Files that the call's `options` name have their whole paths.

    `of` names the file that they are about, unless a warning begins with it itself.
    """
    told = dict.fromkeys((item.code, item.message) for item in warnings if item.severity != "note")
    found = whole_paths(options) if told and options else {}
    count = Counter(code for code, _ in told)
    lines, shown = [], Counter[str]()
    for code, message in told:
        shown[code] += 1
        if shown[code] > MOST_ALIKE:
            continue
        text = _named(placed_text(message, found), of)
        left = count[code] - MOST_ALIKE if shown[code] == MOST_ALIKE else 0
        more = f"; and {left} more such, all in the report (-o)" if left > 0 else ""
        lines.append(f"warning: {text}{more} [{code}]")
    return lines


def _named(message: str, of: str) -> str:
    return message if not of or message.startswith(f"{of}:") else f"{of}: {message}"


def _subject(inputs: Inputs) -> str:
    """What a call names first: study, machine or its one file. What quiet runs, side by side,
    leave in one log is to be told apart; without a name it is what their folder holds.
    """
    from mtu_cli.files.source import given_path

    options = inputs.options
    if options.study is not None and inputs.study is not None:
        return given_path(inputs.study.source.path)
    named = options.machine or options.file
    return "" if named is None else given_path(named)
