"""The parameters of declared effects, as components that a machine file states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

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
SAME_VALUE = 1e-9
"""Relative; less is the rounding of a value that went through a report's unit."""
ELSEWHERE = "elsewhere each predicts other errors, and u is that of this one"


@dataclass(frozen=True, slots=True, kw_only=True)
class DeclaredEffect:
    """An effect of a machine file: its place among the effects of `file`, and by column the lowest
    and highest value that it was found on.
    """

    name: str
    file: str
    index: int
    seen: Mapping[str, Sequence[float]]


def declared_effects(machine: LoadedMachine) -> tuple[DeclaredEffect, ...]:
    """The effects of a machine in the file's order."""
    return tuple(
        DeclaredEffect(
            name=effect.name,
            file=machine.source.shown,
            index=i,
            seen=effect.seen,
        )
        for i, effect in enumerate(machine.machine.effects)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectParameters:
    """The parameters of all effects of a machine, as components that are known; `own` are the
    effects' own components, as the file states them.

    `renames` by effect: the names in its equations -> ``effect.parameter``.
    """

    components: dict[str, ComponentEstimate]
    own: dict[str, ComponentEstimate]
    joint: tuple[JointPasses, ...]
    renames: tuple[dict[str, str], ...]


def effects_of(machine: LoadedMachine, reported: EffectEstimates | None) -> EffectParameters:
    """The parameters of a machine's effects: as the file states them, each effect by itself,
    or, of effects all of whose parameters are `reported`, with the report's joint covariance.
    """
    components: dict[str, ComponentEstimate] = {}
    tables: dict[str, ComponentEstimate] = {}
    joint, renames, together = [], [], []
    for effect in machine.machine.effects:
        names = (*effect.parameters, *effect.components)
        rename = {name: f"{effect.name}{EFFECT_MARK}{name}" for name in names}
        renames.append(rename)
        stated, covariance = _stated(effect, rename)
        for name, entry in effect.components.items():
            tables[rename[name]] = known_component(rename[name], entry)
        components |= stated
        if all(_is_reported(item, reported) for item in stated.values()):
            together += list(stated)
        elif effect.covariance is not None:
            joint.append(_known_together(tuple(stated), covariance))
    if reported is not None and together:
        rows = [reported.names.index(name) for name in together]
        C = reported.covariance[np.ix_(rows, rows)]
        for i, name in enumerate(together):
            value = np.array([reported.values[rows[i]]])
            if np.isclose(value, components[name].coefficients, SAME_VALUE, 0.0).all():
                value = components[name].coefficients
            own = replace(components[name], coefficients=value, covariance=C[i : i + 1, i : i + 1])
            components[name] = own
        joint.append(_known_together(tuple(together), C))
    return EffectParameters(
        components=components, own=tables, joint=tuple(joint), renames=tuple(renames)
    )


def _stated(
    effect: Effect, rename: Mapping[str, str]
) -> tuple[dict[str, ComponentEstimate], FloatArray]:
    """The parameters of an effect as components without an axis, known to their u, and their
    covariance: where the file states one, it stands for the parameters' own u.
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


def _is_reported(stated: ComponentEstimate, reported: EffectEstimates | None) -> bool:
    """Whether a report has a parameter, in a unit of the same kind."""
    if reported is None or stated.name not in reported.names:
        return False
    unit = reported.units[reported.names.index(stated.name)]
    return unit.dimension == stated.unit.dimension


def _known_together(names: tuple[str, ...], C: FloatArray) -> JointPasses:
    return JointPasses(
        components=names,
        widths=(1,) * len(names),
        covariance=C,
        pass_covariance=np.zeros_like(C),
        pass_dof=np.inf,
        n_passes=None,
    )


def all_together(
    machine: LoadedMachine,
    reported: EffectEstimates | None,
    names: tuple[str, ...] = (),
    covariance: FloatArray | None = None,
) -> EffectEstimates | None:
    """All parameters of a machine's effects with one covariance, None where it has no effect.

    That of effects estimated separately is zero between them; `covariance` (k, k), in internal
    units, is over the parameters `names`, estimated together now.
    """
    found = effects_of(machine, reported)
    order, items = list(found.components), list(found.components.values())
    if not order:
        return None
    C = np.diag([item.covariance[0, 0] for item in items])
    for group in found.joint:
        rows = [order.index(name) for name in group.components]
        C[np.ix_(rows, rows)] = group.covariance
    if covariance is not None:
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
    machine: LoadedMachine, reported: EffectEstimates | None, shown: str
) -> list[Finding]:
    """Where the report `shown` and the machine file differ in their effects."""
    if reported is None:
        return []
    stated = effects_of(machine, None).components
    found = effects_of(machine, reported).components
    file = machine.source.shown
    known = [name for name, item in stated.items() if _is_reported(item, reported)]
    unknown = [name for name in reported.names if name not in known]
    changed = [n for n in found if (found[n].coefficients != stated[n].coefficients).any()]
    warnings = []
    if unknown:
        facts = {"what": f"effects of {shown}", "reason": f"{file} has no such effects"}
        warnings.append(finding("not-used", names=unknown, **facts))
    if changed:
        facts = {"what": f"values of {file}", "reason": f"those of {shown} replace them"}
        warnings.append(finding("not-used", names=changed, **facts))
    return warnings


def searched_warnings(machine: LoadedMachine) -> list[Finding]:
    """Of effects whose name is one of several that fit what they were found on."""
    warnings = []
    for i, effect in enumerate(machine.machine.effects):
        what = f"effects[{i}] ({effect.name})"
        facts = {"file": machine.source.shown, "line": machine.line_of("effects", i)}
        names = effect.found.get("class")
        names = names if isinstance(names, list) else []
        rivals = [name for name in names if isinstance(name, str) and name != effect.name]
        if rivals:
            more = {"others": rivals, "consequence": ELSEWHERE}
            warnings.append(finding("not-separable", what=what, **facts, **more))
    return warnings
