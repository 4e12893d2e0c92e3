"""From a call's files to a machine with all components known."""

from __future__ import annotations

import fnmatch
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mtu_cli.cli.inputs import Inputs, unlike_cells
from mtu_cli.files.covariates import closest_covariate
from mtu_cli.files.source import hash_of, shown_path
from mtu_cli.files.study import find_study
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.model.effect_parameters import effect_warnings, not_told_warnings
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.fit import (
    MachineFit,
    beaten_warnings,
    estimates_from_fit,
    estimates_from_report,
    fit_machine,
    machine_warnings,
)
from mtu_cli.model.fit_warnings import (
    DISAGREE,
    LIMITS,
    limit_warnings,
    limits_of,
    scatter_warnings,
)
from mtu_cli.model.machine_model import AXES, MachineModel, build_model

if TYPE_CHECKING:
    from mtu_cli.analyses.thermal_fit import Check
    from mtu_cli.files.machine import LoadedMachine
    from mtu_cli.model.thermal import ThermalEstimate

COLUMNS_FIRST = ("correct", "compare", "close-loop")
"""Commands in which a column of the points comes before --at."""
MOST_LACKING = 6
"""Components without readings that are reported one by one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Modelled:
    """The model of a call, what it was made of, and what to warn of."""

    model: MachineModel
    estimates: Estimates
    fit: MachineFit | None
    warnings: tuple[Finding, ...]


def modelled(inputs: Inputs, check: Check | None = None) -> Modelled:
    """A components report wins over readings, readings over the machine file. `check` hears of
    the sensors of a drift that is fitted, as soon as they are chosen.
    """
    machine = inputs.machine
    estimates, fit, doubts = _components(inputs)
    warnings = [*machine_warnings(machine, estimates), *not_told_warnings(machine), *doubts]
    thermal, more = drift_estimates(inputs, check)
    warnings += more
    try:
        model = build_model(machine, replace(estimates, thermal=thermal))
    except InputError as error:
        raise InputError(_shortened(error.findings, inputs)) from None
    warnings += _limits(inputs, fit, model)
    # Of a column that no equation has a declared effect may tell where it holds.
    used = (*model.covariates(), *(name for effect in model.effects for name in effect.within))
    _expand(inputs.at, dict.fromkeys(used))
    unused = [name for name in inputs.at if name not in used]
    warnings += [_not_needed(name, inputs, model) for name in unused]
    return Modelled(model=model, estimates=estimates, fit=fit, warnings=tuple(warnings))


def _components(inputs: Inputs) -> tuple[Estimates, MachineFit | None, list[Finding]]:
    """The components, the fit that they are of, and what to warn of where they are from."""
    machine = inputs.machine
    report = inputs.components
    if report is not None:
        estimates = estimates_from_report(machine, report)
        doubts = effect_warnings(machine, estimates.effects, report.source.shown)
        doubts += _not_read(inputs, ("lbb", "laser"), report.readings, report.source.shown)
        return estimates, None, doubts
    readings = inputs.readings
    if readings is None:
        return estimates_from_fit(machine, None), None, []
    fit = fit_machine(machine, readings)
    estimates = _as_reported(machine, fit, estimates_from_fit(machine, fit))
    doubts = [*readings.notes, *fit.warnings, *scatter_warnings(fit)]
    return estimates, fit, doubts


def _limits(inputs: Inputs, fit: MachineFit | None, model: MachineModel) -> list[Finding]:
    """What u of a part does not contain (LIMITS), from the fit or from the report of it."""
    used = {term.estimate.name for term in model.terms}
    report = inputs.components
    if report is None:
        return [] if fit is None else limits_of(limit_warnings(fit), used)
    entries = report.document.get("warnings")
    limits = [
        finding(
            "reported", file=report.source.shown, of=item["code"], message=str(item.get("message"))
        )
        for item in (entries if isinstance(entries, list) else ())
        if isinstance(item, dict) and item.get("code") in LIMITS and _component_of(item) in used
    ]
    return list(dict.fromkeys(limits))


def _component_of(entry: Mapping[str, Any]) -> str:
    """The component of a reported warning: a fact, or what its message begins with."""
    facts = entry.get("facts")
    if isinstance(facts, dict) and isinstance(facts.get("component"), str):
        return str(facts["component"])
    return str(entry.get("message")).removeprefix(DISAGREE).partition(" ")[0]


def _not_needed(name: str, inputs: Inputs, model: MachineModel) -> Finding:
    """The warning, with the nearest of those names alone that the call would take."""
    taken = {*inputs.at, *(_columns(inputs) if inputs.options.command in COLUMNS_FIRST else ())}
    near = closest_covariate(name, [n for n in model.covariates() if n not in taken])
    expected = f"a covariate: {name} is the position of a feature" if name in AXES else None
    meant = () if near is None or name in AXES else (near,)
    return finding("covariate-not-needed", name=name, meant=meant, expected=expected)


def _columns(inputs: Inputs) -> Collection[str]:
    from mtu_cli.model.residual_covariates import point_columns

    return point_columns(inputs.points)


def _not_read(
    inputs: Inputs, roles: Sequence[str], fitted: frozenset[str], report: str
) -> list[Finding]:
    """That readings are not read beside the `report` of their fit: a warning only where they are
    not, to the byte, those that it was fitted to.

    Raises InputError for a file that cannot be read.
    """
    found = {path: hash_of(path, role) for role in roles for path in inputs.files(role)}
    if not found:
        return []
    what = "drifts" if roles == ("drift",) else "components"
    if set(found.values()) == fitted:
        return [finding("readings-of-report", report=report, what=what)]
    other = [shown_path(path) for path, own in found.items() if own not in fitted]
    files = other or [shown_path(path) for path in found]
    return [finding("readings-not-used", report=report, what=what, files=files)]


def _shortened(problems: Sequence[Finding], inputs: Inputs) -> list[Finding]:
    """What a model lacks; where -m alone leaves the study of this folder, and so its readings,
    unread, the only report is thermal, or no component of many has readings, that is one cause and
    one problem.
    """
    lacking = [item for item in problems if item.code == "no-estimate"]
    near = find_study(Path()) if inputs.study is None else None
    half = _thermal_alone(inputs)
    if not lacking or (near is None and not half and len(lacking) <= MOST_LACKING):
        return list(problems)
    names = [name for item in lacking for name in item.facts["names"]]
    expected = lacking[0].expected
    if half:
        expected = "a fit-components report too (-c), readings (--lbb, --laser), or "
        expected += "coefficients in the machine file" if near is None else "the study's folder"
        expected += f" ({half})"
    elif near is not None:
        expected = (
            "the study's folder as an argument too, and -m in place of its machine "
            f"({near.name} is not read where -m is given without a study)"
        )
    one = replace(lacking[0], path="components", facts={"names": names}, expected=expected)
    return [one, *(item for item in problems if item not in lacking)]


def _thermal_alone(inputs: Inputs) -> str:
    """That the only report of the call, and all that is read, is of drifts."""
    thermal = inputs.thermal
    if thermal is None or inputs.components is not None or inputs.readings is not None:
        return ""
    return f"{thermal.source.shown} holds the thermal part only"


def one_direction(inputs: Inputs, model: MachineModel) -> list[Finding]:
    """The warning of one approach direction for all features: between them a reversal cancels."""
    names = [name for name in inputs.at if name.startswith("dir_") and name in model.covariates()]
    if not names:
        return []
    return [finding("one-direction", names=names)]


def _expand(at: dict[str, float], needed: Iterable[str]) -> None:
    """Names with * and ? stand for all covariates they match that are not given by themselves."""
    for pattern in [name for name in at if "*" in name or "?" in name]:
        matched = fnmatch.filter(needed, pattern)
        if matched:
            value = at.pop(pattern)
            at |= {name: value for name in matched if name not in at}
    problems = [problem for name in at for problem in unlike_cells(name, at[name])]
    if problems:
        raise InputError(problems)


def drift_estimates(
    inputs: Inputs, check: Check | None = None
) -> tuple[dict[str, ThermalEstimate], list[Finding]]:
    """A thermal-fit report wins over drift readings, those over the machine file."""
    from mtu_cli.model.thermal_estimates import thermal_from_machine_file, thermal_from_report

    machine = inputs.machine
    stated = thermal_from_machine_file(machine)
    if inputs.thermal is not None:
        found = stated | thermal_from_report(machine, inputs.thermal)
        report = inputs.thermal.source.shown
        doubts = [*inputs.thermal.doubts]
        doubts += _beaten(machine, stated, inputs.thermal.components)
        if not inputs.files("drift"):
            return found, doubts
        return found, [*doubts, *_not_read(inputs, ("drift",), inputs.thermal.readings, report)]
    if not inputs.files("drift"):
        return stated, []
    from mtu_cli.cli.thermal_fit import fitted

    fit = fitted(inputs, "auto", check)
    found = stated | {name: item.estimate for name, item in fit.components.items()}
    return found, [*fit.warnings, *_beaten(machine, stated, fit.components)]


def _beaten(
    machine: LoadedMachine, stated: Collection[str], winners: Collection[str]
) -> list[Finding]:
    return beaten_warnings(machine, [name for name in stated if name in winners], "thermal")


def _as_reported(machine: LoadedMachine, fit: MachineFit, estimates: Estimates) -> Estimates:
    """The estimates as a fit-components report holds them.

    Reports are in the components' own units. Going through them makes readings and their
    report give the same bits, which the Monte Carlo would tell apart in the seventh digit.
    """
    from mtu_cli.files.json_file import report_bytes
    from mtu_cli.files.reports_read import COMPONENTS, components_from
    from mtu_cli.reports.fit_components import document

    results = document(machine.machine.name, fit, estimates)
    written = report_bytes({"schema": COMPONENTS, "results": results})
    return estimates_from_report(machine, components_from(machine.source, json.loads(written)))
