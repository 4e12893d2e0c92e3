"""What an analysis of variance has to warn of: figures that the data cannot give."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.settings import Warned
from mtu_cli.stats.anova import Components, OneWay

if TYPE_CHECKING:
    from mtu_cli.files.part import LoadedPart

MOST_NAMED = 6


def anova_warnings(
    tables: MeasuredTables, table: OneWay, components: Components, method: str, fewest: int
) -> list[Warned]:
    """Warnings on the tables of features; every figure that is missing has its reason here."""
    total = len(tables.labels)
    found: list[Warned] = []

    def warn(code: str, count: int, text: str) -> None:
        if count:
            some = "" if count == total else f"{count} of {total} tables: "
            found.append(Warned(code=code, message=some + text))

    warn(
        "one-part", int((table.df_between < 1).sum()),
        "there is one part only, so parts cannot be compared",
    )  # fmt: skip
    warn(
        "no-repeats", int(((table.df_within < 1) & (table.df_between > 0)).sum()),
        "no part was measured twice: part-to-part scatter and the CMM's cannot be told apart, "
        "and what is given for a future part holds both",
    )  # fmt: skip
    warn(
        "zero-variance", int(((table.df_within > 0) & (table.ms_within == 0)).sum()),
        "all repeats are equal, so that F and p cannot be had",
    )  # fmt: skip
    if method == "anova":
        warn(
            "negative-variance", int((components.part_estimate < 0).sum()),
            "the part-to-part variance is estimated below zero; 0 is used for uncertainties",
        )  # fmt: skip
    if method == "paper":
        warn(
            "paper-method", total,
            "--method paper takes MS_between for the part-to-part variance and leaves it out of "
            "the uncertainties, as Gilsinn & Ling 2004 do, eqs. (29)-(34)",
        )  # fmt: skip
    return [*found, *_empty(tables), *_few(tables, fewest)]


def _empty(tables: MeasuredTables) -> list[Warned]:
    empty = ~tables.cells.present
    if not empty.any():
        return []
    table, part = (int(index) for index in np.argwhere(empty)[0])
    name = " ".join(word for word in tables.labels[table] if word)
    text = (
        f"{int(empty.sum())} of {empty.size} cells are empty (first: part {tables.parts[part]!r} "
        f"was not measured at {name}); the rest is analysed with unequal counts"
    )
    return [Warned(code="empty-cells", message=text)]


def _few(tables: MeasuredTables, fewest: int) -> list[Warned]:
    if len(tables.parts) >= fewest or len(tables.parts) < 2:
        return []
    text = f"{len(tables.parts)} parts are too few to say which stands out; {fewest} are needed"
    return [Warned(code="few-parts", message=text)]


def missing_entries(
    part: LoadedPart, lengths: MeasuredTables | None, angles: MeasuredTables | None
) -> list[Warned]:
    """Lengths and angles of the part file that no measurement of a part has all features of."""
    found = []
    for what, entries, tables in (
        ("length", part.part.lengths, lengths),
        ("right angle", part.part.orthogonality, angles),
    ):
        known = set() if tables is None else {label[1] for label in tables.labels}
        lost = [entry.id for entry in entries if entry.id not in known]
        if lost:
            more = f" and {len(lost) - MOST_NAMED} more" if len(lost) > MOST_NAMED else ""
            text = (
                f"{what} {', '.join(lost[:MOST_NAMED])}{more} is left out: no measurement of a "
                "part, in one operation, has all of its features"
            )
            found.append(Warned(code="not-measured", message=text))
    return found
