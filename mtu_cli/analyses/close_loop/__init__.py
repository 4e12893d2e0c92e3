"""What does the model lack? The residual traced to effects, with error rates that hold.

1. Errors are split into strata, each with one variance (`strata`, `posed`); single entries far off
   are set aside (`missing`).
2. Every candidate of the library is evaluated as columns with its margins (`forms`, `design`).
3. One family-wise test says whether anything is there (`gate`); a set of models is searched through
   it, and evidence says what (`likelihood`, `model_set`).
4. Sizes, margins, levels and what was searched are estimated together (`estimate`, `smooth`).
5. Everything is done again without each block of parts, which scores the written machine
   (`held_out`); the experiment that would separate a class is chosen (`experiment`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.analyses.close_loop.crossings import crossings
from mtu_cli.analyses.close_loop.describe import compared, described
from mtu_cli.analyses.close_loop.detectable import minimum_detectable
from mtu_cli.analyses.close_loop.diagnosis import Diagnosis, diagnosed
from mtu_cli.analyses.close_loop.estimate import Estimates, estimated
from mtu_cli.analyses.close_loop.forms import candidates_of
from mtu_cli.analyses.close_loop.held_out import averaged, corrected, held_out, of_written
from mtu_cli.analyses.close_loop.likelihood import Fit
from mtu_cli.analyses.close_loop.posed import Posed
from mtu_cli.analyses.close_loop.result import (
    WORST,
    CloseLoopResult,
    Judged,
    Scores,
    TableResult,
)
from mtu_cli.analyses.close_loop.strata import INTERACTION
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.effects import EffectLibrary, marks
from mtu_cli.files.part import REFERENCE_TEMPERATURE
from mtu_cli.model.effect_library import TableData
from mtu_cli.model.effect_ranges import NEAR_K
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import Progress
from mtu_cli.stats.threads import one_blas_thread

__all__ = ["CloseLoopResult", "TableResult", "close_loop"]


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
    verdict is the weakest of all tables. `progress` hears (done, total) meanwhile.

    Raises InputError for a name in `exclude` that the library does not have.
    """
    found = []
    with one_blas_thread():  # The order of sums depends on the number of threads; bytes must not.
        for number, table in enumerate(tables):

            def tell(done: int, of: int | None, number: int = number) -> None:
                if progress is not None and of is not None:
                    progress(number * of + done, len(tables) * of)

            found.append(
                _one_table(
                    table, library, exclude, alpha / len(tables), max_effects, seed,
                    len(tables), tell,
                )
            )  # fmt: skip
    return CloseLoopResult(
        verdict=min((item.verdict for item in found), key=WORST.index),
        tables=tuple(found),
        alpha=alpha,
        datum=tables[0].datum,
    )


def _one_table(
    table: ResidualTable,
    library: EffectLibrary,
    exclude: Collection[str],
    alpha: float,
    most: int,
    seed: int,
    tables: int,
    tell: Progress,
) -> TableResult:
    shown = (0, 1)

    def diagnose(own: ResidualTable) -> Diagnosis:
        candidates = candidates_of(own, library, exclude)
        return diagnosed(own, candidates, alpha=alpha, most=most, seed=seed, tell=again)

    def again() -> None:
        tell(*shown)

    def show(done: int, of: int) -> None:
        nonlocal shown
        shown = (1 + done, of + 1)
        again()

    found = diagnose(table)
    sizes = estimated(found.models, found.model)
    out = held_out(table, diagnose, show)
    effects = described(found, sizes)
    found_at = _constant_temperatures(found, library)
    seen = table.there & ~found.outliers.any(axis=2)
    after, mean = (
        corrected(table, predicted, seen)
        for predicted in (of_written(effects, table), averaged(found, effects, table))
    )
    effects = tuple(
        replace(item, p_familywise=min(1.0, item.p_familywise * tables), found_at=found_at)
        for item in compared(effects, found, sizes, () if out is None else out.names)
    )
    # Chi^2 against the strata's variances, of one coordinate.
    variance = _entry_variance(found, sizes)
    covariance = sizes.covariance * found.posed.scale**2
    scored = (table.errors, after, mean)
    held = scored if out is None else (out.before, out.after, out.averaged)

    def score(errors: FloatArray) -> Scores:
        return scores(np.where(seen[..., None], errors, np.nan), table.axes, variance)

    return TableResult(
        table=table,
        verdict=found.verdict,  # type: ignore[arg-type]
        effects=effects,
        candidates=_judged(found, tables, minimum_detectable(found, alpha)),
        checks=tuple((name, min(1.0, p * tables)) for name, p in found.checks),
        fired=found.fired,
        nameless=found.nameless,
        set_aside=_set_aside(found, table),
        explained=table.errors - after,
        before=score(held[0]),
        after=score(held[1]),
        after_averaged=score(held[2]),
        in_sample_before=score(table.errors),
        in_sample_after=score(after),
        held_out_by=None if out is None else out.by,
        floor=_repeatability(found.posed, sizes.fit),
        crossings=crossings(effects, covariance, table),
        covariance=covariance,
        stopped=found.models.stopped,
    )


