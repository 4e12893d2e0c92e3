"""What a search found, in the terms of a report: parameters, classes, intervals, shares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from mtu_cli.close_loop_sealed.analyses.loop.added import Added
from mtu_cli.close_loop_sealed.analyses.loop.classes import aliases_of
from mtu_cli.close_loop_sealed.analyses.loop.experiment import SAME, Choice
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.result import DRIFT, FIELD, FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.scatter_rivals import apart_from
from mtu_cli.close_loop_sealed.analyses.loop.scatter_size import scatter_size
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.stats.profile_ratio import member_ratios
from mtu_cli.language import names as equation_names
from mtu_cli.language import parse
from mtu_cli.stats.least_squares import FloatArray

SUPPORT = 3.841458820694124
"""Drop of the likelihood ratio that bounds a 95 % interval (chi^2, one degree of freedom)."""


@dataclass(frozen=True, kw_only=True)
class Described:
    """The search of a table with what its effects are estimated as."""

    prepared: Prepared
    found: Search
    effects: Added
    chosen: tuple[frozenset[str], ...]

    @property
    def nameless(self) -> tuple[str, ...]:
        """The drifts and fields that may be there and have no name."""
        return tuple(candidate_name(self.prepared, i) for i in self.found.nameless)


def found_effects(told: Described, experiments: Sequence[Choice | None]) -> tuple[FoundEffect, ...]:
    """The effects of all steps, in the order found."""
    place = 0
    found = []
    for step, experiment in zip(told.found.steps, experiments, strict=True):
        found.append(_effect(told, step, place, experiment))
        place += step.member >= 0
    return tuple(found)


def candidate_name(prepared: Prepared, index: int) -> str:
    """The name of a candidate, or of a drift or field without one."""
    n, axes = len(prepared.candidates), prepared.table.axes
    if index < n:
        return prepared.candidates[index].name
    kind, axis = divmod(index - n, len(axes))
    return f"{FIELD if kind else DRIFT}-{axes[axis]}"


def _effect(told: Described, step: Step, place: int, planned: Choice | None) -> FoundEffect:
    prepared = told.prepared
    candidate = prepared.candidates[step.index]
    member = prepared.members[step.member] if step.member >= 0 else None
    figures = _figures(told, step, place)
    aliases = () if member is None else _aliases(told, step)
    names = [candidate_name(prepared, i) for i in step.credible]
    names = [candidate.name, *(n for n in names if n != candidate.name)]
    return FoundEffect(
        name=candidate.name,
        family=candidate.family,
        axis=candidate.axis,
        component=prepared.table.component,
        covariate=None if member is None else member.covariate,
        says=candidate.says,
        separates=candidate.separates,
        kind=candidate.kind,
        chosen=None if member is None else member.chosen,
        equations=_equations(told, step, place),
        parameters=figures.parameters,
        intervals=figures.intervals,
        covariance=figures.covariance,
        searched={} if member is None else _searched(told, step, place),
        alike=() if member is None else member.alike,
        p_familywise=step.p,
        log_bayes_factor=step.log_bayes,
        posterior=step.posterior,
        explained_share=_share(told, step, place),
        class_names=tuple(names),
        aliases=aliases,
        experiment=None if planned is None else planned.experiment,
        inseparable=planned is not None and planned.reason == SAME,
        folds=sum(not own.isdisjoint(names) for own in told.chosen),
        of_folds=len(told.chosen),
        apart=tuple(candidate_name(prepared, i) for i in apart_from(prepared, step)),
        unnamed=step.unnamed,
        levels=() if member is None else tuple(_level_axes(told, place)),
        scatter=scatter_size(told.effects.prepared, told.effects.members, step),
    )


@dataclass(frozen=True, slots=True)
class _Figures:
    parameters: tuple[tuple[str, str, float, float], ...]
    intervals: tuple[tuple[float, float, float], ...]
    covariance: FloatArray


def indices_of(told: Described, step: Step, place: int) -> list[int]:
    """Where the parameters of a step stand among the fitted coefficients."""
    prepared = told.prepared
    if step.member >= 0:
        return told.effects.coefficients(place)
    if step.index < prepared.scan.tested:
        axis = prepared.scan.offsets[step.index - len(prepared.scan.columns)]
        return [told.effects.offset(axis)]
    return []


def _figures(told: Described, step: Step, place: int) -> _Figures:
    """Parameters with u and 95 % intervals by Student's t."""
    own, fit = indices_of(told, step, place), told.effects.fit
    if fit is None or not own:
        return _Figures((), (), np.zeros((0, 0)))
    names = _parameters(told, step, place)
    values, covariance = fit.beta[own], fit.covariance[np.ix_(own, own)]
    u_all = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    t = stdtrit(np.maximum(fit.dof[own], 1.0), 0.975)
    low, high = values - t * u_all, values + t * u_all
    return _Figures(
        tuple(
            (name, unit, float(v), float(u))
            for (name, unit), v, u in zip(names, values, u_all, strict=True)
        ),
        tuple(
            (float(a), float(b), float(nu))
            for a, b, nu in zip(low, high, fit.dof[own], strict=True)
        ),
        covariance,
    )


def _parameters(told: Described, step: Step, place: int) -> list[tuple[str, str]]:
    """Names and units of a step's parameters, levels last."""
    unit = told.prepared.table.unit
    if step.member < 0:
        return [("shift", unit)]
    return [
        *told.prepared.members[step.member].parameters,
        *((name, unit) for name in _level_names(told, step, place)),
    ]


