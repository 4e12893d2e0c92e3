"""What does the model lack? The residual traced to effects, with error rates that hold."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.clamped import shift_warnings
from mtu_cli.close_loop_sealed.analyses.loop.fitted import beside_polynomial
from mtu_cli.close_loop_sealed.analyses.loop.loose import loose_warnings
from mtu_cli.close_loop_sealed.analyses.loop.one_table import LoopResult, loop_on
from mtu_cli.close_loop_sealed.analyses.loop.result import (
    VERDICTS,
    CloseLoopResult,
    Experiment,
    FoundEffect,
    Judged,
    Scores,
    TableResult,
    Verdict,
)
from mtu_cli.close_loop_sealed.analyses.loop.share_done import ShareDone
from mtu_cli.close_loop_sealed.analyses.loop.warnings import judged_tables, loop_warnings
from mtu_cli.close_loop_sealed.model.effect_library import EffectLibrary, candidates
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.findings import Finding
from mtu_cli.stats.monte_carlo import Progress
from mtu_cli.stats.threads import one_blas_thread

__all__ = [
    "VERDICTS",
    "CloseLoopResult",
    "Experiment",
    "FoundEffect",
    "Judged",
    "Scores",
    "TableResult",
    "Verdict",
    "close_loop",
]
WORST: tuple[Verdict, ...] = ("unexplained", "class", "named", "none")


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

    One table of points, or one a component of readings: these share the rate (Bonferroni).
    The verdict is the weakest of all tables. `progress` hears (done, total) meanwhile.

    Raises InputError for a name in `exclude` that the library does not have, and for a table of
    too few entries.
    """
    tables, short = judged_tables(tables)
    rate = alpha / len(tables)
    found = []
    # The order of sums depends on the number of threads; bytes must not.
    with one_blas_thread():
        for number, table in enumerate(tables):
            tell = ShareDone(progress, number, len(tables))
            own = beside_polynomial(table, candidates(table, library, exclude))
            found.append(
                loop_on(table, own, library, alpha=rate, most=max_effects, seed=seed, tell=tell)
            )
    results = tuple(_adjusted(item.result, len(tables)) for item in found)
    return CloseLoopResult(
        verdict=min((item.verdict for item in results), key=WORST.index),
        tables=results,
        alpha=alpha,
        datum=tables[0].datum,
        covariance=_joint(found),
        warnings=(*short, *_warnings(results, max_effects)),
    )


def _warnings(results: Sequence[TableResult], most: int) -> Iterator[Finding]:
    """On all tables, each searched for `most` causes."""
    yield from loop_warnings(results, most)
    for warned in (loose_warnings, shift_warnings):
        for result in results:
            yield from warned(result)


def _adjusted(result: TableResult, tables: int) -> TableResult:
    """Family-wise p over all tables (Bonferroni)."""
    if tables == 1:
        return result

    def p(value: float) -> float:
        return min(1.0, value * tables)

    return replace(
        result,
        effects=tuple(replace(e, p_familywise=p(e.p_familywise)) for e in result.effects),
        checks=tuple((name, p(value)) for name, value in result.checks),
        candidates=tuple(
            c if c.p_familywise is None else replace(c, p_familywise=p(c.p_familywise))
            for c in result.candidates
        ),
    )


def _joint(found: Sequence[LoopResult]) -> np.ndarray:
    sizes = [len(item.covariance) for item in found]
    total = np.zeros((sum(sizes), sum(sizes)))
    start = 0
    for item, size in zip(found, sizes, strict=True):
        total[start : start + size, start : start + size] = item.covariance
        start += size
    return total
