"""Effects of a diagnosis as they are reported and written: parameters, equations, classes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from mtu_cli.analyses.close_loop.design import Design, Member
from mtu_cli.analyses.close_loop.diagnosis import Diagnosis, Offset
from mtu_cli.analyses.close_loop.estimate import Estimate, Estimates, Size
from mtu_cli.analyses.close_loop.experiment import Experiment, Rival, experiment
from mtu_cli.analyses.close_loop.likelihood import Likelihood
from mtu_cli.analyses.close_loop.model_set import Entry
from mtu_cli.analyses.close_loop.posed import lever_of
from mtu_cli.analyses.close_loop.result import (
    FoundEffect,
    Parameter,
    Searched,
    SmoothTable,
    component_name,
)
from mtu_cli.analyses.close_loop.smooth import smooth_effect
from mtu_cli.files.extend_machine import free_name
from mtu_cli.language import evaluate, linear_form, parse
from mtu_cli.language.tree import Call, Node, Number, filled_text, names
from mtu_cli.model.effect_library import BoundTemplate
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

ALIAS = 0.999
"""R^2 of the columns of two effects from which on they are the same whatever the data."""
OUTLYING = ("part", "feature")
"""Of what one alone is off: the others are right, and no level is theirs."""
SAYS = {
    "profile": "a smooth error of {axis} along {along}",
}


def described(found: Diagnosis, sizes: Estimates) -> tuple[FoundEffect, ...]:
    """All effects of a diagnosis, the strongest first, but for what `compared` adds."""
    by_item = dict(zip(found.models.members(found.model), sizes.effects, strict=True))
    offsets = [_offset(found, sizes, offset) for offset in found.offsets]
    # The level of an axis is written once: as its offset, or with the first effect along it.
    levels = {key for effect in offsets for key in effect["equations"]}  # type: ignore[attr-defined]
    effects = [
        _smooth(found, entry)
        if entry.item < 0
        else _mean_effect(found, sizes, entry, by_item[entry.item])
        for entry in found.entries
    ]
    made = [FoundEffect(**effect) for effect in effects]  # type: ignore[arg-type]
    made = [
        _with_levels(found, sizes, _as_table(effect, found.posed.table), levels) for effect in made
    ]
    others = [_scatter(found, name, p) for name, p in found.scatter] + offsets
    return (*made, *(FoundEffect(**effect) for effect in others))  # type: ignore[arg-type]


def _with_levels(
    found: Diagnosis, sizes: Estimates, effect: FoundEffect, levels: set[str]
) -> FoundEffect:
    """An effect with what is left of the mean along its axes, where no other has it yet."""
    scale, table = found.posed.scale, found.posed.table
    if table.fitted_degree >= 0 or table.datum != "none" or effect.over in OUTLYING:
        return effect
    for key in [key for key in effect.equations if key not in levels]:
        levels.add(key)
        level = _parameter(sizes.levels[table.axes.index(key[1:])], scale)
        text = effect.equations[key]
        taken = {p.name for p in effect.all_parameters} | names(parse(text)).keys()
        level = replace(level, name=free_name(level.name, taken, "_"))
        rows = (*effect.rows, _level_row(sizes, table, key))
        covariance = np.pad(effect.covariance, (0, 1))
        if len(rows) == len(covariance):
            covariance = sizes.covariance[np.ix_(rows, rows)] * scale**2
        else:  # A smooth effect has no size among those: its mean is independent of it.
            covariance[-1, -1] = level.u**2
        effect = replace(
            effect,
            beside=(*effect.beside, level),
            rows=rows,
            covariance=covariance,
            equations={**effect.equations, key: f"{text} + {level.name}"},
        )
    return effect


def compared(
    effects: Sequence[FoundEffect],
    found: Diagnosis,
    sizes: Estimates,
    folds: Sequence[Sequence[str]],
) -> tuple[FoundEffect, ...]:
    """Effects with the experiment that separates each from its rivals, and how often it was found
    again: `folds` are the names that held-out folds found.
    """
    entries = {entry.name: entry for entry in found.entries}
    return tuple(
        replace(
            effect,
            experiment=_experiment(found, sizes, entries[effect.name])
            if effect.name in entries
            else None,
            folds=(
                sum(not own.isdisjoint(effect.class_names) for own in map(set, folds)),
                len(folds),
            ),
        )
        for effect in effects
    )


def _parameter(size: Size, scale: float) -> Parameter:
    value, u = size.value * scale, size.u * scale
    half = float(stdtrit(max(size.dof, 1.0), 0.975)) * u if np.isfinite(size.dof) else 1.96 * u
    return Parameter(
        name=size.name, unit=size.unit, value=value, u=u, dof=size.dof,
        interval95=(value - half, value + half), role=size.role,
    )  # fmt: skip


def _base(found: Diagnosis, name: str) -> dict[str, object]:
    """What the library says of a candidate."""
    candidate = next(c for c in found.posed.design.candidates if c.name == name)
    return {
        "name": name,
        "family": candidate.family,
        "kind": candidate.kind,
        "axis": candidate.axis,
        "component": found.posed.table.component,
        "says": candidate.says,
        "sentence": candidate.sentence,
        "separates": candidate.separates,
        "covariate": None,
        "parameters": (),
        "beside": (),
        "covariance": np.zeros((0, 0)),
        "equations": {},
        "table": None,
        "chosen": None,
        "ratio": None,
        "searched": {},
        "log_bayes_factor": None,
        "posterior": None,
        "explained_share": 0.0,
        "classes": ((name, 1.0),),
        "aliases": (),
        "nameless": 0.0,
    }


def _mean_effect(
    found: Diagnosis, sizes: Estimates, entry: Entry, own: Estimate
) -> dict[str, object]:
    scale = found.posed.scale
    member = own.member
    bound = member.form.bound
    told = [_parameter(size, scale) for size in own.sizes]
    rows = list(own.rows)
    covariance = sizes.covariance[np.ix_(rows, rows)] * scale**2
    effect = _base(found, entry.name)
    effect |= {
        "kind": "outlier" if bound.family.over in OUTLYING else "mean",
        "over": bound.family.over,
        "covariate": bound.covariate,
        "parameters": tuple(item for item in told if item.role == "own"),
        "beside": tuple(item for item in told if item.role != "own"),
        "covariance": covariance,
        "rows": tuple(rows),
        "equations": _equations(own),
        "chosen": None if member.form.chosen is None else member.form.chosen[member.chosen or 0],
        "searched": {}
        if own.searched is None
        else {
            own.searched.name: Searched(value=own.searched.value, intervals=own.searched.intervals)
        },
        "p_familywise": entry.p,
        "log_bayes_factor": entry.gain,
        "posterior": entry.posterior,
        "explained_share": _explained(found.likelihood, sizes, member),
        "classes": tuple((name, p) for name, _, p in entry.credible),
        "aliases": aliases(found.posed.design, sizes.fit.weights, member),
        "nameless": entry.nameless,
    }
    return effect


def _level_row(sizes: Estimates, table: ResidualTable, key: str) -> int:
    """The row of an equation's level in the covariance."""
    return len(sizes.covariance) - len(table.axes) + table.axes.index(key[1:])


