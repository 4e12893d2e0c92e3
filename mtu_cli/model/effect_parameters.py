"""Declared effects: their parameters as components that a machine file states, and where they were
found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.files.covariates import POSITIONS
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.machine_contract import Effect
from mtu_cli.findings import Finding, finding
from mtu_cli.model.estimates import (
    ComponentEstimate,
    EffectEstimates,
    JointPasses,
    known_component,
)
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS

EFFECT_MARK = "."
"""Stands between an effect and its parameter; no component's name holds it."""
SAME = 1e-9
"""Relative; less is the rounding of a value that went through a file's unit."""
SLACK = 0.1
"""Share of the range seen that may be exceeded without a warning."""
ELSEWHERE = "elsewhere each predicts other errors, and u is that of this one"


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectParameters:
    """The parameters of all effects of a machine, as known components; `tables` are the components
    within effects, as the file states them.

    `renames` by effect: the names in its equations -> ``effect.parameter``.
    """

    components: dict[str, ComponentEstimate]
    tables: dict[str, ComponentEstimate]
    joint: tuple[JointPasses, ...]
    renames: tuple[dict[str, str], ...]


def effects_of(machine: LoadedMachine, reported: EffectEstimates | None) -> EffectParameters:
    """The parameters of a machine's effects: as the file states them, each effect by itself,
    or, of effects all of whose parameters are `reported`, with the report's joint covariance.
    """
    components: dict[str, ComponentEstimate] = {}
    tables: dict[str, ComponentEstimate] = {}
    joint, renames, matches = [], [], list[str]()
    recorded = () if reported is None else reported.names
    for effect in machine.machine.effects:
        names = (*effect.parameters, *effect.components)
        rename = {name: f"{effect.name}{EFFECT_MARK}{name}" for name in names}
        renames.append(rename)
        stated, covariance = _stated(effect, rename)
        components |= stated
        for name, entry in effect.components.items():
            tables[rename[name]] = known_component(rename[name], entry)
        if stated.keys() <= {*recorded}:
            matches += stated
        elif effect.covariance is not None:
            joint.append(_joint_parameters(tuple(stated), covariance))
    if reported is not None and matches:
        rows = [recorded.index(name) for name in matches]
        C = reported.covariance[np.ix_(rows, rows)]
        for i, (name, row) in enumerate(zip(matches, rows, strict=True)):
            value, variance = reported.values[row : row + 1], C[i : i + 1, i : i + 1]
            components[name] = replace(components[name], coefficients=value, covariance=variance)
        joint.append(_joint_parameters(tuple(matches), C))
    return EffectParameters(
        components=components, tables=tables, joint=tuple(joint), renames=tuple(renames)
    )


def _stated(
    effect: Effect, rename: Mapping[str, str]
) -> tuple[dict[str, ComponentEstimate], FloatArray]:
    """The parameters of an effect as components without an axis, known to their u, and their
    covariance: where the file states one, it replaces the parameters' u.
    """
    units = {name: PARAMETER_UNITS[p.unit] for name, p in effect.parameters.items()}
    f = np.array([unit.to_internal for unit in units.values()])
    C = np.diag([p.u**2 for p in effect.parameters.values()])
    if effect.covariance is not None:
        C = np.asarray(effect.covariance, float)
    C = C * np.outer(f, f)
    estimates = {
        rename[name]: ComponentEstimate(
            name=rename[name],
            of=None,
            unit=units[name],
            coefficients=np.array([parameter.value * f[i]]),
            covariance=C[i : i + 1, i : i + 1],
            pass_covariance=np.zeros((1, 1)),
            s_repeat=0.0,
            pass_dof=0.0,
            repeat_dof=np.inf,
        )
        for i, (name, parameter) in enumerate(effect.parameters.items())
    }
    return estimates, C


def _joint_parameters(names: tuple[str, ...], C: FloatArray) -> JointPasses:
    return JointPasses(
        components=names,
        widths=(1,) * len(names),
        covariance=C,
        pass_covariance=np.zeros_like(C),
        pass_dof=np.inf,
        n_passes=None,
    )


def joint_effects(
    machine: LoadedMachine,
    reported: EffectEstimates | None,
    names: tuple[str, ...],
    covariance: FloatArray,
) -> EffectEstimates | None:
    """All parameters of a machine's effects with one covariance, None where it has no effect.

    That of effects estimated separately is zero between them; `covariance` (k, k), in internal
    units, is over the parameters `names`, estimated jointly now.
    """
    effects = effects_of(machine, reported)
    order, items = list(effects.components), list(effects.components.values())
    if not order:
        return None
    C = np.diag([item.covariance[0, 0] for item in items])
    for group in effects.joint:
        rows = [order.index(name) for name in group.components]
        C[np.ix_(rows, rows)] = group.covariance
    rows = [order.index(name) for name in names]
    C[rows] = C[:, rows] = 0.0
    C[np.ix_(rows, rows)] = covariance
    return EffectEstimates(
        names=tuple(order),
        units=tuple(item.unit for item in items),
        values=np.array([item.coefficients[0] for item in items]),
        covariance=C,
    )


def effect_warnings(
    machine: LoadedMachine, reported: EffectEstimates | None, report: str
) -> list[Finding]:
    """Where the file `report` and the machine file differ in their effects."""
    if reported is None:
        return []
    stated, estimates = (effects_of(machine, x).components for x in (None, reported))
    file = machine.source.shown
    unknown = [name for name in reported.names if name not in stated]
    changed = [
        name for name, item in estimates.items()
        if not np.allclose(item.coefficients, stated[name].coefficients, SAME, 0.0)
    ]  # fmt: skip
    differing = (
        (unknown, f"effects of {report}", f"{file} has no such effects"),
        (changed, f"values of {file}", f"those of {report} replace them"),
    )
    return [
        finding("not-used", names=names, what=what, reason=reason)
        for names, what, reason in differing
        if names
    ]


def searched_warnings(machine: LoadedMachine) -> list[Finding]:
    """Of effects whose name is one of several that fit what they were found on."""
    warnings = []
    for i, effect in enumerate(machine.machine.effects):
        names = effect.found.get("class")
        rivals = [str(x) for x in names if x != effect.name] if isinstance(names, list) else []
        if rivals:
            facts = {"file": machine.source.shown, "line": machine.line_of("effects", i)}
            what, more = f"the effect {effect.name}", {"others": rivals, "consequence": ELSEWHERE}
            warnings.append(finding("not-separable", what=what, **facts, **more))
    return warnings


def range_warnings(
    effects: Sequence[Effect], values: Mapping[str, FloatArray | float], file: str | None
) -> list[Finding]:
    """Of effects of a machine `file` that are used, at `values` by name of column or position, more
    than a tenth of the range away from what they were found on.
    """
    warnings = []
    for effect in effects:
        for column, (low, high) in effect.seen.items():
            x = np.atleast_1d(np.asarray(values.get(column, np.nan), float))
            x = x[np.isfinite(x)]
            excess = np.maximum(low - x, x - high)
            slack = max(SLACK * (high - low), SAME * max(abs(low), abs(high)))
            if len(x) and excess.max() > slack:
                unit = " mm" if column in POSITIONS else ""
                span = f"from {low:.8g} to {high:.8g}" if low < high else f"at {low:.8g}"
                far = f"extrapolated to {x[int(np.argmax(excess))]:.8g}{unit}"
                facts = {"effects": effect.name, "covariate": column, "range": span + unit}
                code = "outside-effect-range"
                warnings.append(finding(code, **facts, consequence=far, file=file))
    return warnings
