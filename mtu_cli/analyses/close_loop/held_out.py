"""Held out: everything is refitted without each block of parts, and predicts it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.analyses.close_loop.describe import described
from mtu_cli.analyses.close_loop.design import fitted_powers
from mtu_cli.analyses.close_loop.diagnosis import Diagnosis
from mtu_cli.analyses.close_loop.estimate import estimated
from mtu_cli.analyses.close_loop.result import FoundEffect, component_name
from mtu_cli.files.effects import CHOSEN
from mtu_cli.language import evaluate, parse
from mtu_cli.model.basis import TableShape
from mtu_cli.model.effect_library import choices
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

FOLDS = 5
FEWEST = 4
"""Parts from which on parts are held out, else columns of the table."""
BoolArray = NDArray[np.bool_]
Diagnose = Callable[[ResidualTable], Diagnosis]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """Errors (P, H, A) in mm of what was held out, `before` and `after` the correction by the
    machine as it would be written, and by the `averaged` one; `by` parts or columns; `names` that
    each fold found.
    """

    before: FloatArray
    after: FloatArray
    averaged: FloatArray
    by: str
    names: tuple[tuple[str, ...], ...]


def held_out(
    table: ResidualTable, diagnose: Diagnose, done: Callable[[int, int], None] | None = None
) -> HeldOut | None:
    """Scores of blocks of consecutive parts, or of every n-th column of few parts; None where
    there are too few of both.
    """
    P, H, _ = table.errors.shape
    by = "parts" if P >= FEWEST else "columns"
    size = P if by == "parts" else H
    if size < FEWEST:
        return None
    count = min(FOLDS, size)
    number = np.arange(size) * count // size if by == "parts" else np.arange(size) % count
    errors = np.full((3, *table.errors.shape), np.nan)
    names = []
    for fold in range(count):
        out = number == fold
        rest = only(table, ~out, by)
        found = diagnose(rest)
        effects = described(found, estimated(found.models, found.model))
        where = np.ix_(out) if by == "parts" else np.ix_(np.ones(P, bool), out)
        seen = np.ones((P, H), bool)
        seen[where] = False
        predicted = (
            0.0 * table.errors,
            of_written(effects, table),
            averaged(found, effects, table),
        )
        for own, values in zip(errors, predicted, strict=True):
            own[where] = corrected(table, values, seen)[where]
        names.append(tuple(found.names))
        if done is not None:
            done(fold + 1, count)
    before, after, mean = errors
    return HeldOut(before=before, after=after, averaged=mean, by=by, names=tuple(names))


def corrected(table: ResidualTable, predicted: FloatArray, seen: BoolArray) -> FloatArray:
    """Errors (P, H, A) less what is predicted, and less the components' polynomial fitted anew to
    what that leaves of the cells `seen` (P, H): readings that were fitted have seen themselves.
    """
    left = table.errors - predicted
    powers = fitted_powers(table)
    if powers.shape[1]:
        known = seen & table.there & np.isfinite(left).all(axis=2)
        count = known.sum(axis=0)
        mean = np.where(known[..., None], left, 0.0).sum(axis=0)[count > 0]
        sizes = np.linalg.lstsq(powers[count > 0], mean / count[count > 0, None], rcond=None)[0]
        left = left - powers @ sizes
    return left


def only(table: ResidualTable, kept: BoolArray, by: str) -> ResidualTable:
    """The table of some of its parts, or of its columns."""
    dimension = 0 if by == "parts" else 1

    def cut(values: FloatArray) -> FloatArray:
        if values.shape[dimension] != len(kept) or len(kept) == 1:
            return values
        return np.compress(kept, values, axis=dimension)

    def named(values: Sequence[str]) -> tuple[str, ...]:
        return tuple(value for value, keep in zip(values, kept, strict=True) if keep)

    parts = by == "parts"
    return replace(
        table,
        parts=named(table.parts) if parts else table.parts,
        features=table.features if parts else named(table.features),
        errors=cut(table.errors),
        repeats=np.compress(kept, table.repeats, axis=dimension),
        places=cut(table.places),
        operation=table.operation if parts else table.operation[kept],
        covariates={name: cut(values) for name, values in table.covariates.items()},
        common=cut(table.common),
        of_part=cut(table.of_part),
    )


def of_written(effects: Sequence[FoundEffect], table: ResidualTable) -> FloatArray:
    """The contribution (P, H, A) of effects as a machine is written with them; what is off by
    itself, a feature or an operation, is known as well.
    """
    kept = [effect for effect in effects if effect.table is not None or not effect.several]
    return contribution(kept, table)


def contribution(effects: Sequence[FoundEffect], table: ResidualTable) -> FloatArray:
    """What the equations of effects make of a table (P, H, A), mm, less what its datum frees."""
    total = np.zeros(table.errors.shape)
    columns: dict[str, Any] = dict(zip(AXES, np.moveaxis(table.places, 2, 0), strict=True))
    columns |= table.covariates
    for effect in effects:
        known = columns | {p.name: p.value for p in effect.all_parameters}
        if effect.over is not None:
            known[CHOSEN] = choices(table, effect.over).get(effect.chosen or "", 0.0)
        if effect.table is not None:
            shape = TableShape(at=effect.table.at_mm)
            along = columns[effect.table.of]
            values = shape.columns(along.ravel()) @ effect.table.values
            known[component_name(effect.name)] = values.reshape(along.shape)
        for key, text in effect.equations.items():
            total[..., table.axes.index(key[1:])] += evaluate(parse(text), known)
    return table.freed(total[..., None])[..., 0]


def averaged(found: Diagnosis, effects: Sequence[FoundEffect], table: ResidualTable) -> FloatArray:
    """The contribution (P, H, A) of the effects averaged over the names of each one's class by
    their posteriors (Hoeting, Madigan, Raftery & Volinsky, Stat. Sci. 14 (1999) 382), the other
    effects as they are.
    """
    best = contribution(effects, table)
    total = best.copy()
    for i, entry in enumerate(found.entries):
        whole = sum(p for _, _, p in entry.credible)
        for name, item, p in entry.credible:
            if item == entry.item:
                continue
            model = tuple(item if x == entry.item else x for x in found.model)
            entries = list(found.entries)
            entries[i] = replace(entry, item=item, name=name)
            other = replace(found, model=model, entries=tuple(entries))
            instead = described(other, estimated(found.models, model, sets=False))
            total += p / whole * (contribution(instead, table) - best)
    return total
