"""Held out: everything is refitted without each block of parts, and predicts it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import compress
from typing import Any

import numpy as np

from mtu_cli.analyses.close_loop.describe import effects_of
from mtu_cli.analyses.close_loop.design import fitted_powers
from mtu_cli.analyses.close_loop.diagnosis import Diagnosis
from mtu_cli.analyses.close_loop.result import FoundEffect
from mtu_cli.files.effects import CHOSEN
from mtu_cli.language import evaluate, parse
from mtu_cli.model.effect_library import choices
from mtu_cli.model.estimates import TableShape
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import BoolArray, FloatArray
from mtu_cli.stats.threads import available_threads, workers

FOLDS = (7, 5)
"""Of parts, of columns; blocks of parts are short: what changes with time has to be followed."""
FEWEST = 4
"""Parts from which on parts are held out, else columns of the table."""


def held_out(
    table: ResidualTable,
    diagnose: Callable[[ResidualTable], Diagnosis],
    progress: Callable[[int, int], None],
) -> tuple[Diagnosis, tuple[str, FloatArray] | None]:
    """The diagnosis of all; and what was held out, parts in blocks that follow each other or, of
    few parts, every n-th column, with its errors (3, P, H, A), mm: before, after the correction by
    the machine as it would be written, and by the model average. None where there are too few of
    both.
    """
    axis = 0 if len(table.parts) >= FEWEST else 1
    size = table.errors.shape[axis]
    if size < FEWEST:
        return diagnose(table), None
    count = min(FOLDS[axis], size)
    number = np.arange(size) * count // size if axis == 0 else np.arange(size) % count
    errors = np.full((3, *table.errors.shape), np.nan)

    def predict(fold: int) -> None:
        test = number == fold
        cells = np.broadcast_to(np.expand_dims(test, 1 - axis), table.there.shape)
        diagnosis = diagnose(subset(table, ~test, axis))
        effects = effects_of(diagnosis)
        predicted = (np.zeros(table.errors.shape), contribution(effects, table, written=True))
        for i, values in enumerate((*predicted, model_average(diagnosis, effects, table))):
            errors[i][cells] = remainder(table, values, ~cells)[cells]

    with workers(min(count + 1, available_threads())) as executor:
        future = executor.submit(diagnose, table)
        for fold, _ in enumerate(executor.map(predict, range(count))):
            progress(fold + 1, count)
    return future.result(), (table.plurals[axis], errors)


def remainder(table: ResidualTable, predicted: FloatArray, cells: BoolArray) -> FloatArray:
    """Errors (P, H, A) less what is predicted, and less the components' polynomial fitted anew to
    the rest in the `cells` (P, H): the residuals of readings that were fitted are too small.
    """
    rest = table.errors - predicted
    powers = fitted_powers(table)
    if powers.shape[1]:
        valid = cells & table.there & np.isfinite(rest).all(axis=2)
        count = valid.sum(axis=0)
        mean = np.where(valid[..., None], rest, 0.0).sum(axis=0)[count > 0]
        sizes = np.linalg.lstsq(powers[count > 0], mean / count[count > 0, None], rcond=None)[0]
        rest = rest - powers @ sizes
    return rest


def subset(table: ResidualTable, mask: BoolArray, axis: int) -> ResidualTable:
    """The table of some of its parts (axis 0), or of its columns (1)."""
    name = ("parts", "features")[axis]

    def cut(values: FloatArray) -> FloatArray:
        full = values.shape[axis] == len(mask)  # Or alike in all parts, or columns.
        return np.compress(mask, values, axis=axis) if full else values

    of_cells = ("errors", "repeats", "places", "common", "of_part")
    fields: dict[str, Any] = {name: cut(getattr(table, name)) for name in of_cells}
    fields[name] = tuple(compress(getattr(table, name), mask))
    fields["covariates"] = {name: cut(values) for name, values in table.covariates.items()}
    if axis == 1:
        fields["operation"] = table.operation[mask]
    return replace(table, **fields)


def contribution(
    effects: Sequence[FoundEffect], table: ResidualTable, *, written: bool = False
) -> FloatArray:
    """What the equations of effects make of a table (P, H, A), mm, less what its datum frees; only
    of those that are `written`, or off by themselves: a feature or an operation is known as well.
    """
    total = np.zeros(table.errors.shape)
    columns: dict[str, Any] = dict(zip(AXES, np.moveaxis(table.places, 2, 0), strict=True))
    columns |= table.covariates
    for effect in effects:
        if written and effect.ambiguous and effect.table is None:
            continue
        variables = columns | {p.name: p.value for p in effect.parameters}
        if (over := effect.candidate.over) is not None:
            variables[CHOSEN] = choices(table, over).get(effect.chosen or "", 0.0)
        if effect.table is not None:
            shape = TableShape(at=effect.table.knots)
            along = columns[effect.table.along]
            values = shape.columns(along.ravel()) @ effect.table.values
            variables[effect.component] = values.reshape(along.shape)
        for key, text in effect.equations.items():
            total[..., table.axes.index(key[1:])] += evaluate(parse(text), variables)
    return table.without_datum(total[..., None])[..., 0]


def model_average(
    diagnosis: Diagnosis, effects: Sequence[FoundEffect], table: ResidualTable
) -> FloatArray:
    """The contribution (P, H, A) of the effects averaged over the names of each one's class by
    their posteriors (Hoeting, Madigan, Raftery & Volinsky, Stat. Sci. 14 (1999) 382), the other
    effects as they are.
    """
    best = contribution(effects, table)
    total = best.copy()
    for i, entry in enumerate(diagnosis.entries):
        norm = sum(p for _, _, p in entry.credible)
        for name, item, p in entry.credible:
            if item == entry.item:
                continue
            model = tuple(item if x == entry.item else x for x in diagnosis.model)
            entries = list(diagnosis.entries)
            entries[i] = replace(entry, item=item, name=name)
            rival = replace(diagnosis, model=model, entries=tuple(entries))
            total += p / norm * (contribution(effects_of(rival), table) - best)
    return total