def _level_names(told: Described, step: Step, place: int) -> list[str]:
    """Names of an effect's levels that nothing in its equations has."""
    axes = _level_axes(told, place)
    names = ["level"] if len(axes) == 1 else [f"level_{axis}" for axis in axes]
    own = told.prepared.members[step.member]
    taken = {name for text in own.equations.values() for name in equation_names(parse(text))}
    while not taken.isdisjoint(names):
        names = [f"own_{name}" for name in names]
    return names


def _level_axes(told: Described, place: int) -> list[str]:
    axes = told.prepared.table.axes
    return [axes[level.axis] for level in told.effects.levels if level.owner == place]


def _equations(told: Described, step: Step, place: int) -> dict[str, str]:
    prepared = told.prepared
    if step.member < 0:
        if step.index >= prepared.scan.tested:
            return {}
        axis = prepared.scan.offsets[step.index - len(prepared.scan.columns)]
        return {f"E{prepared.table.axes[axis]}": "shift"}
    found = dict(prepared.members[step.member].equations)
    if found:
        names = _level_names(told, step, place)
        for letter, name in zip(_level_axes(told, place), names, strict=True):
            found[f"E{letter}"] = f"{found[f'E{letter}']} + {name}"
    return found


def _searched(told: Described, step: Step, place: int) -> dict[str, tuple[float, float, float]]:
    """What was searched, with its 95 % interval by the profile of the likelihood ratio, beside
    the other effects; between the values of the grid it is taken as far as the next one. It
    holds what looks the same at these places.
    """
    prepared = told.prepared
    member = prepared.members[step.member]
    if not member.searched:
        return {}
    scan = told.effects.prepared.scan
    others = [m for i, m in enumerate(told.effects.members) if i != place]
    pack = scan.pack(prepared.with_tangents(others))
    LR = member_ratios(pack, pack.without_found(prepared.y)[None]).ratio[0]
    found = {}
    for name, value in member.searched.items():
        family = np.flatnonzero(pack.family == step.index)
        same = [
            i
            for i in family
            if name in prepared.members[i].searched
            and prepared.members[i].covariate == member.covariate
        ]
        grid = np.array([prepared.members[i].searched[name] for i in same])
        order = np.argsort(grid)
        grid, own = grid[order], LR[np.array(same)][order]
        at = int(np.argmin(np.abs(grid - value)))
        inside = own >= own[at] - SUPPORT
        # All grid values that the data support, other modes of an aliased grid among them.
        supported = np.flatnonzero(inside)
        low, high = int(supported[0]), int(supported[-1])
        low, high = max(low - 1, 0), min(high + 1, len(grid) - 1)
        alike = [v for i in supported for v in prepared.members[same[order[i]]].alike]
        ends = [float(grid[low]), float(grid[high]), *alike]
        found[name] = (float(value), min(ends), max(ends))
    return found


def _share(told: Described, step: Step, place: int) -> float:
    """Share of the table's mean square that this effect's columns hold."""
    table, prepared = told.prepared.table, told.prepared
    there = table.there
    total = float(np.sum(np.where(there[:, :, None], table.errors, 0.0) ** 2))
    if step.member < 0:
        figures = _figures(told, step, place)
        if not figures.parameters:
            return 0.0
        return min(1.0, figures.parameters[0][2] ** 2 * int(there.sum()) / total)
    if told.effects.fit is None or total == 0:
        return 0.0
    beta = told.effects.fit.beta[told.effects.coefficients(place)]
    own = np.zeros(table.errors.shape)
    for value, column in zip(beta, prepared.members[step.member].columns, strict=False):
        for axis, lever in column.items():
            own[:, :, axis] += value * (lever - np.broadcast_to(lever, there.shape)[there].mean())
    return min(1.0, float(np.sum(own[there] ** 2)) / total)


def _aliases(told: Described, step: Step) -> tuple[str, ...]:
    """Other candidates that hold the found columns."""
    prepared = told.effects.prepared
    beside = tuple(m for m in told.effects.members if m != step.member)
    owners = prepared.scan.owners()
    found = sorted({owners[m] for m in aliases_of(prepared, step, beside)})
    return tuple(prepared.candidates[i].name for i in found)


def joint_covariance(told: Described) -> FloatArray:
    """Over the parameters of all effects in their order."""
    rows: list[int] = []
    place = 0
    for step in told.found.steps:
        rows += indices_of(told, step, place)
        place += step.member >= 0
    if told.effects.fit is None:
        return np.zeros((0, 0))
    found: FloatArray = told.effects.fit.covariance[np.ix_(rows, rows)]
    return found


def floor_of(prepared: Prepared) -> float | None:
    """Repeatability of one entry: the interaction, or what repeats tell of one part or column."""
    table, null = prepared.table, prepared.scan.null
    if min(len(table.parts), len(table.features)) > 1 and (null.interaction > 0).any():
        return float(np.sqrt(np.mean(null.interaction)))
    if table.repeat_dof > 0 and np.isfinite(table.repeat_variance).all():
        count = float(np.mean(1 / table.repeats[table.there]))
        return float(np.sqrt(np.mean(table.repeat_variance) * count))
    return None
