"""The diagnosis of one table: search and verdict; sizes of the effects of its model, with their
margins, the level, and what was searched; smooth profiles as tables of values along an axis with
their covariance.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from mtu_cli.analyses.close_loop.design import Design, Kernel, Member
from mtu_cli.analyses.close_loop.gate import CHECKS, Gate
from mtu_cli.analyses.close_loop.likelihood import TINY, Fit, Likelihood, outliers
from mtu_cli.analyses.close_loop.model_set import WINDOW, Entry, Model, ModelSet, Scatter
from mtu_cli.analyses.close_loop.result import FoundEffect, Parameter, Searched, SmoothEffect
from mtu_cli.analyses.close_loop.strata import NONE, PADDING
from mtu_cli.model.effect_library import Candidate
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.kernels import averaged, smooth_root
from mtu_cli.stats.least_squares import BoolArray, FloatArray

OF_PARTS = {"rotation-scatter", "scale-scatter"}
"""Scatter effects that make a pattern of part x feature."""


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What one table says: the model, its entries the strongest first, scatter effects with their p
    and ratio of deviations, offsets by name with their p and class (names with their posterior),
    and checks that fired.
    """

    models: ModelSet
    model: Model
    entries: tuple[Entry, ...]
    scatter: tuple[Scatter, ...]
    offsets: dict[str, tuple[float, dict[str, float]]]
    checks: tuple[tuple[str, float], ...]
    fired: tuple[str, ...]
    nameless: bool
    outliers: BoolArray

    @property
    def design(self) -> Design:
        """Of the table, its candidates and strata."""
        return self.models.design

    @cached_property
    def sizes(self) -> Estimates:
        """The sizes of the effects of its model."""
        return estimates_of(self.models, self.model)

    @property
    def names(self) -> list[str]:
        """The names of all effects."""
        scatter = (name for name, _, _ in self.scatter)
        return [*(x.name for x in self.entries), *scatter, *self.offsets]

    @property
    def verdict(self) -> str:
        """Whether all that was found has a name, and one name."""
        if self.fired or self.nameless:
            return "unexplained"
        if not self.names:
            return "none"
        several = any(len(x.credible) > 1 or x.nameless for x in self.entries)
        several |= any(len(credible) > 1 for _, credible in self.offsets.values())
        return "class" if several else "named"


def diagnosis_of(
    table: ResidualTable,
    candidates: Sequence[Candidate],
    *,
    alpha: float,
    most: int,
    seed: int,
    nulls: int,
) -> Diagnosis:
    """The diagnosis of a table at the family-wise rate `alpha`, with `most` effects at most,
    against `nulls` tables without effects, or as many more as a p below `alpha` takes.
    """
    nulls = max(nulls, math.ceil(2 / alpha) - 1)
    mask = outliers(table)
    errors = np.where(mask.any(axis=2, keepdims=True), np.nan, table.errors)
    table = replace(table, errors=errors)
    motion = list[Scatter]()
    while True:
        likelihood = Likelihood(table, candidates, [name for name, _, _ in motion])
        gate = Gate(likelihood, np.random.default_rng(seed), nulls)
        models = ModelSet(gate, alpha=alpha, most=most)
        model, entries = models.entries(without_aliases(models, models.search()))
        scatter = models.scatter(model, motion)
        # What moves whole parts at random is no repeat of their features: all is sought anew.
        of_parts = [item for item in scatter if item[0] in OF_PARTS]
        if len(of_parts) == len(motion):
            break
        motion = of_parts
    p = gate(models.columns(model), tuple(name for name, _, _ in scatter))
    offsets = {
        c.name: (p[c.name], _offset_class(models, model, c))
        for c in candidates
        if c.kind == "offset" and p.get(c.name, 1.0) <= alpha
    }
    checks = tuple((name, p[name]) for name in CHECKS if name in p)
    return Diagnosis(
        models=models,
        model=model,
        entries=entries,
        scatter=tuple(scatter),
        offsets=offsets,
        checks=checks,
        # Whole parts that move at random make a pattern, too.
        fired=tuple(n for n, value in checks if value <= alpha and not (motion and n == "pattern")),
        nameless=any(x.overtaken for x in entries) or models.nameless_wins(model),
        outliers=mask,
    )


