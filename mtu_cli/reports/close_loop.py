"""The report of close-loop: what the model lacks, and what knowing it is worth.

`before` and `after` are scores of what was held out (`held_out.by`; null: nothing could be, and
they are in sample): everything is refitted without it. `rms` pools all coordinates, `p95` and
`max` are of the error vector's length. Keys of an angular component end in `_arcsec` in place of
`_um`. Of several components the first with the verdict stands at the top, `tables` hold all.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from mtu_cli.analyses.close_loop.result import (
    CloseLoopResult,
    TableResult,
)
from mtu_cli.findings import listed
from mtu_cli.reports import close_loop_figures
from mtu_cli.reports.close_loop_words import effect_text, held_out_by, verdict_text
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import SIZES, Fields, declare
from mtu_cli.reports.numbers import significant
from mtu_cli.units import PARAMETER_UNITS

BEST = 5
"""Candidates that are listed."""


class Of(NamedTuple):
    """Something of a table's result, with that result."""

    one: Any
    item: TableResult


class Whole(NamedTuple):
    """A result, and the table whose scores stand at its top."""

    result: CloseLoopResult
    first: TableResult


SCORES = """
    rms_UNIT | rms | root mean square error over all coordinates | rms, sig2()
    *axes
    p95_UNIT | p95 | 95 % of the errors' lengths are below it | 95 %, sig2()
    max_UNIT | largest | length of the largest error | largest, sig2()
    chi2_per_dof | | mean square over the variance that scatter explains | chi2/dof, sig2()
"""
AXIS = "rms_{0}_UNIT | by_axis.{0} | root mean square error of one axis | rms {0}, sig2()"
# @ is where a table is: itself, or the first of a result.
SCORED = """
    before. | @before | *scores
    after. | @after | *scores
    after_averaged. | @after_averaged | *scores
    floor_UNIT | @floor | repeatability of one coordinate, below which no error can fall
    in_sample.before. | @in_sample_before | *scores
    in_sample.after. | @in_sample_after | *scores
    improvement_percent | improvement(@) | fall of the rms error of what was held out | -, unit=-
    held_out.by | held_out(@) | what was left out in turn; null: nothing, all scores are in sample
    unexplained.found | left(@) | whether something is left that no effect of the library explains
    unexplained.without_name | @nameless | whether a drift or field without a name explains more
    unexplained.checks[]. | checks(@)
        name | one.0 | check of what the effects leave
        component | item.table.component | whose readings; null: points
        p | one.1 | family-wise p of the check
        fired | fired() | whether it is significant
    unexplained.rms_UNIT | @in_sample_after.rms | root mean square of what the effects leave
"""
TABLE = """
    component | table.component | whose readings are judged
    verdict | | none, named, class or unexplained
    effects | names() | names of its effects
    *scored
"""
PARAMETER = """
    value | | estimate | -, size=size()
    u | | standard uncertainty | -, size=size()
    unit | | unit of value, u and interval95
    dof | | degrees of freedom (Satterthwaite); null: inf
    interval95 | interval95 | 95 % interval (Student's t) | -, interval, size=size()
    role | | own of the effect, margin (a lower term that it is estimated with), level, or \
        searched (a change of what was searched)
"""
EFFECT = """
    name | one.name | name of the effect
    family | one.family | family of the library
    kind | one.kind | mean, smooth, scatter, offset or outlier
    axis | one.axis | axis, axes or component that errs; null: all
    component | one.component | in whose readings it was found; null: points
    covariate | one.covariate | column that it depends on
    says | sentence() | what it does, with its size
    separates | one.separates | what would separate it from others
    equations | equations() | equations of the machine that it adds to; empty: none can hold it
    parameters{}. | parameters() | *parameter
    covariance | covariance() | covariance of the parameters, in their order and units
    table. | one.table
        of | | axis along which a smooth effect runs
        at_mm | | places of its values
        values_UNIT | values | values at these places
        u_UNIT | u() | their standard uncertainties
        covariance_UNIT2 | covariance | covariance of the values
        roughness_UNIT2_per_mm3 | roughness | variance of the integrated Wiener process between \
            them | -, size=square()
        between_UNIT2 | between | variance added off these places
    chosen | one.chosen | feature, part or operation that it is of
    scatter_ratio | one.ratio | how many times the rest's scatter it has
    searched{}. | one.searched
        value | | likeliest value of what was searched
        interval95 | whole() | lowest and highest value of its 95 % set
        intervals | | the 95 % set, a union of intervals
    found_at_degC | one.found_at | temperatures that were the same in all data, not 20 degC: what \
        it is at another is not known
    p_familywise | one.p_familywise | p among all tests
    log_bayes_factor | one.log_bayes_factor | natural log of the Bayes factor against the model \
        without it
    posterior | one.posterior | its share among the explanations in its place
    explained_share | one.explained_share | share of the weighted squares of the errors
    class | one.class_names | names that this data cannot separate, itself first
    class_posteriors | posteriors() | their posteriors
    aliases | one.aliases | other names for the same errors here, whatever the data
    without_name | one.nameless | posterior of a drift or field without a name in its place
    experiment. | one.experiment
        do | | follow-up that would separate the class best
        predicted_d | | separation after it, in standard deviations
        now_d | | separation today
    folds.chose_it | one.folds.0 | folds of held-out data in which it was chosen again
    folds.of | one.folds.1 | number of folds
"""
CROSSING = """
    axis | one.axis | axis whose effects cancel
    covariate | one.covariate | column or coordinate along which they do
    effect | one.effect | effect that is 0 there
    whole | one.whole | whether all errors along the axis are 0 there
    value | one.value | where
    u | one.u | standard uncertainty
    interval95 | one.interval95 | 95 % interval (Fieller); null: unbounded
"""
OUTLIER = """
    feature | one.0 | feature of an excluded entry
    part | one.1 | its part or pass
    component | item.table.component | whose readings; null: points
    axis | one.2 | its axis
    error_UNIT | one.3 | its error, measured minus predicted
"""
RESULTS_OF = """
    verdict | result.verdict | none, named, class or unexplained: the weakest of all tables
    undeclared_effect_found | found() | whether the verdict is another than none
    verdict_text | sentences() | the verdict in sentences, one a table
    alpha | result.alpha | family-wise rate of false alarms
    datum | result.datum | best-fit alignment removed from each part
    component | first.table.component | whose scores these are; null: points
    *scored
    effects[]. | effects() | *effect
    crossings[]. | crossings() | *crossing
    candidates[]. | candidates() | *candidate
    outliers[]. | outliers() | *outlier
    tables[]. | several() | *table
"""
CANDIDATE = """
    component | one.component | whose readings; null: points
    NAME | one.name | name of the effect | candidate, text, mark=star()
    family | one.family | family of the library
    p_familywise | one.p_familywise | p among all tests | p family- / wise, p
    log_bayes_factor | one.log_bayes_factor | natural log of the Bayes factor against no effect \
        | ln Bayes / factor, fix1
    posterior | one.posterior | share among all candidates, each alone | posterior / %, percent1
    *smallest
    found | found() | whether it is one of the effects
    in_class | in_class() | whether it is in the class of one
    unavailable | one.unavailable | why it could not be tested
"""
SMALLEST = """
    minimum_detectable_UNIT | smallest() | rms over the data of an effect that would be found four \
        times in five | would be found / from rms UNIT, sig2()
"""
SHOWN = """
    - | effect() | | effect, text
    - | one.name | | parameter, text
    - | one.value | | value ± u, plus-minus, u=one.u, size=size(one), unit=
    - | one.unit | | unit, text
    - | one.interval95 | | 95 % / interval, interval, u=one.u, size=size(one)
    - | of.p_familywise | | p family- / wise, p
    - | share(of) | | of squares / %, percent1
    - | folds(of) | | chosen in / folds, text
"""
SEVERAL = """
    - | table.component | | component, text
    - | verdict | | verdict, text
    - | names() | | effects, text
    before_UNIT | before.rms | | before, sig2()
    after_UNIT | after.rms | | after, sig2()
    floor_UNIT | floor | | repeatability, sig2()
"""


