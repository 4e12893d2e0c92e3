"""The diagnosis of one table: outliers, strata and candidates as a likelihood, search, verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mtu_cli.analyses.close_loop.design import Design, smooth_covariance
from mtu_cli.analyses.close_loop.estimate import Estimates, estimates_of, without_aliases
from mtu_cli.analyses.close_loop.gate import CHECKS, Gate, level_of, lever_of
from mtu_cli.analyses.close_loop.likelihood import Likelihood
from mtu_cli.analyses.close_loop.model_set import WINDOW, Entry, Model, ModelSet, Scatter
from mtu_cli.analyses.close_loop.strata import (
    INTERACTION,
    LINE,
    PART,
    Missing,
    Strata,
    interaction,
    outliers,
    strata_of,
)
from mtu_cli.model.effect_library import Candidate
from mtu_cli.model.residuals import ResidualTable
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
        several = any(len(x.credible) > 1 for x in self.entries)
        several |= any(len(credible) > 1 for _, credible in self.offsets.values())
        several |= any(entry.nameless for entry in self.entries)
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
    measured = np.isfinite(table.errors).all(axis=2) & table.there
    mask = outliers(table.errors, measured, free_lines(table), steps_of(table))
    errors = np.where(mask.any(axis=2, keepdims=True), np.nan, table.errors)
    table = replace(table, errors=errors)
    motion = list[Scatter]()
    while True:
        likelihood = likelihood_of(table, candidates, [name for name, _, _ in motion])
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
        level, u = level_of(like, like.fit(models.columns((*model, item))), a)
        # The offset pays for its column, as the effect does.
        paid = 0.5 * np.log1p(design.strata.shape[0])
        logs[models.names[i]] = float(
            total[i] - models.value(model) - 0.5 * (level / u) ** 2 + paid
        )
    odds = {name: np.exp(log) for name, log in logs.items() if log > -np.log(WINDOW)}
    return {name: float(x / sum(odds.values())) for name, x in odds.items()}


# A table as a likelihood.

NOTABLE = 0.05
"""Share of the level's predicted variance from which a line's scatter is a stratum."""
SAME = 1e-6
"""Of a direction; less is rounding."""


def likelihood_of(
    table: ResidualTable, candidates: Sequence[Candidate], scatter: Sequence[str] = ()
) -> Likelihood:
    """The likelihood of a table's errors in its strata with the columns of its candidates, given
    motions of whole parts that `scatter`, each a line, the last of each axis.
    """
    measured = np.isfinite(table.errors).all(axis=2) & table.there
    gaps = Missing(measured, free_lines(table))
    errors = np.moveaxis(gaps.filled(np.moveaxis(table.errors, -1, 0)), 0, -1)
    steps = steps_of(table)
    inner = max(float(np.std(interaction(E, gaps.lines))) for E in np.moveaxis(errors, 2, 0))
    largest = float(np.abs(errors).max())
    sizes = (inner, float(np.std(errors)), float(steps.max()), largest)
    scale = next((size for size in sizes if size > 1e-12 * max(largest, 1e-300)), 1.0)
    errors, steps = errors / scale, steps / scale
    strata = _strata(table, errors, scatter)
    design = Design(table, strata, candidates, scale, gaps)
    # Degrees of freedom: less the missing cells and what a datum freed.
    P, _, A = strata.shape
    n, axis = strata.sizes.copy(), np.array(strata.axis)
    n[strata.of(INTERACTION)] -= np.sum(~measured)
    of_axis, _, j = strata.cells
    lost = np.zeros(len(n))
    for motion in table.motions:
        Q = motion.Q.reshape(len(motion.columns), A, -1)
        of_basis = np.einsum("hak,ahj->akj", Q, strata.of_features[:, motion.columns])
        share = np.sum(of_basis**2, axis=1)[of_axis, j]
        lost += np.bincount(strata.labels(), share, len(n)) * len(motion.rows) / P
    # A stratum that the datum takes whole is rounding.
    n = np.where(n - lost > 1e-6 * n, np.maximum(n - lost, 1.0), 0.0)
    design.kernels = tuple(k for k in design.kernels if all(n[s] > 0 for s in k.directions))
    y = np.where(n[strata.labels()] > 0, strata.coordinates(errors), 0.0)
    variance = np.zeros(len(steps))
    for s in strata.of(INTERACTION):
        part = y[strata.slices[s]]
        variance[axis[s]] = part @ part / max(n[s], 1.0)
    least = steps[axis] ** 2 / 12
    # Repeats that scatter less than half a step share their rounding: so do means of features.
    first = strata.at[:, 0]
    means = np.isin(np.arange(len(axis)), strata.labels()[first[first >= 0]])
    shared = means & (variance[axis] < steps[axis] ** 2 / 4)
    least = np.where(shared, P * least, least)
    # What the model's D tells of the parts' scatter, but for the lines of `scatter`.
    squares, dof = np.zeros((2, len(n)))
    F, nu = table.of_part / scale, min(float(table.pass_dof), 1e4)
    lines = [sum(axis[t] == a for t in strata.of(LINE)) - len(scatter) for a in range(A)]
    for s in (*strata.of(PART), *strata.of(LINE)) if F.shape[3] else ():
        a, line = strata.axis[s], int(strata.place[strata.slices[s].start]) % strata.shape[1]
        if n[s] == 0 or line > lines[a]:
            continue
        direction = strata.of_features[a][:, line]
        size = float(np.mean(np.sum(np.einsum("h,phr->pr", direction, F[:, :, a]) ** 2, 1)))
        if size > 0:
            dof[s], squares[s] = nu, nu * (variance[a] + size)
    return Likelihood(design, y, errors.mean(axis=(0, 1)), n, (squares, dof), least)


def steps_of(table: ResidualTable) -> FloatArray:
    """The resolution (A,) of errors, mm."""
    steps = np.zeros(table.errors.shape[2])
    steps[: len(table.resolution)] = table.resolution
    return steps


def free_lines(table: ResidualTable) -> FloatArray:
    """Orthonormal directions (H, k) in which each part is free: its level, and of readings the
    slope, direction, and both, along which passes move.
    """
    columns = [np.ones(len(table.features))]
    if table.component is not None:
        along = _along(table)
        columns += [] if along is None else [along]
        sign = next((v for k, v in table.covariates.items() if k.startswith("dir_")), None)
        if sign is not None and sign.shape == (1, len(table.features)):
            columns.append(np.asarray(sign[0], float))
            columns += [] if along is None else [sign[0] * (along - along.mean())]
    X = np.column_stack(columns)
    rest = np.abs(np.diag(np.linalg.qr(X, mode="r")))
    Q, R = np.linalg.qr(X[:, rest > 1e-8 * np.linalg.norm(X, axis=0)])
    return np.asarray(Q * np.sign(np.diag(R)))


def _strata(table: ResidualTable, errors: FloatArray, moving: Sequence[str]) -> Strata:
    """With a line for each motion of whole parts in `moving`, and of readings the bends of each
    pass: the REML estimate of their variance, from differences between passes.
    """
    P, H, A = errors.shape
    readings = table.component is not None
    lines = _lines(table)
    levers = (lever_of(name, table.axes, table.mean_places) for name in moving)
    for lever in (x for x in levers if x is not None):
        for a in range(A):
            rest = lever[:, a] - lever[:, a].mean()
            rest = rest - lines[a] @ (lines[a].T @ rest)
            if (size := float(np.linalg.norm(rest))) > SAME:
                lines[a] = np.column_stack([lines[a], rest / size])
    along = _along(table) if readings and P >= 3 else None
    if along is None:
        # Along a line of a single part nothing is separable from its scatter, unless that is known.
        estimable = P > 1 or table.of_part.shape[3] > 0
        return strata_of(
            P, lines, features_scatter=not readings, moving=len(moving), lines_known=estimable
        )
    rough = smooth_covariance(along)
    strata = strata_of(P, lines, features_scatter=False, roughness=rough)
    y, (_, i, j) = strata.coordinates(errors), strata.cells
    inner = np.isin(strata.labels(), strata.of(INTERACTION)) & (i > 0)
    squares, count = (np.bincount(j[inner], w, H) for w in (y[inner] ** 2, np.ones(inner.sum())))
    grid = np.concatenate([[0.0], np.geomspace(0.01, 1000, 40)])
    spread = 1 + grid[:, None] * strata.bends
    rss = np.maximum((squares / spread).sum(axis=1), 1e-300)
    deviance = (count * np.log(spread)).sum(axis=1) + count.sum() * np.log(rss)
    return replace(strata, spread=np.sqrt(spread[int(np.argmin(deviance)), j]))


def _along(table: ResidualTable) -> FloatArray | None:
    """Places (H,) along the axis that the readings of a component were taken along."""
    places = table.mean_places
    spans = np.nan_to_num(np.ptp(places, axis=0))
    i = int(np.argmax(spans))
    return places[:, i] if spans[i] > 0 and len(np.unique(places[:, i])) > 3 else None


def _lines(table: ResidualTable) -> list[FloatArray]:
    """Orthonormal directions (H, k) by axis along which whole parts move beside their level."""
    _, H, A = table.errors.shape
    if table.component is not None:
        return [free_lines(table)[:, 1:]] * A
    result = []
    for F in np.moveaxis(table.of_part.mean(axis=0), 1, 0):
        size = max(float(np.sum(F.mean(axis=0) ** 2)) * H, 1e-300)
        U, s, _ = np.linalg.svd(F - F.mean(axis=0), full_matrices=False)
        result.append(U[:, s**2 > NOTABLE * size][:, :2])
    return result
