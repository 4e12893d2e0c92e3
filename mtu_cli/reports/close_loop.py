"""The report of close-loop: what the model lacks, in a machinist's words, and what correcting it is
worth.

`before` and `after` are scores of the held-out data: everything is refitted without them. `rms`
pools all coordinates, `p95` and `max` are of the error vector's length. Keys of an angular
component end in `_arcsec` in place of `_um`. Of several components the first with the verdict
stands at the top, `tables` hold all.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mtu_cli.analyses.close_loop.result import CloseLoopResult, FoundEffect, TableResult
from mtu_cli.files.effects import WORD
from mtu_cli.findings import listed
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports.close_loop_figures import figure, ranked
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Fields, declare
from mtu_cli.reports.numbers import p_value, plus_minus, significant
from mtu_cli.units import PARAMETER_UNITS, UNITS

CHOICE = re.compile(r"\(([\w ]+)\|([\w ]+)\)")
"""Of ``(gains|loses)`` the first is used where the first parameter is positive."""
CHECKS = {
    "pattern": "several {rows} share a pattern over the {columns}",
    "walk": "{rows} follow one another too smoothly to be scatter",
    "field": "{columns} near one another err alike",
    "column-variance": "{columns} differ by more than single entries scatter",
    "part-variance": "{rows} differ by more than the model or single entries explain",
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
    if not template or not effect.parameters or not {*WORD.findall(template)} <= words.keys():
        template = "{says}: {values}" if words["values"] else "{says}"
    positive = not effect.parameters or effect.parameters[0].value >= 0
    text = CHOICE.sub(r"\1" if positive else r"\2", template)
    return WORD.sub(lambda match: words[match[1]], text)


def _words(effect: FoundEffect, item: TableResult) -> dict[str, str]:
    """What it is, and the words of a `SENTENCE` that it has."""
    row, column = item.table.nouns
    words = {"says": effect.candidate.says, "row": row, "column": column}
    axis = effect.candidate.axis
    subjects = tuple(axis.upper()) if axis else ("all axes",)
    if item.table.component is not None:
        subjects = (item.table.component,)
    words |= dict(zip("AB", subjects, strict=False))
    sizes = effect.of_role("own")
    words["values"] = ", ".join(f"{p.name} {_size(p.unit, p.value, p.u)}" for p in sizes)
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
        words["value"] = _size(size.unit, size.value, size.u)
        words["size"] = _size(size.unit, abs(size.value), size.u)
        # The reversal value is twice the parameter, which acts both ways (ISO 230-2, 2.13).
        words["twice"] = _size(size.unit, 2 * abs(size.value), 2 * size.u)
    elif len({p.unit for p in sizes}) == 1:
        # The root of the sum of squares, with its u (JCGM 100, 5.2.2).
        amplitudes = np.array([p.value for p in sizes])
        k, length = len(amplitudes), float(np.linalg.norm(amplitudes))
        J = amplitudes / length if length > 0 else np.full(k, k**-0.5)
        rows = [p.row for p in sizes]
        u = float(np.sqrt(J @ item.covariance[np.ix_(rows, rows)] @ J))
        words["wave"] = _size(sizes[0].unit, length, u)
    return words


def _size(unit: str, value: float, u: float) -> str:
    scale = PARAMETER_UNITS[unit].to_internal
    return f"{plus_minus(value / scale, u / scale)} {unit}"


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
        sizes = {
            x.minimum_detectable: x.candidate.name for x in item.candidates if x.minimum_detectable
        }
        if sizes:
            low, high = (f"{with_unit(end)} rms ({sizes[end]})" for end in (min(sizes), max(sizes)))
            yield f"Four times in five an effect of {low} to {high} would have been found."
        return
    tentative = ""
    if item.verdict == "unexplained":
        (rows, columns), p = item.table.plurals, dict(item.checks)
        reasons = [
            f"{CHECKS[name].format(rows=rows, columns=columns)} ({name}, p {p_value(p.get(name))})"
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
        before, after = (number(scores.rms) for scores in (item.before, item.after))
        moves = "falls" if item.after.rms < item.before.rms else "goes"
        rms = f"the rms error of held-out {item.held_out}"
        worth = f"with the correction {rms} {moves} from {before} to {after} {unit}"
        if all(effect.ratio is not None for effect in item.effects):
            worth = f"no equation corrects that: {rms} is {before} {unit}"
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


BEST = 5
"""Candidates that are listed."""


class Of(NamedTuple):
    """Something of a table's result, with that result."""

    one: Any
    item: TableResult


