"""Effects of a diagnosis as they are reported and written: parameters, equations, classes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mtu_cli.analyses.close_loop.design import Design, Member
from mtu_cli.analyses.close_loop.diagnosis import Diagnosis
from mtu_cli.analyses.close_loop.estimate import Estimates, smooth_effect
from mtu_cli.analyses.close_loop.experiment import experiment
from mtu_cli.analyses.close_loop.likelihood import Likelihood
from mtu_cli.analyses.close_loop.model_set import SHARE, Entry
from mtu_cli.analyses.close_loop.result import FoundEffect, Parameter, SmoothEffect
from mtu_cli.files.extend_machine import free_name
from mtu_cli.language import evaluate, linear_form, parse
from mtu_cli.model.effect_library import Candidate
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

OUTLYING = ("part", "feature")
"""Of these a single one is off, the others are right: an effect has no level."""
ALIAS = 0.999
"""R^2 of the columns of two effects from which on they are the same whatever the errors."""


def effects_of(
    diagnosis: Diagnosis, sizes: Estimates, *, compare: bool = False
) -> tuple[FoundEffect, ...]:
    """All effects of a diagnosis, the strongest first; `compare`: with the share of squares that
    each explains, its aliases and the experiment that separates it from its rivals.
    """
    design, table = diagnosis.design, diagnosis.design.table
    candidates = {candidate.name: candidate for candidate in design.candidates}
    pairs = zip(sizes.effects, sizes.members, strict=True)
    estimates = dict(zip(diagnosis.models.members(diagnosis.model), pairs, strict=True))
    effects, offsets = list[FoundEffect](), list[FoundEffect]()
    for entry in diagnosis.entries:
        if entry.item in estimates:
            effect, member = estimates[entry.item]
            if compare:
                effect = replace(
                    effect,
                    explained_share=_explained(diagnosis.likelihood, sizes, member),
                    aliases=aliases(design, sizes.fit.weights, member),
                    experiment=experiment(diagnosis, entry, sizes.fit.weights),
                )
            effect = _as_table(effect, table)
        else:
            effect = _smooth(diagnosis, entry)
        effects.append(
            replace(
                effect,
                p_familywise=entry.p,
                log_bayes_factor=entry.gain,
                posterior=entry.posterior,
                class_names=tuple(name for name, _, _ in entry.credible),
                nameless=entry.nameless > 1 - SHARE,
            )
        )
    for offset in diagnosis.offsets:
        a = design.axis(candidates[offset.name])
        level = replace(sizes.levels[a], name="shift", role="own")
        offsets.append(
            FoundEffect(
                candidate=candidates[offset.name],
                parameters=(level,),
                covariance=np.array([[level.u**2]]),
                rows=(len(sizes.covariance) - len(table.axes) + a,),
                equations={f"E{table.axes[a]}": level.name},
                p_familywise=offset.p,
                posterior=offset.credible[offset.name],
                class_names=tuple(offset.credible),
            )
        )
    effects = _with_levels(diagnosis, sizes, effects, {key for x in offsets for key in x.equations})
    for name, p, ratio in diagnosis.scatter:
        # Of operations that which scatters more.
        chosen = table.operations[1 if ratio > 1 else 0] if name == "operation-scatter" else None
        effects.append(
            FoundEffect(
                candidate=candidates[name], covariance=np.zeros((0, 0)), equations={},
                chosen=chosen, ratio=max(ratio, 1 / ratio), p_familywise=p, class_names=(name,),
            )
        )  # fmt: skip
    return (*effects, *offsets)


def _with_levels(
    diagnosis: Diagnosis, sizes: Estimates, effects: list[FoundEffect], offsets: set[str]
) -> list[FoundEffect]:
    """The effects with the level of each axis that is no offset by itself: with the effect that it
    goes with most, as in the file of a machine effects have no covariance with others.
    """
    table, C = diagnosis.design.table, sizes.covariance
    if table.fitted_degree >= 0 or table.datum != "none":
        return effects
    u, first = np.sqrt(np.maximum(np.diag(C), 1e-300)), len(C) - len(table.axes)
    for row, (level, axis) in enumerate(zip(sizes.levels, table.axes, strict=True), first):
        key = f"E{axis}"
        along = [x for x in effects if key in x.equations and x.candidate.over not in OUTLYING]
        if key in offsets or not along:
            continue
        # Of effects that it goes with as little the strongest, which stands first.
        r = [np.abs(C[row] / u / u[row])[list(x.rows)].max(initial=0.0) for x in along]
        effect = along[int(np.argmax(np.round(r, 1)))]
        names = {*effect.used, *(p.name for p in effect.parameters)}
        level = replace(level, name=free_name(level.name, names, "_"))
        rows, covariance = (*effect.rows, row), np.pad(effect.covariance, (0, 1))
        if len(rows) == len(covariance):
            covariance = C[np.ix_(rows, rows)]
        else:  # A smooth effect has no size among those; it is independent of its mean.
            covariance[-1, -1] = level.u**2
        text = f"{effect.equations[key]} + {level.name}"
        with_level = replace(
            effect,
            parameters=(*effect.parameters, level),
            rows=rows,
            covariance=covariance,
            equations={**effect.equations, key: text},
        )
        effects = [with_level if x is effect else x for x in effects]
    return effects


def _as_table(effect: FoundEffect, table: ResidualTable) -> FoundEffect:
    """An effect along a coordinate of which several ranges of what was searched fit: written as its
    values at the places that were measured, which all of them share. Between these each makes other
    errors: a wave and what is interpolated differ by the sum of their mean squares.
    """
    sizes = [p.name for p in effect.parameters]
    along = {*effect.used} - {*sizes}
    if not effect.ambiguous or len(effect.equations) > 1 or len(along) != 1 or not along <= {*AXES}:
        return effect
    (text,), (axis,) = effect.equations.values(), along
    levers = linear_form(parse(text), sizes).coefficients
    knots = np.unique(np.round(table.mean_places[:, AXES.index(axis)], 6))
    J = np.array([evaluate(levers[name], {axis: knots}) * np.ones(len(knots)) for name in sizes])
    return replace(
        effect,
        equations=dict.fromkeys(effect.equations, effect.component),
        table=SmoothEffect(
            along=axis,
            knots=knots,
            values=np.array([p.value for p in effect.parameters]) @ J,
            covariance=J.T @ effect.covariance @ J,
            roughness=0.0,
            dof=effect.parameters[0].dof,
            between=sum(p.value**2 for p in effect.of_role("own")),
        ),
    )


def _explained(likelihood: Likelihood, sizes: Estimates, member: Member) -> float:
    """The share of the errors' weighted squares that an effect explains with its margins, but for
    those that are other effects.
    """
    fit, strata = sizes.fit, likelihood.design.strata
    foreign = {i for x in sizes.members if x is not member for i in x.terms}
    closure = {*member.terms, *member.low} - (foreign - {*member.terms})
    at = [k for k, i in enumerate(fit.columns) if i in closure]
    x = fit.beta[at] @ likelihood.design.columns.dense([fit.columns[i] for i in at])
    w = np.repeat(fit.weights, strata.sizes.astype(int))
    total = float(np.sum(w * likelihood.y**2))
    return float(np.sum(w * x**2)) / total if total > 0 else 0.0


def aliases(design: Design, weights: FloatArray, member: Member) -> tuple[str, ...]:
    """Other candidates with a member whose columns span the same, whatever the errors."""
    cross, terms = design.columns.cross, np.array(member.terms)
    members = design.members[: design.tested]
    rivals = [m for m in members if m.candidate != member.candidate and len(m.terms) == len(terms)]
    if not rivals:
        return ()
    rival_terms = np.array([m.terms for m in rivals])
    pairs = (
        (terms[:, None], terms),
        (terms[:, None], rival_terms[:, None]),
        (rival_terms[..., None], rival_terms[:, None]),
    )
    gram, across, inner = (np.tensordot(weights, cross(*pair), 1) for pair in pairs)
    inner = across @ np.linalg.solve(inner, np.swapaxes(across, 1, 2))
    share = np.trace(np.linalg.solve(gram, inner), axis1=1, axis2=2)
    same = np.array(rivals, object)[share > ALIAS * len(terms)]
    return tuple(dict.fromkeys(design.candidates[m.candidate].name for m in same))


def _smooth(diagnosis: Diagnosis, entry: Entry) -> FoundEffect:
    design, like = diagnosis.design, diagnosis.likelihood
    kernel = design.kernels[-1 - entry.item]
    rest = tuple(item for item in diagnosis.model if item != entry.item)
    table = smooth_effect(like, like.fit(diagnosis.models.columns(rest)), kernel)
    value = float(np.sqrt(np.mean(table.values**2)))
    J = table.values / max(value, 1e-300) / len(table.values)
    u2 = max(float(J @ table.covariance @ J), 0.0)
    rms = Parameter(name="rms", unit=design.table.unit, value=value, u=u2**0.5, dof=table.dof)
    candidate = Candidate(
        name=entry.name,
        family="profile",
        axis=kernel.axis,
        kind="smooth",
        says=f"a smooth error of {(kernel.axis or '')[:1]} along {kernel.along}",
        sentence=f"{{A}} has a smooth error along {kernel.along}, {{value}} rms",
    )
    axis = design.table.axes[design.strata.axis[kernel.strata[0]]]
    return FoundEffect(
        candidate=candidate,
        parameters=(rms,),
        covariance=np.array([[u2]]),
        equations={f"E{axis}": entry.name.replace("-", "_")},
        table=table,
    )
