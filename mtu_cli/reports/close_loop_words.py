"""Effects and verdicts of close-loop as a machinist says them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from mtu_cli.analyses.close_loop.estimate import Parameter, Searched
from mtu_cli.analyses.close_loop.result import FoundEffect, TableResult
from mtu_cli.findings import listed
from mtu_cli.reports.numbers import p_value, plus_minus, significant
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS, UNITS

CHOICE = re.compile(r"\(([\w ]+)\|([\w ]+)\)")
"""Of ``(gains|loses)`` the first is used where the first parameter is positive."""
CHECKS = {
    "pattern": "{columns} share a pattern that some {rows} have more of",
    "walk": "{rows} follow one another too smoothly to be scatter",
    "field": "{columns} near one another err alike",
}
"""What a check of the remainder says where it is significant."""
NAMELESS = "a drift or a smooth field without a name explains the errors better than any effect"
SEARCHED_DIGITS, MOST_SEARCHED = 4, 6
UNITS_OF = {"_degC": " degC", "_min": " min", "x": " mm", "y": " mm", "z": " mm"}
"""By how a column or coordinate ends."""
WORTH_WHILE = 1.0
"""Standard deviations that an experiment must separate."""


def effect_text(effect: FoundEffect, item: TableResult) -> str:
    """Such as "X loses 8.2 ± 0.6 um at reversal"."""
    words, template = _words(effect, item), effect.candidate.sentence
    used = set(re.findall(r"{(\w+)}", template))
    if not template or not effect.parameters or not used <= words.keys():
        template = "{says}: {values}" if words["values"] else "{says}"
    positive = not effect.parameters or effect.parameters[0].value >= 0
    return CHOICE.sub(r"\1" if positive else r"\2", template).format_map(words)


def _words(effect: FoundEffect, item: TableResult) -> dict[str, str]:
    """What sentences may name of an effect (`files.effects.WORDS`)."""
    row, column = item.nouns
    words = {"says": effect.candidate.says, "row": row, "column": column}
    axis = effect.candidate.axis
    subjects = tuple(axis.upper()) if axis else ("all axes",)
    if item.table.component is not None:
        subjects = (item.table.component,)
    words |= dict(zip("AB", subjects, strict=False))
    sizes = effect.of_role("own")
    words["values"] = ", ".join(f"{p.name} {_size(p)}" for p in sizes)
    if effect.ratio is not None:
        words["values"] = f"{significant(effect.ratio)} times the rest"
    if effect.chosen is not None:
        words["chosen"] = effect.chosen
        words["says"] += f" ({effect.chosen})"
    if effect.covariate is not None:
        words["covariate"] = effect.covariate
    if (searched := effect.searched) is not None:
        words |= {"searched": _searched(searched), "at": _first_after(searched.value, item)}
    if len(sizes) == 1:
        (only,) = sizes
        words["value"] = _size(only)
        words["size"] = _size(only, abs(only.value))
        # The reversal value is twice the parameter, which acts both ways (ISO 230-2, 2.13).
        words["twice"] = _size(only, 2 * abs(only.value), 2 * only.u)
    elif len({p.unit for p in sizes}) == 1:
        words["wave"] = _amplitude(sizes, effect.covariance)
    return words


def _size(parameter: Parameter, value: float | None = None, u: float | None = None) -> str:
    scale = PARAMETER_UNITS[parameter.unit].to_internal
    value, u = (parameter.value if value is None else value), (parameter.u if u is None else u)
    return f"{plus_minus(value / scale, u / scale)} {parameter.unit}"


def _amplitude(sizes: Sequence[Parameter], covariance: FloatArray) -> str:
    """Root of the sum of squares of the parameters, with its u (JCGM 100, 5.2.2)."""
    values = np.array([p.value for p in sizes])
    k, length = len(values), float(np.linalg.norm(values))
    J = values / length if length > 0 else np.full(k, k**-0.5)
    return _size(sizes[0], length, float(np.sqrt(J @ covariance[:k, :k] @ J)))


def _searched(searched: Searched) -> str:
    """Such as "pitch 12.34 mm", or the middles of the ranges that fit alike."""
    word, _, unit = searched.name.rpartition("_")
    values = [searched.value]
    if len(searched.intervals) > 1:
        values = [(low + high) / 2 for low, high in searched.intervals]
    texts = [significant(value, SEARCHED_DIGITS) for value in values]
    texts[MOST_SEARCHED:] = ["..."] if len(texts) > MOST_SEARCHED else []
    return f"{word or searched.name} {' or '.join(texts)} {unit}".strip()


def _first_after(at: float, item: TableResult) -> str:
    """The first part after a step."""
    order, parts = item.table.covariates.get("sequence", np.zeros((0, 1)))[:, 0], item.table.parts
    after = np.flatnonzero(order[: len(parts)] > at)
    return parts[after[0]] if len(after) else significant(at, 3)


def verdict_text(item: TableResult, alpha: float) -> str:
    """The verdict on a table in a few sentences, its component in front."""
    text = " ".join(_sentences(item, alpha))
    component = item.table.component
    if component is None:
        return text
    return text if text.startswith(f"{component} ") else f"{component}: {text}"


def _sentences(item: TableResult, alpha: float) -> Iterator[str]:
    unit = item.table.unit
    floor = "" if item.floor is None else f"; repeatability {_shown(item, item.floor)} {unit}"
    if item.verdict == "none":
        yield (
            f"Nothing undeclared was found (at {100 * alpha:.2g} % false alarms in all): the rms "
            f"error of {_shown(item, item.before.rms)} {unit} is no more than scatter{floor}."
        )
        yield from _detectable(item)
        return
    if item.verdict == "unexplained":
        yield f"Something is left that no effect of the library describes: {_left(item)}."
    found = "; ".join(_named(effect, item) for effect in item.effects)
    if found:
        if item.verdict == "unexplained":
            found = f"Tentative: {found}"
        elif item.table.component is None:
            found = found[:1].upper() + found[1:]
        yield f"{found}; {_worth(item)}{floor}."
    for effect in item.effects:
        if len(effect.classes) > 1:
            yield _separated(effect)
    for each in item.crossings:
        subject = f"{each.axis.upper()} is right" if each.whole else f"{each.effect} is zero"
        unit = next((u for ends, u in UNITS_OF.items() if each.covariate.endswith(ends)), "")
        yield f"{subject} at {each.covariate} = {plus_minus(each.value, each.u)}{unit}."


def _detectable(item: TableResult) -> Iterator[str]:
    """What would have been found."""
    sizes = {x.name: x.minimum_detectable for x in item.candidates if x.minimum_detectable}
    if sizes:
        ends = (min(sizes, key=sizes.__getitem__), max(sizes, key=sizes.__getitem__))
        low, high = (_shown(item, sizes[name]) for name in ends)
        unit = item.table.unit
        yield (
            f"Four times in five an effect of {low} {unit} rms ({ends[0]}) to {high} {unit} "
            f"({ends[1]}) would have been found."
        )


def _named(effect: FoundEffect, item: TableResult) -> str:
    """With its name, and those that the data cannot separate from it."""
    _, *others = effect.class_names or (effect.name,)
    rivals = f", or {listed(others)}" if others else ""
    return f"{effect_text(effect, item)} ({effect.name}{rivals})"


def _separated(effect: FoundEffect) -> str:
    names = listed(effect.class_names)
    if effect.experiment is None or effect.experiment.predicted_d < WORTH_WHILE:
        separates = effect.candidate.separates
        do = f": {separates}" if separates else " by more data"
        return f"To separate {names}{do}."
    d = significant(effect.experiment.predicted_d)
    return f"To separate {names}: {effect.experiment.do} (then {d} standard deviations apart)."


def _worth(item: TableResult) -> str:
    """The error before and after the correction."""
    held = item.held_out
    of = "all data (nothing could be held out)" if held is None else f"held-out {held}"
    before, after = (_shown(item, scores.rms) for scores in (item.before, item.after))
    unit = item.table.unit
    if all(effect.ratio is not None for effect in item.effects):
        return f"no equation corrects that: the rms error of {of} is {before} {unit}"
    moves = "falls" if item.after.rms < item.before.rms else "goes"
    return f"with the correction the rms error of {of} {moves} from {before} to {after} {unit}"


def _left(item: TableResult) -> str:
    (row, _), (rows, columns) = item.nouns, item.plurals
    p = dict(item.checks)
    texts = [
        f"{CHECKS.get(name, name).format(row=row, rows=rows, columns=columns)} "
        f"({name}, p {p_value(p.get(name))})"
        for name in item.fired
    ]
    return "; ".join([*texts, *([NAMELESS] if item.nameless else [])])


def _shown(item: TableResult, value: float) -> str:
    return significant(value / UNITS[item.table.unit].to_internal)
