"""What a user has to know about how the loop was closed, and what is too little to close it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mtu_cli.analyses.close_loop.result import CloseLoopResult
from mtu_cli.findings import Finding, counted, error, finding
from mtu_cli.model.residuals import ResidualTable

FEW_PARTS, FEWEST_ENTRIES = 5, 4
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
        if item.excluded:
            entries = [f"{feature} of {part}" for feature, part, *_ in item.excluded]
            yield finding("outliers-set-aside", entries=entries, of=of)
        if item.stopped:
            yield finding("max-effects", most=counted(most, "effect"), of=of)
    if result.datum in FREES:
        yield finding("datum-freed", datum=result.datum, unseen=FREES[result.datum])
