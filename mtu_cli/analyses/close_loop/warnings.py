"""What a user has to know about how the loop was closed, and what is too little to close it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mtu_cli.analyses.close_loop.result import CloseLoopResult, TableResult
from mtu_cli.files.contract import is_identifier
from mtu_cli.files.covariates import looks_like_temperature
from mtu_cli.findings import Finding, counted, error, finding
from mtu_cli.model.effect_library import TableData
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import larger_scatter
from mtu_cli.units import UNITS, p_text

FEW_PARTS, FEWEST_ENTRIES = 5, 4
ALL = 0.999
"""Share of the squares of errors that nothing but themselves explains."""
APART = 2.0
"""Scatter of the passes' means over that of single readings, from which on it is warned of."""
RATE, TWICE = 1e-3, 2.0
"""Chance of any warning of scatter, and the least ratio of standard deviations for one."""
FEWEST_FEATURES, LEAST = 6, 0.1
"""Features that are compared, and the share of a variance that a part's line leaves at least."""
COPY = 1 - 1e-9
"""Correlation of columns from which on one tells no more than the other."""
FREES = {
    "offset": "trend, step, and drift and warm-up but for what changes within a part",
    "offset,rotation": "trend, step, rotation, squareness, and drift and warm-up but for what "
    "changes within a part",
    "offset,diameter": "trend, step, a scale of both axes alike, and drift and warm-up but for "
    "what changes within a part",
}
"""What cannot be seen any more where a best-fit alignment is removed from each part."""


def judged_tables(tables: Sequence[ResidualTable]) -> tuple[list[ResidualTable], list[Finding]]:
    """The tables with enough to separate an effect from scatter, and a warning of each other one.

    Raises InputError where none has.
    """
    lacking = [_lacking(table) for table in tables]
    if None not in lacking:
        what, expected = lacking[0] or ("no readings", "readings")
        raise error("too-little-data", what=what, expected=expected)
    kept = [table for table, lack in zip(tables, lacking, strict=True) if lack is None]
    return kept, [finding("too-few", what=lack[0]) for lack in lacking if lack is not None]


def _lacking(table: ResidualTable) -> tuple[str, str] | None:
    """What there is too little of to judge by, and what there should be."""
    P, H = table.there.shape
    of = "" if table.component is None else f" of {table.component}"
    part, feature = ("passes", "positions") if of else ("parts", "features")
    if max(P, H) < FEWEST_ENTRIES:
        expected = f"{FEWEST_ENTRIES} or more of one or the other"
        return f"{P} by {H} {part} and {feature}{of}", expected
    alone = int((table.there.sum(axis=1) == 1).sum())
    if min(P, H) > 1 and alone > P / 2:
        what = f"{alone} of {P} {part}{of} have one of the {feature}"
        return what, f"one value in column {part[:4]!r} for all {feature} measured in one go"
    return None


def loop_warnings(result: CloseLoopResult, most: int) -> Iterator[Finding]:
    """Warnings of a search for `most` effects in each table."""
    for item in result.tables:
        table, row = item.table, item.nouns[0]
        of = "" if table.component is None else f" of {table.component}"
        if len(table.parts) < FEW_PARTS:
            number = counted(len(table.parts), row, "passes" if row == "pass" else "")
            hard = f"what changes from {row} to {row} can hardly be separated from its scatter"
            name = table.component or "all features"
            yield finding("few-parts", parts=number, items=name, consequence=hard)
        if item.set_aside:
            entries = [f"{feature} of {part}" for feature, part, *_ in item.set_aside]
            yield finding("outliers-set-aside", entries=entries, of=of)
        if item.stopped:
            yield finding("max-effects", most=counted(most, "effect"), of=of)
        if table.there.mean() < 0.5:
            yield finding("sparse-table", of=of)
        for name, others in _copies(table).items():
            copy = "the one is a copy of the other" + of
            yield finding("not-separable", what=name, others=others, consequence=copy)
        for effect in item.effects:
            if effect.family == "covariate" and effect.explained_share > ALL:
                facts = {"covariate": effect.covariate, "effect": effect.name}
                yield finding("covariate-is-the-error", **facts, of=of)
        if table.component is None:
            yield from _scattering(item)
        elif item.floor and (apart := _passes_apart(item, item.floor)) > APART * item.floor:
            sizes = (float(f"{s / UNITS[table.unit].to_internal:.2g}") for s in (apart, item.floor))
            scatter = dict(zip(("apart", "s"), sizes, strict=True))
            yield finding("passes-apart", component=table.component, unit=table.unit, **scatter)
    columns = dict.fromkeys(name for item in result.tables for name in item.table.covariates)
    odd = [name for name in columns if not (is_identifier(name) or looks_like_temperature(name))]
    if odd:
        yield finding("not-used", what="columns", names=odd, reason="no equation can name them")
    if result.datum in FREES:
        yield finding("datum-freed", datum=result.datum, unseen=FREES[result.datum])