SCORES = """
    rms_UNIT | rms | root mean square error over all coordinates
    *axes
    p95_UNIT | p95 | 95 % of the errors' lengths are below it
    max_UNIT | largest | length of the largest error
    chi2_per_dof | | mean square over the variance that scatter explains
"""
AXIS = "rms_AXIS_UNIT | by_axis.AXIS | root mean square error of one axis"
SCORED = """
    component | table.component | whose readings are judged; null: points
    before. | | *scores
    after. | | *scores
    after_averaged. | | *scores
    floor_UNIT | floor | repeatability of one coordinate, below which no error can fall
    in_sample.before. | in_sample_before | *scores
    in_sample.after. | in_sample_after | *scores
    improvement_percent | improvement() | fall of the rms error of what was held out | -, unit=-
    held_out.by | held_out | what was left out in turn
    unexplained.found | rest() | whether something is left that no effect of the library explains
    unexplained.checks[]. | checks()
        name | | check of what the effects leave
        p | | family-wise p of the check
        fired | | whether it is significant
    unexplained.rms_UNIT | in_sample_after.rms | root mean square of what the effects leave
"""
TABLE = """
    verdict | | none, named, class or unexplained
    *scored
"""
EFFECT = """
    name | one.name | name of the effect
    family | one.candidate.family | family of the library
    axis | one.candidate.axis | axis, axes or component that errs; null: all
    component | item.table.component | in whose readings it was found; null: points
    covariate | one.covariate | column that it depends on
    says | sentence() | what it does, with its size
    equations | equations() | equations of the machine that it adds to; empty: none can hold it
    parameters{}. | parameters()
        value | | estimate | -, size=size(unit)
        u | | standard uncertainty | -, size=size(unit)
        unit | | unit of value, u and interval95
        dof | | degrees of freedom (Satterthwaite); null: inf
        interval95 | | 95 % interval (Student's t) | -, interval, size=size(unit)
    table. | one.table
        of | along | axis along which a smooth effect runs
        at_mm | knots | places of its values
        values_UNIT | values | values at these places
        u_UNIT | u() | their standard uncertainties
    chosen | one.chosen | feature, part or operation that it is of
    scatter_ratio | one.ratio | how many times the rest's scatter it has
    searched{}. | searched()
        value | | likeliest value of what was searched
        interval95 | ends(intervals) | lowest and highest value of its 95 % set
        intervals | | the 95 % set, a union of intervals
    p_familywise | one.p_familywise | p among all tests
    log_bayes_factor | one.log_bayes_factor | natural log of the Bayes factor against the model \
        without it
    posterior | one.posterior | its share among the explanations in its place
    explained_share | one.explained_share | its weighted squares over those of all errors
    class | one.class_names | names that this data cannot separate, itself first
    aliases | one.aliases | other names for the same errors here, whatever the data
    experiment. | one.experiment
        do | | follow-up that would separate the class best
        predicted_d | | separation after it, in standard deviations
"""
RESULTS_OF = """
    verdict | | none, named, class or unexplained: the weakest of all tables
    undeclared_effect_found | found() | whether the verdict is another than none
    verdict_text | sentences() | the verdict in sentences, one a table
    alpha | | family-wise rate of false alarms
    datum | tables.0.table.datum | best-fit alignment removed from each part
    effects[]. | effects() | *effect
    candidates[]. | candidates() | *candidate
    tables[]. | several() | *table
"""
CANDIDATE = """
    component | item.table.component | whose readings; null: points
    name | one.candidate.name | name of the effect | candidate, text, mark=star(), csv=candidate
    family | one.candidate.family | family of the library
    p_familywise | one.p_familywise | p among all tests | p family- / wise, p
    log_bayes_factor | one.log_bayes_factor | natural log of the Bayes factor against no effect \
        | ln Bayes / factor, fix1
    posterior | one.posterior | share among all candidates, each alone | posterior / %, percent1
    *smallest
    found | is_effect() | whether it is one of the effects
    in_class | in_class() | whether it is in the class of one
    unavailable | one.unavailable | why it could not be tested
    notes | one.candidate.notes | why some of its forms could not be
"""
SMALLEST = """
    minimum_detectable_UNIT | smallest_UNIT() | rms over the data of an effect that would be found \
        four times in five | would be found / from rms UNIT, sig2()
"""
SHOWN = """
    - | effect | | effect, text
    - | one.name | | parameter, text
    - | one.value | | value ± u, plus-minus, u=one.u, size=size(one.unit), unit=
    - | one.unit | | unit, text
    - | one.interval95 | | 95 % / interval, interval, u=one.u, size=size(one.unit)
    - | p_familywise | | p family- / wise, p
    - | explained_share | | of squares / %, percent1
"""
SCORED_TABLE = """
    - | table.component | | component, text
    - | verdict | | verdict, text
    - | before.rms | | rms / before, sig2(), size=size(table.unit)
    - | after.rms | | rms / after, sig2(), size=size(table.unit)
    - | floor | | repeatability, sig2(), size=size(table.unit), unit=
    - | table.unit | | unit, text
"""


