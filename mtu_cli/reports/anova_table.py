"""The tables of anova: a screen that sums up, then lengths, angles and features."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from rich.text import Text

from mtu_cli.analyses.anova import Analysed, AnovaResult
from mtu_cli.analyses.anova.totals import Total
from mtu_cli.reports.anova_squares import squares_sheets
from mtu_cli.reports.anova_words import UNITS, sentences
from mtu_cli.reports.document import root
from mtu_cli.reports.numbers import MISSING, plus_minus, significant, with_u
from mtu_cli.reports.tables import Column, Sheet
from mtu_cli.units import UM

SHOWN = 24
"""Tables of a kind that are listed in full; of more the worst are shown."""
WORST = 10
DIGITS = 3
"""Significant digits of a mean whose uncertainty is not known."""
TITLES = {"feature": "Features", "length": "Lengths", "angle": "Right angles"}
BELOW_ZERO = (
    "[0, 0] bounds no s: both limits of the variance were below 0, as the part means scatter less "
    "than repeats alone make them in 39 of 40 cases"
)
METHODS = {
    "reml": "restricted maximum likelihood",
    "anova": "mean squares (a negative variance is shown as <0)",
    "paper": "the root of MS_between, as Gilsinn & Ling 2004",
}


def table(result: AnovaResult, digits: int = 2) -> list[object]:
    """What a terminal shows; everything is in the report and in the CSV."""
    k = result.coverage_factor
    lines = [Text(line) for line in sentences(result)]
    found: list[object] = [_summary(result, digits), *lines, Text("")]
    apart = [item for item in (result.lengths, result.angles) if item is not None]
    kinds = [*apart, result.features]
    sheets = [_sheet(item, k, digits) for item in kinds]
    # The same legend once, below the last of them.
    *before, last = sheets
    sheets = [replace(item, notes=[]) if item.notes == last.notes else item for item in before]
    return [
        *found,
        *sheets,
        last,
        *squares_sheets((item, _listed(item, k)) for item in kinds),
    ]


def _listed(found: Analysed, k: float) -> Sequence[int]:
    """The tables of a kind that are listed: all where they are few, else the worst."""
    total = len(found.tables.labels)
    return range(total) if total <= SHOWN else found.largest(k)[:WORST]


def _filled(
    title: str,
    columns: Sequence[Column],
    rows: Sequence[Sequence[str]],
    notes: Sequence[tuple[str, str]],
) -> Sheet:
    """A sheet without the columns that no row has anything in; a note belongs to a column."""
    kept = [
        i for i, column in enumerate(columns) if any(row[i] not in (MISSING, "") for row in rows)
    ]
    names = {columns[i].title.partition("\n")[0] for i in kept}
    said = [text for column, text in notes if not column or column in names]
    return Sheet(
        title=title,
        columns=[columns[i] for i in kept],
        rows=[[row[i] for i in kept] for row in rows],
        notes=["; ".join(said)] if said else [],
    )


def _summary(result: AnovaResult, digits: int) -> Sheet:
    parts = len(result.features.tables.parts)
    columns = [
        Column(title="operation\n", text=True, folds=True),
        Column(title="axis\n", text=True),
        Column(title="features\n"),
        Column(title="mean error\num"),
        Column(title="largest\num"),
        Column(title="at\n", text=True, folds=True),
        Column(title="feature s\num"),
        Column(title="part s\num"),
        Column(title="part+CMM s\num"),
        Column(title="CMM s\num"),
        Column(title="CMM share\n%"),
        Column(title="parts differ\n"),
    ]
    notes = [
        ("largest", "largest: mean error of the worst feature"),
        ("feature s", "feature s: scatter of the features' mean errors"),
        ("part s", f"part s: from part to part, by {METHODS[result.method]}"),
        ("part+CMM s", "part+CMM s: of parts measured once"),
        ("CMM s", "CMM s: of repeated measurement"),
        ("CMM share", "CMM share: of the variance of one measured point (REML)"),
        ("parts differ", "parts differ: features where F says so, 5 % error rate over all (Holm)"),
    ]
    datum = "" if result.datum == "none" else f", less {result.datum.replace(',', ' and ')}"
    return _filled(
        f"{parts} part{'s' if parts > 1 else ''} by operation and axis{datum}",
        columns,
        [_total(item, digits) for item in result.totals],
        notes,
    )


def _total(item: Total, digits: int) -> list[str]:
    return [
        item.operation or MISSING,
        item.axis,
        str(item.features),
        _mean(item.mean / UM, item.rounding / UM, digits),
        _mean(item.largest / UM, item.rounding / UM, digits),
        item.worst,
        significant(item.spread / UM, digits),
        significant(root(item.part) / UM, digits),
        significant(root(item.both) / UM, digits),
        significant(root(item.repeat) / UM, digits),
        significant(100 * item.repeat_share),
        f"{item.differ} of {item.tested}" if item.tested else MISSING,
    ]


def _mean(value: float, u: float, digits: int) -> str:
    """A mean to the last place of its uncertainty, or to three digits at least."""
    if np.isfinite(u) and u > 0:
        return with_u(value, u, digits)[0]
    return significant(value, max(digits, DIGITS))


def _sheet(found: Analysed, k: float, digits: int) -> Sheet:
    unit, size = UNITS[found.kind]
    total = len(found.tables.labels)
    chosen = _listed(found, k)
    several = bool((found.one_way.df_between > 0).any())
    columns = [
        Column(title="operation\n", text=True, folds=True),
        Column(title=f"{found.kind}\n", text=True, folds=True),
        Column(title="axis\n" if found.kind == "feature" else "", text=True),
        Column(title="n\n"),
        Column(title=f"mean ± u\n{unit}" if several else f"error\n{unit}"),
        Column(title=f"part s\n{unit}"),
        Column(title=f"part+CMM s\n{unit}"),
        Column(title=f"95 % interval\n{unit}"),
        Column(title=f"CMM s\n{unit}"),
        Column(title="F\n"),
        Column(title="F 95 %\n"),
        Column(title=f"U future\n{unit}"),
        Column(title="unusual\n", text=True, folds=True),
    ]
    title = TITLES[found.kind]
    if total > len(chosen):
        what = "the largest errors to come" if several else "the largest errors"
        counted = f"{total} features and axes" if found.kind == "feature" else str(total)
        title += f": the {len(chosen)} with {what}, of {counted}"
    rows = [_row(found, i, k, size, digits) for i in chosen]
    empty = bool(found.below_zero[list(chosen)].any())
    return _filled(title, columns, rows, _notes(found, k, listed=total > len(chosen), empty=empty))


def _notes(found: Analysed, k: float, *, listed: bool, empty: bool) -> list[tuple[str, str]]:
    notes = [("mean ± u", "mean of all readings (a part counts by its repeats) and its u")]
    if found.method == "paper":
        notes.append(("part s", f"part s: {METHODS['paper']}"))
        notes.append(("U future", f"U future = {k:g} u by eq. (34), of the CMM's scatter alone"))
    else:
        notes.append(("95 % interval", "95 % interval: of the s before it"))
        notes += [("95 % interval", BELOW_ZERO)] if empty else []
        notes.append(("U future", f"U future = {k:g} u, of a future part"))
    notes.append(("unusual", "unusual: parts that stand out there by themselves"))
    if listed:
        notes.append(("", "all of them: --csv FILE, -o FILE"))
    return notes


def _row(found: Analysed, i: int, k: float, size: float, digits: int) -> list[str]:
    operation, name, axis = found.tables.labels[i]
    one, components = found.one_way, found.components
    u = found.u_mean[i] / size
    mean = one.mean[i] / size
    interval = found.both_interval[i] if np.isfinite(found.both[i]) else found.interval[i]
    low, high = (significant(root(end) / size, digits) for end in interval)
    known = np.isfinite(u) and u > 0
    part = components.part_estimate[i], root(components.part[i]) / size
    return [
        operation or MISSING,
        name,
        axis or MISSING,
        str(int(one.N[i])),
        plus_minus(mean, u, digits) if known else significant(mean, max(digits, DIGITS)),
        "<0" if part[0] < 0 else significant(part[1], digits),
        significant(root(found.both[i]) / size, digits),
        f"[{low}, {high}]" if np.isfinite(interval).all() else MISSING,
        significant(root(components.repeat[i]) / size, digits),
        significant(one.F[i], 3),
        significant(one.F_critical_95[i], 3),
        significant(k * found.u_future[i] / size, digits),
        " ".join(found.unusual[i]),
    ]