def _passes_apart(item: TableResult, floor: float) -> float:
    """Standard deviation of the means of passes, beyond what single readings make of it; 0 where a
    report says how they scatter: more than that is a finding.
    """
    table = item.table
    if table.of_part.shape[3] or len(table.parts) < 2:
        return 0.0
    left = np.where(table.there, (table.errors - item.explained)[..., 0], 0.0)
    count = np.maximum(table.there.sum(axis=1), 1)
    variance = np.var(left.sum(axis=1) / count, ddof=1) - floor**2 * np.mean(1 / count)
    return float(np.sqrt(max(variance, 0.0)))


def _scattering(item: TableResult) -> Iterator[Finding]:
    """Features, and parts, that scatter by more than twice as much as the others, beside a line
    along each axis that every part may have for itself.
    """
    table = item.table
    P, H = table.there.shape
    if P < FEW_PARTS or H < FEWEST_FEATURES:
        return
    excluded = {(part, feature) for feature, part, *_ in item.set_aside}
    sound = [
        [(part, feature) not in excluded for feature in table.features] for part in table.parts
    ]
    known = table.there & np.array(sound)
    left, lost = _beside_lines(
        table, np.where(known[..., None], table.errors - item.explained, np.nan)
    )
    unit = UNITS[table.unit].to_internal
    for noun, names, turned, taken in (
        ("feature", table.features, left, 1),
        ("part", table.parts, left.swapaxes(0, 1), lost),
    ):
        each = [larger_scatter(turned[..., a], taken) for a in range(len(table.axes))]
        s, others, p = (np.array(own) for own in zip(*each, strict=True))
        p = np.minimum(1.0, p * p.size)
        for i in np.flatnonzero(((p < RATE) & (s > TWICE * others)).any(axis=0)):
            a = int(np.argmin(p[:, i]))
            facts = {"s": f"{table.axes[a]} {s[a, i] / unit:.2g}", "p": p_text(float(p[a, i]))}
            facts |= {"what": f"{noun} {names[i]}", "others": f"{others[a, i] / unit:.2g}"}
            yield finding("feature-scatters", **facts)


def _beside_lines(table: ResidualTable, left: FloatArray) -> tuple[FloatArray, int]:
    """Residuals (P, H, A) about the features' means and a line of each part, and the degrees of
    freedom that a part loses by it.
    """
    left = left - np.nanmean(left, axis=0)
    places = np.nan_to_num(table.mean_places)
    places = places[:, np.ptp(places, axis=0) > 0]
    X = np.column_stack([np.ones(len(places)), places - places.mean(axis=0)])
    for part in left:
        known = np.isfinite(part).all(axis=1)
        Q = np.linalg.qr(X[known])[0]
        share = np.maximum(1 - np.sum(Q**2, axis=1), LEAST)
        part[known] = (part[known] - Q @ (Q.T @ part[known])) / np.sqrt(share)[:, None]
    return left - np.nanmean(left, axis=0), X.shape[1]


def _copies(table: ResidualTable) -> dict[str, list[str]]:
    """Columns that others are copies of, but for their scale and zero."""
    data = TableData.of(table)
    own = [name for name in data.values if name in data.changing and name in table.covariates]
    centred = [np.broadcast_to(data.values[n], table.there.shape)[table.there] for n in own]
    centred = [value - value.mean() for value in centred]
    unit = np.array([value / max(float(np.linalg.norm(value)), 1e-300) for value in centred])
    alike = np.abs(unit @ unit.T) > COPY if own else np.zeros((0, 0), bool)
    first = {name: own[int(np.argmax(row))] for name, row in zip(own, alike, strict=True)}
    return {
        name: others
        for name in own
        if (others := [other for other in own if other != name and first[other] == name])
    }