def _size(parameter: Any) -> float:
    unit = PARAMETER_UNITS.get(parameter.unit)
    return 1.0 if unit is None else unit.to_internal


def _covariance(x: Of) -> Any:
    factors = np.array([_size(p) for p in x.one.all_parameters])
    return x.one.covariance / np.outer(factors, factors) if len(factors) else None


def _improvement(item: TableResult) -> float | None:
    return 100 * (1 - item.after.rms / item.before.rms) if item.before.rms > 0 else None


def _is_found(x: Of) -> bool:
    return any(x.one.name == effect.name for effect in x.item.effects)


def _in_class(x: Of) -> bool:
    return any(x.one.name in effect.class_names for effect in x.item.effects)


def _each(name: str, whole: Whole) -> list[Of]:
    return [Of(one, item) for item in whole.result.tables for one in getattr(item, name)]


def _sig2(value: Any, u: None, digits: int) -> str:
    return significant(value, 2)


def _smallest(unit: str, x: Of) -> float | None:
    found: float | None = x.one.minimum_detectable
    return found if x.item.table.unit == unit else None


def _candidate(name: str, *units: str) -> Fields:
    """Of JSON or, with another name of the name, of CSV and table; a size in each of `units`."""
    sizes = [
        declare(SMALLEST.replace("UNIT", unit), smallest=partial(_smallest, unit), sig2=_sig2)
        for unit in units
    ]
    star = {True: "*", False: ""}
    return declare(
        CANDIDATE.replace("NAME", name),
        smallest=[field for each in sizes for field in each],
        found=_is_found,
        in_class=_in_class,
        star=lambda x: star[_is_found(x) or _in_class(x)],
    )


