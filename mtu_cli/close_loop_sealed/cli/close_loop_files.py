"""The extended machine and its components report, written beside the report of close-loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from mtu_cli import __version__
from mtu_cli.cli.emit import written_files
from mtu_cli.cli.load import Inputs
from mtu_cli.close_loop_sealed.bridge import as_listed, loop_warning
from mtu_cli.close_loop_sealed.files.extend_machine import (
    ExtendedMachine,
    WrittenEffect,
    extended_machine,
)
from mtu_cli.findings import Finding
from mtu_cli.language import to_text
from mtu_cli.language.tree import Number
from mtu_cli.model.effect_parameters import all_together
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.fit import MachineFit, estimates_from_fit, fit_machine
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS

READINGS = ("lbb", "laser")
MACHINE_FILES = ("write_machine", "write_components")
"""Options that name what is written of the extended machine."""


class Found(Protocol):
    """An effect as close-loop finds it; internal units (mm, rad, degC, min).

    `parameters` are (name, unit, value, u), `covariance` (k, k) is over them; `searched` by
    name: (value, low, high), `alike` are other values of it that fit as well. `component`:
    whose readings it was found in, None for points.
    """

    @property
    def component(self) -> str | None: ...

    @property
    def name(self) -> str: ...
    @property
    def family(self) -> str: ...
    @property
    def axis(self) -> str | None: ...
    @property
    def covariate(self) -> str | None: ...
    @property
    def says(self) -> str: ...
    @property
    def equations(self) -> Mapping[str, str]: ...
    @property
    def parameters(self) -> Sequence[tuple[str, str, float, float]]: ...
    @property
    def covariance(self) -> FloatArray: ...
    @property
    def searched(self) -> Mapping[str, tuple[float, float, float]]: ...
    @property
    def alike(self) -> Sequence[float]: ...
    @property
    def p_familywise(self) -> float: ...
    @property
    def class_names(self) -> Sequence[str]: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """What the components were known from: `fit` where readings were fitted, else None."""

    estimates: Estimates
    fit: MachineFit | None


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundOn:
    """Lowest and highest value of the columns of an effect's equations, and of others."""

    seen: Mapping[str, Sequence[float]] = field(default_factory=dict)
    within: Mapping[str, Sequence[float]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """What is to be written, by path, and what to warn of."""

    files: dict[Path, bytes]
    warnings: tuple[Finding, ...]


def written(
    inputs: Inputs,
    known: Known,
    settings: Settings,
    effects: Sequence[Found],
    covariance: FloatArray | None,
    held_out: Sequence[Mapping[str, Any]] | None,
    found_on: Sequence[FoundOn] | None = None,
) -> Written:
    """The files of --write-machine and --write-components, none where neither is asked for.

    `covariance` (K, K) is over the parameters of all `effects` in their order, in internal
    units; None leaves them uncorrelated between effects. `held_out` tells what each effect is
    worth, in plain data, for the machine's `found`; `found_on` the ranges that each was found on.

    Raises InputError for effects that no machine file can hold.
    """
    asked = written_files(inputs.options)
    targets = {name: path for name, path in asked.items() if name in MACHINE_FILES}
    if not targets:
        return Written(files={}, warnings=())
    stated = [_equations(inputs, effect) for effect in effects]
    kept = [i for i, equations in enumerate(stated) if equations]
    warnings = _left_out([effect for effect, own in zip(effects, stated, strict=True) if not own])
    worth = [held_out[i] if held_out is not None else None for i in range(len(effects))]
    on = found_on or [FoundOn()] * len(effects)
    entries = [_entry(inputs, effects[i], stated[i], worth[i], on[i]) for i in kept]
    extended = extended_machine(inputs.machine, entries)
    warnings += extended.warnings
    if not kept:
        message = "no effect is added: what is written is the machine as it was"
        warnings.append(loop_warning(code="nothing-added", message=message))
    files = {}
    for name, path in targets.items():
        if name == "write_machine":
            files[path] = extended.content
        elif name == "write_components":
            joint = _joint(effects, kept, covariance)
            files[path] = _components(inputs, known, settings, extended, joint)
    return Written(files=files, warnings=tuple(warnings))


def _left_out(effects: Sequence[Found]) -> list[Finding]:
    if not effects:
        return []
    names = ", ".join(effect.name for effect in effects)
    message = f"no equation of the machine can describe {names}: not added to it"
    return [loop_warning(code="effect-not-written", message=message)]


def _entry(
    inputs: Inputs,
    effect: Found,
    equations: Mapping[str, str],
    held_out: Mapping[str, Any] | None,
    on: FoundOn,
) -> WrittenEffect:
    factors = np.array([PARAMETER_UNITS[unit].to_internal for _, unit, _, _ in effect.parameters])
    C = np.asarray(effect.covariance, float) / np.outer(factors, factors)
    return WrittenEffect(
        name=effect.name,
        family=effect.family,
        axis=effect.axis,
        covariate=effect.covariate,
        says=effect.says,
        parameters={
            name: (float(value / f), float(u / f), unit)
            for (name, unit, value, u), f in zip(effect.parameters, factors, strict=True)
        },
        covariance=((C + C.T) / 2).tolist(),
        equations=equations,
        alike={name: list(effect.alike) for name in effect.searched if effect.alike},
        seen=on.seen,
        within=on.within,
        found=_where(inputs, effect, held_out),
    )


def _equations(inputs: Inputs, effect: Found) -> dict[str, str]:
    """The effect in the machine's equations: one of a component's readings by its lever arms.

    With E the equation and c the component, c + f adds (dE/dc) f.
    """
    if effect.component is None or not effect.equations:
        return dict(effect.equations)
    (own,) = effect.equations.values()
    levers = {
        name: form.coefficients[effect.component]
        for name, form in inputs.machine.forms.items()
        if effect.component in form.coefficients
    }
    return {
        name: own
        if isinstance(lever, Number) and lever.value == 1
        else f"({to_text(lever)})*({own})"
        for name, lever in levers.items()
    }


def _where(inputs: Inputs, effect: Found, held_out: Mapping[str, Any] | None) -> dict[str, Any]:
    """`found` of the machine file: by what, in which files, how surely."""
    # Beside points, readings are only what the components were fitted to.
    judged = ("cmm",) if inputs.files("cmm") else READINGS
    sources = [source for source in inputs.sources if source.role in judged]
    found: dict[str, Any] = {
        "by": f"mtu close-loop {__version__}",
        "files": [{"path": source.shown, "sha256": source.sha256} for source in sources],
    }
    if inputs.files("cmm"):
        found["parts"] = len(inputs.points.parts)
    if effect.component is not None:
        found["component"] = effect.component
    found["p_familywise"] = effect.p_familywise
    if len(effect.class_names) > 1:
        found["class"] = list(effect.class_names)
    if effect.searched:
        found["searched"] = {
            name: {"value": value, "interval95": [low, high]}
            for name, (value, low, high) in effect.searched.items()
        }
    if held_out is not None:
        found["held_out"] = dict(held_out)
    return found


def _joint(
    effects: Sequence[Found], kept: Sequence[int], covariance: FloatArray | None
) -> FloatArray:
    """The covariance over the parameters of the kept effects, in internal units."""
    widths = [len(effect.parameters) for effect in effects]
    ends = np.cumsum(widths)
    rows = [row for i in kept for row in range(ends[i] - widths[i], ends[i])]
    if covariance is not None:
        whole = np.asarray(covariance, float)
        if whole.shape != (sum(widths), sum(widths)):
            raise ValueError(f"{whole.shape} is not the size of {sum(widths)} parameters")
    else:
        whole = np.zeros((sum(widths), sum(widths)))
        for effect, end, width in zip(effects, ends, widths, strict=True):
            whole[end - width : end, end - width : end] = effect.covariance
    return np.asarray((whole + whole.T)[np.ix_(rows, rows)] / 2)


def _components(
    inputs: Inputs,
    known: Known,
    settings: Settings,
    extended: ExtendedMachine,
    joint: FloatArray,
) -> bytes:
    """The fit-components report of the call's components, with the effects of the machine."""
    from mtu_cli.files.write import report_bytes
    from mtu_cli.reports.document import envelope
    from mtu_cli.reports.fields import plain

    earlier = known.estimates.effects
    known = _less_effects(inputs, known, extended)
    effects = all_together(extended.machine, earlier, extended.parameters, joint)
    results, warnings = _results(inputs, known)
    if effects is not None:
        f = np.array([unit.to_internal for unit in effects.units])
        results["effects"] = {
            "parameters": list(effects.names),
            "units": [unit.name for unit in effects.units],
            "values": plain(effects.values / f),
            "covariance": plain(effects.covariance / np.outer(f, f)),
        }
    return report_bytes(
        envelope(
            "fit-components",
            inputs=inputs.sources,
            settings=settings,
            results=results,
            warnings=warnings,
        )
    )


def _less_effects(inputs: Inputs, known: Known, extended: ExtendedMachine) -> Known:
    """What was fitted to readings, fitted to what the effects that were found leave of them."""
    readings = inputs.readings
    if known.fit is None or readings is None:
        return known
    fit = fit_machine(extended.machine, readings)
    return Known(estimates=estimates_from_fit(inputs.machine, fit), fit=fit)


def _results(inputs: Inputs, known: Known) -> tuple[dict[str, Any], list[Finding]]:
    """`results` and warnings as fit-components has them, or as the report of -c had them."""
    from mtu_cli.analyses.fit_components import fit_result
    from mtu_cli.reports.fit_components import document

    machine = inputs.machine
    if inputs.reports.components is not None:
        given = inputs.reports.components.document
        earlier = [as_listed(item) for item in given.get("warnings", ()) if isinstance(item, dict)]
        rest = {key: value for key, value in given["results"].items() if key != "effects"}
        return rest, earlier
    fit = known.fit or MachineFit(components={}, joint=())
    estimates = estimates_from_fit(machine, fit)
    says = {name: item.says for name, item in machine.machine.components.items() if item.says}
    result = fit_result(machine.machine.name, fit, estimates, says=says)
    return document(result).record(), list(result.warnings)
