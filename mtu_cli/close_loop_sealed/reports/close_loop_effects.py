"""Each effect as a sentence with its size: families that are not listed say it by themselves."""

from __future__ import annotations

import math
import re

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.one_phase import least_amplitude
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect, TableResult
from mtu_cli.close_loop_sealed.analyses.loop.scatter_rivals import ROTATION
from mtu_cli.close_loop_sealed.analyses.loop.shown import (
    amplitude,
    column_text,
    pitch_is_open,
    things,
)
from mtu_cli.close_loop_sealed.analyses.loop.zeros import zeros_of
from mtu_cli.close_loop_sealed.reports.close_loop_scatter import one_axis_text, scatter_text
from mtu_cli.close_loop_sealed.reports.close_loop_searched import (
    AT,
    SEARCHED_DIGITS,
    open_end,
    searched_text,
)
from mtu_cli.close_loop_sealed.reports.close_loop_shown import (
    RIVALS,
    Shown,
    either,
    parameters_of,
    plural,
)
from mtu_cli.language import names, parse
from mtu_cli.reports.numbers import plus_minus, significant
from mtu_cli.units import PARAMETER_UNITS

SENTENCES = {
    "offset": "everything is shifted along {A} by {value}{where}",
    "scale": "{of}{A} {grows} by {size} of travel{where}",
    "curvature": "{of}{A} bends along the travel: {values}",
    "straightness": "{A} bends along {along}: {values}",
    "squareness": "{A} and {B} are out of square by {size}, {angle} than 90 degrees{where}",
    "rotation": "everything is turned about {A} by {value}",
    "backlash": "{A} {loses} {twice} at reversal{sides}",
    "cyclic": "{A} has a periodic error of {wave} amplitude, pitch {pitch_mm} mm",
    "abbe": "a tilt of {value} acts on {A} over the height",
    "thermal-drift": "{A} drifts by {value} of {covariate}",
    "thermal-growth": "{A} {grows} by {size} of {covariate}",
    "thermal-squareness": "the angle of {A} and {B} changes by {value} of {covariate}",
    "warm-up": "{A} shifts by {value} while warming up, time constant {tau_min} min",
    "trend": "{A} shifts by {value} {each}",
    "scale-trend": "{A} {grows} by {size} {each}",
    "wear-approach": "{A} {goes} {size} {each} {further} in the direction of approach, by wear",
    "step": "{A} jumps by {value} from {row} {at} on",
    "backlash-step": "{A} {loses} {twice} {more}at reversal{sides}, from {row} {at} on",
    "operation": "{chosen} is shifted along {A} by {value}",
    "radial": "everything is shifted {outward} from the centre by {size}",
    "covariate": "{A} shifts by {value} per unit of {covariate}",
    "feature-outlier": "{column} {chosen} stands out on every {row}: {values}",
    "part-outlier": "{row} {chosen} stands out as a whole: {values}",
}
"""By family; what is missing falls back to what the library says of the effect."""
CHANGES = {"scale": "thermal-growth", "squareness": "thermal-squareness"}
"""The family of what changes with a temperature, by that of what is the same in all parts."""
CENTRED = ("trend", "covariate")
"""Families of what changes from part to part and is 0 on the mean of them."""
LATER_BACKLASH = "backlash-step"
TWICE = 2.0
"""The reversal value is twice the parameter, which acts in both directions (ISO 230-2, 2.13)."""


def effect_text(effect: FoundEffect, item: TableResult) -> str:
    """Such as "X loses 8.2 ± 0.6 um at reversal"."""
    shown = parameters_of(effect)[: len(effect.sizes)]
    return sentence_text(effect, item, shown) + _alike(effect)


def sentence_text(effect: FoundEffect, item: TableResult, shown: tuple[Shown, ...]) -> str:
    """What is said of an effect whose parameters are `shown`, or would be."""
    sentence = SENTENCES.get(effect.family)
    if sentence is None or not shown:
        return _says(effect, shown)
    words = _words(effect, item, shown)
    if any(name not in words for name in re.findall(r"{(\w+)}", sentence)):
        return _says(effect, shown)
    return sentence.format(**words)


