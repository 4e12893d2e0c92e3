"""What a command gives, and the Python API returns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mtu_cli.files.source import report_bytes
from mtu_cli.findings import SUSPICIOUS, Finding, InputError, counted, error, listed
from mtu_cli.reports import figures
from mtu_cli.reports.document import Document, document_of, envelope, page_bytes
from mtu_cli.reports.fields import csv_text

if TYPE_CHECKING:
    import pandas as pd

USED = {"k": "coverage_factor", **{x: x for x in ("seed", "digits", "correlation", "trials")}}
"""Settings that a report to hand on states, by the options of the commands that have them."""
Gate = Callable[[float], str | None]


@dataclass(frozen=True)
class Listing:
    """A document of plain lines, with its `results` and the header and rows of its table."""

    lines: Sequence[str] = ()
    results: Mapping[str, Any] = field(default_factory=dict)
    table: tuple[Sequence[str], Sequence[Sequence[object]]] = ((), ())
    title: str = ""
    figure: None = None

    def record(self) -> dict[str, Any]:
        """`results` of the JSON report."""
        return dict(self.results)

    def rows(self) -> tuple[Sequence[str], Sequence[Sequence[object]]]:
        """Header and rows of the CSV."""
        return self.table

    def blocks(self, *, detail: bool) -> Iterable[str]:
        """What is printed."""
        return self.lines


@dataclass(frozen=True)
class Result:
    """What a command gives: its document, warnings beside those of the `inputs` of its call
    (`cli.load`), and by name `gates`: the reason why one is met, of a limit where it has one, or
    None. `files`: what the command writes beside report, table and picture, by path.
    """

    inputs: Any
    document: Document | Listing
    further: Sequence[Finding] = ()
    gates: Mapping[str, Gate] = field(default_factory=dict)
    files: Mapping[Path, bytes] = field(default_factory=dict)

    @classmethod
    def reported(
        cls, inputs: Any, result: Any, warnings: Iterable[Finding] = (), **more: Any
    ) -> Result:
        """An analysis' result as the document of the command, and its warnings after others."""
        document = document_of(inputs.options.command, result, inputs.settings.digits)
        further = [*warnings, *getattr(result, "warnings", ())]
        return cls(inputs, document, further, **more)

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Those of the input, and of the result."""
        return (*self.inputs.suspicions, *self.further)

    def to_dict(self) -> dict[str, Any]:
        """`results` of the JSON report."""
        return self.document.record()

    def to_frame(self) -> pd.DataFrame:
        """The main table, as `--csv` writes it."""
        import pandas as pd

        header, rows = self.document.rows()
        return pd.DataFrame([list(row) for row in rows], columns=list(header))

    def report(self) -> dict[str, Any]:
        """The whole report, as `-o` writes it."""
        return envelope(
            self.inputs.options.command,
            inputs=self.inputs.sources,
            settings=self.inputs.settings,
            results=self.to_dict(),
            warnings=self.warnings,
            at=self.inputs.at,
        )

    def gates_met(self, limits: Mapping[str, float]) -> dict[str, str]:
        """The reasons of the gates that are met, of those with `limits`."""
        codes = [each.code for each in self.warnings if each.kind.suspicious]
        suspicious = f"{counted(len(codes), 'warning')} of the checks ({listed(codes)})"
        gates = {SUSPICIOUS: lambda _: suspicious if codes else None, **self.gates}
        return {name: why for name, limit in limits.items() if (why := gates[name](limit))}

    def outputs(self) -> dict[Path, bytes]:
        """All files of the call, by path."""
        options, document = self.inputs.options, self.document
        files = dict(self.files)
        if options.out is not None:
            files[options.out] = report_bytes(self.report())
        if options.csv is not None:
            files[options.csv] = csv_text(*document.rows()).encode()
        if options.plot is not None:
            if document.figure is None:
                raise error("not-applicable", reason="this result is not drawn", path="--plot")
            files[options.plot] = figures.figure_bytes(document.figure, options.plot.suffix)
        if options.report is not None:
            files[options.report] = self.page(options.report.suffix.lower())
        return files

    def page(self, ending: str) -> bytes:
        """The report to hand on, ``.html`` or ``.pdf``; without a picture where it cannot be
        drawn.
        """
        inputs, options = self.inputs, self.inputs.options
        svg = ""
        if self.document.figure is not None:
            with suppress(InputError):
                svg = figures.figure_bytes(self.document.figure, ".svg").decode()
        # A command that has no such option does not use it.
        used = [name for option, name in USED.items() if option in options.values]
        settings = {name.replace("_", " "): getattr(inputs.settings, name) for name in used}
        settings |= {"trials": "adaptive"} if settings.get("trials", 0) is None else {}
        names = [getattr(vars(inputs)[x], x).name for x in ("machine", "part") if x in vars(inputs)]
        names += [inputs.study.source.shown] if inputs.study else []
        names = names or [source.shown for source in inputs.sources]
        synthetic = ["synthetic data"] if any(each.synthetic for each in inputs.sources) else []
        return page_bytes(
            ending,
            svg,
            self.document.blocks(detail=options.detail),
            self.warnings,
            settings | {f"{name} =": value for name, value in inputs.at.items()},
            title=": ".join([self.document.title, *names[:1]]),
            subject=[*names[1:], *synthetic],
            inputs=inputs.sources,
            date=options.date,
        )