ROW = _candidate("candidate", "um")


@cache
def _known(unit: str, axes: tuple[str, ...], at: str = "") -> dict[str, Fields]:
    """The fields of a table whose errors are of `axes` and in `unit`, by name."""

    def fields(text: str, **more: Any) -> Fields:
        return declare(text.replace("UNIT", unit).replace("@", at), sig2=_sig2, **more)

    scores = fields(SCORES, axes=[x for axis in axes for x in fields(AXIS.format(axis))])
    scored = fields(
        SCORED,
        scores=scores,
        improvement=_improvement,
        held_out=held_out_by,
        left=lambda item: bool(item.fired) or item.nameless,
        checks=lambda item: [Of(check, item) for check in item.checks],
        fired=lambda x: x.one[0] in x.item.fired,
    )
    effect = fields(
        EFFECT,
        sentence=lambda x: effect_text(x.one, x.item),
        parameter=declare(PARAMETER, size=_size),
        equations=lambda x: x.one.equations if x.one.over is None else {},
        parameters=lambda x: {p.name: p for p in x.one.all_parameters},
        covariance=_covariance,
        u=lambda table: np.sqrt(np.diag(table.covariance)),
        square=lambda table: SIZES[f"{unit}2"],
        whole=lambda found: (found.intervals[0][0], found.intervals[-1][1]),
        posteriors=lambda x: dict(x.one.classes),
    )
    names = {"names": lambda item: [each.name for each in item.effects]}
    return {
        "scores": scores,
        "scored": scored,
        "effect": effect,
        "candidate": _candidate("name", unit),
        "outlier": fields(OUTLIER),
        "table": fields(TABLE, scored=scored, **names),
        "several": fields(SEVERAL, names=lambda item: listed(each.name for each in item.effects)),
    }


def _of(name: str, part: TableResult | Of | None, at: str = "") -> Fields:
    """The fields `name` of a table or something in it; of points in x and y where there is none."""
    if part is None:
        return _known("um", ("x", "y"), at)[name]
    table = (part.item if isinstance(part, Of) else part).table
    return _known(table.unit, tuple(table.axes), at)[name]


def _results(first: TableResult | None = None) -> Fields:
    """The fields of `results` where the scores of a table stand at the top."""
    return declare(
        RESULTS_OF,
        found=lambda whole: whole.result.verdict != "none",
        sentences=lambda whole: [verdict_text(x, whole.result.alpha) for x in whole.result.tables],
        several=lambda whole: whole.result.tables if len(whole.result.tables) > 1 else (),
        scored=_of("scored", first, "first."),
        crossing=declare(CROSSING),
        **{name: partial(_of, name) for name in ("effect", "candidate", "outlier", "table")},
        effects=partial(_each, "effects"),
        crossings=partial(_each, "crossings"),
        candidates=partial(_each, "candidates"),
        outliers=partial(_each, "set_aside"),
    )


RESULTS = _results()


