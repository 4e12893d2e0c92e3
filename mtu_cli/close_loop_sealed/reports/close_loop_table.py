"""The tables of close-loop: the verdict first, then what was found and what it is worth."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group
from rich.padding import Padding
from rich.text import Text

from mtu_cli.close_loop_sealed.analyses.loop.result import (
    CloseLoopResult,
    FoundEffect,
    Judged,
    TableResult,
)
from mtu_cli.close_loop_sealed.analyses.loop.shown import (
    effect_rms,
    entry_text,
    improvement_percent,
    pitch_is_open,
)
from mtu_cli.close_loop_sealed.reports.close_loop_effects import direction_text
from mtu_cli.close_loop_sealed.reports.close_loop_notes import (
    copied,
    effect_notes,
    level_text,
    untested,
)
from mtu_cli.close_loop_sealed.reports.close_loop_scatter import scatter_lines
from mtu_cli.close_loop_sealed.reports.close_loop_scores import before_after
from mtu_cli.close_loop_sealed.reports.close_loop_searched import (
    AT,
    searched_text,
    searched_unit,
    size_interval,
)
from mtu_cli.close_loop_sealed.reports.close_loop_shown import (
    RIVALS,
    class_of,
    first_table,
    in_words,
    parameters_of,
    ranked,
    size_of,
)
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_lines
from mtu_cli.findings import listed
from mtu_cli.reports.document import finite
from mtu_cli.reports.numbers import MISSING, p_value, plus_minus, significant
from mtu_cli.reports.tables import Column, Sheet

ITS_RMS = "its rms: of all coordinates, about the effect's own mean over the data"
BEST = 5
"""Candidates listed."""
COMPONENTS = 20
"""Components listed."""
NAMES = 6
"""Names of a long class."""
OUTLIERS = 6
"""Entries set aside that are listed."""


def table(result: CloseLoopResult) -> list[object]:
    """The verdict in words; effects; before and after; the likeliest candidates; notes."""
    sheets: list[object] = [_verdict(result)]
    if result.effects:
        sheets.append(_effects(result))
    if len(result.tables) > 1:
        sheets.append(_components(result))
    else:
        sheets.append(before_after(result.tables[0]))
    sheets.append(_candidates(first_table(result), several=len(result.tables) > 1))
    rest = _rest(result)
    return [*sheets, rest] if rest is not None else sheets


def _verdict(result: CloseLoopResult) -> Group:
    """Components without an undeclared effect take one line together."""
    found = [item for item in result.tables if item.verdict != "none"]
    shown = found or [result.tables[0]]
    lines = [line for item in shown for line in verdict_lines(item, result)]
    none = (item for item in result.tables if item.verdict == "none" and item not in shown)
    if silent := [item.table.component or "" for item in none]:
        aside = any(item.gross for item in result.tables if item.table.component in silent)
        but = ", beside what was set aside (see below)" if aside else ""
        lines.append((False, f"Nothing undeclared in {listed(silent, 8)}{but}."))
    head = Text(f"Undeclared effects: {result.verdict}", style="bold")
    told = [Padding(Text(text), (0, 0, 0, 2 if one else 0)) for one, text in lines]
    return Group(head, *told, Text(""))


def _effects(result: CloseLoopResult) -> Sheet:
    """One line a parameter, and one for what was searched."""
    rows = [row for item in result.tables for e in item.effects for row in _effect(e, item)]
    columns = [
        Column(title="effect\n", text=True, folds=True),
        Column(title="parameter\n", text=True),
        Column(title="value ± u\n"),
        Column(title="unit\n", text=True),
        Column(title="95 %\ninterval"),
        Column(title="p family-\nwise"),
        Column(title="its rms\n"),
        Column(title="chosen in\nfolds"),
    ]
    return Sheet(title="Effects", columns=columns, rows=rows, notes=_effect_notes(result))


def _effect_notes(result: CloseLoopResult) -> list[str]:
    """What a level is, which way a reversal goes, and classes too long for the sentence."""
    notes = [
        f"{effect.name} may be: {_some([in_words(name) for name in class_of(effect)])}"
        for effect in result.effects
        if len(class_of(effect)) > RIVALS + 1
    ]
    notes += [
        f"{effect.name}: not much less likely, but no readings of it (they look different): "
        f"{_some(effect.apart)}"
        for effect in result.effects
        if effect.apart
    ]
    notes += [
        f"{effect.name}: {len(effect.alike) + 1} values of {name} fit alike at these places; the "
        "interval holds them all"
        for effect in result.effects
        if pitch_is_open(effect)
        for name in effect.searched
    ]
    ways = [(e.name, direction_text(e, item)) for item in result.tables for e in item.effects]
    notes += dict.fromkeys(f"{name}: {way}" for name, way in ways if way is not None)
    for item in result.tables:
        notes += effect_notes(item)
    if any(effect.kind == "mean" for effect in result.effects):
        notes.append(ITS_RMS)
    return [*level_text(result.effects), *notes]


def _some(names: Sequence[str]) -> str:
    """The likeliest few of many names."""
    more = len(names) - NAMES
    return listed(names, NAMES) + (" (-o FILE.json)" if more > 0 else "")


def _effect(effect: FoundEffect, item: TableResult) -> list[list[str]]:
    component = item.table.component
    plain = component is None or effect.name.endswith(f"-{component}")
    name = effect.name if plain else f"{component} {effect.name}"
    folds = f"{effect.folds} of {effect.of_folds}" if effect.of_folds else MISSING
    size = size_of(item, effect_rms(effect, item))
    rms = f"{significant(size)} {item.table.unit}" if size else MISSING
    lines = [
        [p.name, plus_minus(p.value, p.u), p.unit, size_interval(*p.interval, p.u)]
        for p in parameters_of(effect)
    ]
    for name_searched, value in effect.searched.items():
        best, ends = searched_text(value, pitch_is_open(effect), ends=name_searched != AT)
        lines.append([name_searched, best, searched_unit(name_searched), ends])
    if effect.scatter is not None:
        lines += scatter_lines(effect.scatter)
    lines = lines or [[MISSING, MISSING, "", MISSING]]
    first = [p_value(effect.p_familywise), rms, folds]
    return [
        [name if i == 0 else "", *line, *(first if i == 0 else ["", "", ""])]
        for i, line in enumerate(lines)
    ]


def _components(result: CloseLoopResult) -> Sheet:
    rows = [
        [
            item.table.component or MISSING,
            item.verdict,
            listed([effect.name for effect in item.effects], 3) or MISSING,
            *(
                significant(size_of(item, value), 3)
                for value in (item.before.rms, item.after.rms, item.floor)
            ),
            item.table.unit,
            significant(finite(improvement_percent(item))),
        ]
        for item in result.tables[:COMPONENTS]
    ]
    columns = [
        Column(title="component\n", text=True, folds=True),
        Column(title="verdict\n", text=True),
        Column(title="effects\n", text=True, folds=True),
        Column(title="rms\nbefore"),
        Column(title="rms\nafter"),
        Column(title="repeat-\nability"),
        Column(title="unit\n", text=True),
        Column(title="better\nby, %"),
    ]
    by = dict.fromkeys(item.held_out_by for item in result.tables)
    notes = ["rms held out" if None not in by else "rms held out where the data allow it"]
    if len(result.tables) > COMPONENTS:
        notes.append(f"{COMPONENTS} of {len(result.tables)} components")
    return Sheet(title="Components", columns=columns, rows=rows, notes=notes)


def _candidates(item: TableResult, several: bool) -> Sheet:
    marked = {name for effect in item.effects for name in class_of(effect)}
    best = ranked(item)
    rows = [_candidate(judged, item, marked) for judged in best[:BEST]]
    columns = [
        Column(title="candidate\n", text=True),
        Column(title="ln Bayes\nfactor"),
        Column(title="posterior\n%"),
        Column(title="p family-\nwise"),
        Column(title=f"would be found\nfrom rms {item.table.unit}"),
    ]
    of = f" of {item.table.component}" if several else ""
    notes = [f"{len(best)} candidates tested at the first look"]
    if marked:
        notes[0] += "; *: found, or in the class of what was"
        first = next((i for i, judged in enumerate(best) if judged.name in marked), 0)
        held = {f"offset-{axis}" for effect in item.effects for axis in effect.levels}
        if above := [judged.name for judged in best[:first] if judged.name not in held]:
            # A scatter may be likelier at first: what moves the mean is taken out before it.
            notes.append(f"{listed(above, 3)}: at the first look; not beside what was found")
    return Sheet(title=f"Likeliest candidates{of}", columns=columns, rows=rows, notes=notes)


def _candidate(judged: Judged, item: TableResult, marked: set[str]) -> list[str]:
    factor = judged.log_bayes_factor
    return [
        judged.name + ("*" if judged.name in marked else ""),
        MISSING if factor is None else f"{round(factor, 1) + 0.0:.1f}",
        MISSING if judged.posterior is None else f"{100 * judged.posterior:.1f}",
        p_value(judged.p_familywise),
        significant(size_of(item, judged.minimum_detectable)),
    ]


def _rest(result: CloseLoopResult) -> Text | None:
    """What was set aside, and what could not be tested."""
    lines = [text for text in (_outliers(item) for item in result.tables) if text]
    item = first_table(result)
    lines += copied(item)
    lines += untested(item)
    return Text("\n".join(lines), style="dim") if lines else None


def _outliers(item: TableResult) -> str | None:
    if not item.gross:
        return None
    unit, named = item.table.unit, []
    for gross in item.gross:
        sizes = [significant(size_of(item, value)) for value in gross.deviation]
        axes = item.table.axes if item.table.component is None else [""]
        off = ", ".join(f"{a} {size}".strip() for a, size in zip(axes, sizes, strict=True))
        named.append(f"{entry_text(gross, item)} ({off} {unit})")
    of = "" if item.table.component is None else f"{item.table.component}: "
    return f"{of}set aside as far off whatever the rest does: {listed(named, OUTLIERS)}"