def _says(effect: FoundEffect, shown: tuple[Shown, ...]) -> str:
    """The library's own words, and the parameters by their names."""
    if effect.scatter is not None and effect.of_one_axis:
        return one_axis_text(effect.scatter, turns=effect.family == ROTATION)
    chosen = "" if effect.chosen is None else f" ({effect.chosen})"
    values = _values(shown) if effect.scatter is None else scatter_text(effect.scatter)
    return ": ".join(text for text in (f"{effect.says}{chosen}", values) if text)


def lost_before(effect: FoundEffect, item: TableResult) -> FoundEffect | None:
    """The lost motion of an axis that is there before more or less of it begins at one part."""
    if effect.family != LATER_BACKLASH:
        return None
    return next((own for own in item.effects if own.name == f"backlash-{effect.axis}"), None)


def _beside_backlash(value: float, effect: FoundEffect, item: TableResult) -> dict[str, str]:
    """How lost motion that begins at one part changes what was there before."""
    before = lost_before(effect, item)
    if before is None:
        return {"more": ""}
    was = before.parameters[0][2]
    if was * value >= 0:
        return {"more": "more "}
    return {"more": "less ", "loses": _reversal(was, item)["loses"], "sides": ""}


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
        "where": _where(effect, item),
        "values": _values(shown),
        **{name: _searched(name, found, effect) for name, found in effect.searched.items()},
    }
    along = _along(effect)
    if along is not None:
        words["along"] = along
    if effect.axis is not None and len(effect.axis) == 2 and item.table.component is None:
        words |= {"A": effect.axis[0].upper(), "B": effect.axis[1].upper()}
    if effect.chosen is not None:
        words["chosen"] = column_text(effect.chosen, item)
    if effect.covariate is not None:
        words["covariate"] = effect.covariate
        words["each"] = _each(effect.covariate, row)
    if AT in effect.searched:
        words["at"] = first_after(effect, item)
    if len(shown) == 1:
        words |= _of_one(first, effect, item)
    if len({p.unit for p in shown}) == 1:
        scale = PARAMETER_UNITS[first.unit].to_internal
        seen = least_amplitude(effect, item.table) if effect.family == "cyclic" else None
        length, u = amplitude(effect) if seen is None else seen
        words["wave"] = _size(length / scale, u / scale, first.unit)
        if seen is not None:
            words["wave"] = f"at least {words['wave']}"
        if TWICE * u > length:
            words["wave"] = f"unknown ({words['wave']})"
    return words


def _of_one(first: Shown, effect: FoundEffect, item: TableResult) -> dict[str, str]:
    """What sentences may say of an effect with one parameter."""
    value = abs(first.value)
    return {
        "value": _size(first.value, first.u, first.unit) + open_end(*first.interval),
        "size": _size(value, first.u, first.unit),
        "twice": _size(TWICE * value, TWICE * first.u, first.unit),
        **_reversal(first.value, item),
        "grows": _grows(effect, item, first.value),
        "angle": "more" if first.value >= 0 else "less",
        "outward": "outward" if first.value >= 0 else "inward",
        "goes": "goes" if first.value >= 0 else "stops",
        "further": "further" if first.value >= 0 else "short",
        **_beside_backlash(first.value, effect, item),
    }


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


def _where(effect: FoundEffect, item: TableResult) -> str:
    """The temperature at which a scale is meant, where a growth stands beside it, or a squareness,
    where its change does; and an offset, which is the mean error of the data, where any effect of a
    temperature does. Beside one that changes from part to part it is that of these parts alone.
    """
    found = []
    for other in item.effects:
        known = other.covariate
        if CHANGES.get(effect.family) == other.family:
            if other.axis in (None, effect.axis):
                found += [f"{known} is {zero:.4g}" for zero in zeros_of(other)]
        elif effect.family == "offset" and other.family.startswith("thermal-"):
            own = item.table.covariates.get(known or "")
            if own is not None and f"E{effect.axis}" in other.equations:
                mean = np.broadcast_to(own, item.table.there.shape)[item.table.there].mean()
                found.append(f"{known} is {mean:.4g}")
    told = " and ".join(dict.fromkeys(found))
    if told:
        return f" where {told}"
    if effect.family == "offset" and item.table.component is not None and _one_way(item):
        return ", or has half of a lost motion: all was read one way"
    varies = any(e.family in CENTRED and e.axis == effect.axis for e in item.effects)
    mean_of = f" on the mean of these {plural(things(item)[0])}"
    return mean_of if varies and effect.family == "offset" else ""


