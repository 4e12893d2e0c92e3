"""Effects of a diagnosis as they are reported and written: parameters, equations, classes, and
where effects cancel: the temperature at which an axis is right, the place about which it turns.

The sizes of an effect and of its margins are counted from somewhere; where their sum is 0 is not.
Along one axis errors are a sum of sizes times levers. Where all levers are linear in a covariate or
coordinate t, the sum is v(t) = a + b t of one number, or of several: of growth and drift one that
goes with the place and one that is alike at all places. It is 0 where all of them are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import fdtri

from mtu_cli.analyses.close_loop.design import Member
from mtu_cli.analyses.close_loop.diagnosis import COVERED, Diagnosis, smooth_effect
from mtu_cli.analyses.close_loop.experiment import experiment
from mtu_cli.analyses.close_loop.model_set import Entry
from mtu_cli.analyses.close_loop.result import Crossing, FoundEffect, Parameter, SmoothEffect
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.extend_machine import free_name
from mtu_cli.language import Node, evaluate, linear_form, parse
from mtu_cli.model.effect_library import Candidate, TableData
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

ALIAS = 0.999
"""R^2 of the columns of two effects from which on they are the same whatever the errors."""


def effects_of(diagnosis: Diagnosis, *, compare: bool = False) -> tuple[FoundEffect, ...]:
    """All effects of a diagnosis, the strongest first; `compare`: with the share of squares that
    each explains, its aliases and the experiment that separates it from its rivals.
    """
    design, table, sizes = diagnosis.design, diagnosis.design.table, diagnosis.sizes
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
                    explained_share=_explained(diagnosis, member),
                    aliases=_aliases(diagnosis, member),
                    experiment=experiment(diagnosis, entry),
                )
            effect = _as_table(effect, diagnosis)
        else:
            effect = _smooth(diagnosis, entry)
        effects.append(
            replace(
                effect,
                p_familywise=entry.p,
                log_bayes_factor=entry.gain,
                posterior=entry.posterior,
                class_names=tuple(name for name, _, _ in entry.credible),
                nameless=entry.nameless,
            )
        )
    for name, (p, credible) in diagnosis.offsets.items():
        a = design.axis(candidates[name])
        level = replace(sizes.levels[a], name="shift", role="own")
        offsets.append(
            FoundEffect(
                candidate=candidates[name],
                parameters=(level,),
                equations={f"E{table.axes[a]}": level.name},
                p_familywise=p,
                posterior=credible[name],
                class_names=tuple(credible),
            )
        )
    effects = _with_levels(diagnosis, effects, {key for x in offsets for key in x.equations})
    for name, p, ratio in diagnosis.scatter:
        # Of operations that which scatters more.
        chosen = table.operations[1 if ratio > 1 else 0] if name == "operation-scatter" else None
        effects.append(
            FoundEffect(
                candidate=candidates[name],
                equations={},
                chosen=chosen,
                ratio=max(ratio, 1 / ratio),
                p_familywise=p,
                class_names=(name,),
            )
        )
    return (*effects, *offsets)


def _with_levels(
    diagnosis: Diagnosis, effects: list[FoundEffect], offsets: set[str]
) -> list[FoundEffect]:
    """The effects with the level of each axis that is no offset by itself: with the effect that it
    goes with most, as in the file of a machine effects have no covariance with others; with one
    outlying feature or part only where there is no other.
    """
    table, sizes = diagnosis.design.table, diagnosis.sizes
    if table.fitted_degree >= 0 or table.datum != "none":
        return effects
    u = np.sqrt(np.maximum(np.diag(sizes.covariance), 1e-300))
    for level, axis in zip(sizes.levels, table.axes, strict=True):
        key = f"E{axis}"
        along = [x for x in effects if key in x.equations]
        along = [x for x in along if x.candidate.kind != "outlier"] or along
        if key in offsets or not along:
            continue
        # Of effects that it goes with as little the strongest, which stands first.
        correlations = np.abs(sizes.covariance[level.row] / u / u[level.row])
        rows = [[p.row for p in x.parameters if p.row >= 0] for x in along]
        r = [correlations[of_effect].max(initial=0.0) for of_effect in rows]
        effect = along[int(np.argmax(np.round(r, 1)))]
        names = {*effect.used, *(p.name for p in effect.parameters)}
        level = replace(level, name=free_name(level.name, names, "_"))
        text = f"{effect.equations[key]} + {level.name}"
        with_level = replace(
            effect,
            parameters=(*effect.parameters, level),
            equations={**effect.equations, key: text},
        )
        effects = [with_level if x is effect else x for x in effects]
    return effects


def _as_table(effect: FoundEffect, diagnosis: Diagnosis) -> FoundEffect:
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
    places, rows = diagnosis.design.table.mean_places, [p.row for p in effect.parameters]
    knots = np.unique(np.round(places[:, AXES.index(axis)], 6))
    J = np.array([evaluate(levers[name], {axis: knots}) * np.ones(len(knots)) for name in sizes])
    return replace(
        effect,
        equations=dict.fromkeys(effect.equations, effect.component),
        table=SmoothEffect(
            along=axis,
            knots=knots,
            values=np.array([p.value for p in effect.parameters]) @ J,
            covariance=J.T @ diagnosis.sizes.covariance[np.ix_(rows, rows)] @ J,
            roughness=0.0,
            dof=effect.parameters[0].dof,
            between=sum(p.value**2 for p in effect.of_role("own")),
        ),
    )


def _explained(diagnosis: Diagnosis, member: Member) -> float:
    """The share of the errors' weighted squares that an effect explains with its margins, but for
    those that are other effects.
    """
    fit, design = diagnosis.sizes.fit, diagnosis.design
    foreign = {i for x in diagnosis.sizes.members if x is not member for i in x.terms}
    closure = {*member.terms, *member.low} - (foreign - {*member.terms})
    at = [k for k, i in enumerate(fit.columns) if i in closure]
    x = fit.beta[at] @ design.columns.dense([fit.columns[i] for i in at])
    w = fit.weights[design.strata.labels()]
    total = float(np.sum(w * diagnosis.models.likelihood.y**2))
    return float(np.sum(w * x**2)) / total if total > 0 else 0.0


def _aliases(diagnosis: Diagnosis, member: Member) -> tuple[str, ...]:
    """Other candidates with a member whose columns span the same, whatever the errors."""
    design, k = diagnosis.design, len(member.terms)
    members = design.members[: design.tested]
    rivals = [m for m in members if m.candidate != member.candidate and len(m.terms) == k]
    if not rivals:
        return ()
    terms = np.array([m.terms for m in rivals])
    inner = design.columns.cross(terms[:, :, None], terms[:, None])
    _, products = design.columns.crossed((terms, inner), member.terms)
    G = np.tensordot(diagnosis.sizes.fit.weights, products, 1)
    one, other = (np.linalg.pinv(G[:, at, at], hermitian=True) for at in (slice(k), slice(k, None)))
    share = np.trace(one @ G[:, :k, k:] @ other @ G[:, k:, :k], axis1=1, axis2=2)
    same = np.array(rivals, object)[share > ALIAS * k]
    return tuple(dict.fromkeys(design.candidates[m.candidate].name for m in same))


def _smooth(diagnosis: Diagnosis, entry: Entry) -> FoundEffect:
    design, like = diagnosis.design, diagnosis.models.likelihood
    kernel = like.kernels[entry.item]
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
        says=f"a smooth error of {kernel.axis[:1]} along {kernel.along}",
        sentence=f"{{A}} has a smooth error along {kernel.along}, {{value}} rms",
        separates="measure at places between these",
    )
    axis = design.table.axes[design.strata.axis[next(iter(kernel.directions))]]
    return FoundEffect(
        candidate=candidate,
        parameters=(rms,),
        equations={f"E{axis}": entry.name.replace("-", "_")},
        table=table,
    )


CELLS = 40
"""Measured cells at which levers are compared."""
SAME = 1e-9
"""Relative; less is rounding."""
REFERENCE_DEGC = 20.0
"""Temperature from which on lengths are counted (ISO 1)."""


Term = tuple[Parameter, Node]
"""A size along one axis and its lever."""


def without_references(diagnosis: Diagnosis) -> Diagnosis:
    """A diagnosis without the offsets that say no more than where effects are counted from: with
    the level these are zero at a value of a covariate, which is reported instead.
    """
    for offset in tuple(diagnosis.offsets) if diagnosis.entries else ():
        others = {name: x for name, x in diagnosis.offsets.items() if name != offset}
        rest = replace(diagnosis, offsets=others)
        zeros = crossings(effects_of(rest), rest.sizes.covariance, diagnosis.design.table)
        if any(x.covariate not in AXES and offset == f"offset-{x.axis}" for x in zeros):
            diagnosis = rest
    return diagnosis


def crossings(
    effects: Sequence[FoundEffect], covariance: FloatArray, table: ResidualTable
) -> tuple[Crossing, ...]:
    """Of all effects along an axis at once, and of each that has its level; of effects that are
    alone in their class, with the `covariance` of a table. A place may lie beyond the features, as
    a fixed end does; intervals of covariates reach into their range, or hold REFERENCE_DEGC.
    """
    result = list[Crossing]()
    values = TableData(table).values
    # Coordinates and covariates at some of the measured cells, and their ends.
    cells = np.linspace(0, int(table.there.sum()) - 1, CELLS).astype(int)
    columns = {
        name: np.broadcast_to(v, table.there.shape)[table.there][cells]
        for name, v in values.items()
    }
    # Where a polynomial or the datum took the level, it is none that is missing.
    no_level = table.fitted_degree >= 0 or table.datum != "none"
    for axis in table.axes:
        key = f"E{axis}"
        along = [(x, _terms(x, key)) for x in effects if key in x.equations]
        groups = [along] * (len(along) > 1) + [[pair] for pair in along]
        for name in (name for name in columns if not name.startswith("dir_")):
            for group in groups:
                terms = [term for _, of_effect in group for term in of_effect]
                level = any(size.role == "level" for size, _ in terms)
                level |= no_level or any(x.candidate.kind == "offset" for x, _ in group)
                certain = all(len(x.class_names) < 2 and of_effect for x, of_effect in group)
                zero = _zero(terms, covariance, columns, name) if level and certain else None
                if zero is None:
                    continue
                (low, high), met = zero[2], values[name]
                inside = name in AXES or (low <= met.max() and high >= met.min())
                inside |= is_temperature(name) and low <= REFERENCE_DEGC <= high
                if inside:
                    whole, (first, _) = group is groups[0], group[0]
                    result.append(Crossing(axis, name, *zero, first.name, whole=whole))
                    break
    return tuple(result)


def _terms(effect: FoundEffect, key: str) -> list[Term]:
    """Of an effect that is a sum of sizes times levers, but for sizes that are not estimable."""
    if effect.candidate.over is not None or effect.table is not None:
        return []
    sizes = {p.name: p for p in effect.parameters if p.u > 0}
    form = linear_form(parse(effect.equations[key]), [p.name for p in effect.parameters])
    return [(sizes[x], lever) for x, lever in form.coefficients.items() if x in sizes]


def _zero(
    terms: Sequence[Term], covariance: FloatArray, columns: dict[str, FloatArray], name: str
) -> tuple[float, float, tuple[float, float]] | None:
    """Where the sum of sizes is zero, with u and the 95 % interval: the values t
    at which v(t) = 0 is not rejected (of one number that of Fieller, 1954). None where there is no
    such value, or none that is known to within the range of the data, at most that from its middle.
    """
    low, high = columns[name].min(), columns[name].max()
    centre, half = (low + high) / 2, (high - low) / 2
    if not half > SAME * max(abs(low), abs(high)):
        return None
    sizes, arms = [size for size, _ in terms], [arm for _, arm in terms]
    u = np.array([size.u for size in sizes])

    def levers(t: float) -> FloatArray:
        values = columns | {name: centre + t * half}
        return np.array([evaluate(arm, values) + np.zeros(CELLS) for arm in arms])

    before, middle, after = map(levers, (-1, 0, 1))
    M, R = middle.T * u, (after - before).T / 2 * u
    largest = np.abs(M) + np.abs(R)
    if np.abs((after - 2 * middle + before).T * u).max() > 1e-6 * largest.max():
        return None
    U, s, _ = np.linalg.svd(np.hstack([M, R]), full_matrices=False)
    M, R = (U[:, s > 1e-6 * s[0]].T @ X for X in (M, R))
    # A sum that is zero there whatever the sizes has no zero to estimate.
    if np.linalg.matrix_rank(np.array([M.ravel(), R.ravel()]), tol=1e-6 * s[0]) < 2:
        return None
    b, rows = np.array([size.value for size in sizes]) / u, [size.row for size in sizes]
    C = covariance[np.ix_(rows, rows)] / u / u[:, None]

    def tests(t: FloatArray) -> FloatArray:
        """v' V^-1 v, and the inverse of the variance of t."""
        J = M + t[:, None, None] * R
        V = J @ C @ np.swapaxes(J, 1, 2)
        V = V + 1e-14 * s[0] ** 2 * np.eye(len(M))
        stack = np.stack([J @ b, np.broadcast_to(R @ b, (len(t), len(M)))], axis=-1)
        return np.einsum("tki,tki->it", stack, np.linalg.solve(V, stack))

    t, step = np.zeros(1), 3.0
    while step > 1e-9:
        t = t[np.argmin(tests(t)[0])] + np.linspace(-step, step, 201)
        step /= 50
    t = t[[np.argmin(tests(t)[0])]]
    dof = min(min(size.dof for size in sizes), 1e9)
    limit = len(M) * fdtri(len(M), max(dof, 1.0), COVERED)
    (least,), (information,) = tests(t)
    bracket = np.array([-1e3, t[0] - 2, t[0] + 2, 1e3])
    if least > limit or abs(t[0]) > 2 or (tests(bracket)[0] <= limit).any():
        return None
    inner, outer = np.repeat(t, 2), t[0] + np.array([-2.0, 2.0])
    for _ in range(50):
        between = (inner + outer) / 2
        accept = tests(between)[0] <= limit
        inner, outer = np.where(accept, between, inner), np.where(accept, outer, between)
    if np.ptp(inner) > 2:
        return None
    first, last = (centre + half * inner).tolist()
    return centre + half * float(t[0]), half * float(information**-0.5), (first, last)
