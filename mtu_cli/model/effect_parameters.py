"""The parameters of declared effects, as components that a machine file states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.findings import Finding, counted, finding
from mtu_cli.model.estimates import (
    ComponentEstimate,
    EffectEstimates,
    JointPasses,
    stated_component,
)
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS, Unit

EFFECT_MARK = "."
"""Stands between an effect and its parameter; no component's name holds it."""
NAMELESS = "unnamed-"
"""What names of drifts and fields without a name in a class begin with."""
SAME_VALUE = 1e-9
"""Relative; less is the rounding of a value that went through a report's unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeclaredEffect:
    """An effect of a machine file: its place among the effects of `file`, and by column the lowest
    and highest value that it was found on; `within` those of them that no equation has.
    """

    name: str
    file: str
    index: int
    seen: Mapping[str, tuple[float, float]]
    within: tuple[str, ...] = ()


ELSEWHERE = "elsewhere each predicts other errors, and u is that of this one"


def declared_effects(machine: LoadedMachine) -> tuple[DeclaredEffect, ...]:
    """The effects of a machine in the file's order."""
    return tuple(
        DeclaredEffect(
            name=effect.name,
            file=machine.source.shown,
            index=i,
            seen={
                column: (low, high)
                for column, (low, high) in {**effect.within, **effect.seen}.items()
            },
            within=tuple(effect.within),
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
    joint: list[JointPasses] = []
    renames = []
    together: list[str] = []
    known = {} if reported is None else dict(zip(reported.names, reported.units, strict=True))
    for effect in machine.machine.effects:
        rename = {name: f"{effect.name}{EFFECT_MARK}{name}" for name in effect.parameters}
        own, group = effect_estimates(effect, rename)
        for name, entry in effect.components.items():
            rename[name] = f"{effect.name}{EFFECT_MARK}{name}"
            tables[rename[name]] = stated_component(rename[name], entry)
        renames.append(rename)
        components |= own
        if all(_knows(known, item) for item in own.values()):
            together += own
        else:
            joint += group
    if reported is not None and together:
        rows = [reported.names.index(name) for name in together]
        C = reported.covariance[np.ix_(rows, rows)]
        for i, name in enumerate(together):
            components[name] = _reported(components[name], reported.values[rows[i]], C[i, i])
        joint.append(_known_together(tuple(together), C))
    return EffectParameters(
        components=components, own=tables, joint=tuple(joint), renames=tuple(renames)
    )


def _knows(known: Mapping[str, Unit], stated: ComponentEstimate) -> bool:
    unit = known.get(stated.name)
    return unit is not None and unit.dimension == stated.unit.dimension


def _reported(stated: ComponentEstimate, value: float, variance: float) -> ComponentEstimate:
    differ = _differ(stated.coefficients[0], value)
    coefficients = np.array([value]) if differ else stated.coefficients
    return replace(stated, coefficients=coefficients, covariance=np.array([[variance]]))


def _differ(first: float, second: float) -> bool:
    return abs(first - second) > SAME_VALUE * max(abs(first), abs(second))


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

    That of effects estimated apart is zero between them; `covariance` (k, k), in internal
    units, is over the parameters `names`, estimated together now.
    """
    found = effects_of(machine, reported)
    order = list(found.components)
    if not order:
        return None
    C = np.diag([item.covariance[0, 0] for item in found.components.values()])
    for group in found.joint:
        rows = [order.index(name) for name in group.components]
        C[np.ix_(rows, rows)] = group.covariance
    if covariance is not None:
        rows = [order.index(name) for name in names]
        C[rows] = C[:, rows] = 0.0
        C[np.ix_(rows, rows)] = covariance
    return EffectEstimates(
        names=tuple(order),
        units=tuple(item.unit for item in found.components.values()),
        values=np.array([item.coefficients[0] for item in found.components.values()]),
        covariance=C,
    )


def effect_warnings(
    machine: LoadedMachine, reported: EffectEstimates | None, shown: str
) -> list[Finding]:
    """Where the report `shown` and the machine file speak of different effects."""
    if reported is None:
        return []
    stated = effects_of(machine, None).components
    found = effects_of(machine, reported).components
    warnings = []
    known = dict(zip(reported.names, reported.units, strict=True))
    unused = [name for name in known if name not in stated or not _knows(known, stated[name])]
    if unused:
        reason = f"{machine.source.shown} has no such effects"
        warnings.append(
            finding("not-used", what=f"effects of {shown}", names=unused, reason=reason)
        )
    changed = [
        name
        for name, item in found.items()
        if (item.coefficients != stated[name].coefficients).any()
    ]
    if changed:
        warnings.append(
            finding(
                "not-used",
                what=f"values of {machine.source.shown}",
                names=changed,
                reason=f"those of {shown} replace them",
            )
        )
    return warnings


def searched_warnings(machine: LoadedMachine) -> list[Finding]:
    """Of effects of which a searched value (a pitch), or which effect it is, was not told by what
    they were found on: elsewhere each of those foretells other errors.
    """
    warnings = []
    for i, effect in enumerate(machine.machine.effects):
        facts: dict[str, Any] = {"index": i, "effect": effect.name}
        facts |= {"file": machine.source.shown, "line": machine.line_of("effects", i)}
        own = f"effects[{i}] ({effect.name})"
        rivals = _named_with(effect.found, effect.name)
        if rivals:
            warnings.append(
                finding("not-separable", what=own, others=rivals, consequence=ELSEWHERE, **facts)
            )
        for name, others in effect.alike.items():
            what, _, unit = name.rpartition("_")
            where = "places" if unit == "mm" else "data"
            rest = f"{counted(len(others), 'other')} that fit alike at its {where}"
            facts |= {"what": f"the {what or name} of {own}", "others": [rest], "where": where}
            facts |= {"consequence": f"it holds at those {where} alone"}
            warnings.append(finding("not-separable", **facts, fits=len(others) + 1))
    return warnings


def _named_with(found: Mapping[str, Any], name: str) -> list[str]:
    """The other names of the class that an effect was `found` in, as far as it says so."""
    names = found.get("class")
    known = names if isinstance(names, list) else []
    return [
        own
        for own in known
        if isinstance(own, str) and own != name and not own.startswith(NAMELESS)
    ]


def effect_estimates(
    effect: Any, rename: Mapping[str, str]
) -> tuple[dict[str, ComponentEstimate], list[JointPasses]]:
    """The parameters of an effect as components without an axis, known to their u.

    Where the effect states a covariance, it stands for the parameters' own u.
    """
    estimates: dict[str, ComponentEstimate] = {}
    factors = np.array([PARAMETER_UNITS[p.unit].to_internal for p in effect.parameters.values()])
    if effect.covariance is None:
        C = np.diag([p.u**2 for p in effect.parameters.values()]) * np.outer(factors, factors)
    else:
        C = np.asarray(effect.covariance, float) * np.outer(factors, factors)
    for i, (name, parameter) in enumerate(effect.parameters.items()):
        unit = PARAMETER_UNITS[parameter.unit]
        estimates[rename[name]] = ComponentEstimate(
            name=rename[name],
            of=None,
            unit=unit,
            coefficients=np.array([parameter.value * unit.to_internal]),
            covariance=C[i : i + 1, i : i + 1],
            pass_covariance=np.zeros((1, 1)),
            s_repeat=0.0,
            pass_dof=0.0,
            repeat_dof=np.inf,
        )
    if effect.covariance is None:
        return estimates, []
    return estimates, [_known_together(tuple(estimates), C)]