def _offset_class(models: ModelSet, model: Model, offset: Candidate) -> dict[str, float]:
    """The offset, and effects that would make the same mean: with them the level may be 0."""
    design, like, a = models.design, models.likelihood, models.design.axis(offset)
    total, best = models.additions(model)
    logs = {offset.name: 0.0}
    for i in np.flatnonzero(np.isfinite(total)):
        item = best[i]
        if item < 0 or i in {design.members[m].candidate for m in models.members(model)}:
            continue
        means = design.columns.means[list(design.members[item].terms), a]
        if not np.any(np.abs(means) > 1e-9):
            continue
        level, u = like.level(like.fit(models.columns((*model, item))), a)
        # The offset pays for its column, as the effect does.
        paid = 0.5 * np.log1p(design.strata.shape[0])
        logs[models.names[i]] = float(
            total[i] - models.value(model) - 0.5 * (level / u) ** 2 + paid
        )
    odds = {name: np.exp(log) for name, log in logs.items() if log > -np.log(WINDOW)}
    return {name: float(x / sum(odds.values())) for name, x in odds.items()}


# Sizes.

STEP = 5e-7
"""Relative, of a searched value to either side, for the derivative by its logarithm."""
TRIALS = 5
COVERED = 0.95
PLACES = 20
"""Quantiles of its posterior over which a place between values is averaged."""


class Tangent(NamedTuple):
    """The derivative of an effect by the logarithm of what is searched, at the `sizes` of its
    parameters: its unit `column` and its norm.
    """

    column: int
    norm: float
    sizes: FloatArray


class Estimates(NamedTuple):
    """All mean effects of a model, as far as it says what they are, and the `members` that they
    are; `covariance` (k, k) of their sizes, then of the levels of all axes; `levels` (A,) are the
    remainder of the mean with the effects in the model. In mm or rad.
    """

    effects: tuple[FoundEffect, ...]
    members: tuple[Member, ...]
    levels: tuple[Parameter, ...]
    covariance: FloatArray
    fit: Fit


def searched_set(models: ModelSet, model: Model, item: int, member: Member) -> Searched | None:
    """The 95 % set of what was searched of one effect of a model, which is best at `member`; None
    where nothing was.

    It is the union of the profile-likelihood set and of the highest-posterior set, the prior
    uniform in the angle between columns: the first alone forgets values that the search could have
    hit.
    """
    design, like, form = models.design, models.likelihood, member.form
    if not form.searched:
        return None
    base = like.fit(models.columns(tuple(x for x in model if x != item)))
    items, arcs, (lowest, highest) = design.fine(member)
    values = np.array([design.members[m].value for m in items])
    gains = _gains(like, base, items)
    logs = gains / 2 + np.log(np.maximum(arcs, 1e-12))
    shares = np.exp(logs - np.logaddexp.reduce(logs))
    credible = gains.max() - gains <= chdtri(1, 1 - COVERED)
    ranked = np.argsort(-shares, kind="stable")
    credible[ranked[: 1 + int(np.searchsorted(np.cumsum(shares[ranked]), COVERED))]] = True
    # Runs of values; a gap of one value is bridged, as the grid may miss a peak.
    hits = np.flatnonzero(credible)
    ends = np.r_[2 * lowest - values[0], values, 2 * highest - values[-1]]
    lows, highs = (ends[:-2] + values) / 2, (ends[2:] + values) / 2
    places = np.zeros(0)
    if form.ends is not None:
        # Of all places between two of the data's values the errors are the same: a gap that is n
        # times as wide as most has n of them.
        after, widths = np.searchsorted(form.ends, values), np.diff(form.ends)
        lows, highs = np.minimum(lows, form.ends[after - 1]), np.maximum(highs, form.ends[after])
        quantiles = (np.arange(PLACES) + 0.5) / PLACES
        ends = np.cumsum([0.0, *shares[hits] / shares[hits].sum()])
        i = np.searchsorted(ends[1:-1], quantiles)
        gap = after[hits[i]] - 1
        counts = np.maximum(1.0, np.round(widths[gap] / np.median(widths)))
        inside = np.floor(counts * (quantiles - ends[i]) / (ends[i + 1] - ends[i]))
        inside = np.minimum(inside, counts - 1) + 0.5
        places = form.ends[gap] + inside * widths[gap] / counts
    runs = np.split(hits, np.flatnonzero(np.diff(hits) > 2) + 1)
    return Searched(
        name=form.searched,
        value=member.value,
        intervals=tuple((float(lows[run[0]]), float(highs[run[-1]])) for run in runs),
        places=tuple(places.tolist()),
    )


