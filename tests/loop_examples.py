"""Results of closing the loop made by hand, with numbers that are known to the last digit."""

from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
from effect_tables import readings_table
from effect_tables import table as points_table

from mtu_cli.analyses.close_loop.result import (
    WORST,
    CloseLoopResult,
    Experiment,
    FoundEffect,
    Judged,
    Parameter,
    Scores,
    Searched,
    SmoothEffect,
    TableResult,
)
from mtu_cli.model.effect_library import Candidate, effect_library
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS

FAMILIES = {own.family: own for own in effect_library().families}


def parameter(name: str, unit: str, value: float, u: float, role: str = "own") -> Parameter:
    """Of a value and its u in the unit."""
    value, u = (x * PARAMETER_UNITS[unit].to_internal for x in (value, u))
    return Parameter(name=name, unit=unit, value=value, u=u, dof=20, role=role)


def searched(name: str, value: float, *intervals: tuple[float, float]) -> Searched:
    return Searched(name=name, value=value, intervals=intervals)


def effect(name: str, *parameters: Parameter, **changed: Any) -> FoundEffect:
    """A mean effect."""
    family, _, axis = name.rpartition("-")
    found = FoundEffect(
        candidate=Candidate(
            name=name,
            family=family or name,
            axis=axis if family else None,
            says=f"what {family} does",
            sentence=FAMILIES[family].sentence if family in FAMILIES else "",
            separates="reverse the program",
        ),
        parameters=parameters,
        equations={f"E{axis}": " + ".join(p.name for p in parameters)},
        p_familywise=0.003,
        log_bayes_factor=31.2,
        posterior=0.99,
        explained_share=0.25,
        class_names=(name,),
    )
    return replace(found, **changed)


def uncorrelated(*effects: FoundEffect) -> tuple[tuple[FoundEffect, ...], FloatArray]:
    """Effects as those of one table, and the covariance of all their parameters."""
    rows = count()
    numbered = tuple(
        replace(e, parameters=tuple(replace(p, row=next(rows)) for p in e.parameters))
        for e in effects
    )
    return numbered, np.diag([p.u**2 for e in effects for p in e.parameters])


def of_candidate(found: FoundEffect, **changed: Any) -> FoundEffect:
    return replace(found, candidate=replace(found.candidate, **changed))


BACKLASH = effect(
    "backlash-x",
    parameter("lost_motion", "um", -4.1, 0.15),
    parameter("level_x", "um", 0.2, 0.3, "level"),
    covariate="dir_x",
    equations={"Ex": "lost_motion*dir_x + level_x"},
)
CYCLIC = effect(
    "cyclic-y",
    parameter("sine", "um", 3.0, 0.2),
    parameter("cosine", "um", 4.0, 0.2),
    parameter("pitch_mm_change", "um", 0.0, 0.4, "searched"),
    equations={"Ey": "sine*sin(y) + cosine*cos(y) + pitch_mm_change*y"},
    searched=searched("pitch_mm", 12.5, (12.3, 12.7)),
)
CLASS = replace(
    BACKLASH,
    class_names=("backlash-x", "wear-approach-x"),
    experiment=Experiment(do="turn the part", predicted_d=6.3),
)
SMOOTH = replace(
    of_candidate(
        effect("profile-x", parameter("rms", "um", 2.5, 0.3)), says="a smooth error of x along x"
    ),
    equations={"Ex": "profile_x"},
    table=SmoothEffect(
        along="x",
        knots=np.array([0.0, 50.0, 100.0, 150.0]),
        values=np.array([0.0, 3e-3, -1e-3, 2e-3]),
        covariance=np.diag([1e-7, 2e-7, 2e-7, 1e-7]),
        roughness=1e-11,
        dof=20,
    ),
)
SCATTER = replace(
    of_candidate(effect("operation-scatter"), axis=None, says="one operation scatters more"),
    equations={}, chosen="milled", ratio=2.5,
)  # fmt: skip


def scores(rms_um: float, axes: tuple[str, ...], scale: float = 1e-3) -> Scores:
    """Of a rms, in mm or rad."""
    rms = rms_um * scale
    return Scores(
        rms=rms, by_axis=dict.fromkeys(axes, rms), p95=2 * rms, largest=3 * rms, chi2_per_dof=1.04
    )


def judged(name: str, factor: float | None, why: str | None = None) -> Judged:
    """A candidate, one that cannot be tested without a Bayes factor."""
    return Judged(
        candidate=Candidate(name=name, family=name.rpartition("-")[0]),
        p_familywise=None if factor is None else 0.5,
        log_bayes_factor=factor,
        posterior=None if factor is None else 0.1,
        unavailable=why,
        minimum_detectable=None if factor is None else 0.4e-3,
    )


def on_table(
    *effects: FoundEffect, verdict: str = "named", component: str | None = None, **changed: Any
) -> TableResult:
    """Errors of 3.6 um before and 2.0 um after, of points or of the readings of a component."""
    unit = "arcsec" if component and component.startswith("e") else "um"
    own = points_table(9, 12)
    if component:
        own = readings_table(name="x", component=component, unit=unit)
    effects, covariance = uncorrelated(*effects)
    rng = np.random.default_rng(5)
    scale = PARAMETER_UNITS[unit].to_internal
    own = replace(own, errors=3 * scale * rng.standard_normal(own.errors.shape))
    before, after = (scores(rms, own.axes, scale) for rms in (3.6, 2.0 if effects else 3.6))
    found = TableResult(
        table=own,
        verdict=verdict,
        effects=effects,
        candidates=(
            judged("scale-x", -1.25),
            judged("backlash-x", 31.2),
            judged("covariate-x", None, "no other numeric column"),
        ),
        checks=(("pattern", 0.61), ("walk", 0.002)),
        fired=("walk",) if verdict == "unexplained" else (),
        nameless=False,
        outliers=np.zeros(own.errors.shape, bool),
        explained=0.3 * own.errors if effects else np.zeros_like(own.errors),
        before=before,
        after=after,
        after_averaged=after,
        in_sample_before=before,
        in_sample_after=after,
        held_out=own.plurals[0],
        floor=1.8 * scale,
        crossings=(),
        covariance=covariance,
        stopped=False,
    )
    return replace(found, **changed)


def result(*tables: TableResult) -> CloseLoopResult:
    """The weakest verdict of all."""
    verdict = min((item.verdict for item in tables), key=WORST.index)
    return CloseLoopResult(verdict=verdict, tables=tables, alpha=0.05)
