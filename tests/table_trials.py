"""Simulated axes with a smooth profile, written apart from the package, and their tables.

The axes are those of the shop day's laser runs, here in mm.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from made_tables import made_readings
from shop_day import runs

from mtu_cli.files.machine import LoadedMachine, machine_from
from mtu_cli.files.readings import Readings
from mtu_cli.files.yaml_file import read_yaml
from mtu_cli.model.fit import estimates_from_fit, fit_machine
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.prediction import predict
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray

UM = 1e-3
SIGMA = runs.Axis.sigma * UM
TARGETS = 11
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


def bend(travel: float, amplitude: float, rng: np.random.Generator) -> runs.Profile:
    """An S-bend of rms amplitude/sqrt(2) about its line, mm."""
    found = runs.bend(travel, amplitude / UM, rng)
    return lambda x: UM * found(x)


def axis_readings(
    targets: FloatArray, profile: runs.Profile, rng: np.random.Generator, own: float = 0.0
) -> Readings:
    """Runs there and back, mm; `own` is the amplitude of a bend of each run's own."""
    axis = runs.Axis(targets=targets, profile=lambda x: profile(x) / UM, zeroed=False, own=own / UM)
    return readings_of(axis, rng)


def readings_of(axis: runs.Axis, rng: np.random.Generator) -> Readings:
    """As they are read from a laser's file."""
    error, T = axis.taken(rng), len(axis.targets)
    return made_readings(
        np.round(UM * error.ravel(), 6),
        position=np.tile(axis.targets, 2 * axis.runs),
        passes=np.repeat(np.arange(axis.runs) + 1, 2 * T),
        direction=np.tile(np.repeat([1, -1], T), axis.runs),
        role="laser",
    )


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
    u = runs.Axis.sigma / np.sqrt(2 * runs.Axis.runs)
    held, widths = [], []
    for _ in range(axes):
        travel = float(rng.choice([400.0, 600.0, 1000.0]))
        axis = runs.Axis(
            targets=np.linspace(0, travel, TARGETS),
            profile=runs.bend(travel, amplitude * u, rng),
            zeroed=False,
            own=own * runs.Axis.sigma,
        )
        fit = fit_machine(known, readings_of(axis, rng))
        model = build_model(known, estimates_from_fit(known, fit))
        at = np.append(rng.uniform(0, travel, PLACES), [-0.05 * travel, 1.05 * travel])
        points = np.column_stack([at, np.zeros((len(at), 2))])
        found = predict(model, [str(i) for i in range(len(at))], points)
        variance = found.variance()
        k = np.array([coverage_factor(0.95, dof) for dof in variance.dof])
        half = k * np.sqrt(variance.total)
        arm, n = 2 * at / travel - 1, len(at)
        state = rng.normal(0, axis.level, n) + rng.normal(0, axis.slope, n) * arm
        if own:
            state += [runs.bend(travel, axis.own, rng, 0.0)(x[None])[0] for x in at]
        future = axis.profile(at) + state + rng.normal(0, axis.sigma, n)
        held.append(np.abs(UM * future - found.mean) <= half)
        widths.append(half / (UM * axis.half_width(at)))
    share, width = np.mean(held, axis=0), np.mean(widths, axis=0)
    return Covered(
        inside=float(share[:PLACES].mean()),
        width=float(width[:PLACES].mean()),
        outside=float(share[PLACES:].mean()),
        width_outside=float(width[PLACES:].mean()),
    )