def _ends(intervals: Sequence[tuple[float, float]]) -> tuple[float, float]:
    return intervals[0][0], intervals[-1][1]


def _in_class(x: Of) -> bool:
    return any(x.one.candidate.name in effect.class_names for effect in x.item.effects)


def _smallest(unit: str, x: Of) -> Any:
    return x.one.minimum_detectable if x.item.table.unit == unit else None


def _items(name: str, result: CloseLoopResult) -> list[Of]:
    return [Of(one, item) for item in result.tables for one in getattr(item, name)]


DEFINITIONS: dict[str, Any] = {
    "sig2": lambda value, u, digits: significant(value, 2),
    "size": lambda unit: PARAMETER_UNITS[unit].to_internal if unit in PARAMETER_UNITS else 1.0,
    # Of all tables.
    "found": lambda result: result.verdict != "none",
    "sentences": lambda result: [verdict_text(item, result.alpha) for item in result.tables],
    "several": lambda result: result.tables if len(result.tables) > 1 else (),
    "effects": partial(_items, "effects"),
    "effect": lambda x: _fields(EFFECT, x and x.item),
    "candidates": partial(_items, "candidates"),
    "candidate": lambda x: _fields(CANDIDATE, x and x.item),
    "table": lambda item: _fields(TABLE, item),
    # Of one.
    "scored": SCORED,
    "scores": SCORES,
    "improvement": lambda x: 100 * (1 - x.after.rms / x.before.rms) if x.before.rms > 0 else None,
    "rest": lambda item: bool(item.fired) or item.nameless,
    "checks": lambda item: [
        {"name": name, "p": p, "fired": name in item.fired} for name, p in item.checks
    ],
    # Of an effect.
    "sentence": lambda x: effect_text(x.one, x.item),
    "equations": lambda x: x.one.equations if x.one.candidate.over is None else {},
    "parameters": lambda x: {p.name: p for p in x.one.parameters},
    "searched": lambda x: {} if x.one.searched is None else {x.one.searched.name: x.one.searched},
    "ends": _ends,
    "u": lambda table: np.sqrt(np.diag(table.covariance)),
    # Of a candidate.
    "is_effect": lambda x: x.one.candidate.name in [effect.name for effect in x.item.effects],
    "in_class": _in_class,
    "star": lambda x: "*" if _in_class(x) else "",
    "smallest_um": partial(_smallest, "um"),
    "smallest_arcsec": partial(_smallest, "arcsec"),
}


