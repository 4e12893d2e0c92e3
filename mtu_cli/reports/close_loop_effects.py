"""Each effect as a sentence with its size: families that are not listed say it by themselves."""

from __future__ import annotations

import re
from dataclasses import dataclass

from mtu_cli.analyses.close_loop.result import FixedPoint, FoundEffect, TableResult
from mtu_cli.analyses.close_loop.shown import amplitude, is_level
from mtu_cli.language import names, parse
from mtu_cli.reports.close_loop_shown import (
    Shown,
    parameters_of,
    things,
)
from mtu_cli.reports.numbers import MISSING, interval, plus_minus, significant, with_u
from mtu_cli.units import PARAMETER_UNITS

SENTENCES = {
    "offset": "everything is shifted along {A} by {value}",
    "scale": "{of}{A} {grows} by {size} of travel",
    "curvature": "{of}{A} bends along the travel: {values}",
    "straightness": "{A} bends along {along}: {values}",
    "squareness": "{A} and {B} are out of square by {value}",
    "rotation": "everything is turned about {A} by {value}",
    "backlash": "{A} {loses} {twice} at reversal",
    "cyclic": "{A} has a periodic error of {length} amplitude, pitch {pitch_mm} mm",
    "abbe": "a tilt of {value} acts on {A} over the height",
    "thermal-drift": "{A} drifts by {value} of {covariate}",
    "thermal-growth": "{A} {grows} by {size} of {covariate}",
    "thermal-squareness": "the angle of {A} and {B} changes by {value} of {covariate}",
    "warm-up": "{A} shifts by {value} while warming up, time constant {tau_min} min",
    "trend": "{A} shifts by {value} {each}",
    "wear-approach": "wear shifts {A} by {value} {each} against the direction of approach",
    "step": "{A} jumps by {value} from {row} {at} on",
    "operation": "{chosen} is shifted along {A} by {value}",
    "radial": "everything is shifted {outward} from the centre by {size}",
    "covariate": "{A} shifts by {value} per unit of {covariate}",
    "feature-outlier": "{column} {chosen} stands out on every {row}: {values}",
    "part-outlier": "{row} {chosen} stands out as a whole: {values}",
}
"""By family; what is missing falls back to what the library says of the effect."""
TWICE = 2.0
"""The reversal value is twice the parameter, which acts in both directions (ISO 230-2, 2.13)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sentence:
    """What is said of `effects`: of one, of those that are one cause, or (none) of all before."""

    effects: tuple[FoundEffect, ...]
    text: str

    @property
    def named(self) -> str:
        """The text with the names of the effects behind it."""
        names = " and ".join(effect.name for effect in self.effects)
        return f"{self.text} ({names})" if names else self.text


def sentences(item: TableResult) -> list[Sentence]:
    """One an effect, in the order found; an axis that grows from a fixed point takes one.

    A drift of several axes keeps its own beside it, unless all of them grow from fixed points.
    """
    joined: dict[int, Sentence] = {}
    told: dict[int, set[str]] = {}
    last = []
    for point in item.fixed_points:
        first = item.effects[point.growth[0]]
        if point.told and len(point.growth) == 1 and first.axis == point.axis:
            text = f"{effect_text(first, item)} from a fixed point at {_place(point)}"
            own = tuple(item.effects[e] for e in (*point.growth, *point.drift))
            joined[point.growth[0]] = Sentence(effects=own, text=text)
            for e in point.drift:
                told.setdefault(e, set()).add(f"E{point.axis}")
        else:
            last.append(Sentence(effects=(), text=_fixed(point)))
    return [
        joined.get(e, Sentence(effects=(effect,), text=effect_text(effect, item)))
        for e, effect in enumerate(item.effects)
        if e not in told or not effect.equations.keys() <= told[e]
    ] + last


def _fixed(point: FixedPoint) -> str:
    axis = point.axis.upper()
    if not point.told:
        return f"the fixed point of {axis} is not told"
    return f"in all, the fixed point of {axis} is {_place(point)}"


def _place(point: FixedPoint) -> str:
    return f"{point.axis} = {plus_minus(point.at, point.u)} mm"


def effect_text(effect: FoundEffect, item: TableResult) -> str:
    """Such as "X loses 8.2 ± 0.6 um at reversal"."""
    shown = tuple(p for p in parameters_of(effect) if not is_level(p.name))
    sentence = SENTENCES.get(effect.family)
    if sentence is None or not shown:
        return _says(effect, shown)
    words = _words(effect, item, shown)
    if any(name not in words for name in re.findall(r"{(\w+)}", sentence)):
        return _says(effect, shown)
    return sentence.format(**words)


def _says(effect: FoundEffect, shown: tuple[Shown, ...]) -> str:
    """The library's own words, and the parameters by their names."""
    chosen = "" if effect.chosen is None else f" ({effect.chosen})"
    return ": ".join(text for text in (f"{effect.says}{chosen}", _values(shown)) if text)


