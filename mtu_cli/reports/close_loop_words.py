"""Effects and verdicts of close-loop in a machinist's words."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from mtu_cli.analyses.close_loop.result import FoundEffect, Parameter, TableResult
from mtu_cli.findings import listed
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports.numbers import p_value, plus_minus, significant
from mtu_cli.units import PARAMETER_UNITS, UNITS

CHOICE = re.compile(r"\(([\w ]+)\|([\w ]+)\)")
"""Of ``(gains|loses)`` the first is used where the first parameter is positive."""
CHECKS = {
    "pattern": "{columns} share a pattern that some {rows} have more of",
    "walk": "{rows} follow one another too smoothly to be scatter",
    "field": "{columns} near one another err alike",
}
"""What a check of the remainder says where it is significant."""
WITHOUT_NAME = "a drift or a smooth field without a name"
NAMELESS = f"{WITHOUT_NAME} explains the errors better than any effect"
MOST_SEARCHED = 6
WORTH_WHILE = 1.0
"""Standard deviations that an experiment must separate."""


def effect_text(effect: FoundEffect, item: TableResult) -> str:
    """Such as "X loses 8.2 ± 0.6 um at reversal"."""
    words, template = _words(effect, item), effect.candidate.sentence
    placeholders = set(re.findall(r"{(\w+)}", template))
    if not template or not effect.parameters or not placeholders <= words.keys():
        template = "{says}: {values}" if words["values"] else "{says}"
    positive = not effect.parameters or effect.parameters[0].value >= 0
    text = CHOICE.sub(r"\1" if positive else r"\2", template)
    return re.sub(r"{(\w+)}", lambda match: words[match[1]], text)


def _words(effect: FoundEffect, item: TableResult) -> dict[str, str]:
    """What sentences may name of an effect (`files.effects.Family`)."""
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
        word, _, unit = searched.name.rpartition("_")
        # The middles of other ranges fit nearly as well.
        ranges = [ends for ends in searched.intervals if not ends[0] <= searched.value <= ends[1]]
        values = [searched.value, *(sum(ends) / 2 for ends in ranges)]
        choices = listed((significant(value, 4) for value in values), MOST_SEARCHED, " or ")
        words["searched"] = f"{word or unit} {choices} {unit if word else ''}".strip()
        # The first part after a step.
        order = item.table.covariates.get("sequence", np.zeros((0, 1)))[:, 0]
        parts = np.flatnonzero(order[: len(item.table.parts)] > searched.value)
        words["at"] = item.table.parts[parts[0]] if len(parts) else significant(searched.value, 3)
    if len(sizes) == 1:
        (size,) = sizes
        words["value"] = _size(size)
        words["size"] = _size(size, abs(size.value))
        # The reversal value is twice the parameter, which acts both ways (ISO 230-2, 2.13).
        words["twice"] = _size(size, 2 * abs(size.value), 2 * size.u)
    elif len({p.unit for p in sizes}) == 1:
        # The root of the sum of squares, with its u (JCGM 100, 5.2.2).
        amplitudes = np.array([p.value for p in sizes])
        k, length = len(amplitudes), float(np.linalg.norm(amplitudes))
        J = amplitudes / length if length > 0 else np.full(k, k**-0.5)
        u = float(np.sqrt(J @ effect.covariance[:k, :k] @ J))
        words["wave"] = _size(sizes[0], length, u)
    return words


def _size(parameter: Parameter, value: float | None = None, u: float | None = None) -> str:
    scale = PARAMETER_UNITS[parameter.unit].to_internal
    value, u = (parameter.value if value is None else value), (parameter.u if u is None else u)
    return f"{plus_minus(value / scale, u / scale)} {parameter.unit}"


def verdict_text(item: TableResult, alpha: float) -> str:
    """The verdict on a table in a few sentences, its component in front."""
    text, component = " ".join(_sentences(item, alpha)), item.table.component
    if component is None:
        return text[:1].upper() + text[1:]
    return text if text.startswith(f"{component} ") else f"{component}: {text}"


def _sentences(item: TableResult, alpha: float) -> Iterator[str]:
    """The unexplained rest, the effects, the gain of correcting them, what would separate them."""
    unit = item.table.unit

    def number(value: float) -> str:
        return significant(value / UNITS[unit].to_internal)

    def with_unit(value: float) -> str:
        return f"{number(value)} {unit}"

    floor = "" if item.floor is None else f"; repeatability {with_unit(item.floor)}"
    if item.verdict == "none":
        yield (
            f"Nothing undeclared was found (at {100 * alpha:.2g} % false alarms in all): the rms "
            f"error of {with_unit(item.before.rms)} is no more than scatter{floor}."
        )
        sizes = {x.minimum_detectable: x.name for x in item.candidates if x.minimum_detectable}
        if sizes:
            low, high = (f"{with_unit(end)} rms ({sizes[end]})" for end in (min(sizes), max(sizes)))
            yield f"Four times in five an effect of {low} to {high} would have been found."
        return
    tentative = ""
    if item.verdict == "unexplained":
        row, (rows, columns), p = item.nouns[0], item.plurals, dict(item.checks)
        reasons = [
            f"{CHECKS[name].format(row=row, rows=rows, columns=columns)} "
            f"({name}, p {p_value(p.get(name))})"
            for name in item.fired
        ]
        reasons += [NAMELESS] if item.nameless else []
        yield f"Something is left that no effect of the library describes: {'; '.join(reasons)}."
        tentative = "Tentative: "
    texts = []
    for effect in item.effects:
        others = [*effect.class_names[1:], *[WITHOUT_NAME] * effect.nameless]
        rivals = f", or {listed(others)}" if others else ""
        texts.append(f"{effect_text(effect, item)} ({effect.name}{rivals})")
    if texts:
        held_out = item.held_out
        of = "all data (nothing could be held out)" if held_out is None else f"held-out {held_out}"
        before, after = (number(scores.rms) for scores in (item.before, item.after))
        moves = "falls" if item.after.rms < item.before.rms else "goes"
        worth = f"with the correction the rms error of {of} {moves} from {before} to {after} {unit}"
        if all(effect.ratio is not None for effect in item.effects):
            worth = f"no equation corrects that: the rms error of {of} is {before} {unit}"
        yield f"{tentative}{'; '.join(texts)}; {worth}{floor}."
    for effect in item.effects:
        if len(effect.class_names) > 1:
            separates = effect.candidate.separates
            do = f": {separates}" if separates else " by more data"
            if (best := effect.experiment) is not None and best.predicted_d >= WORTH_WHILE:
                separation = significant(best.predicted_d)
                do = f": {best.do} (then {separation} standard deviations apart)"
            yield f"To separate {listed(effect.class_names)}{do}."
    for each in item.crossings:
        subject = f"{each.axis.upper()} is right" if each.whole else f"{each.effect} is zero"
        of = " mm" if each.covariate in AXES else " degC" * each.covariate.endswith("_degC")
        yield f"{subject} at {each.covariate} = {plus_minus(each.value, each.u)}{of}."