def _one_way(item: TableResult) -> bool:
    way = item.table.covariates.get(f"dir_{item.table.axes[0]}")
    return way is not None and len(np.unique(way[np.isfinite(way)])) == 1


def _grows(effect: FoundEffect, item: TableResult, value: float) -> str:
    verb = "grow" if value >= 0 else "shrink"
    several = effect.axis is None and item.table.component is None and len(item.table.axes) > 1
    return verb if several else f"{verb}s"


def _reversal(value: float, item: TableResult) -> dict[str, str]:
    """Words of a lost motion: an axis with play stops short after a move towards + (forward), and
    loses; one that goes too far gains.
    """
    if item.table.component is not None:
        return {"loses": "changes by", "sides": "" if value > 0 else ", lower forward"}
    if value > 0:
        return {"loses": "gains", "sides": ", too far from both sides"}
    return {"loses": "loses", "sides": ", short from both sides"}


def direction_text(effect: FoundEffect, item: TableResult) -> str | None:
    """Which way a reversal goes: E = lost_motion dir, dir = +1 after a move towards +; and what
    the sign of a squareness means.
    """
    shown = parameters_of(effect)
    if effect.family == "squareness":
        return "+ where the right angle is too large, as in `mtu orthogonality`"
    if effect.family not in ("backlash", LATER_BACKLASH) or len(shown) != 1:
        return None
    first, over = shown[0], shown[0].value >= 0
    size = _size(TWICE * abs(first.value), TWICE * first.u, first.unit)
    if item.table.component is not None:
        way = "higher" if over else "lower"
        return f"{item.table.component} is {size} {way} forward than in reverse"
    subject = _subject(effect, item)
    if lost_before(effect, item) is not None:
        way = "+" if over else "-"
        stands = f"after a move to + {subject} stands {size} further to {way} than after one to -"
        return f"{stands}, compared with what it did before"
    way, meant = (
        ("+", "it goes too far, as play that is corrected too much does")
        if over
        else ("-", "it stops short, as play does that is not corrected")
    )
    return (
        f"after a move to + {subject} stands {size} further to {way} than after one to -: {meant}"
    )


def _searched(name: str, found: tuple[float, float, float], effect: FoundEffect) -> str:
    """With its interval, where that is one and not from the first of many values to the last."""
    several = pitch_is_open(effect)
    value, ends = searched_text(found, several, ends=name != AT)
    return value if several else f"{value} {ends}".rstrip()


def _alike(effect: FoundEffect) -> str:
    """Such as "; pitch_mm 26.0 or 18.6 fits as well, ...", the nearest first; how many fit where
    they are more than a reader compares.
    """
    if not pitch_is_open(effect):
        return ""
    ((name, (value, _, _)),) = effect.searched.items()
    if len(effect.alike) > RIVALS:
        many = len(effect.alike) + 1
        return f"; {name} is one of {many} that fit alike, each with a size of its own"
    near = sorted(effect.alike, key=lambda other: abs(math.log(abs(other / value))))
    shown = either(tuple(significant(other, SEARCHED_DIGITS) for other in near))
    return f"; {name} {shown} fits as well, with a size of its own"


def _each(covariate: str, row: str) -> str:
    if covariate == "time_min":
        return "of time_min"  # Its parameters are per minute.
    return f"from {row} to {row}" if covariate == "sequence" else f"per count of {covariate}"


def first_after(effect: FoundEffect, item: TableResult) -> str:
    """The first part after a step."""
    at = effect.searched[AT][0]
    order = item.table.covariates.get("sequence")
    if order is None or len(order) != len(item.table.parts):
        return significant(at, 3)
    after = [name for name, value in zip(item.table.parts, order[:, 0], strict=True) if value > at]
    return after[0] if after else significant(at, 3)
