"""What the report, the tables and the picture of close-loop share: sizes in the unit shown."""

from __future__ import annotations

from dataclasses import dataclass

from mtu_cli.close_loop_sealed.analyses.loop.result import (
    DRIFT,
    FIELD,
    CloseLoopResult,
    FoundEffect,
    Judged,
    TableResult,
)
from mtu_cli.close_loop_sealed.analyses.loop.shown import is_nameless, pitch_is_open
from mtu_cli.reports.document import finite
from mtu_cli.units import PARAMETER_UNITS, UNITS, Unit

RIVALS = 4
"""Effects of a class that a sentence names: one more where that is the last."""
WORTH, WORTH_AS_SCATTER = 0.9, 0.5
"""Shares of the held-out error below which a correction for each place is worth to be told."""
LIKELY = 0.95
"""Posterior above which one name is told before what has none."""


DRIFTS = "thermal-drift"
SURE_LEVEL = 3.0
"""Times its u from which on a level is told from 0."""
OF_TEMPERATURES = (DRIFTS, "thermal-growth", "thermal-squareness")
"""The families of what a temperature makes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """A parameter in the unit it is shown in, with its 95 % interval."""

    name: str
    unit: str
    value: float
    u: float
    interval: tuple[float, float]
    dof: float


def first_table(result: CloseLoopResult) -> TableResult:
    """The table that the scores at the top are of: the first that gave the verdict."""
    return next(
        (item for item in result.tables if item.verdict == result.verdict), result.tables[0]
    )


def unit_of(item: TableResult) -> Unit:
    """The unit that the errors of a table are shown in."""
    return UNITS[item.table.unit]


def size_of(item: TableResult, value: float | None) -> float | None:
    """An error in internal units (mm, rad) in the table's own; None where it is not finite."""
    return None if value is None else finite(value / unit_of(item).to_internal)


def in_shown_unit(found: tuple[str, str, float, float]) -> tuple[float, float, str]:
    """Value and u of (name, unit, value, u) in the unit, and the unit."""
    _, unit, value, u = found
    scale = PARAMETER_UNITS[unit].to_internal
    return value / scale, u / scale, unit


def article(noun: str) -> str:
    """Such as "a scale", "an angle"."""
    return f"{'an' if noun[0] in 'aeio' else 'a'} {noun}"


def parameters_of(effect: FoundEffect) -> tuple[Shown, ...]:
    """The parameters of an effect in the units they are shown in."""
    found = []
    for (name, unit, value, u), (low, high, dof) in zip(
        effect.parameters, effect.intervals, strict=True
    ):
        scale = PARAMETER_UNITS[unit].to_internal
        found.append(
            Shown(
                name=name,
                unit=unit,
                value=value / scale,
                u=u / scale,
                interval=(low / scale, high / scale),
                dof=dof,
            )
        )
    return tuple(found)


def sure_levels(effect: FoundEffect) -> list[tuple[Shown, str]]:
    """Its levels that are told from 0, each with its axis, where it has no constant part itself:
    offsets.
    """
    levels = zip(parameters_of(effect)[len(effect.sizes) :], effect.levels, strict=True)
    if effect.family in OF_TEMPERATURES:
        return []
    return [(own, axis) for own, axis in levels if abs(own.value) >= SURE_LEVEL * own.u]


def class_of(effect: FoundEffect) -> tuple[str, ...]:
    """What the data cannot tell apart: the effect, its rivals, what is the same on these points."""
    return tuple(name for name in effect.candidates if name not in effect.apart)


def nearly_alone(effect: FoundEffect) -> bool:
    """Whether it holds nearly all of the posterior, beside drifts and fields without a name."""
    return effect.posterior > LIKELY and all(map(is_nameless, class_of(effect)[1:]))


def titled(effect: FoundEffect) -> str:
    """Its name, and that its pitch is one of many where it is."""
    if not pitch_is_open(effect):
        return effect.name
    return f"{effect.name}, one of {len(effect.alike) + 1} pitches that fit"


def beside_which(item: TableResult, effect: FoundEffect) -> list[str]:
    """Other effects beside which an effect has its size, and beside whose rivals another one."""
    return [
        own.name
        for own in item.effects
        if any(effect.name == other.name for rival in own.rivals for other in rival.changed)
    ]


def something_left(item: TableResult) -> bool:
    """Whether there is more than scatter beside what was named."""
    return bool(item.fired or item.twofold or item.of_one_axis) or item.without_name


def stays(item: TableResult) -> bool:
    """Whether a correction for each place would take so much off the held-out error that it is to
    be told: a tenth where something has no name; else half, of what is left in sample as well.
    """
    if item.by_column is None:
        return False
    if something_left(item):
        return item.by_column.rms <= WORTH * item.after.rms
    least = min(item.after.rms, item.in_sample_after.rms)
    return item.by_column.rms <= WORTH_AS_SCATTER * least


def ranked(item: TableResult) -> list[Judged]:
    """The candidates that could be tested, the likeliest first."""
    seen = [judged for judged in item.candidates if judged.log_bayes_factor is not None]
    return sorted(seen, key=lambda judged: -(judged.log_bayes_factor or 0.0))


def in_words(name: str) -> str:
    """A rival's name as people read it: drifts and fields without a name have none."""
    for prefix, text in ((DRIFT, "a smooth drift in"), (FIELD, "a smooth field in")):
        if name.startswith(f"{prefix}-"):
            return f"{text} {name.removeprefix(f'{prefix}-')} without a name"
    return name


def either(names: tuple[str, ...]) -> str:
    """Rivals for a sentence, the likeliest few of them: "a, b or c"."""
    known = [in_words(name) for name in names]
    more = len(known) - RIVALS
    if more > 1:
        known = [*known[:RIVALS], f"one of {more} others"]
    return " or ".join(filter(None, (", ".join(known[:-1]), known[-1])))


def plural(word: str) -> str:
    return f"{word}es" if word.endswith("s") else f"{word}s"


def capital(text: str, item: TableResult) -> str:
    """With a capital, where no component's name stands in front."""
    return text if item.table.component is not None else text[:1].upper() + text[1:]