def without_aliases(models: ModelSet, model: Model) -> Model:
    """The model with a smooth profile in the place of each wave whose pitch has several intervals,
    where the profile is credible: regular places cannot decide between the aliases of a wave, and
    of these each predicts other errors between the places.
    """
    for item in models.members(model):
        member = models.design.members[item]
        searched = searched_set(models, model, item, member)
        if searched is None or len(searched.intervals) < 2:
            continue
        axis = models.design.candidates[member.candidate].axis
        smooth = [k for k in models.named if models.likelihood.kernels[k].axis == axis]
        total, best = models.additions(tuple(x for x in model if x != item))
        top = [i for x, i in zip(total, best, strict=True) if x > total.max() - np.log(WINDOW)]
        other = next((k for k in smooth if k in top), item)
        # The profile may be in the model already.
        model = tuple(dict.fromkeys(other if x == item else x for x in model))
    return model


def _gains(like: Likelihood, base: Fit, members: Sequence[int]) -> FloatArray:
    """The chi^2 that each of some members of a form adds to a fitted model, its margins and
    the common columns, the strata's variances those of the fit with the best of them.
    """
    design, k = like.design, len(like.design.members[members[0]].terms)
    added, inner = design.closures_of(members)
    added = np.where(np.isin(added, base.columns), PADDING, added)
    models, G = design.columns.crossed((added, inner), base.columns)
    w, b, ridge = base.weights, like.b[:, models], design.columns.precisions[models]
    result = np.zeros(len(models))
    for _ in range(2):
        A = np.einsum("s,smij->mij", w, G)
        diagonal = ridge + TINY * np.einsum("mii->mi", A)
        A += diagonal[:, :, None] * np.eye(models.shape[1])
        c = np.einsum("s,smi->mi", w, b)[:, :, None]
        sizes = np.linalg.solve(A, c)
        # What the margins explain is not the effect's.
        of_others = np.sum(c[:, k:] * np.linalg.solve(A[:, k:, k:], c[:, k:]), axis=(1, 2))
        result = np.sum(c * sizes, axis=(1, 2)) - of_others
        best = int(np.argmax(result))
        x = sizes[best, :, 0]
        R = like.R0 - 2 * b[:, best] @ x + np.einsum("i,sij,j->s", x, G[:, best], x)
        w = like.weights(np.maximum(R, 1e-12), base.dof)
    return result


def optimum_of(models: ModelSet, model: Model, item: int) -> tuple[int, Tangent | None]:
    """The member of an effect at the likeliest value of what is searched (Gauss-Newton from the
    grid's best), and its derivative there.
    """
    design, like, form = models.design, models.likelihood, models.design.members[item].form
    if form.scale in ("", "between"):
        return item, None
    rest = tuple(x for x in models.members(model) if x != item)
    smooth = models.columns(model)[len(like.closure(model)) :]
    best, tangent, top, m = item, None, -np.inf, item
    for _ in range(TRIALS):
        columns = like.closure((*rest, m)) + smooth
        if (now := like.log_likelihood(columns)) <= top + 1e-9:
            break
        best, tangent, top, member = m, None, now, design.members[m]
        sizes = like.fit(columns).sizes(member)[: len(form.parameters)]
        items = design.members_at(form, np.array(_beside(member.value)))
        if len(items) != 2:
            break
        weights = sizes / (2 * STEP)
        slope = weights @ (items[0].columns - items[1].columns)[: len(weights)]
        mean = weights @ (items[0].means - items[1].means)[: len(weights)]
        (index,), (norm,) = design.columns.add(items[0].at, slope[None], mean[None])
        if index == NONE:
            break
        tangent = Tangent(int(index), float(norm), sizes)
        change = np.clip(like.fit((tangent.column, *columns)).beta[0] / tangent.norm, -0.3, 0.3)
        value = np.clip(member.value * np.exp(change), form.grid.min(), form.grid.max())
        if not (items := design.members_at(form, np.array([value]))):
            break
        (m,) = design.add(member.candidate, items)
    return best, tangent


def _beside(value: float) -> tuple[float, float]:
    """The values between which the derivative at a searched one is taken."""
    return value * (1 + STEP), value * (1 - STEP)


