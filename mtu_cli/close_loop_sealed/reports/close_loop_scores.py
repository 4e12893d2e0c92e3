"""Errors before and after, held out and in sample, as a table."""

from __future__ import annotations

from mtu_cli.close_loop_sealed.analyses.loop.result import Scores, TableResult
from mtu_cli.close_loop_sealed.analyses.loop.shown import things
from mtu_cli.close_loop_sealed.reports.close_loop_notes import left_text
from mtu_cli.close_loop_sealed.reports.close_loop_shown import plural, size_of
from mtu_cli.reports.numbers import significant, with_u
from mtu_cli.reports.tables import Column, Sheet

NO_BETTER = "held-out {by} are foretold no better with what was found than without"
FEWER = 0.97
"""Of the rms in sample, that of held-out parts below which it is told why it is less."""
WEIGHED = (
    "held out is foretold by all that the other {by} leave possible, by its probability; all data "
    "by what is written alone"
)


def before_after(item: TableResult) -> Sheet:
    """Rows of scores, and what is left below them."""
    unit, axes = item.table.unit, list(item.before.rms_by_axis)
    row, column = things(item)
    rows = []
    if item.held_out_by is not None:
        by = plural(row if item.held_out_by == "parts" else column)
        rows += [
            [f"held-out {by}, before", *_scores(item, item.before)],
            [f"held-out {by}, after", *_scores(item, item.after)],
        ]
    rows += [
        ["all data, before", *_scores(item, item.in_sample_before)],
        ["all data, after", *_scores(item, item.in_sample_after)],
    ]
    if not item.effects:
        rows = rows[::2]
    columns = [
        Column(title=f"errors, {unit}", text=True),
        Column(title="rms"),
        *[Column(title=f"rms {axis}") for axis in axes],
        Column(title="95 %"),
        Column(title="largest"),
        Column(title="chi2/dof"),
    ]
    return Sheet(
        title="Before and after" if item.effects else "Measured minus predicted",
        columns=columns,
        rows=rows,
        notes=_notes(item),
    )


def _notes(item: TableResult) -> list[str]:
    """What there is to compare the errors with, and what is left."""
    notes, (row, column) = [], things(item)
    if item.floor is not None:
        notes.append(
            f"repeatability {significant(size_of(item, item.floor))} {item.table.unit}; 95 % and "
            "largest: of the error vector's length"
        )
    if item.effects and item.held_out_by and item.after.rms >= item.before.rms:
        by = plural(row if item.held_out_by == "parts" else column)
        notes.append(NO_BETTER.format(by=by))
    of_parts = bool(item.effects) and item.held_out_by == "parts"
    if of_parts and item.after.rms < FEWER * item.in_sample_after.rms:
        notes.append(WEIGHED.format(by=plural(row)))
    if item.gross:
        notes.append(_without_outliers(item))
    left = left_text(item)
    return [*notes, *([left] if left is not None else [])]


def _without_outliers(item: TableResult) -> str:
    """What the figures leave out, and what the held-out rms is with it."""
    count = len(item.gross)
    said = f"without {count} {'entry' if count == 1 else 'entries'} set aside"
    if item.held_out_with_gross is None:
        return said
    before, after = (
        significant(size_of(item, scores.rms), 3) for scores in item.held_out_with_gross
    )
    rms = f"{before} -> {after}" if item.effects else before
    return f"{said}; held out with {'it' if count == 1 else 'them'}: rms {rms} {item.table.unit}"


def _scores(item: TableResult, scores: Scores) -> list[str]:
    values = [scores.rms, *scores.rms_by_axis.values(), scores.p95, scores.largest]
    return [
        *(with_u(size_of(item, value), size_of(item, scores.rms))[0] for value in values),
        significant(scores.chi2_per_dof),
    ]
