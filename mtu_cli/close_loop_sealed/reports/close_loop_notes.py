"""Notes below the tables of close-loop: what was not tested, what is a copy, what checks say."""

from __future__ import annotations

from collections.abc import Sequence

from mtu_cli.close_loop_sealed.analyses.loop.one_temperature import LOOKS_LIKE
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect, TableResult
from mtu_cli.close_loop_sealed.analyses.loop.shown import things
from mtu_cli.close_loop_sealed.analyses.loop.zeros import DIGITS, zeros_of
from mtu_cli.close_loop_sealed.reports.close_loop_held import (
    growth_alone_notes,
    held_notes,
    one_cause_notes,
)
from mtu_cli.close_loop_sealed.reports.close_loop_shown import (
    plural,
    something_left,
    stays,
    sure_levels,
)
from mtu_cli.files.part import REFERENCE_TEMPERATURE
from mtu_cli.findings import listed
from mtu_cli.reports.numbers import p_value, plus_minus

WEAR, SEQUENCE = "wear-approach", "sequence"
LEVEL = (
    "{names}: {what} of its own: the error where the effects of its axis are 0. Beside a growth or "
    "a drift it holds their constant part and any offset"
)
MEANINGS = {
    "interaction-pattern": "the {columns} share a pattern that some {rows} have more of",
    "serial-correlation": "{rows} follow one another too smoothly to be scatter",
    "serial-shape": "the shape of the {rows} (scale, turn, squareness) changes smoothly in time",
    "spatial-correlation": "{columns} near one another err alike",
    "common-shape": "all {rows} share a shape (scale, turn, squareness) that no one effect has",
    "column-variance": "{columns} differ from one another by more than single entries scatter",
    "part-variance": "{rows} differ from one another by more than single entries scatter",
}
"""What a check of the remainder says where it fires."""
COPY = " is a copy of "
COPIED = ": the two cannot be told apart"
"""What the note of a candidate says of a column that is, and how it ends."""


def level_text(effects: Sequence[FoundEffect]) -> list[str]:
    """What the levels of effects are, by their names, and their effects where another has a size
    of that name.
    """
    sizes = {name for own in effects for name, *_ in own.sizes}
    levels = [(own, name) for own in effects for name, *_ in own.parameters[len(own.sizes) :]]
    names = [f"{name} of {own.name}" if name in sizes else name for own, name in levels]
    names = list(dict.fromkeys(names))
    if not names:
        return []
    what = "the constant of an equation and no effect"
    if len(names) > 1:
        what = "each the constant of an equation and no effect"
    return [LEVEL.format(names=listed(names), what=what)]


def effect_notes(item: TableResult) -> list[str]:
    """What the effects are counted from, and on what their figures depend."""
    return [
        *one_cause_notes(item),
        *growth_alone_notes(item),
        *held_notes(item),
        *_level_notes(item),
        *_wear_notes(item),
        *_pass_notes(item),
        *_unsure_notes(item),
        *_found_at_notes(item),
    ]


def _level_notes(item: TableResult) -> list[str]:
    """Of levels that are told from 0, of effects that have no constant part: they are offsets."""
    return [
        f"{effect.name}: its {own.name} is an offset of {axis.upper()}, "
        f"{plus_minus(own.value, own.u)} {own.unit}, which is written with it"
        for effect in item.effects
        for own, axis in sure_levels(effect)
    ]


def _pass_notes(item: TableResult) -> list[str]:
    """What stands for the pass in equations on readings."""
    counted = any(effect.covariate == SEQUENCE for effect in item.effects)
    if item.table.component is None or not counted:
        return []
    return ["sequence counts the passes in the order of time: 1, 2, ... (there and back are one)"]


def _wear_notes(item: TableResult) -> list[str]:
    """Where in its covariate a wear in the direction of approach is 0: one about the mean of the
    data has the lost motion of that mean beside it, one from the first part on that of a new tool.
    """
    return [
        f"{effect.name} is counted from {effect.covariate} = {zero:.{DIGITS}g}: there it is 0"
        for effect in item.effects
        if effect.family == WEAR
        for zero in zeros_of(effect)
    ]


def _unsure_notes(item: TableResult) -> list[str]:
    """Of effects that passed a test, and whose size beside all others is not told from 0."""
    unsure = [effect.name for effect in item.effects if effect.is_hint]
    if not unsure:
        return []
    passes, its = ("passes", "its size is") if len(unsure) == 1 else ("pass", "their sizes are")
    return [
        f"{listed(unsure)} {passes} a test, but {its} not told from 0 (95 %): no more than a hint"
    ]


def _found_at_notes(item: TableResult) -> list[str]:
    """Of effects that may be those of a temperature that did not change."""
    found: dict[tuple[tuple[str, float], ...], list[str]] = {}
    for effect in item.effects:
        if effect.found_at:
            of = "" if effect.family in LOOKS_LIKE else "the level of "
            found.setdefault(effect.found_at, []).append(f"{of}{effect.name}")
    notes = []
    for at, names in found.items():
        where = listed([f"{name} = {T:.4g}" for name, T in at])
        what, those, it = "is that", "it is", "it"
        if len(names) > 1:
            what, those, it = ("are those", "they are", "them")
        notes.append(
            f"{listed(names)} {what} of {where}, the same in all this data: what {those} at "
            f"{REFERENCE_TEMPERATURE:g} degC, and how much of {it} comes with the temperature, "
            "only parts made at another one tell"
        )
    return notes


def of_p(p: float) -> str:
    """Such as "= 0.012", "<0.001"."""
    shown = p_value(p)
    return shown if shown.startswith("<") else f"= {shown}"


def left_text(item: TableResult) -> str | None:
    """The checks that what is left passed, None where they did not all."""
    if something_left(item) or not item.checks:
        return None
    count, least = len(item.checks), f"smallest p {of_p(min(p for _, p in item.checks))}"
    if stays(item):
        _, column = things(item)
        return f"{count} checks take what stays for errors of single {plural(column)} ({least})"
    return f"nothing is left that {count} checks would see ({least})"


def untested(item: TableResult, most: int = 4) -> list[str]:
    """Candidates that could not be tested, a line a reason; the last one of many reasons."""
    reasons: dict[str, list[str]] = {}
    for judged in item.candidates:
        if judged.unavailable is not None:
            reasons.setdefault(judged.unavailable, []).append(judged.name)
    texts = [f"not tested: {listed(own, 5)}: {reason}" for reason, own in reasons.items()]
    if len(texts) <= most + 1:
        return texts
    rest = [name for own in list(reasons.values())[most:] for name in own]
    count = len(reasons) - most
    return [
        *texts[:most],
        f"not tested for {count} further reasons (-o FILE.json): {listed(rest, 5)}",
    ]


def copied(item: TableResult, names: tuple[str, ...] | None = None) -> list[str]:
    """Columns of the data that are copies of others, once each; of some `names` those that two of
    these candidates take: one alone is the same as none of the others for that.
    """
    judged = [own for own in item.candidates if names is None or own.name in names]
    told = [note for own in judged for note in own.notes if COPY in note]
    least = 1 if names is None else 2
    return [note for note in dict.fromkeys(told) if told.count(note) >= least]
