"""What a run leaves: tables, files (all or none), warnings, and the exit code of its gates."""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mtu_cli.cli.load import Inputs
from mtu_cli.cli.options import SUSPICIOUS, Options, option_name
from mtu_cli.files.csv_table import number
from mtu_cli.files.source import SYNTHETIC, begins_with, given_path
from mtu_cli.files.write import check_targets, made_ready, overwrites
from mtu_cli.findings import EXIT_GATE, Finding, InputError, counted, finding, listed
from mtu_cli.model.settings import Settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mtu_cli.reports.document import Document

STANDARD_OUTPUT = Path("-")
MOST_ALIKE = 20
"""Warnings of one code that are shown."""
ENDINGS: dict[str, tuple[str, ...]] = {
    "out": (".json",),
    "csv": (".csv",),
    "plot": (".png", ".svg", ".pdf"),
    "report": (".html", ".htm", ".pdf"),
    "to": (".svg", ".png", ".pdf", ".dot", ".mmd", ".pl"),
    "write_machine": (".yaml", ".yml"),
    "write_components": (".json",),
    **dict.fromkeys(("write_lbb", "write_cmm", "write_drift"), (".csv",)),
}
"""What the names of files to write may end in, by the option."""
MADE: dict[tuple[str, str], tuple[str, ...]] = {
    ("simulate", "write_lbb"): ("lbb", "laser"),
    ("simulate", "write_cmm"): ("cmm",),
    ("simulate", "write_drift"): ("drift",),
    ("fit-components", "out"): ("components",),
    ("thermal-fit", "out"): ("components",),
}
"""Roles of a study's files that a command is there to make, anew too, by its option."""
Gate = Callable[[float], str | None]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a command has to say, each part made only when it is asked for.

    `tables` knows whether details are asked for; `rows` are the main table's header and rows.
    `gates` by name: the reason why one is met, of a limit where it has one, or None. `settings`:
    those of the report, where the command had to choose some itself. `files`: what the command
    writes beside report, table and picture, by path.
    """

    results: Callable[[], dict[str, Any]] = dict
    tables: Callable[[bool], Iterable[object]] = lambda detail: ()
    rows: Callable[[], tuple[Sequence[str], Iterable[Sequence[object]]]] = lambda: ((), ())
    figure: Callable[[], Figure] | None = None
    warnings: Sequence[Finding] = ()
    gates: Mapping[str, Gate] = field(default_factory=dict)
    settings: Settings | None = None
    files: Callable[[], Mapping[Path, bytes]] = dict

    @classmethod
    def of(cls, document: Document, **more: Any) -> Outcome:
        """What a document holds; `more` are the other fields of an outcome."""
        return cls(
            results=document.record,
            tables=lambda detail: document.shown(detail=detail),
            rows=document.rows,
            figure=document.figure,
            **more,
        )


def execute(options: Options, analyse: Callable[[Inputs, Settings], Outcome]) -> None:
    """Runs one command and writes what was asked for: all files, or none.

    Tables go to standard output, warnings and progress to standard error; with `-o -` the
    report is alone on standard output. Ends with EXIT_GATE where a gate is met.
    """
    inputs = Inputs(options)
    try:
        asked = asked_gates(options)
        check_outputs(inputs)
        with LateBar(options.command) as progress:
            settings = replace(inputs.settings, progress=progress)
            outcome = analyse(inputs, settings)
            outcome = replace(outcome, warnings=[*inputs.suspicions, *outcome.warnings])
            met = _gates_met(asked, outcome)
            files = _files(inputs, outcome.settings or settings, outcome)
    except InputError as fault:
        raise InputError(inputs.placed(fault.findings), fault.uncounted) from None
    report = files.pop(STANDARD_OUTPUT, None)
    quiet = bool(options.quiet)
    told = [each for each in outcome.warnings if not (quiet and each.severity == "note")]
    lines = warning_lines(inputs.placed(told), inputs.subject if quiet else "")
    lines += [f"mtu: gate {name}: {reason}" for name, reason in met.items()]

    def say() -> None:
        if report is not None:
            sys.stdout.buffer.write(report)
        elif not quiet:
            show(outcome.tables(bool(options.detail)))

    deliver(files, inputs, say, lines)
    if met:
        sys.exit(EXIT_GATE)


def deliver(
    files: Mapping[Path, bytes], inputs: Inputs, say: Callable[[], None], lines: Sequence[str]
) -> None:
    """What a run has made: `say` on standard output and `lines` on standard error, then the
    files. Where any of it fails no file is there; a reader that leaves early is no failure.
    """
    sources = [source.path for source in inputs.sources]
    with made_ready(files, inputs=sources) if files else nullcontext(lambda: None) as put_in_place:
        try:
            say()
            sys.stdout.flush()
        except BrokenPipeError:
            silence(sys.stdout)
        try:
            for line in lines:
                print(line, file=sys.stderr, flush=True)
        except BrokenPipeError:
            silence(sys.stderr)
        put_in_place()


def silence(stream: Any) -> None:
    """Nothing more can be said on a stream, not even when the interpreter flushes it at its end."""
    if stream in (sys.__stdout__, sys.__stderr__):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def show(tables: Iterable[object]) -> None:
    """Tables and lines on standard output: with colour on a terminal, plain text in a pipe."""
    from mtu_cli.reports.tables import console, plain_text

    terminal = console() if sys.stdout.isatty() else None
    for table in tables:
        if isinstance(table, str):
            print(table)
        elif terminal:
            terminal.print(table, crop=False)
        else:
            sys.stdout.write(plain_text([table]))


def warning_lines(warnings: Iterable[Finding], subject: str = "") -> list[str]:
    """Warnings and notes as lines for standard error, each once, of one code MOST_ALIKE at most.
    They begin with the `subject`, where runs side by side leave theirs in one log.
    """
    distinct = dict.fromkeys((each.severity, each.code, each.message) for each in warnings)
    count = Counter(code for _, code, _ in distinct)
    shown: Counter[str] = Counter()
    lines = []
    for severity, code, message in distinct:
        shown[code] += 1
        left = count[code] - MOST_ALIKE if shown[code] == MOST_ALIKE else 0
        more = f"; and {left} more such, all in the report (-o)" if left > 0 else ""
        if shown[code] <= MOST_ALIKE:
            about = f"{subject}: " if subject and not message.startswith(subject) else ""
            lines.append(f"{severity}: {about}{message}{more} [{code}]")
    return lines


def asked_gates(options: Options) -> dict[str, float]:
    """The gates of --fail-if with their limits, 0 of a gate without one.

    Those of the command are as its help has them: ``drift``, ``nonconforming=0.01``.
    Raises InputError with every gate that is unknown, stands twice, or lacks its limit.
    """
    known = (SUSPICIOUS, *options.gates)
    limited = {name.partition("=")[0]: "=" in name for name in known}
    found: dict[str, float] = {}
    problems = []
    for text in (part.strip() for item in options.fail_if or () for part in item.split(",")):
        name, equals, limit = text.partition("=")
        share = number(limit) if equals else 0.0
        place = {"path": f"--fail-if {name}", "value": text}
        if limited.get(name) != bool(equals):
            expected = " or ".join(known)
            problems.append(finding("unknown-name", what="gate", value=text, expected=expected))
        elif share is None or not 0 <= share < 1:
            expected = "a probability from 0 to below 1, such as 0.01 for 1 %"
            problems.append(finding("out-of-range", **place, expected=expected))
        elif equals and name in found:
            problems.append(finding("appears-twice", what=place["path"], value=text))
        found[name] = share or 0.0
    if problems:
        raise InputError(problems)
    return found


def _gates_met(asked: Mapping[str, float], outcome: Outcome) -> dict[str, str]:
    """Why the gates that were asked for are met, of those that are."""
    codes = [each.code for each in outcome.warnings if each.kind.suspicious]
    suspicious = f"{counted(len(codes), 'warning')} of the checks ({listed(codes)})"
    known = {SUSPICIOUS: lambda _: suspicious if codes else None, **outcome.gates}
    reasons = {name: known[name](limit) for name, limit in asked.items()}
    return {name: reason for name, reason in reasons.items() if reason is not None}


def _files(inputs: Inputs, settings: Settings, outcome: Outcome) -> dict[Path, bytes]:
    """All files of a run, by path."""
    options = inputs.options
    files = dict(outcome.files())
    if options.out is not None:
        from mtu_cli.files.write import report_bytes
        from mtu_cli.reports.document import envelope

        document = envelope(
            options.command,
            inputs=inputs.sources,
            settings=settings,
            results=outcome.results(),
            warnings=outcome.warnings,
            at=inputs.at,
        )
        files[options.out] = report_bytes(document)
    if options.csv is not None:
        from mtu_cli.reports.fields import csv_text

        files[options.csv] = csv_text(*outcome.rows()).encode()
    if options.plot is not None and outcome.figure is not None:
        from mtu_cli.reports.figures import figure_bytes

        files[options.plot] = figure_bytes(outcome.figure(), options.plot.suffix)
    if options.report is not None:
        files[options.report] = _page(inputs, settings, outcome)
    return files


def _page(inputs: Inputs, settings: Settings, outcome: Outcome) -> bytes:
    """The report to hand on; without a picture where what was asked for cannot be drawn."""
    from mtu_cli.reports.html import Page, report_bytes

    options = inputs.options
    figure = None
    with suppress(InputError):
        figure = outcome.figure and outcome.figure()
    known: dict[str, tuple[str, object]] = {
        "k": ("coverage factor", settings.coverage_factor),
        "seed": ("seed", settings.seed),
        "digits": ("digits", settings.digits),
        "correlation": ("correlation", settings.correlation),
        "trials": ("trials", settings.trials or "adaptive"),
    }
    made = ["synthetic data"] if any(each.synthetic for each in inputs.sources) else []
    # A command that has no such option does not use it.
    used = dict(own for option, own in known.items() if option in options.values)
    used |= {f"{name} =": value for name, value in inputs.at.items()}
    page = Page(
        title=f"{options.command.replace('-', ' ').capitalize()}: {inputs.names[0]}",
        subject=[*inputs.names[1:], *made],
        tables=outcome.tables(bool(options.detail)),
        figure=figure,
        warnings=outcome.warnings,
        inputs=inputs.sources,
        settings=used,
        date=options.date,
    )
    return report_bytes(page, options.report.suffix.lower())


def written_files(options: Options) -> dict[str, Path]:
    """The files that a call writes: path by name of the option."""
    values = {name: options.values.get(name) for name in ENDINGS}
    return {name: path for name, path in values.items() if isinstance(path, Path)}


def check_outputs(inputs: Inputs) -> None:
    """Refuses files that cannot be made or would overwrite an input, all at once, before
    anything is calculated.
    """
    written = written_files(inputs.options)
    files = {name: path for name, path in written.items() if path != STANDARD_OUTPUT}
    problems = [*_overwritten(inputs, files)]
    try:
        check_targets(list(files.values()))
    except InputError as fault:
        problems += fault.findings
    problems += _wrong_forms(written)
    first = {each.file or each.message: each for each in reversed(problems)}
    if problems:
        raise InputError(reversed(first.values()))


def _wrong_forms(written: Mapping[str, Path]) -> Iterator[Finding]:
    """The report or the table alone may go to standard output; a file that other programs would
    take for what it is not is refused.
    """
    for name, path in written.items():
        option, ending = "-o" if name == "out" else option_name(name), path.suffix.lower()
        if path == STANDARD_OUTPUT:
            if name != "out" and (name != "csv" or written.get("out") == path):
                reason = f"{option} cannot go to standard output"
                yield finding("output-form", reason=reason, expected="a file")
        elif ending not in ENDINGS[name] and (path.is_file() or not os.path.exists(path)):
            reason = f"{option} does not write {ending or 'a file without an ending'}"
            expected = f"a name that ends in {' or '.join(ENDINGS[name])}"
            yield finding("output-form", reason=reason, file=given_path(path), expected=expected)


def _overwritten(inputs: Inputs, files: Mapping[str, Path]) -> Iterator[Finding]:
    """Outputs over a file that the call, its study or the study of this folder names, whether the
    command reads it or not; but for what it is there to make. Measured data is no synthetic data.
    """
    options = inputs.options
    called = {role for role, value in options.values.items() if value}
    for name, target in files.items():
        made = set(MADE.get((options.command, name), ())) - called
        reason = None
        if any(role not in made and overwrites(target, path) for role, path in inputs.named()):
            reason = "it is an input"
        elif options.command == "simulate" and not begins_with(target, SYNTHETIC):
            reason = f"it does not begin with '{SYNTHETIC}'"
        if reason and os.path.exists(target):
            place = {"file": given_path(target), "expected": "another name"}
            yield finding("not-overwritten", reason=reason, **place)


class LateBar:
    """What share of a calculation is done, on a terminal's standard error, of what takes more than
    a second. It writes when it is called and has no thread of its own.
    """

    delay_s = 1.0
    every_s = 0.1

    def __init__(self, text: str) -> None:
        self.text = text
        self.next = time.monotonic() + self.delay_s
        self.drawn = False

    def __call__(self, done: int, total: int | None) -> None:
        now = time.monotonic()
        if now >= self.next and sys.stderr.isatty():
            share = f"{done / total:.0%}" if total else f"{done}"
            print(f"\r{self.text}: {share} ", end="", file=sys.stderr, flush=True)
            self.next, self.drawn = now + self.every_s, True

    def __enter__(self) -> LateBar:
        return self

    def __exit__(self, *failed: object) -> None:
        if self.drawn:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