def _equations(own: Estimate) -> dict[str, str]:
    """The equations of an effect with its margins and the change of what is searched."""
    member = own.member
    value = member.value
    terms: dict[str, list[str]] = {}
    for bound in (member.form.bound, *member.form.margins):
        for key, text in bound.texts(value).items():
            terms.setdefault(key, []).append(text)
    # The same change is told once, of two effects that have it.
    if value is not None and any(size.role == "searched" for size in own.sizes):
        for key, text in _change(member.form.bound, own, value).items():
            terms.setdefault(key, []).append(text)
    return {key: " + ".join(texts) for key, texts in terms.items()}


def _change(bound: BoundTemplate, own: Estimate, value: float) -> dict[str, str]:
    """The change of an effect with the logarithm of what is searched, its sizes in proportion."""
    name = bound.template.searched or ""
    assert own.tangent is not None
    shares = own.tangent.sizes / max(float(np.linalg.norm(own.tangent.sizes)), 1e-300)
    order = list(bound.parameters)
    found = {}
    for a, slopes in bound.slopes().items():
        terms: list[Node] = []
        for parameter, slope in slopes.items():
            share = float(shares[order.index(parameter)])
            terms.append(Call("*", (Number(share * value, 0), slope), 0))
        total = terms[0]
        for term in terms[1:]:
            total = Call("+", (total, term), 0)
        axis = bound.data.table.axes[a]
        found[f"E{axis}"] = f"{name}_change*({filled_text(total, {name: value})})"
    return found