def _fields(text: str, item: TableResult | None, *units: str) -> Fields:
    """The fields of a text in the unit and axes of the table, of points of a plane in um; with the
    smallest size of a candidate in each of `units`.
    """
    unit, names = ("um", ("x", "y")) if item is None else (item.table.unit, item.table.axes)
    axes = [x for name in names for x in declare(AXIS, UNIT=unit, AXIS=name, **DEFINITIONS)]
    smallest = "\n".join(SMALLEST.replace("UNIT", each) for each in units or (unit,))
    return declare(text, UNIT=unit, axes=axes, smallest=smallest, **DEFINITIONS)


RESULTS_FIELDS = _fields(RESULTS_OF, None)
RESULTS = [*RESULTS_FIELDS, *_fields(SCORED, None)]
ROW = _fields(CANDIDATE, None)


def document(result: CloseLoopResult, digits: int = 2) -> Document:
    """The effects, errors before and after, and the likeliest candidates; CSV of all of these."""
    first = next(item for item in result.tables if item.verdict == result.verdict)
    units = dict.fromkeys(item.table.unit for item in result.tables)
    rows = [row for item in result.tables for effect in item.effects for row in _rows(effect, item)]
    held_out = listed(dict.fromkeys(item.held_out for item in result.tables))
    tables = [
        Table("", _fields(CANDIDATE, None, *units), _items("candidates", result), selection=()),
        Table("Effects", _fields(SHOWN, None), rows),
        Table(f"Errors of held-out {held_out}", _fields(SCORED_TABLE, None), result.tables),
        _candidates(first),
    ]
    sentences = [verdict_text(x, result.alpha) for x in result.tables if x.effects or x is first]
    scores = declare("-. | first() | *scored", first=lambda _: first, scored=_fields(SCORED, first))
    return Document(
        "Undeclared effects",
        ([*RESULTS_FIELDS, *scores], result),
        tables,
        lambda _: figure(result, first),
        "\n".join([f"Undeclared effects: {result.verdict}", *sentences]),
        digits,
    )


def _rows(effect: FoundEffect, item: TableResult) -> Iterator[dict[str, Any]]:
    """A row for each parameter and searched value; of a scatter effect the ratio."""
    rows: list[Any] = [*effect.of_role("own")]
    if (searched := effect.searched) is not None:
        word, _, unit = searched.name.rpartition("_")
        words = {"name": word or unit, "unit": unit if word else ""}
        rows.append(words | {"value": searched.value, "interval95": _ends(searched.intervals)})
    if effect.ratio is not None:
        rows.append({"name": "ratio of s", "unit": "", "value": round(effect.ratio, 2)})
    of_effect = {
        "effect": " ".join(filter(None, (item.table.component, effect.name))),
        "p_familywise": effect.p_familywise,
        "explained_share": effect.explained_share or None,
    }
    for row in (*rows, *effect.of_role("margin", "level")):
        yield {**of_effect, "one": row}
        of_effect = {"effect": ""}


def _candidates(item: TableResult) -> Table:
    reasons: dict[str, list[str]] = {}
    for each in item.candidates:
        if each.unavailable:
            reasons.setdefault(each.unavailable, []).append(each.candidate.name)
    notes = [f"not tested: {listed(names)}: {reason}" for reason, names in reasons.items()]
    of = "" if item.table.component is None else f" of {item.table.component}"
    tested = ranked(item)
    missing = f", {sum(map(len, reasons.values()))} could not be (--detail: why)" if reasons else ""
    footer = f"{len(tested)} tested, each alone{missing}; *: found, or in the class of an effect"
    rows = [Of(x, item) for x in tested[:BEST]]
    return Table(f"Likeliest candidates{of}", _fields(CANDIDATE, item), rows, footer, notes)
