"""The table of mean squares of anova, for what its other tables list."""

from __future__ import annotations

from collections.abc import Iterable

from mtu_cli.analyses.anova import Analysed
from mtu_cli.reports.anova_words import UNITS
from mtu_cli.reports.numbers import MISSING, significant
from mtu_cli.reports.tables import Column, Sheet

DIGITS = 3
"""Significant digits of a mean square, and of F."""
NOTE = (
    "MS: mean squares, one way; within estimates (CMM s)^2, between (CMM s)^2 + n0 (part s)^2, n0 "
    "the repeats of a part; F = MS between/MS within"
)


def squares_sheets(listed: Iterable[tuple[Analysed, Iterable[int]]]) -> list[Sheet]:
    """One row a listed table of several parts that were measured again; no sheet without any."""
    rows = [
        _row(found, i)
        for found, chosen in listed
        for i in chosen
        if found.one_way.df_between[i] > 0 and found.one_way.df_within[i] > 0
    ]
    if not rows:
        return []
    columns = [
        Column(title="operation\n", text=True, folds=True),
        Column(title="of\n", text=True, folds=True),
        Column(title="axis\n", text=True),
        Column(title="df\nbetween"),
        Column(title="df\nwithin"),
        Column(title="MS\nbetween"),
        Column(title="MS\nwithin"),
        Column(title="\n", text=True),
        Column(title="F\n"),
    ]
    kept = [i for i in range(len(columns)) if any(row[i] != MISSING for row in rows)]
    return [
        Sheet(
            title="Mean squares",
            columns=[columns[i] for i in kept],
            rows=[[row[i] for i in kept] for row in rows],
            notes=[NOTE],
        )
    ]


def _row(found: Analysed, i: int) -> list[str]:
    operation, name, axis = found.tables.labels[i]
    unit, size = UNITS[found.kind]
    one = found.one_way
    return [
        operation or MISSING,
        f"{found.kind} {name}",
        axis or MISSING,
        str(int(one.df_between[i])),
        str(int(one.df_within[i])),
        significant(one.ms_between[i] / size**2, DIGITS),
        significant(one.ms_within[i] / size**2, DIGITS),
        f"{unit}^2",
        significant(one.F[i], DIGITS),
    ]
