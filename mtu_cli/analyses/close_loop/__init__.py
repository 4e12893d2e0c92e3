"""What does the model lack? The residual traced to effects, with error rates that hold.

1. Too small tables are left out; errors are split into strata, each with one variance (`strata`,
   `likelihood`); single entries far off are excluded.
2. Every candidate of the library is evaluated as columns with its margins (`design`).
3. One family-wise test says whether anything is there (`gate`); a set of models is searched through
   it, and evidence says what (`likelihood`, `model_set`, `diagnosis`). An offset that says no more
   than where an effect is counted from is none (`describe`).
4. Sizes, margins, levels and what was searched are estimated together (`diagnosis`) and stated as
   equations of the machine (`describe`).
5. Everything is done again without each block of parts, which scores the written machine
   (`_held_out`); the experiment that would separate a class is chosen (`experiment`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mtu_cli.analyses.close_loop.describe import crossings, effects_of, without_references
from mtu_cli.analyses.close_loop.diagnosis import Diagnosis, diagnosis_of
from mtu_cli.analyses.close_loop.experiment import minimum_detectable
from mtu_cli.analyses.close_loop.result import (
    WORST,
    CloseLoopResult,
    FoundEffect,
    Judged,
    Scores,
    TableResult,
)
from mtu_cli.files.effects import CHOSEN, EffectLibrary
from mtu_cli.findings import Finding, counted, error, finding
from mtu_cli.language import evaluate, parse
from mtu_cli.model.effect_library import NOTHING_LEFT, candidates_of, choices
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.kernels import weights
from mtu_cli.stats.least_squares import BoolArray, FloatArray, submodel_average
from mtu_cli.stats.monte_carlo import Progress
from mtu_cli.stats.threads import available_threads, one_blas_thread, workers
from mtu_cli.units import UNITS

NULLS, NULLS_OF_FOLD = 299, 99
"""Tables without effects for a p that is reported, and for what passes without a block of parts."""
FEW_PARTS, FEWEST_ENTRIES = 5, 4
MOST_OPTIONAL = 8
"""Sizes that may be 0: the models are all their combinations, whose number doubles with each."""


def close_loop(
    tables: Sequence[ResidualTable],
    library: EffectLibrary,
    *,
    alpha: float,
    max_effects: int,
    exclude: Collection[str] = (),
    seed: int,
    progress: Progress | None = None,
) -> CloseLoopResult:
    """Searches residuals for undeclared effects at the family-wise rate `alpha`.

    One table of points, or one a component of readings: these share the rate (Bonferroni). The
    verdict is the weakest of all tables. `progress` is called with (done, total).

    Raises InputError for a name in `exclude` that the library does not have, and where no table has
    enough to separate an effect from scatter.
    """
    large, findings = _large_enough(tables)
    rate = alpha / len(large)

    def one_table(number: int, table: ResidualTable) -> TableResult:
        def advance(part: int, parts: int) -> None:
            if progress is not None:
                progress(number * parts + part, len(large) * parts)

        def diagnose(subset: ResidualTable) -> Diagnosis:
            candidates = candidates_of(subset, library, exclude)
            nulls = NULLS if subset is table else NULLS_OF_FOLD
            diagnosis = diagnosis_of(
                subset, candidates, alpha=rate, most=max_effects, seed=seed, nulls=nulls
            )
            return without_references(diagnosis)

        advance(0, 1)
        validation = _held_out(table, diagnose, advance)
        return _result(*validation, table, len(large))

    with one_blas_thread():  # The order of sums depends on the number of threads; bytes must not.
        results = tuple(one_table(number, table) for number, table in enumerate(large))
    return CloseLoopResult(
        verdict=min((item.verdict for item in results), key=WORST.index),
        tables=results,
        alpha=alpha,
        warnings=(*findings, *_warnings(results, max_effects)),
    )


def _large_enough(tables: Sequence[ResidualTable]) -> tuple[list[ResidualTable], list[Finding]]:
    """The tables with enough to separate an effect from scatter, and a warning of each other one.

    Raises InputError where none has.
    """
    large, small = list[ResidualTable](), list[tuple[str, str]]()
    for table in tables:
        P, H = table.there.shape
        of = "" if table.component is None else f" of {table.component}"
        part, feature = table.plurals
        single = int((table.there.sum(axis=1) == 1).sum())
        if max(P, H) < FEWEST_ENTRIES:
            expected = f"{FEWEST_ENTRIES} or more of one or the other"
            small.append((f"{P} by {H} {part} and {feature}{of}", expected))
        elif min(P, H) > 1 and single > P / 2:
            what = f"{single} of {P} {part}{of} have one of the {feature}"
            expected = f"one value in column {part[:4]!r} for all {feature} measured in one go"
            small.append((what, expected))
        else:
            large.append(table)
    if not large:
        what, expected = small[0] if small else ("no readings", "readings")
        raise error("too-little-data", what=what, expected=expected)
    return large, [finding("too-few", what=what) for what, _ in small]


def _result(
    diagnosis: Diagnosis, held_out: str, errors: FloatArray, table: ResidualTable, tables: int
) -> TableResult:
    """The diagnosis of one of `tables`, with the `errors` of what was held out."""
    covariance = diagnosis.sizes.covariance
    effects = effects_of(diagnosis, compare=True)
    effects = tuple(replace(e, p_familywise=min(1.0, e.p_familywise * tables)) for e in effects)
    valid = table.there & ~diagnosis.outliers.any(axis=2)
    _, after, _ = _corrected(diagnosis, effects, table, valid)
    variance, floor = _scatter(diagnosis)

    def rms(errors: FloatArray) -> float:
        return float(np.sqrt(np.mean(errors**2)))

    def scores(errors: FloatArray) -> Scores:
        vectors = errors[valid & np.isfinite(errors).all(axis=2)]
        length = np.sqrt((vectors**2).sum(axis=1))
        return Scores(
            rms=rms(vectors),
            by_axis={axis: rms(vectors[:, a]) for a, axis in enumerate(table.axes)},
            p95=float(np.quantile(length, 0.95)),
            largest=float(length.max()),
            chi2_per_dof=float(np.mean(vectors**2 / variance)) if (variance > 0).all() else None,
        )

    return TableResult(
        table=table,
        verdict=diagnosis.verdict,
        effects=effects,
        candidates=_candidate_tests(diagnosis, tables),
        checks=tuple((name, min(1.0, p * tables)) for name, p in diagnosis.checks),
        fired=diagnosis.fired,
        nameless=diagnosis.nameless,
        outliers=diagnosis.outliers,
        explained=table.errors - after,
        before=scores(errors[0]),
        after=scores(errors[1]),
        after_averaged=scores(errors[2]),
        in_sample_before=scores(table.errors),
        in_sample_after=scores(after),
        held_out=held_out,
        floor=floor,
        crossings=crossings(effects, covariance, table),
        covariance=covariance,
        stopped=diagnosis.models.stopped,
    )


def _scatter(diagnosis: Diagnosis) -> tuple[FloatArray, float | None]:
    """What the effects leave: the variance (A,) of one coordinate by all that scatters, and the
    repeatability, of single entries about the means of parts and of features, of readings about the
    lines of passes and what all have alike, at least that of rounding; None where there are none.
    """
    design, strata, fit = diagnosis.design, diagnosis.design.strata, diagnosis.sizes.fit
    P, H, A = strata.shape
    axis, live = np.array(strata.axis), fit.weights > 0
    total = np.bincount(axis[live], strata.sizes[live] / fit.weights[live], minlength=A)
    mean_squares, steps = list[float](), design.table.steps / design.scale
    for s in strata.of("interaction"):
        # What readings have alike in all passes is no repeatability.
        varies = strata.cells[1][strata.slices[s]] > 0
        X = design.columns.dense(fit.columns)[:, strata.slices[s]][:, varies]
        leverage = fit.weights[s] * np.einsum("ik,ij,jk->", X, fit.covariance, X)
        if (dof := diagnosis.models.likelihood.n[s] - np.sum(~varies) - leverage) > 0:
            square = np.sum(fit.residual[strata.slices[s]][varies] ** 2) / dof
            mean_squares.append(max(square, steps[axis[s]] ** 2 / 12))
    variance = np.asarray(total * design.scale**2 / (P * H), float)
    return variance, design.scale * float(np.sqrt(np.mean(mean_squares))) if mean_squares else None


def _candidate_tests(diagnosis: Diagnosis, tables: int) -> tuple[Judged, ...]:
    """All candidates, each added alone to the model of the machine."""
    models, smallest = diagnosis.models, minimum_detectable(diagnosis)
    p = models.gate(()) | {name: p for name, p, _ in diagnosis.scatter}
    total, _ = models.additions(())
    shares = np.exp(total - total.max(initial=0.0))
    shares = shares / max(float(shares.sum()), 1e-300)
    results = []
    for candidate, gain, share in zip(models.design.candidates, total, shares, strict=False):
        name, finite = candidate.name, bool(np.isfinite(gain))
        tested = finite or name in p
        results.append(
            Judged(
                candidate=candidate,
                p_familywise=min(1.0, p[name] * tables) if name in p else None,
                log_bayes_factor=float(gain) if finite else None,
                posterior=float(share) if finite else None,
                unavailable=None if tested else candidate.unavailable or NOTHING_LEFT,
                minimum_detectable=smallest.get(name) if name in p else None,
            )
        )
    return tuple(results)


def _warnings(results: Sequence[TableResult], most: int) -> Iterator[Finding]:
    """What a user has to know of a search for `most` effects in each table."""
    for item in results:
        table, component, row = item.table, item.table.component, item.table.nouns[0]
        of = "" if component is None else f" of {component}"
        if len(table.parts) < FEW_PARTS:
            number = counted(len(table.parts), row, table.plurals[0])
            hard = f"what changes from {row} to {row} can hardly be separated from its scatter"
            items = component or "all features"
            yield finding("few-parts", parts=number, items=items, consequence=hard)
        if item.outliers.any():
            entries = [
                f"{table.features[h]} of {table.parts[p]} in {table.axes[a]}"
                for p, h, a in np.argwhere(item.outliers)
            ]
            errors = (table.errors[item.outliers] / UNITS[table.unit].to_internal).tolist()
            facts = {"errors": errors, "unit": table.unit}
            yield finding("outliers-set-aside", entries=entries, of=of, **facts)
        if item.stopped:
            yield finding("max-effects", most=counted(most, "effect"), of=of)


# Held out.

FOLDS = (7, 5)
"""Of parts, of columns; blocks of parts are short: what changes with time has to be followed."""


def _held_out(
    table: ResidualTable,
    diagnose: Callable[[ResidualTable], Diagnosis],
    progress: Callable[[int, int], None],
) -> tuple[Diagnosis, str, FloatArray]:
    """The diagnosis of all; what was held out, parts in blocks that follow each other or, of few
    parts, every n-th column; and its errors (3, P, H, A) as they are `_corrected`.
    """
    axis = 0 if len(table.parts) >= FEWEST_ENTRIES else 1
    size = table.errors.shape[axis]
    count = min(FOLDS[axis], size)
    number = np.arange(size) * count // size if axis == 0 else np.arange(size) % count
    errors = np.full((3, *table.errors.shape), np.nan)

    def predict(fold: int) -> None:
        test = number == fold
        cells = np.broadcast_to(np.expand_dims(test, 1 - axis), table.there.shape)
        diagnosis = diagnose(table.taken(np.flatnonzero(~test), axis))
        errors[:, cells] = _corrected(diagnosis, effects_of(diagnosis), table, ~cells)[:, cells]

    with workers(min(count + 1, available_threads())) as executor:
        future = executor.submit(diagnose, table)
        for fold, _ in enumerate(executor.map(predict, range(count))):
            progress(fold + 2, count + 1)
    return future.result(), table.plurals[axis], errors


def _corrected(
    diagnosis: Diagnosis, effects: Sequence[FoundEffect], table: ResidualTable, cells: BoolArray
) -> FloatArray:
    """Errors (3, P, H, A), mm, less nothing, what the machine as it would be written predicts, and
    the model average; and less the components' polynomial fitted anew to the rest in the `cells`
    (P, H): the residuals of readings that were fitted are too small.

    The average is over the names of each effect's class by their posteriors, and over whether its
    margins and levels are there (Hoeting, Madigan, Raftery & Volinsky, Stat. Sci. 14 (1999) 382).
    """
    # A feature or an operation is known as well; of several ranges that fit none is written. The
    # level beside an outlier is that of the others, which no effect corrects.
    written = [x for x in effects if x.table is not None or not x.ambiguous]
    outliers = [x for x in effects if x.candidate.kind == "outlier"]
    no_level = {p.row: 0.0 for x in outliers for p in x.of_role("level")}
    named = _predicted(effects, table, _averaged(diagnosis, effects))
    averaged = named.copy()
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
                rivals = effects_of(other)
                change = _predicted(rivals, table, _averaged(other, rivals)) - named
                averaged += p / norm * change
    predicted = [np.zeros(named.shape), _predicted(written, table, no_level), averaged]
    result = table.errors - np.array(predicted)
    powers = table.fitted_powers
    for rest in result if powers.shape[1] else ():
        valid = cells & table.there & np.isfinite(rest).all(axis=2)
        known = valid.any(axis=0)
        mean = rest[:, known].mean(axis=0, where=valid[:, known, None])
        rest -= powers @ np.linalg.lstsq(powers[known], mean, rcond=None)[0]
    return result


def _averaged(diagnosis: Diagnosis, effects: Sequence[FoundEffect]) -> dict[int, float]:
    """Sizes by row, averaged over whether margins and levels, of many the least certain, are 0."""
    sizes = {p.row: p for x in effects if x.table is None for p in x.parameters if p.u > 0}
    rows, values = [*sizes], np.array([p.value for p in sizes.values()])
    optional = [i for i, p in enumerate(sizes.values()) if p.role in ("margin", "level")]
    optional.sort(key=lambda i: abs(values[i]) / sizes[rows[i]].u)
    C, parts = diagnosis.sizes.covariance[np.ix_(rows, rows)], diagnosis.design.strata.shape[0]
    mean = submodel_average(values, C, optional[:MOST_OPTIONAL], parts)
    return dict(zip(rows, mean.tolist(), strict=True))


def _predicted(
    effects: Sequence[FoundEffect], table: ResidualTable, sizes: Mapping[int, float]
) -> FloatArray:
    """What the equations of effects make of a table (P, H, A), mm, less what its datum frees; with
    other `sizes` of some parameters by their rows.
    """
    total = np.zeros(table.errors.shape)
    columns: dict[str, Any] = dict(zip(AXES, np.moveaxis(table.places, 2, 0), strict=True))
    columns |= table.covariates
    for effect in effects:
        variables = columns | {p.name: sizes.get(p.row, p.value) for p in effect.parameters}
        if (over := effect.candidate.over) is not None:
            variables[CHOSEN] = choices(table, over).get(effect.chosen or "", 0.0)
        if effect.table is not None:
            along = columns[effect.table.along]
            values = weights(effect.table.knots, along.ravel()) @ effect.table.values
            variables[effect.component] = values.reshape(along.shape)
        for key, text in effect.equations.items():
            total[..., table.axes.index(key[1:])] += evaluate(parse(text), variables)
    return table.without_datum(total[..., None])[..., 0]
