"""The report of fit-components, read back by every command that predicts."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from mtu_cli.errors import InputError
from mtu_cli.files.components_checks import component_problems, effect_problems, group_problems
from mtu_cli.files.components_contract import ReportedComponent, ReportedEffects, ReportedGroup
from mtu_cli.files.json_file import read_json
from mtu_cli.files.report_file import not_a_report, read_from, schema_of, validated
from mtu_cli.files.source import Source

SCHEMA = "mtu/fit-components/1"


class _Results(BaseModel):
    model_config = ConfigDict(extra="ignore")
    components: dict[str, ReportedComponent]
    joint_pass_covariance: list[ReportedGroup] = []
    effects: ReportedEffects | None = None


class _Report(BaseModel):
    model_config = ConfigDict(extra="ignore")
    results: _Results


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentsReport:
    """A checked fit-components report; `document` is the whole of it as it was read, `readings`
    the hashes of the files that it was fitted to.
    """

    source: Source
    components: dict[str, ReportedComponent]
    joint: tuple[ReportedGroup, ...]
    effects: ReportedEffects | None = None
    document: dict[str, Any] = field(default_factory=dict)
    readings: frozenset[str] = frozenset()


def read_components(path: Path) -> ComponentsReport:
    """Reads a fit-components report.

    Raises InputError for a file that is not one, with the path inside the document.
    """
    return components_from(*read_json(path, "components"))


def components_from(source: Source, document: Any) -> ComponentsReport:
    """Checks a fit-components report that was read, or made, already.

    Raises InputError with every fault of the document.
    """
    if schema_of(document) != SCHEMA:
        expected = f"{SCHEMA!r}, as `mtu fit-components -o FILE.json` writes it"
        raise not_a_report(source, document, expected)
    report = validated(source, document, _Report, "fit-components")
    problems = [
        problem
        for name, item in report.results.components.items()
        for problem in component_problems(source, name, item)
    ]
    problems += [
        problem
        for i, group in enumerate(report.results.joint_pass_covariance)
        for problem in group_problems(source, i, group, report.results.components)
    ]
    if report.results.effects is not None:
        problems += effect_problems(source, report.results.effects)
    if problems:
        raise InputError(problems)
    return ComponentsReport(
        source=source,
        components=report.results.components,
        joint=tuple(report.results.joint_pass_covariance),
        effects=report.results.effects,
        document=document,
        readings=read_from(document, ("lbb", "laser")),
    )
