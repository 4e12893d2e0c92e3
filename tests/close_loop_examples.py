"""Results of closing the loop made by hand, with numbers that are known to the last digit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from effect_tables import readings_table
from effect_tables import table as points_table

from mtu_cli.close_loop_sealed.analyses.loop.gross import Gross
from mtu_cli.close_loop_sealed.analyses.loop.result import (
    CloseLoopResult,
    Experiment,
    FoundEffect,
    Judged,
    Scores,
    TableResult,
    Verdict,
)
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.units import PARAMETER_UNITS

CHECKS = (("serial-correlation", 0.61), ("spatial-correlation", 0.42))


def effect(
    name: str = "backlash-x",
    *,
    parameters: tuple[tuple[str, str, float, float], ...] = (("lost_motion", "um", 2.05, 0.15),),
    equations: dict[str, str] | None = None,
    **changed: object,
) -> FoundEffect:
    """An effect with parameters in the units they are shown in; the last of them named `level` are
    those of its equations.
    """
    known = tuple(_internal(*item) for item in parameters)
    family, _, axis = name.rpartition("-")
    found = FoundEffect(
        name=name,
        family=family,
        axis=axis,
        component=None,
        covariate=None,
        says=f"what {family} says of {axis}",
        separates="reverse the program",
        kind="mean",
        chosen=None,
        equations={"Ex": "lost_motion*dir_x"} if equations is None else equations,
        parameters=known,
        intervals=tuple((value - 2 * u, value + 2 * u, 17.0) for _, _, value, u in known),
        covariance=np.diag([u**2 for _, _, _, u in known]),
        searched={},
        p_familywise=0.0005,
        log_bayes_factor=31.2,
        posterior=0.998,
        explained_share=0.25,
        class_names=(name,),
        aliases=(),
        experiment=None,
        folds=5,
        of_folds=5,
        levels=tuple(axis for own, *_ in parameters if own.startswith("level")),
    )
    return replace(found, **changed)  # type: ignore[arg-type]  # the fields of the effect


def _internal(name: str, unit: str, value: float, u: float) -> tuple[str, str, float, float]:
    scale = PARAMETER_UNITS[unit].to_internal
    return name, unit, value * scale, u * scale


def scores(rms_um: float, axes: tuple[str, ...] = ("x", "y"), scale: float = 1e-3) -> Scores:
    return Scores(
        rms=rms_um * scale,
        rms_by_axis=dict.fromkeys(axes, rms_um * scale),
        p95=2.4 * rms_um * scale,
        largest=3.3 * rms_um * scale,
        chi2_per_dof=1.04,
    )


def judged(name: str, **changed: object) -> Judged:
    found = Judged(
        name=name,
        family=name.rpartition("-")[0],
        component=None,
        p_familywise=0.62,
        log_bayes_factor=-1.25,
        posterior=0.001,
        minimum_detectable=1.234e-3,
        unavailable=None,
    )
    return replace(found, **changed)  # type: ignore[arg-type]  # the fields of a candidate


CANDIDATES = (
    judged("backlash-x", p_familywise=0.0005, log_bayes_factor=31.2, posterior=0.998),
    judged("abbe-x", log_bayes_factor=2.0, minimum_detectable=0.51e-3),
    judged("scale-x"),
    judged("cyclic-x", minimum_detectable=2.75e-3),
    judged("trend-x", log_bayes_factor=-0.04),
    judged("radial", log_bayes_factor=-3.0, notes=("T_a is a copy of T_b",)),
    judged(
        "covariate-x",
        p_familywise=None,
        log_bayes_factor=None,
        posterior=None,
        minimum_detectable=None,
        unavailable="no other numeric column",
    ),
)


def on_table(
    verdict: Verdict, effects: tuple[FoundEffect, ...] = (), **changed: object
) -> TableResult:
    """Points of 9 parts and 12 features, 5.9 um before and 3.8 um after."""
    residuals = _noisy(points_table(9, 12))
    found = TableResult(
        table=residuals,
        verdict=verdict,
        effects=effects,
        candidates=CANDIDATES,
        checks=CHECKS,
        fired=(),
        gross=(),
        explained=_backlash(residuals) if effects else np.zeros_like(residuals.errors),
        before=scores(5.9),
        after=scores(3.8) if effects else scores(5.9),
        in_sample_before=scores(6.0),
        in_sample_after=scores(3.7) if effects else scores(6.0),
        held_out_by="parts",
        folds=5,
        floor=3.6e-3,
        fixed_points=(),
    )
    return replace(found, **changed)  # type: ignore[arg-type]  # the fields of a table's result


def _noisy(table: ResidualTable, scale: float = 3e-3) -> ResidualTable:
    rng = np.random.default_rng(5)
    errors = scale * rng.standard_normal(table.errors.shape)
    return replace(table, errors=errors + _backlash(table))


def _backlash(table: ResidualTable) -> np.ndarray:
    found = np.zeros(table.errors.shape)
    axis = table.axes[0]
    if f"dir_{axis}" in table.covariates:
        found[:, :, 0] = 2.05e-3 * table.covariates[f"dir_{axis}"]
    return found


def on_component(
    component: str = "dx_x",
    unit: str = "um",
    verdict: Verdict = "named",
    effects: tuple[FoundEffect, ...] | None = None,
    name: str = "x",
) -> TableResult:
    """Readings of a component: 6 passes, 7 positions in both directions."""
    residuals = _noisy(readings_table(name=name, component=component, unit=unit))
    scale = PARAMETER_UNITS[unit].to_internal
    own = (
        effect(parameters=(("lost_motion", unit, 2.05, 0.15),), component=component),
    ) if effects is None else effects  # fmt: skip
    own = () if verdict == "none" else own
    return on_table(
        verdict,
        own,
        table=residuals,
        candidates=tuple(replace(c, component=component) for c in CANDIDATES),
        explained=_backlash(residuals) if own else np.zeros_like(residuals.errors),
        before=scores(5.9, (name,), scale),
        after=scores(3.8, (name,), scale),
        in_sample_before=scores(6.0, (name,), scale),
        in_sample_after=scores(3.7, (name,), scale),
        floor=3.6 * scale,
    )


def result(*tables: TableResult) -> CloseLoopResult:
    worst: tuple[Verdict, ...] = ("unexplained", "class", "named", "none")
    size = sum(len(e.parameters) for t in tables for e in t.effects)
    return CloseLoopResult(
        verdict=min((t.verdict for t in tables), key=worst.index),
        tables=tables,
        alpha=0.05,
        datum="none",
        covariance=np.zeros((size, size)),
    )


def named() -> CloseLoopResult:
    return result(on_table("named", (effect(),)))


def ambiguous() -> CloseLoopResult:
    told = Experiment(do="shift the fixture by 17 mm", predicted_d=6.34, now_d=0.81, further_d=6.29)
    own = effect(class_names=("backlash-x", "abbe-x"), aliases=("trend-x",), experiment=told)
    return result(on_table("class", (own,)))


def left_over(effects: tuple[FoundEffect, ...] = ()) -> CloseLoopResult:
    checks = (("serial-correlation", 0.61), ("spatial-correlation", 0.0004))
    return result(on_table("unexplained", effects, checks=checks, fired=("spatial-correlation",)))


def nothing() -> CloseLoopResult:
    gross = Gross(part="P3", feature="H7", deviation=(0.0171, -0.0004), score=9.1)
    return result(on_table("none", gross=(gross,)))


def several() -> CloseLoopResult:
    return result(
        on_component(),
        on_component("ez_x", "arcsec"),
        on_component("dy_x", verdict="none"),
    )