def _repeatability(posed: Posed, fit: Fit) -> float | None:
    """Standard deviation of single entries beside the means of parts and of features, at least
    that of rounding; None where there are no such.
    """
    strata, variances = posed.strata, []
    for s in strata.of(INTERACTION):
        rest = fit.residual[strata.slices[s]]
        rounding = posed.steps[strata.axis[s]] ** 2 / 12
        variances.append(max(float(rest @ rest / fit.dof[s]), float(rounding)))
    return posed.scale * float(np.sqrt(np.mean(variances))) if variances else None


def _constant_temperatures(found: Diagnosis, library: EffectLibrary) -> dict[str, float]:
    """Temperatures, degC, that are the same in all data of points and not near 20 degC, where an
    effect of a temperature is a candidate: what any effect is at 20 degC is then not known.
    """
    table = found.posed.table
    thermal = {own.family.family for own in library.families if "T" in marks(str(own.family))}
    if table.component or thermal.isdisjoint(c.family for c in found.posed.design.candidates):
        return {}
    data = TableData.of(table)
    steady = [name for name in data.values if is_temperature(name) and name not in data.changing]
    at = {name: data.number(name, "0") for name in steady}
    return {name: T for name, T in at.items() if abs(T - REFERENCE_TEMPERATURE) > NEAR_K}


def _entry_variance(found: Diagnosis, sizes: Estimates) -> FloatArray:
    """The variance (A,) of a single entry by the variances of its strata, mm^2."""
    strata = found.posed.strata
    P, H, A = strata.shape
    total = np.zeros(A)
    for s, n in enumerate(strata.sizes):
        if sizes.fit.weights[s] > 0:
            total[strata.axis[s]] += n / sizes.fit.weights[s]
    return np.asarray(total / (P * H) * found.posed.scale**2)


def scores(errors: FloatArray, axes: Sequence[str], variance: FloatArray) -> Scores:
    """Of errors (P, H, A), nan where they do not count."""
    there = np.isfinite(errors).all(axis=2)
    own = errors[there]
    length = np.sqrt((own**2).sum(axis=1))
    return Scores(
        rms=float(np.sqrt(np.mean(own**2))),
        by_axis={axis: float(np.sqrt(np.mean(own[:, a] ** 2))) for a, axis in enumerate(axes)},
        p95=float(np.quantile(length, 0.95)),
        largest=float(length.max()),
        chi2_per_dof=float(np.mean(own**2 / variance)) if (variance > 0).all() else None,
    )


def _judged(found: Diagnosis, tables: int, smallest: Mapping[str, float]) -> tuple[Judged, ...]:
    models, table = found.models, found.posed.table
    p = models.gate(()).p | dict(found.scatter)
    total, _ = models.additions(())
    with np.errstate(over="ignore"):
        shares = np.exp(total - total.max(initial=0.0))
    shares = shares / max(float(shares.sum()), 1e-300)
    judged = []
    for i, candidate in enumerate(models.design.candidates):
        seen = np.isfinite(total[i]) or candidate.name in p
        reason = candidate.unavailable or models.design.unavailable.get(candidate.name)
        finite = bool(np.isfinite(total[i]))
        judged.append(
            Judged(
                name=candidate.name,
                family=candidate.family,
                component=table.component,
                p_familywise=min(1.0, p[candidate.name] * tables) if candidate.name in p else None,
                log_bayes_factor=float(total[i]) if finite else None,
                posterior=float(shares[i]) if finite else None,
                unavailable=None if seen else reason or "this data cannot tell it apart",
                minimum_detectable=smallest.get(candidate.name) if seen else None,
            )
        )
    return tuple(judged)


def _set_aside(found: Diagnosis, table: ResidualTable) -> tuple[tuple[str, str, str, float], ...]:
    return tuple(
        (table.features[h], table.parts[p], table.axes[a], float(table.errors[p, h, a]))
        for p, h, a in np.argwhere(found.outliers)
    )
