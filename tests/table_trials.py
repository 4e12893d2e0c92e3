"""Simulated axes with a smooth profile, written apart from the package, and their tables.

A profile is an S-bend of two waves between half and 1.6 times the travel; every run there and back
draws its level and slope, every reading its own noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from made_tables import made_readings
from numpy.typing import NDArray

from mtu_cli.files.machine import LoadedMachine, machine_from
from mtu_cli.files.readings import Readings
from mtu_cli.files.yaml_file import read_yaml
from mtu_cli.model.fit import estimates_from_fit, fit_machine
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.prediction import predict
from mtu_cli.stats.coverage import coverage_factor

FloatArray = NDArray[np.float64]
Profile = Callable[[FloatArray], FloatArray]

UM = 1e-3
SIGMA, LEVEL, SLOPE, LOST = 0.5 * UM, 0.4 * UM, 0.2 * UM, 3.0 * UM
"""Of one reading, a run's level, its slope over half the travel; the lost motion; mm."""
RUNS, TARGETS = 5, 11
PLACES = 8


def axis_machine(folder: Path, shape: str = "shape: table") -> LoadedMachine:
    """A machine of one axis whose positioning has this shape."""
    text = f"""schema: mtu/machine/1
name: axis
components: {{dx_x: {{of: x, unit: um, {shape}}}}}
equations: {{Ex: dx_x}}
"""
    (folder / "axis.yaml").write_text(text)
    return machine_from(read_yaml(folder / "axis.yaml", "machine"))


def bend(
    travel: float, amplitude: float, rng: np.random.Generator, steepest: float = 2e-5
) -> Profile:
    """An S-bend of random phase and length, rms amplitude/sqrt(2) about its line."""
    length, phase = rng.uniform(0.55, 1.6) * travel, rng.uniform(0, 2 * np.pi)

    def raw(x: FloatArray) -> FloatArray:
        first = np.sin(2 * np.pi * x / length + phase)
        return np.asarray(first + 0.4 * np.sin(2 * np.pi * x / (length / 1.7) + 2 * phase))

    x = np.linspace(0, travel, 201)
    level_and_slope = np.polyfit(x, raw(x), 1)
    size = amplitude / np.sqrt(2) / np.std(raw(x) - np.polyval(level_and_slope, x))
    slope = rng.uniform(-steepest, steepest)
    return lambda x: size * (raw(x) - np.polyval(level_and_slope, x)) + slope * x


def axis_readings(
    targets: FloatArray, profile: Profile, rng: np.random.Generator, own: float = 0.0
) -> Readings:
    """RUNS runs there and back; `own` is the amplitude of a bend of each run's own."""
    middle, half, travel = targets.mean(), np.ptp(targets) / 2, float(np.ptp(targets))
    rows = []
    for run in range(1, RUNS + 1):
        state = rng.normal(0, LEVEL) + rng.normal(0, SLOPE) * (targets - middle) / half
        if own:
            state = state + bend(travel, own, rng, 0.0)(targets)
        for way in (1, -1):
            noise = rng.normal(0, SIGMA, len(targets))
            values = profile(targets) + way * LOST / 2 + state + noise
            rows += [(run, way, x, y) for x, y in zip(targets, values, strict=True)]
    run_, way_, x_, y_ = map(np.array, zip(*rows, strict=True))
    return made_readings(np.round(y_, 6), position=x_, passes=run_, direction=way_, role="laser")


@dataclass(frozen=True)
class Covered:
    """Shares of the 95 % intervals of future readings that hold, between the targets and up to 5 %
    beyond, and the mean width over that of one who knows the profile and all variances.
    """

    inside: float
    width: float
    outside: float
    width_outside: float


def table_coverage(
    known: LoadedMachine, axes: int, amplitude: float, seed: int, own: float = 0.0
) -> Covered:
    """Of simulated axes; `amplitude` in u of a target's mean, `own` in sigma."""
    rng = np.random.default_rng(seed)
    u = SIGMA / np.sqrt(2 * RUNS)
    held, widths = [], []
    for _ in range(axes):
        travel = float(rng.choice([400.0, 600.0, 1000.0]))
        targets, profile = np.linspace(0, travel, TARGETS), bend(travel, amplitude * u, rng)
        readings = axis_readings(targets, profile, rng, own * SIGMA)
        fit = fit_machine(known, readings)
        model = build_model(known, estimates_from_fit(known, fit))
        at = np.append(rng.uniform(0, travel, PLACES), [-0.05 * travel, 1.05 * travel])
        points = np.column_stack([at, np.zeros((len(at), 2))])
        found = predict(model, [str(i) for i in range(len(at))], points)
        variance = found.variance()
        k = np.array([coverage_factor(0.95, dof) for dof in variance.dof])
        half = k * np.sqrt(variance.total)
        arm = 2 * at / travel - 1
        state = rng.normal(0, LEVEL, len(at)) + rng.normal(0, SLOPE, len(at)) * arm
        if own:
            state += [bend(travel, own * SIGMA, rng, 0.0)(x[None])[0] for x in at]
        future = profile(at) + state + rng.normal(0, SIGMA, len(at))
        held.append(np.abs(future - found.mean) <= half)
        ideal = SIGMA**2 + LEVEL**2 + (SLOPE * arm) ** 2 + (own * SIGMA) ** 2 / 2
        widths.append(half / (1.96 * np.sqrt(ideal)))
    share, width = np.mean(held, axis=0), np.mean(widths, axis=0)
    return Covered(
        inside=float(share[:PLACES].mean()),
        width=float(width[:PLACES].mean()),
        outside=float(share[PLACES:].mean()),
        width_outside=float(width[PLACES:].mean()),
    )