def estimates_of(models: ModelSet, model: Model) -> Estimates:
    """Generalised least squares of all effects of a model at once, with the 95 % set of what was
    searched.
    """
    design, like = models.design, models.likelihood
    items = models.members(model)
    optima = [optimum_of(models, model, item) for item in items]
    smooth = (item for item in model if item < 0)
    closure = models.columns((*(best for best, _ in optima), *smooth))
    tangents = [tangent.column for _, tangent in optima if tangent is not None]
    fit = like.fit(tuple(dict.fromkeys((*closure, *tangents))))
    J, labels, starts = _map(design, fit.columns, optima)
    covariance, values = J @ fit.covariance @ J.T, J @ fit.beta
    bounded = list[int]()
    for (best, _), end in zip(optima, starts[1:], strict=True):
        value, grid = design.members[best].value, design.members[best].form.grid
        if labels[end - 1][2] == "searched":
            change, low, high = values[end - 1], grid.min() * (1 + 1e-9), grid.max() * (1 - 1e-9)
            if (value <= low and change < 0) or (value >= high and change > 0):
                bounded.append(end - 1)
    # What was searched does not leave its range; u is kept as if it could.
    cross = covariance[:, bounded]
    values = values - cross @ np.linalg.solve(cross[bounded], values[bounded])
    # Degrees of freedom (Satterthwaite) by the share of a column's information that comes from each
    # stratum; those of a sum of sizes are of the largest part in it.
    V, X = fit.covariance, design.columns.dense(fit.columns)
    G = design.columns.products(np.array(fit.columns, int), X)
    shares = fit.weights[:, None] * np.einsum("ij,sjk,ki->si", V, G, V) / np.diag(V)
    parts = np.abs(J) * np.sqrt(np.diag(V))
    sums = [np.sum(shares[:, np.argmax(p)] ** 2 / fit.dof) if p.any() else 0.0 for p in parts]
    dof = [float(1 / x) if x else np.inf for x in sums]
    for a, row in enumerate(range(starts[-1], len(labels))):
        mean, variance, nu = like.mean(fit, a)
        values[row] += mean
        covariance[row, row] += np.nan_to_num(variance)
        dof[row] = float(np.nan_to_num(nu, nan=np.inf))
    values, covariance = values * design.scale, covariance * design.scale**2
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    numbers = zip(labels, values.tolist(), u.tolist(), dof, strict=True)
    sizes = tuple(
        Parameter(name=name, unit=unit, role=role, value=value, u=s, dof=nu)
        for (name, unit, role), value, s, nu in numbers
    )
    effects, members = [], [design.members[best] for best, _ in optima]
    for item, member, (_, tangent), ends in zip(
        items, members, optima, pairwise(starts), strict=True
    ):
        form, rows = member.form, tuple(range(*ends))
        searched = searched_set(models, model, item, member)
        effects.append(
            FoundEffect(
                candidate=design.candidates[member.candidate],
                covariate=form.covariate,
                parameters=sizes[slice(*ends)],
                covariance=covariance[np.ix_(rows, rows)],
                rows=rows,
                equations=_equations(member, tangent, sizes[slice(*ends)], searched),
                chosen=form.chosen[member.chosen] if form.chosen else None,
                searched=searched,
            )
        )
    return Estimates(tuple(effects), tuple(members), sizes[starts[-1] :], covariance, fit)


def _map(
    design: Design, columns: Sequence[int], optima: Sequence[tuple[int, Tangent | None]]
) -> tuple[FloatArray, list[tuple[str, str, str]], list[int]]:
    """The linear map (n + A, k) from the sizes of the unit columns of a fit to those of the n
    parameters of effects and to the levels; name, unit and role of each of these; and where those
    of each effect begin and end.
    """
    axes, k = design.table.axes, len(columns)
    means = design.columns.means[list(columns)].reshape(k, len(axes)).copy()
    rows, labels, starts = list[FloatArray](), list[tuple[str, str, str]](), [0]
    # Of effects that share a column the first has it.
    places = {index: at for at, index in reversed([*enumerate(columns)])}
    for best, tangent in optima:
        member = design.members[best]
        form = member.form
        labels += [(name, u, "own") for name, u in form.parameters.items()]
        labels += [(n, u, "margin") for low in form.margins for n, u in low.parameters.items()]
        for index, factor, mean in zip(member.indices, member.factors, member.means, strict=True):
            rows.append(np.zeros(k))
            if (at := places.pop(index, None)) is not None:
                # Columns alike but for their mean are one: that of the effect counts.
                rows[-1][at], means[at] = 1 / factor, mean / factor
        if tangent is not None and (at := places.pop(tangent.column, None)) is not None:
            rows.append(np.zeros(k))
            rows[-1][at] = float(np.linalg.norm(tangent.sizes)) / tangent.norm
            unit = next(iter(form.parameters.values()))
            labels.append((f"{form.searched}_change", unit, "searched"))
        starts.append(len(rows))
    labels += [(f"level_{axis}", design.table.unit, "level") for axis in axes]
    return np.concatenate([np.reshape(rows, (len(rows), k)), -means.T]), labels, starts