def _explained(likelihood: Likelihood, sizes: Estimates, member: Member) -> float:
    """The share of the errors' weighted squares that an effect's own columns explain."""
    fit, strata = sizes.fit, likelihood.design.strata
    at = [fit.columns.index(i) for i in member.own if i in fit.columns]
    x = fit.beta[at] @ likelihood.design.columns.dense([fit.columns[i] for i in at])
    w = np.repeat(fit.weights, strata.sizes.astype(int))
    total = float(np.sum(w * likelihood.y**2))
    return float(np.sum(w * x**2)) / total if total > 0 else 0.0


def aliases(design: Design, weights: FloatArray, member: Member) -> tuple[str, ...]:
    """Other candidates with a member whose columns span the same, whatever the data."""
    weighed, own = design.columns.weighed, np.array(member.own)
    among = design.members[: design.tested]
    others = [m for m in among if m.candidate != member.candidate and len(m.own) == len(own)]
    if not others:
        return ()
    its = np.array([m.own for m in others])
    both = weighed(weights, own[:, None], its[:, None, :])
    theirs = weighed(weights, its[:, :, None], its[:, None, :])
    inner = both @ np.linalg.solve(theirs, np.swapaxes(both, 1, 2))
    share = np.trace(np.linalg.solve(weighed(weights, own[:, None], own), inner), axis1=1, axis2=2)
    alike = np.array(others, object)[share > ALIAS * len(own)]
    return tuple(dict.fromkeys(design.candidates[m.candidate].name for m in alike))


def _experiment(found: Diagnosis, sizes: Estimates, entry: Entry) -> Experiment | None:
    design = found.posed.design
    rivals = []
    for _, item, posterior in entry.credible:
        if item < 0:
            continue
        member = design.members[item]
        fit = found.likelihood.fit(found.likelihood.closure((item,)))
        values = [
            fit.beta[fit.columns.index(i)] / f if i >= 0 else 0.0
            for i, f in zip(member.indices, member.factors, strict=True)
        ]
        own = len(member.form.bound.parameters)
        rivals.append(Rival(member=member, sizes=np.array(values[:own]), posterior=posterior))
    if len(rivals) < 2 or entry.item < 0:
        return None
    return experiment(found.posed.table, rivals, design.strata, sizes.fit.weights)


def _smooth(found: Diagnosis, entry: Entry) -> dict[str, object]:
    scale = found.posed.scale
    kernel = found.posed.design.kernels[-1 - entry.item]
    rest = tuple(item for item in found.model if item != entry.item)
    fit = found.likelihood.fit(found.models.columns(rest))
    effect = smooth_effect(found.likelihood, fit, kernel)
    rms = effect.rms * scale
    J = effect.values / max(effect.rms, 1e-300) / len(effect.values)
    u = float(np.sqrt(max(float(J @ effect.covariance @ J), 0.0))) * scale
    size = Parameter(
        name="rms",
        unit=found.posed.table.unit,
        value=rms,
        u=u,
        dof=effect.dof,
        interval95=(rms - 2 * u, rms + 2 * u),
    )
    own = _empty(found, entry.name, kernel.family)
    axis = found.posed.table.axes[found.posed.strata.axis[kernel.strata[0]]]
    return own | {
        "kind": "smooth",
        "axis": kernel.axis,
        "equations": {f"E{axis}": component_name(entry.name)},
        "sentence": f"{{A}} has a smooth error along {kernel.along}, {{value}} rms",
        "says": SAYS[kernel.family].format(axis=(kernel.axis or "")[:1], along=kernel.along),
        "parameters": (size,),
        "covariance": np.array([[u**2]]),
        "table": SmoothTable(
            of=kernel.along,
            at_mm=effect.knots,
            values=effect.values * scale,
            covariance=effect.covariance * scale**2,
            roughness=effect.roughness * scale**2,
        ),
        "p_familywise": entry.p,
        "log_bayes_factor": entry.gain,
        "posterior": entry.posterior,
        "classes": tuple((name, p) for name, _, p in entry.credible),
        "nameless": entry.nameless,
    }


