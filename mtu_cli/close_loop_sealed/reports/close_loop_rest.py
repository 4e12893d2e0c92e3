"""What close-loop says of what is left beside the effects, and of what has no name."""

from __future__ import annotations

from mtu_cli.close_loop_sealed.analyses.loop.result import TableResult
from mtu_cli.close_loop_sealed.analyses.loop.shown import column_text, entry_text, most_left, things
from mtu_cli.close_loop_sealed.reports.close_loop_shown import in_words, size_of
from mtu_cli.reports.numbers import with_u

ROUNDING = 1e-7
"""Share of the figure beside it below which an error is gone, but for the rounding of numbers."""
NO_MORE = 1.1
"""Times the repeatability up to which what is left is told to be that."""


def nameless_text(item: TableResult) -> str:
    """What may be there and has no name."""
    names = " and ".join(map(in_words, item.nameless))
    explain, are = ("explains", "is") if len(item.nameless) == 1 else ("explain", "are")
    return (
        f"{names} {explain} as much as the names do, or {are} likely in the place of one "
        "or beside them"
    )


def rest_text(item: TableResult) -> str:
    """What is left, and where most of it is; nothing to look for where it is only scatter."""
    _, column = things(item)
    where = most_left(item)
    at_place = column_text(where.column, item)
    rest, floor, *at = together(item, item.unexplained_rms, item.floor, where.along, where.there)
    left = f"What is left has an rms of {rest} {item.table.unit}"
    if item.floor is not None and item.unexplained_rms is not None:
        scatter = item.unexplained_rms < NO_MORE * item.floor
        if scatter and not (item.fired or item.twofold):
            return f"{left}: about repeatability ({floor})."
    along = f"along {where.axis.upper()} ({at[0]} {item.table.unit}), and there "
    left += f": most {along if item.table.component is None else ''}at {column} {at_place}"
    left += f" ({at[1]} {item.table.unit})"
    known = "" if item.floor is None else f"; repeatability is {floor} {item.table.unit}"
    return f"{left}{known}."


def together(item: TableResult, *values: float | None) -> list[str]:
    """Sizes beside one another to the same place: two digits of the smallest, as long as the
    largest has no more than four; what is smaller than that place has two of its own.
    """
    shown = [size_of(item, value) for value in values]
    known = [value for value in shown if value]
    largest = max(known, default=0.0)
    last = max(min(known, default=1.0), 0.01 * largest)
    return [
        with_u(value, min(value, last) if value and value > ROUNDING * largest else last)[0]
        for value in shown
    ]


def beside_gross(item: TableResult) -> str:
    """What was set aside is nothing that the model lacks, and yet is not in order."""
    count = len(item.gross)
    if not count:
        return ""
    first = entry_text(item.gross[0], item)
    return (
        f" beside {first}, set aside as far off"
        if count == 1
        else (f" beside {count} entries set aside as far off ({first} and so on)")
    )
