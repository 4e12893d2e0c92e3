"""The reports that a machine's model is taken from, told apart by their `schema`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from mtu_cli.errors import InputError, Problem
from mtu_cli.files import components_file, thermal_file
from mtu_cli.files.components_file import ComponentsReport, components_from
from mtu_cli.files.json_file import read_json
from mtu_cli.files.report_file import not_a_report, schema_of
from mtu_cli.files.source import Source
from mtu_cli.files.thermal_file import ThermalReport, thermal_from
from mtu_cli.findings import Finding

_EXPECTED = (
    f"{components_file.SCHEMA!r} or {thermal_file.SCHEMA!r}, "
    "as `mtu fit-components -o FILE.json` or `mtu thermal-fit -o FILE.json` writes it"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelReports:
    """At most one report of each kind."""

    components: ComponentsReport | None = None
    thermal: ThermalReport | None = None

    @property
    def sources(self) -> tuple[Source, ...]:
        """The files that were read."""
        return tuple(item.source for item in (self.components, self.thermal) if item is not None)


def read_report(path: Path) -> ComponentsReport | ThermalReport:
    """Reads a fit-components or a thermal-fit report, whichever it is.

    Raises InputError for a file that is neither, or a faulty one.
    """
    source, document = read_json(path, "components")
    kind = schema_of(document)
    if kind == components_file.SCHEMA:
        return components_from(source, document)
    if kind == thermal_file.SCHEMA:
        return thermal_from(replace(source, role="thermal"), document)
    raise not_a_report(source, document, _EXPECTED)


def read_reports(paths: Iterable[Path]) -> ModelReports:
    """Reads all reports of a call.

    Raises InputError with the problems of all files, and for a second report of a kind.
    """
    problems: list[Finding] = []
    found = ModelReports()
    for path in paths:
        try:
            report = read_report(path)
        except InputError as error:
            problems += error.findings
            continue
        if isinstance(report, ComponentsReport):
            problems += _second(found.components, report, "fit-components")
            found = replace(found, components=report)
        else:
            problems += _second(found.thermal, report, "thermal-fit")
            found = replace(found, thermal=report)
    if problems:
        raise InputError(problems)
    return found


def _second(
    earlier: ComponentsReport | ThermalReport | None,
    report: ComponentsReport | ThermalReport,
    kind: str,
) -> list[Finding]:
    if earlier is None:
        return []
    return [
        Problem(
            what=f"a second {kind} report, beside {earlier.source.shown}",
            file=report.source.shown,
            expected="at most one of each kind",
        )
    ]