def _equations(
    member: Member, tangent: Tangent | None, sizes: Sequence[Parameter], searched: Searched | None
) -> dict[str, str]:
    """The equations of an effect with its margins, and the change of what was searched: by its
    logarithm, the sizes in proportion. A place between values is averaged over its set.
    """
    bound, value = member.form, member.value
    places = (searched is not None and searched.places) or (value,)
    terms: dict[str, list[str]] = {}
    for form in (bound, *bound.margins):
        counts = Counter(pair for place in places for pair in form.texts(place).items())
        for (key, text), count in counts.items():
            weight = count / len(places)
            terms.setdefault(key, []).append(text if weight == 1 else f"{weight:g}*({text})")
    # Two effects that have the same change have it once.
    if tangent is not None and any(size.role == "searched" for size in sizes):
        direction = tangent.sizes / max(float(np.linalg.norm(tangent.sizes)), 1e-300)
        shares = dict(zip(bound.parameters, direction.tolist(), strict=True))
        above, below = (bound.texts(x, shares) for x in _beside(value))
        for key, text in above.items():
            difference = f"({text} - ({below[key]}))/{2 * STEP:g}"
            terms.setdefault(key, []).append(f"{bound.searched}_change*{difference}")
    return {key: " + ".join(texts) for key, texts in terms.items()}


def smooth_effect(likelihood: Likelihood, fit: Fit, kernel: Kernel) -> SmoothEffect:
    """The profile of a random function given a fitted model (BLUP), its amplitude averaged over
    its posterior, so that future values between the places are covered at any amplitude.
    """
    design, strata = likelihood.design, likelihood.design.strata
    (s,) = kernel.directions
    places = np.nan_to_num(design.table.mean_places)[:, AXES.index(kernel.along)]
    knots, at = np.unique(np.round(places, 6), return_inverse=True)
    part, (shared, basis) = strata.slices[s], strata.directions(s)
    centred = places - places.mean()
    line = basis.T @ centred
    N = np.sqrt(strata.shape[0]) * basis.T @ np.eye(len(knots))[at]
    y = fit.residual[part][shared]
    # Of readings the lines of the passes hold it: the rest of it is rounding.
    if np.linalg.norm(line) > 1e-9 * np.linalg.norm(centred):
        unit = line / np.linalg.norm(line)
        N, y = N - np.outer(unit, unit @ N), y - unit * (unit @ y)
    B = smooth_root(knots)
    scale = float(np.mean((B[at] ** 2).sum(axis=1)))
    U, sizes, V = np.linalg.svd(N, full_matrices=False)
    nonzero = sizes > 1e-9 * sizes[0]
    G, z = sizes[nonzero, None] * V[nonzero], U[:, nonzero].T @ y
    rest = float(fit.residual[part] @ fit.residual[part] - z @ z) + float(likelihood.extra[s])
    # The rest of the coordinates is the error that the profile is tested by.
    nu = max(round(fit.dof[s]) - len(z), 1)
    if nu < 2 or rest <= 0:
        rest, nu = float(fit.dof[s] / fit.weights[s]), round(fit.dof[s])
    values, covariance, amplitude2 = averaged(G, z, B / np.sqrt(scale), rest, nu)
    variance = rest / nu * design.scale**2
    # The level is estimated with those of all other effects: here it is taken out.
    centring = np.eye(len(knots)) - np.bincount(at) / len(at)
    return SmoothEffect(
        along=kernel.along,
        knots=knots,
        values=centring @ values * design.scale,
        covariance=centring @ covariance @ centring.T * variance,
        roughness=amplitude2 * variance / scale,
        dof=float(nu),
    )
