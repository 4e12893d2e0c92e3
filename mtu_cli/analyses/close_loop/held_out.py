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
    few parts, every n-th column, with its errors (3, P, H, A) as they are `corrected`. None where
    there are too few of both.
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
        errors[:, cells] = corrected(diagnosis, effects_of(diagnosis), table, ~cells)[:, cells]

    with workers(min(count + 1, available_threads())) as executor:
        future = executor.submit(diagnose, table)
        for fold, _ in enumerate(executor.map(predict, range(count))):
            progress(fold + 1, count)
    return future.result(), (table.plurals[axis], errors)


def corrected(
    diagnosis: Diagnosis, effects: Sequence[FoundEffect], table: ResidualTable, cells: BoolArray
) -> FloatArray:
    """Errors (3, P, H, A), mm, less nothing, what the machine as it would be written predicts, and
    the model average; and less the components' polynomial fitted anew to the rest in the `cells`
    (P, H): the residuals of readings that were fitted are too small.

    The average is over the names of each effect's class by their posteriors (Hoeting, Madigan,
    Raftery & Volinsky, Stat. Sci. 14 (1999) 382), the other effects as they are.
    """
    # A feature or an operation is known as well; of several ranges that fit none is written.
    written = [x for x in effects if x.table is not None or not x.ambiguous]
    best = _predicted(effects, table)
    averaged = best.copy()
    for entry in diagnosis.entries:
        norm = sum(p for _, _, p in entry.credible)
        for name, item, p in entry.credible:
            if item != entry.item:
                rival = replace(entry, item=item, name=name)
                other = replace(
                    diagnosis,
                    model=tuple(item if x == entry.item else x for x in diagnosis.model),
                    entries=tuple(rival if x is entry else x for x in diagnosis.entries),
                )
                averaged += p / norm * (_predicted(effects_of(other), table) - best)
    predicted = np.array([np.zeros(best.shape), _predicted(written, table), averaged])
    result = table.errors - predicted
    powers = fitted_powers(table)
    for rest in result if powers.shape[1] else ():
        valid = cells & table.there & np.isfinite(rest).all(axis=2)
        count = valid.sum(axis=0)
        mean = np.where(valid[..., None], rest, 0.0).sum(axis=0)[count > 0]
        sizes = np.linalg.lstsq(powers[count > 0], mean / count[count > 0, None], rcond=None)[0]
        rest -= powers @ sizes
    return result


def _predicted(effects: Sequence[FoundEffect], table: ResidualTable) -> FloatArray:
    """What the equations of effects make of a table (P, H, A), mm, less what its datum frees."""
    total = np.zeros(table.errors.shape)
    columns: dict[str, Any] = dict(zip(AXES, np.moveaxis(table.places, 2, 0), strict=True))
    columns |= table.covariates
    for effect in effects:
        variables = columns | {p.name: p.value for p in effect.parameters}
        if (over := effect.candidate.over) is not None:
            variables[CHOSEN] = choices(table, over).get(effect.chosen or "", 0.0)
        if effect.table is not None:
            along = columns[effect.table.along]
            values = TableShape(at=effect.table.knots).columns(along.ravel()) @ effect.table.values
            variables[effect.component] = values.reshape(along.shape)
        for key, text in effect.equations.items():
            total[..., table.axes.index(key[1:])] += evaluate(parse(text), variables)
    return table.without_datum(total[..., None])[..., 0]


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
