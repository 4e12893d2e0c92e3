"""What close-loop found, for its report: effects, and where several of them cancel."""

from __future__ import annotations

from typing import Any

from mtu_cli.close_loop_sealed.analyses.loop.cancelling import FixedPoint, NeutralPoint
from mtu_cli.close_loop_sealed.analyses.loop.result import (
    FoundEffect,
    LeftMean,
    Otherwise,
    TableResult,
)
from mtu_cli.close_loop_sealed.analyses.loop.shown import effect_rms, own_verdict
from mtu_cli.close_loop_sealed.reports.close_loop_scatter import scatter_document
from mtu_cli.close_loop_sealed.reports.close_loop_shown import in_shown_unit, parameters_of, size_of
from mtu_cli.reports.document import finite
from mtu_cli.units import UM


def effect_of(effect: FoundEffect, item: TableResult) -> dict[str, Any]:
    """An effect of a table: its parameters, its class, the experiment that tells that apart."""
    return {
        "name": effect.name,
        "family": effect.family,
        "axis": effect.axis,
        "component": effect.component,
        "kind": effect.kind,
        "verdict": own_verdict(effect, item),
        "says": effect.says,
        "covariate": effect.covariate,
        "chosen": effect.chosen,
        "equations": dict(effect.equations),
        "parameters": _parameters(effect),
        "scatter": scatter_document(effect.scatter),
        "otherwise": [_otherwise(own) for own in effect.otherwise],
        "found_at_degC": dict(effect.found_at),
        "searched": _searched(effect),
        "alike": [finite(value) for value in effect.alike],
        "p_familywise": finite(effect.p_familywise),
        "log_bayes_factor": finite(effect.log_bayes_factor),
        "posterior": finite(effect.posterior),
        "explained_share": finite(effect.explained_share),
        f"rms_{item.table.unit}": size_of(item, effect_rms(effect, item)),
        "class": list(effect.class_names),
        "apart": list(effect.apart),
        "aliases": list(effect.aliases),
        "rivals": [_rival(rival) for rival in effect.rivals],
        "folds": {"chose_it": effect.folds, "of": effect.of_folds},
        "separates": effect.separates,
        "experiment": None
        if effect.experiment is None
        else {
            "do": effect.experiment.do,
            "predicted_d": finite(effect.experiment.predicted_d),
            "now_d": finite(effect.experiment.now_d),
            "further_d": finite(effect.experiment.further_d),
        },
    }


def _rival(rival: FoundEffect) -> dict[str, Any]:
    """What is the rival's own: estimated in the place of the effect that was found."""
    return {
        "name": rival.name,
        "family": rival.family,
        "covariate": rival.covariate,
        "equations": dict(rival.equations),
        "parameters": _parameters(rival),
        "searched": _searched(rival),
        "without": list(rival.without),
        "changed": {own.name: _parameters(own) for own in rival.changed},
    }


def _searched(effect: FoundEffect) -> dict[str, Any]:
    return {
        name: {"value": finite(value), "interval95": [finite(low), finite(high)]}
        for name, (value, low, high) in effect.searched.items()
    }


def _parameters(effect: FoundEffect) -> dict[str, Any]:
    return {
        shown.name: {
            "value": finite(shown.value),
            "u": finite(shown.u),
            "unit": shown.unit,
            "interval95": [finite(end) for end in shown.interval],
            "dof_effective": finite(shown.dof),
        }
        for shown in parameters_of(effect)
    }


def _otherwise(own: Otherwise) -> dict[str, Any]:
    both = {own.parameter[0]: own.parameter, f"{own.name}.{own.constant[0]}": own.constant}
    shown = {name: in_shown_unit(found) for name, found in both.items()}
    return {
        "beside": own.name,
        "covariate": own.covariate,
        "p": finite(own.p),
        "parameters": {
            name: {"value": finite(value), "u": finite(u), "unit": unit}
            for name, (value, u, unit) in shown.items()
        },
    }


def fixed_point_of(point: FixedPoint, item: TableResult) -> dict[str, Any]:
    """Where effects of a table cancel along an axis."""
    names = {e: effect.name for e, effect in enumerate(item.effects)}
    if point.given is not None:
        names |= dict([point.given])
    ends = point.interval
    return {
        "axis": point.axis,
        "covariate": point.covariate,
        "effects": [names[e] for e in (*point.growth, *point.drift)],
        "given": None if point.given is None else point.given[1],
        "at_mm": {
            "value": finite(point.at),
            "u": finite(point.u),
            "interval95": None if ends is None else [finite(end) for end in ends],
        },
        "told": point.told,
    }


def left_mean_of(mean: LeftMean) -> dict[str, Any]:
    """A mean error beside the effects of an axis, which is no finding."""
    return {
        "axis": mean.axis,
        "value_um": finite(mean.value / UM),
        "u_um": finite(mean.u / UM),
        "p": finite(mean.p),
    }


def neutral_point_of(point: NeutralPoint, item: TableResult) -> dict[str, Any]:
    """At which value of a covariate effects of a table cancel."""
    names = {e: effect.name for e, effect in enumerate(item.effects)}
    if point.given is not None:
        names |= dict([point.given])
    return {
        "axis": point.axis,
        "covariate": point.covariate,
        "beside": point.beside,
        "effects": [names[e] for e in (*point.drift, *point.offset)],
        "given": None if point.given is None else point.given[1],
        "at": {"value": point.at, "u": finite(point.u), "interval95": list(point.interval)},
        "seen": list(point.seen),
    }