def _values(shown: tuple[Shown, ...]) -> str:
    return ", ".join(f"{p.name} {_size(p.value, p.u, p.unit)}" for p in shown)


def _words(effect: FoundEffect, item: TableResult, shown: tuple[Shown, ...]) -> dict[str, str]:
    """What sentences may name of an effect."""
    row, column = things(item)
    first = shown[0]
    words = {
        "row": row,
        "column": column,
        "A": _subject(effect, item),
        "of": "positioning of " if item.table.component is None else "",
        "loses": "loses" if item.table.component is None else "changes by",
        "values": _values(shown),
        **{name: _searched(found) for name, found in effect.searched.items()},
    }
    along = _along(effect)
    if along is not None:
        words["along"] = along
    if effect.axis is not None and len(effect.axis) == 2 and item.table.component is None:
        words |= {"A": effect.axis[0].upper(), "B": effect.axis[1].upper()}
    if effect.chosen is not None:
        words["chosen"] = effect.chosen
    if effect.covariate is not None:
        words["covariate"] = effect.covariate
        words["each"] = _each(effect.covariate, row)
    if "at" in effect.searched:
        words["at"] = _first_after(effect, item)
    if len(shown) == 1:
        value = abs(first.value)
        words |= {
            "value": _size(first.value, first.u, first.unit),
            "size": _size(value, first.u, first.unit),
            "twice": _size(TWICE * value, TWICE * first.u, first.unit),
            "grows": _grows(effect, item, first.value),
            "outward": "outward" if first.value >= 0 else "inward",
        }
    elif len({p.unit for p in shown}) == 1:
        scale = PARAMETER_UNITS[first.unit].to_internal
        length, u = amplitude(effect)
        words["length"] = _size(length / scale, u / scale, first.unit)
    return words


def _subject(effect: FoundEffect, item: TableResult) -> str:
    """The axes in capitals; a component is named in front of the sentence."""
    if item.table.component is not None:
        return "it"
    axes = item.table.axes if effect.axis is None else (effect.axis,)
    return " and ".join(axis.upper() for axis in axes)


def _along(effect: FoundEffect) -> str | None:
    """The axis that an effect's equations hold beside its parameters, where it is one."""
    parameters = {name for name, _, _, _ in effect.parameters}
    known = {name for text in effect.equations.values() for name in names(parse(text))}
    axes = sorted(known - parameters)
    return axes[0].upper() if len(axes) == 1 else None


def _size(value: float, u: float, unit: str) -> str:
    return f"{plus_minus(value, u)} {unit}"


def _grows(effect: FoundEffect, item: TableResult, value: float) -> str:
    verb = "grow" if value >= 0 else "shrink"
    several = effect.axis is None and item.table.component is None and len(item.table.axes) > 1
    return verb if several else f"{verb}s"


def _searched(found: tuple[float, float, float]) -> str:
    return " ".join(searched_text(found))


def searched_text(found: tuple[float, float, float]) -> tuple[str, str]:
    """What was searched, and its 95 % interval, to two digits of a quarter of its width."""
    value, low, high = found
    if not high > low:
        return significant(value, 3), MISSING
    u = (high - low) / 4
    return with_u(value, u)[0], interval(low, high, u)


def _each(covariate: str, row: str) -> str:
    return f"from {row} to {row}" if covariate == "sequence" else f"per count of {covariate}"


def _first_after(effect: FoundEffect, item: TableResult) -> str:
    """The first part after a step."""
    at = effect.searched["at"][0]
    order = item.table.covariates.get("sequence")
    if order is None or len(order) != len(item.table.parts):
        return significant(at, 3)
    after = [name for name, value in zip(item.table.parts, order[:, 0], strict=True) if value > at]
    return after[0] if after else significant(at, 3)