def _as_table(effect: FoundEffect, table: ResidualTable) -> FoundEffect:
    """An effect along a coordinate of which several ranges of what was searched fit: written as its
    values at the places that were measured, which all of them share. Between these each makes other
    errors: a wave and what is interpolated differ by the sum of their mean squares.
    """
    (text, *others) = effect.equations.values() or ("0",)
    sizes = [p.name for p in effect.all_parameters]
    levers = linear_form(parse(text), sizes).coefficients
    along = {name for lever in levers.values() for name in names(lever)}
    if not effect.several or others or len(along) != 1 or not along <= {*AXES}:
        return effect
    (axis,) = along
    knots = np.unique(np.round(table.mean_places[:, AXES.index(axis)], 6))
    J = np.array([evaluate(levers[name], {axis: knots}) * np.ones(len(knots)) for name in sizes])
    values = np.array([p.value for p in effect.all_parameters])
    return replace(
        effect,
        equations=dict.fromkeys(effect.equations, component_name(effect.name)),
        table=SmoothTable(
            of=axis,
            at_mm=knots,
            values=values @ J,
            covariance=J.T @ effect.covariance @ J,
            roughness=0.0,
            between=sum(p.value**2 for p in effect.parameters),
        ),
    )


def _empty(found: Diagnosis, name: str, family: str) -> dict[str, object]:
    first = found.posed.design.candidates[0]
    return _base(found, first.name) | {
        "name": name, "family": family, "separates": None, "classes": ((name, 1.0),),
    }  # fmt: skip


def _scatter(found: Diagnosis, name: str, p: float) -> dict[str, object]:
    """A scatter effect: how many times the rest's standard deviation its pattern has."""
    table, strata = found.posed.table, found.posed.strata
    fit = found.likelihood.fit(found.models.columns(found.model))
    own = np.zeros_like(fit.residual)
    for s, kind in enumerate(strata.kinds):
        if kind == "interaction":
            own[strata.slices[s]] = fit.residual[strata.slices[s]]
    E = strata.table(own)
    if name == "operation-scatter":
        chosen = table.operation == 1
        one, rest = (float(np.mean(E[:, at] ** 2)) for at in (chosen, ~chosen))
        ratio = float(np.sqrt(max(one, rest) / max(min(one, rest), 1e-300)))
        label = table.operations[1 if one > rest else 0]
    else:
        lever = lever_of(name, table.axes, table.mean_places)
        assert lever is not None
        turns = np.einsum("pha,ha->p", E, lever)
        ratio = float(np.sqrt(np.mean(turns**2) / max(float(np.mean(E**2)), 1e-300)))
        label = None
    return _base(found, name) | {
        "kind": "scatter", "p_familywise": p, "ratio": ratio, "chosen": label,
    }  # fmt: skip


def _offset(found: Diagnosis, sizes: Estimates, offset: Offset) -> dict[str, object]:
    table = found.posed.table
    effect = _base(found, offset.name)
    key = f"E{effect['axis'] or table.axes[0]}"
    level = _parameter(sizes.levels[table.axes.index(key[1:])], found.posed.scale)
    shift = replace(level, name="shift", role="own")
    return effect | {
        "kind": "offset",
        "parameters": (shift,),
        "covariance": np.array([[level.u**2]]),
        "rows": (_level_row(sizes, table, key),),
        "equations": {key: "shift"},
        "p_familywise": offset.p,
        "classes": offset.credible,
        "posterior": offset.credible[0][1],
    }