def document(result: CloseLoopResult, digits: int = 2) -> Document:
    """The effects, errors before and after, and the likeliest candidates; CSV of all of these."""
    first = next(item for item in result.tables if item.verdict == result.verdict)
    whole = Whole(result, first)
    units = dict.fromkeys(item.table.unit for item in result.tables)
    tables = [
        Table("", _candidate("candidate", *units), _each("candidates", whole), shown=()),
        Table("Effects", _shown(), list(_rows(result))),
        *_before_after(result, first),
        _candidates(first),
    ]
    said = [verdict_text(x, result.alpha) for x in result.tables if x.effects or x is first]
    return Document(
        "Undeclared effects",
        (_results(first), whole),
        tables,
        partial(close_loop_figures.figure, result, first),
        "\n".join([f"Undeclared effects: {result.verdict}", *said]),
        digits,
    )


def _shown() -> Fields:
    return declare(
        SHOWN,
        size=_size,
        effect=lambda row: row.named,
        share=lambda of: of.explained_share or None,
        folds=lambda of: f"{of.folds[0]} of {of.folds[1]}" if of.folds[1] else None,
    )


def _rows(result: CloseLoopResult) -> Iterator[Any]:
    """A row a parameter and value that was searched; of a scatter effect its ratio."""
    for effect in result.effects:
        rows = [_row(p.name, p.unit, p.value, p.u, p.interval95) for p in effect.parameters]
        for name, found in effect.searched.items():
            word, _, unit = name.rpartition("_")
            whole = (found.intervals[0][0], found.intervals[-1][1])
            rows.append(_row(word or name, unit, found.value, None, whole))
        if effect.ratio is not None:
            rows.append(_row("ratio of s", "", round(effect.ratio, 2), None, None))
        beside = [p for p in effect.beside if p.role != "searched"]
        rows += [_row(p.name, p.unit, p.value, p.u, p.interval95) for p in beside]
        named = " ".join(filter(None, (effect.component, effect.name)))
        for i, one in enumerate(rows):
            first = i == 0
            yield SimpleNamespace(one=one, named=named * first, of=effect if first else None)


def _row(name: str, unit: str, value: float, u: float | None, interval95: Any) -> SimpleNamespace:
    return SimpleNamespace(name=name, unit=unit, value=value, u=u, interval95=interval95)


def _before_after(result: CloseLoopResult, first: TableResult) -> Iterator[Table]:
    """Scores of one table line by line; of several a line each, by unit."""
    if len(result.tables) > 1:
        for unit in dict.fromkeys(item.table.unit for item in result.tables):
            own = [item for item in result.tables if item.table.unit == unit]
            yield Table("Rms error of held-out passes", _of("several", own[0]), own)
        return
    held = held_out_by(first)
    lines = [("all data", first.in_sample_before, first.in_sample_after)]
    if held is not None:
        lines.insert(0, (f"held-out {held}", first.before, first.after))
    both = ("before", "after") if first.effects else ("before",)
    rows = [
        (f"{label}, {side}", scores)
        for label, *pair in lines
        for side, scores in zip(both, pair, strict=False)
    ]
    fields = declare("- | 0 | | errors, text\nscores. | 1 | *scores", scores=_of("scores", first))
    checks = ", ".join(f"{name} p {p:.2g}" for name, p in first.checks)
    footer = "95 % and largest: of the error vector's length"
    yield Table("Before and after", fields, rows, footer, [f"checks of what is left: {checks}"])


def _candidates(item: TableResult) -> Table:
    tested = [x for x in item.candidates if x.log_bayes_factor is not None]
    tested.sort(key=lambda x: -(x.log_bayes_factor or 0.0))
    lacking: dict[str, list[str]] = {}
    for each in item.candidates:
        if each.unavailable:
            lacking.setdefault(each.unavailable, []).append(each.name)
    of = "" if item.table.component is None else f" of {item.table.component}"
    footer = f"{len(tested)} candidates tested, each beside the known model alone"
    if item.effects:
        footer += "; *: found, or in the class of an effect"
    if lacking:
        footer += f"; {sum(map(len, lacking.values()))} could not be (--detail: why)"
    notes = [f"not tested: {listed(names)}: {reason}" for reason, names in lacking.items()]
    rows = [Of(each, item) for each in tested[:BEST]]
    fields = _candidate("candidate", item.table.unit)
    return Table(f"Likeliest candidates{of}", fields, rows, footer, notes)
