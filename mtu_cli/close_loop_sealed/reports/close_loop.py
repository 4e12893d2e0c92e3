"""The report of close-loop: the verdict, what was found, and what it is worth on held-out data.

`before` and `after` are held out (`held_out.by` says what was left out in turn; null: nothing
could be, and they are in sample): of `held_out.scored`, what the search without the held-out
data foretells of them, the mean over all explanations of an effect by their posterior, `nothing`
where the machine gets no equation. `rms` pools all coordinates, `p95` and `max` are of the error
vector's length. The keys of an angular component end in `_arcsec`, all others in `_um`. With
several components, `component` names the one whose scores stand at the top, `tables` hold all.
A `minimum_detectable` is the root mean square over the cells of an effect that would have been
found four times in five. The `rms` of an effect is over all coordinates, about its mean,
`explained_share` the share of their mean square. Fields of a candidate are of the first look at
the data.
`fixed_points` are the places where effects that grow along an axis and effects that move it as a
whole cancel; one is `told` where its 95 % interval is no longer than the machine's travel, and
`given` the effect it depends on where the data cannot tell that from others. `neutral_points` are
the values of a `covariate` (a temperature, the place along another axis in mm) at which what
changes with it and an offset cancel, `given` as there; `seen` is the range of the data.
`left_means` are mean errors along axes of effects that are no finding among all tests.
`rivals` are the likeliest others of a class, each estimated in the place of the effect; `changed`
are other effects that have another size beside one, as they are then. An effect that is one of
several `alike` pitches makes the verdict `class`, though its `class` has one name.
The `verdict` of an effect is its own: `named` beside a verdict `unexplained` where what has no name
lies elsewhere, with less than 0.1 % of the posterior in its place; `unexplained` is a hint only.
`apart` are those of the `class` of a scatter that it cannot be mistaken for: not much less likely.
`held_out.by_column` is what a correction of its own for every feature (position, of readings)
would leave of held-out parts (passes): the mean of what the others leave there taken off.
`unexplained.twofold` names effects that fit only in two forms which no one cause has at once.
An experiment is foretold to set rivals `predicted_d` standard deviations apart, of which this data
holds `now_d` and the experiment adds `further_d`: predicted_d^2 = now_d^2 + further_d^2.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mtu_cli.close_loop_sealed.analyses.loop.gross import Gross
from mtu_cli.close_loop_sealed.analyses.loop.result import (
    CloseLoopResult,
    Judged,
    Scores,
    TableResult,
)
from mtu_cli.close_loop_sealed.analyses.loop.shown import improvement_percent
from mtu_cli.close_loop_sealed.reports.close_loop_figure import figure
from mtu_cli.close_loop_sealed.reports.close_loop_found import (
    effect_of,
    fixed_point_of,
    left_mean_of,
    neutral_point_of,
)
from mtu_cli.close_loop_sealed.reports.close_loop_gate import gate_text
from mtu_cli.close_loop_sealed.reports.close_loop_shown import (
    class_of,
    first_table,
    size_of,
    something_left,
    unit_of,
)
from mtu_cli.close_loop_sealed.reports.close_loop_table import table
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_text
from mtu_cli.reports.document import finite

__all__ = ["csv_rows", "document", "figure", "gate_text", "table"]

UNITS = ("um", "arcsec")


def document(result: CloseLoopResult) -> dict[str, Any]:
    """`results` of the report."""
    first = first_table(result)
    several = len(result.tables) > 1
    return {
        "verdict": result.verdict,
        "undeclared_effect_found": result.is_found,
        "verdict_text": [verdict_text(item, result) for item in result.tables],
        "alpha": float(result.alpha),
        "datum": result.datum,
        "component": first.table.component,
        **_scored(first),
        "effects": [effect_of(e, t) for t in result.tables for e in t.effects],
        "fixed_points": [fixed_point_of(p, t) for t in result.tables for p in t.fixed_points],
        "neutral_points": [neutral_point_of(p, t) for t in result.tables for p in t.neutral_points],
        "left_means": [left_mean_of(m) for t in result.tables for m in t.left_means],
        "candidates": [_candidate(c, t) for t in result.tables for c in t.candidates],
        "unexplained": {
            "found": any(something_left(item) for item in result.tables),
            "checks": [check for item in result.tables for check in _checks(item)],
            "twofold": [name for item in result.tables for name in item.twofold],
            "of_one_axis": [name for item in result.tables for name in item.of_one_axis],
            "without_name": [name for item in result.tables for name in item.nameless],
            f"rms_{first.table.unit}": size_of(first, first.unexplained_rms),
        },
        "outliers": [_outlier(g, t) for t in result.tables for g in t.gross],
        "tables": [_table(item) for item in result.tables] if several else [],
    }


def _scored(item: TableResult) -> dict[str, Any]:
    return {
        "before": _scores(item, item.before),
        "after": _scores(item, item.after),
        f"floor_{item.table.unit}": size_of(item, item.floor),
        "in_sample": {
            "before": _scores(item, item.in_sample_before),
            "after": _scores(item, item.in_sample_after),
        },
        "improvement_percent": finite(improvement_percent(item)),
        "held_out": {
            "by": item.held_out_by,
            "scored": _held_out_scored(item),
            "folds": item.folds or None,
            "with_outliers": _with_outliers(item),
            "by_column": None if item.by_column is None else _scores(item, item.by_column),
        },
    }


def _with_outliers(item: TableResult) -> dict[str, Any] | None:
    """`before` and `after` are without the points set aside; the same with them."""
    if item.held_out_with_gross is None:
        return None
    before, after = item.held_out_with_gross
    return {"before": _scores(item, before), "after": _scores(item, after)}


def _held_out_scored(item: TableResult) -> str | None:
    """What `after` takes out of held-out data."""
    if item.held_out_by is None:
        return None
    written = any(effect.kind != "scatter" for effect in item.effects)
    return "mean by posterior" if written else "nothing"


def _scores(item: TableResult, scores: Scores) -> dict[str, Any]:
    unit = item.table.unit
    return {
        f"rms_{unit}": size_of(item, scores.rms),
        **{f"rms_{a}_{unit}": size_of(item, rms) for a, rms in scores.rms_by_axis.items()},
        f"p95_{unit}": size_of(item, scores.p95),
        f"max_{unit}": size_of(item, scores.largest),
        "chi2_per_dof": finite(scores.chi2_per_dof),
    }


def _candidate(judged: Judged, item: TableResult) -> dict[str, Any]:
    return {
        "name": judged.name,
        "family": judged.family,
        "component": judged.component,
        "p_familywise": finite(judged.p_familywise),
        "log_bayes_factor": finite(judged.log_bayes_factor),
        "posterior": finite(judged.posterior),
        f"minimum_detectable_{item.table.unit}": size_of(item, judged.minimum_detectable),
        "unavailable": judged.unavailable,
        "notes": list(judged.notes),
    }


def _checks(item: TableResult) -> list[dict[str, Any]]:
    return [
        {"name": name, "p": finite(p), "fired": name in item.fired}
        | ({} if item.table.component is None else {"component": item.table.component})
        for name, p in item.checks
    ]


def _outlier(gross: Gross, item: TableResult) -> dict[str, Any]:
    axes = zip(item.table.axes, gross.deviation, strict=True)
    return {
        "part": gross.part,
        "feature": gross.feature,
        "component": item.table.component,
        f"deviation_{item.table.unit}": {axis: size_of(item, value) for axis, value in axes},
        "score": finite(gross.score),
    }


def _table(item: TableResult) -> dict[str, Any]:
    return {
        "component": item.table.component,
        "verdict": item.verdict,
        "effects": [effect.name for effect in item.effects],
        **_scored(item),
        "unexplained": {
            "found": something_left(item),
            "checks": _checks(item),
            "twofold": list(item.twofold),
            "of_one_axis": list(item.of_one_axis),
            "without_name": list(item.nameless),
            f"rms_{item.table.unit}": size_of(item, item.unexplained_rms),
        },
    }


def csv_rows(result: CloseLoopResult) -> tuple[list[str], Iterable[list[object]]]:
    """One row a candidate, those that could not be tested too."""
    units = [unit for unit in UNITS if any(t.table.unit == unit for t in result.tables)]
    header = ["component", "candidate", "family", "p_familywise", "log_bayes_factor", "posterior"]
    header += [f"minimum_detectable_{unit}" for unit in units]
    header += ["found", "in_class", "unavailable", "notes"]
    return header, (_row(c, t, units) for t in result.tables for c in t.candidates)


def _row(judged: Judged, item: TableResult, units: list[str]) -> list[object]:
    smallest = size_of(item, judged.minimum_detectable)
    return [
        judged.component,
        judged.name,
        judged.family,
        finite(judged.p_familywise),
        finite(judged.log_bayes_factor),
        finite(judged.posterior),
        *(smallest if unit == unit_of(item).name else None for unit in units),
        any(effect.name == judged.name for effect in item.effects),
        any(judged.name in class_of(effect) for effect in item.effects),
        judged.unavailable,
        "; ".join(judged.notes),
    ]
