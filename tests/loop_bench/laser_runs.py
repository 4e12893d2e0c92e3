"""Laser runs of one axis, as many kinds of them as shops make; with an effect or without."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from model_examples import Segment, loaded, readings
from shop_day.day import Floats, Kind

from loop_bench.days import GATE_SEED, SAMPLES
from mtu_cli.close_loop_sealed.analyses.loop import FoundEffect, close_loop
from mtu_cli.close_loop_sealed.analyses.loop.fitted import beside_polynomial, refitted
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.searched import searched
from mtu_cli.close_loop_sealed.model.effect_library import EffectLibrary, candidates, effect_library
from mtu_cli.close_loop_sealed.model.reading_tables import reading_tables
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.family_gate import Gate
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import Readings
from mtu_cli.model.fit import estimates_from_fit, fit_machine
from mtu_cli.stats.threads import one_blas_thread

UM = 1e-3
ALPHA, MOST = 0.05, 4
NOISE = 0.6
"""Of a single reading, um."""
MACHINE = "components:\n  px: {of: x, unit: um}\nequations: {Ex: px}\n"
PARAMETERS = {
    "backlash": "lost_motion",
    "thermal-drift": "drift",
    "thermal-growth": "growth",
    "trend": "slope",
}
"""Those that mean the same in every form that the library has of the family."""
RUN_FAMILIES = (*PARAMETERS, "cyclic", "curvature", "warm-up", "step")
SCATTER = {False: (0.3, 3.0), True: (0.1, 2.0)}
"""Of passes over that of readings: of clean runs, and of those with an effect, some of which lie in
whole passes.
"""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Positions (n,) mm, passes, directions, times (min) and temperatures (K from 20 degC) of n
    readings, in the order they were taken; `scatter` of passes, and the `step` of a reading, um.
    """

    position: Floats
    passes: np.ndarray
    direction: np.ndarray
    minutes: Floats
    warm: Floats
    scatter: float
    step: float

    def column(self, family: str, rng: np.random.Generator) -> Floats:
        """What an effect of 1 in the units of its parameter does, in mm."""
        x, middle = self.position, self.position.mean()
        if family == "step":
            return np.asarray(self.passes > rng.integers(2, self.passes.max() - 1), float)
        # Shorter than three targets a wave is what single targets may have.
        phase, pitch = rng.uniform(0, 2 * np.pi), np.ptp(x) * rng.uniform(0.3, 0.5)
        settling = np.exp(rng.uniform(np.log(24.0), np.log(120.0)))
        found: dict[str, Floats] = {
            "backlash": self.direction.astype(float),
            "thermal-drift": self.warm,
            "thermal-growth": x * self.warm,
            "trend": self.passes.astype(float),
            "cyclic": np.sin(2 * np.pi * x / pitch + phase),
            "curvature": (x - middle) ** 2,
            "warm-up": 1 - np.exp(-self.minutes / settling),
        }
        return found[family]

    def left(self, column: Floats) -> Floats:
        """What the readings' own line leaves of it."""
        X = np.column_stack([np.ones_like(self.position), self.position / 100])
        rest: Floats = column - X @ np.linalg.lstsq(X, column, rcond=None)[0]
        return rest

    def measured(self, rng: np.random.Generator, effect: Floats | float = 0.0) -> Readings:
        """The readings, mm, rounded; every pass and direction of a level and slope of its own."""
        own = self.passes * 2 + (self.direction > 0)
        level, slope = self.scatter * rng.normal(size=(2, own.max() + 1))
        half = np.ptp(self.position) / 2
        error = 2.0 + 0.03 * self.position + level[own]
        error += 0.5 * slope[own] * (self.position - self.position.mean()) / half
        error += NOISE * rng.normal(size=len(error)) + effect / UM
        error = np.round(error / self.step) * self.step
        run = Segment(
            name="px",
            position=self.position,
            error=error * UM,
            passes=self.passes,
            direction=self.direction,
            role="laser",
            time=self.minutes,
        )
        sensor = np.round(20 + self.warm + 0.05 * rng.normal(size=len(error)), 2)
        return replace(readings([run]), covariates={"T_x_degC": sensor})


