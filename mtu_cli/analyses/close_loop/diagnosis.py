"""The diagnosis of one table: outliers, search, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mtu_cli.analyses.close_loop.design import Design
from mtu_cli.analyses.close_loop.estimate import Estimates, estimates_of, without_aliases
from mtu_cli.analyses.close_loop.gate import CHECKS, Gate, level_of
from mtu_cli.analyses.close_loop.likelihood import Likelihood
from mtu_cli.analyses.close_loop.model_set import SHARE, WINDOW, Entry, Model, ModelSet
from mtu_cli.analyses.close_loop.posed import free_lines, likelihood_of, steps_of
from mtu_cli.analyses.close_loop.strata import BoolArray, outliers
from mtu_cli.model.effect_library import Candidate
from mtu_cli.model.residuals import ResidualTable

OF_PARTS = {"rotation-scatter", "scale-scatter"}
"""Scatter effects that make a pattern of part x feature."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Offset:
    """A mean that is not zero, with its p and its class: names with their posterior."""

    name: str
    p: float
    credible: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What one table says: the model, its entries the strongest first, scatter effects with their p
    and ratio of deviations, offsets, and checks that fired.
    """

    likelihood: Likelihood
    models: ModelSet
    model: Model
    entries: tuple[Entry, ...]
    scatter: tuple[tuple[str, float, float], ...]
    offsets: tuple[Offset, ...]
    checks: tuple[tuple[str, float], ...]
    fired: tuple[str, ...]
    nameless: bool
    outliers: BoolArray

    @property
    def design(self) -> Design:
        """Of the table, its candidates and strata."""
        return self.likelihood.design

    @cached_property
    def sizes(self) -> Estimates:
        """The sizes of the effects of its model."""
        return estimates_of(self.models, self.model)

    @property
    def names(self) -> list[str]:
        """The names of all effects."""
        scatter = (name for name, _, _ in self.scatter)
        return [*(x.name for x in self.entries), *scatter, *(x.name for x in self.offsets)]

    @property
    def verdict(self) -> str:
        """Whether all that was found has a name, and one name."""
        if self.fired or self.nameless:
            return "unexplained"
        if not self.names:
            return "none"
        several = any(len(x.credible) > 1 for x in self.entries)
        several |= any(len(x.credible) > 1 for x in self.offsets)
        several |= any(entry.nameless > 1 - SHARE for entry in self.entries)
        return "class" if several else "named"


def diagnosis_of(
    table: ResidualTable,
    candidates: Sequence[Candidate],
    *,
    alpha: float,
    most: int,
    seed: int,
) -> Diagnosis:
    """The diagnosis of a table at the family-wise rate `alpha`, with `most` effects at most."""
    measured = np.isfinite(table.errors).all(axis=2) & table.there
    mask = outliers(table.errors, measured, free_lines(table), steps_of(table))
    errors = np.where(mask.any(axis=2, keepdims=True), np.nan, table.errors)
    table = replace(table, errors=errors)
    motion: list[tuple[str, float, float]] = []
    while True:
        likelihood = likelihood_of(table, candidates, [name for name, _, _ in motion])
        gate = Gate(likelihood, np.random.default_rng(seed))
        models = ModelSet(likelihood, gate, alpha=alpha, most=most)
        model, entries = models.entries(without_aliases(models, models.search()))
        scatter = motion + models.scatter(model, [name for name, _, _ in motion])
        # What moves whole parts at random is no repeat of their features: all is sought anew.
        of_parts = [item for item in scatter if item[0] in OF_PARTS]
        if len(of_parts) == len(motion):
            break
        motion = of_parts
    p = gate(models.columns(model), tuple(name for name, _, _ in scatter))
    offsets = [
        Offset(name=c.name, p=p[c.name], credible=_offset_class(models, model, c))
        for c in candidates
        if c.kind == "offset" and p.get(c.name, 1.0) <= alpha
    ]
    checks = tuple((name, p[name]) for name in CHECKS if name in p)
    return Diagnosis(
        likelihood=likelihood,
        models=models,
        model=model,
        entries=entries,
        scatter=tuple(scatter),
        offsets=tuple(offsets),
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
        level, u, _ = level_of(like, like.fit(models.columns((*model, item))), a)
        # The offset pays for its column, as the effect does.
        paid = 0.5 * np.log1p(design.strata.shape[0])
        logs[models.names[i]] = float(
            total[i] - models.value(model) - 0.5 * (level / u) ** 2 + paid
        )
    odds = {name: np.exp(log) for name, log in logs.items() if log > -np.log(WINDOW)}
    return {name: float(x / sum(odds.values())) for name, x in odds.items()}