def layout(rng: np.random.Generator, *, planted: bool) -> Layout:
    """5 to 10 passes over 8 to 14 uneven targets, there and back or (one clean run in four) there
    alone, a reading in 0.3 to 2 min, while the axis warms up by 2 to 8 K; one run in four has gaps.
    """
    passes, targets = int(rng.integers(5, 11)), int(rng.integers(8, 15))
    even = np.linspace(0, 400, targets)
    one = np.sort(np.round(even + rng.uniform(-0.3, 0.3, targets) * 400 / targets))
    back = one[::-1] if rng.random() < 0.75 or planted else one[:0]
    n = passes * (targets + len(back))
    minutes = np.arange(1.0, n + 1) * float(rng.uniform(0.3, 2.0))
    warm = rng.uniform(2, 8) * (1 - np.exp(-minutes / rng.uniform(20, 90)))
    there = rng.random(n) > (0.03 if rng.random() < 0.25 else 0.0)
    least, most = SCATTER[planted]
    return Layout(
        position=np.tile(np.concatenate([one, back]), passes)[there],
        passes=np.repeat(np.arange(passes) + 1, targets + len(back))[there],
        direction=np.tile(np.repeat([1, -1], [targets, len(back)]), passes)[there],
        minutes=minutes[there],
        warm=warm[there],
        scatter=NOISE * float(np.exp(rng.uniform(np.log(least), np.log(most)))),
        step=float(rng.choice([0.01, 0.1, 0.2])),
    )


@cache
def axis_machine() -> LoadedMachine:
    with tempfile.TemporaryDirectory() as folder:
        return loaded(Path(folder), MACHINE)


@cache
def library() -> EffectLibrary:
    return effect_library()


def clean_run(kind: Kind, rng: np.random.Generator) -> dict[str, Any]:
    """Whether anything is found, by name or check, in a run in which nothing is."""
    (table,) = _tables(kind, rng, layout(rng, planted=False))
    own = beside_polynomial(table, candidates(table, library()))

    def start(left: ResidualTable) -> tuple[Prepared, Gate]:
        prepared = prepare(refitted(left), own, table.pass_dof)
        return prepared, calibrated(prepared.scan, SAMPLES, GATE_SEED)

    with one_blas_thread():
        first = searched(table, start, alpha=ALPHA, most=MOST)
    names = [first.prepared.candidates[step.index].name for step in first.found.steps]
    fired = first.found.fired(ALPHA)
    return {
        "names": names,
        "fired": fired,
        "gross": len(first.gross),
        "passes": len(table.parts),
        "alarm": bool(names or fired),
    }


def laser_run(kind: Kind, rng: np.random.Generator, family: str) -> dict[str, Any]:
    """What is said of a run with an effect."""
    run = layout(rng, planted=True)
    column = run.column(family, rng)
    size = NOISE * UM / float(np.sqrt(np.mean(run.left(column) ** 2)))
    size *= float(rng.choice([-1, 1]))
    found = close_loop(
        _tables(kind, rng, run, size * column),
        library(),
        alpha=ALPHA,
        max_effects=MOST,
        seed=GATE_SEED,
    )
    effects = found.effects
    return {
        "names": [effect.name for effect in effects],
        "first_class": effects[0].candidates if effects else (),
        "fired": found.tables[0].fired,
        "nameless": found.tables[0].without_name,
        "verdict": found.verdict,
        "lone": found.verdict == "named",
        "truths": [f"{family}-x"],
        "families": [family],
        "aliases": [[]],
        "covers": _covers(effects[0], family, size) if effects else None,
    }


def _tables(
    kind: Kind, rng: np.random.Generator, run: Layout, effect: Floats | float = 0.0
) -> tuple[ResidualTable, ...]:
    """Of design A nothing was known before; of B the components, with their scatter from pass to
    pass, by an earlier run without the effect.
    """
    machine, known = axis_machine(), None
    if kind == "B":
        known = estimates_from_fit(machine, fit_machine(machine, run.measured(rng)))
    return reading_tables(machine, known, run.measured(rng, effect))[0]


def _covers(effect: FoundEffect, family: str | None, size: float) -> bool | None:
    """Whether the 95 % interval holds the true value; None of another effect, or of one whose
    parameters have no true value.
    """
    if family not in PARAMETERS or effect.family != family:
        return None
    if family == "trend" and effect.covariate != "sequence":
        return None
    names = [name for name, *_ in effect.parameters]
    low, high, _ = effect.intervals[names.index(PARAMETERS[family])]
    return bool(low <= size <= high)
