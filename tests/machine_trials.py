"""Virtual machines written apart from the package: readings, fits, future parts, coverage.

A planar machine with eight components and an axis angle; every pass draws each component's
level and slope, either on its own or all from one common cause, every reading its own noise.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from made_tables import made_readings

from mtu_cli.files.machine import LoadedMachine, machine_from
from mtu_cli.files.readings import Readings
from mtu_cli.files.yaml_file import read_yaml
from mtu_cli.model.fit import estimates_from_fit, fit_machine
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray

Z = 127.0
POINTS = np.array([[10.0, 10.0, Z], [10.0, 140.0, Z], [140.0, 140.0, Z]])
PAIRS = [(0, 1), (1, 2), (0, 2)]
POSITIONS = np.linspace(10.0, 150.0, 8)
CENTRE = float(POSITIONS.mean())

# name -> (axis, intercept, slope, repeatability, sd of a pass's level, sd of its slope) in
# mm or rad; angles weigh in with a lever of about 100 mm.
COMPONENTS: dict[str, tuple[str, float, float, float, float, float]] = {
    "dx_x": ("x", -5.8e-3, -1.9e-5, 0.8e-3, 1.5e-3, 1.0e-5),
    "dy_x": ("x", 4.2e-3, -3.8e-6, 0.7e-3, 1.2e-3, 0.5e-5),
    "ez_x": ("x", 3.0e-5, -2.9e-8, 0.9e-5, 1.6e-5, 1.0e-7),
    "ey_x": ("x", -6.1e-6, -3.1e-8, 0.5e-5, 0.9e-5, 0.5e-7),
    "dy_y": ("y", 4.3e-4, -1.8e-5, 1.1e-3, 2.0e-3, 1.2e-5),
    "dx_y": ("y", 3.4e-3, -3.9e-6, 0.7e-3, 1.2e-3, 0.5e-5),
    "ez_y": ("y", 1.5e-5, -5.6e-8, 0.8e-5, 1.3e-5, 0.8e-7),
    "ex_y": ("y", -6.6e-5, -6.0e-9, 0.9e-5, 1.5e-5, 1.0e-7),
}
AXY = (-3.3e-5, 1.7e-6)
AXY_PASSES = 5

MACHINE = """schema: mtu/machine/1
name: virtual
constants: {z: 127.0}
components:
  dx_x: {of: x, unit: um}
  dy_x: {of: x, unit: um}
  ez_x: {of: x, unit: urad}
  ey_x: {of: x, unit: urad}
  dy_y: {of: y, unit: um}
  dx_y: {of: y, unit: um}
  ez_y: {of: y, unit: urad}
  ex_y: {of: y, unit: urad}
  axy: {unit: urad}
equations:
  Ex: dx_x + dx_y + z*ey_x + y*ez_x + y*ez_y - y*axy
  Ey: dy_x + dy_y - x*ez_x - z*ex_y
"""


def machine(folder: Path) -> LoadedMachine:
    """The machine file above, read as any other."""
    (folder / "machine.yaml").write_text(MACHINE)
    return machine_from(read_yaml(folder / "machine.yaml", "machine"))


@dataclass(frozen=True)
class Drift:
    """How passes scatter: `size` times the table's, all components alike if `common`; a pass there
    and the one back alike if `there_and_back`.
    """

    size: float
    common: bool = False
    there_and_back: bool = False


def pass_states(rng: np.random.Generator, drift: Drift, n: int) -> dict[str, FloatArray]:
    """(n, 2) deviations of level at the centre and slope, by component."""
    states = {}
    common = rng.standard_normal((n, 2))
    for name, (*_, level, slope) in COMPONENTS.items():
        own = rng.standard_normal((n, 2))
        z = 0.8 * common + 0.6 * own if drift.common else own
        states[name] = drift.size * z * [level, slope]
    return states


def read_machine(rng: np.random.Generator, drift: Drift) -> Readings:
    """Ball-bar readings of one machine: five passes forward and as many in reverse."""
    names, error, passes = (*COMPONENTS, "axy"), [], 5
    states = pass_states(rng, drift, passes if drift.there_and_back else 2 * passes)
    if drift.there_and_back:
        states = {name: np.repeat(state, 2, axis=0) for name, state in states.items()}
    for name, (_, b0, b1, repeat, _, _) in COMPONENTS.items():
        level, slope = states[name].T[:, :, None]
        y = b0 + b1 * POSITIONS + level + slope * (POSITIONS - CENTRE)
        error.append((y + repeat * rng.standard_normal(y.shape)).ravel())
    error.append(AXY[0] + AXY[1] * rng.standard_normal(AXY_PASSES))
    # Readings of one component with an axis; all have the same places, passes and directions.
    g = np.repeat(np.arange(2 * passes), len(POSITIONS))
    places, count = np.tile(POSITIONS, 2 * passes), len(COMPONENTS)
    position = np.append(np.tile(places, count), np.full(AXY_PASSES, np.nan))
    number = np.append(np.tile(g // 2 + 1, count), np.arange(1, AXY_PASSES + 1))
    direction = np.append(np.tile(1 - 2 * (g % 2), count), np.zeros(AXY_PASSES, int))
    code = np.repeat(np.arange(count + 1), [len(item) for item in error])
    return made_readings(
        np.concatenate(error), names, code=code, position=position, passes=number,
        direction=direction,
    )  # fmt: skip


def true_coefficients() -> dict[str, FloatArray]:
    found = {name: np.array([b0, b1]) for name, (_, b0, b1, *_) in COMPONENTS.items()}
    return found | {"axy": np.array([AXY[0]])}


def make_parts(
    rng: np.random.Generator, drift: Drift, parts: int, at: FloatArray = POINTS
) -> FloatArray:
    """True errors (parts, points, 2) of points on parts made by the true machine: eq. (1)."""
    states = pass_states(rng, drift, parts)
    value: dict[str, FloatArray] = {}
    for name, (axis, b0, b1, repeat, _, _) in COMPONENTS.items():
        p = at[:, "xy".index(axis)]
        level, slope = states[name].T[:, :, None]
        value[name] = b0 + b1 * p + level + slope * (p - CENTRE)
        value[name] = value[name] + repeat * rng.standard_normal((parts, len(at)))
    axy = AXY[0] + AXY[1] * rng.standard_normal((parts, 1))
    x, y = at[:, 0], at[:, 1]
    v = value
    Ex = v["dx_x"] + v["dx_y"] + Z * v["ey_x"] + y * (v["ez_x"] + v["ez_y"] - axy)
    Ey = v["dy_x"] + v["dy_y"] - x * v["ez_x"] - Z * v["ex_y"]
    return np.stack([Ex, Ey], axis=2)


def length_errors(errors: FloatArray) -> FloatArray:
    """(parts, lengths): true lengths between POINTS less nominal ones, eq. (20)."""
    actual = POINTS[:, :2] + errors
    found = []
    for i, j in PAIRS:
        L = np.linalg.norm(actual[:, i] - actual[:, j], axis=1)
        found.append(L - np.linalg.norm(POINTS[i] - POINTS[j]))
    return np.stack(found, axis=1)


def unit_gradients() -> FloatArray:
    """(lengths, rows): first-order lengths in the errors of POINTS, rows points first."""
    A = np.zeros((len(PAIRS), 2 * len(POINTS)))
    for row, (i, j) in enumerate(PAIRS):
        unit = (POINTS[j] - POINTS[i])[:2]
        unit = unit / np.linalg.norm(unit)
        A[row, 2 * i : 2 * i + 2] -= unit
        A[row, 2 * j : 2 * j + 2] += unit
    return A


def predicted(known: LoadedMachine, readings: Readings) -> tuple[Prediction, dict[str, bool]]:
    """The package's prediction at POINTS, and which coefficients' intervals cover the truth."""
    fit = fit_machine(known, readings)
    model = build_model(known, estimates_from_fit(known, fit))
    truth = true_coefficients()
    covered = {}
    for name, item in fit.components.items():
        e = item.estimate
        k = coverage_factor(0.95, e.pass_dof)
        half = k * np.sqrt(np.diag(e.covariance))
        for power, (b, h, t) in enumerate(zip(e.coefficients, half, truth[name], strict=True)):
            covered[f"{name}[{power}]"] = bool(abs(b - t) <= h)
    return predict(model, ["a", "b", "c"], POINTS), covered


def coverage(known: LoadedMachine, drift: Drift, machines: int, seed: int) -> dict[str, float]:
    """Shares of machines whose 95 % intervals hold: each coefficient, future point, length."""
    found = coverage_by_machine(known, drift, machines, seed)
    return {name: float(np.mean(shares)) for name, shares in found.items()}


def coverage_by_machine(
    known: LoadedMachine, drift: Drift, machines: int, seed: int, parts: int = 1
) -> dict[str, FloatArray]:
    """Of each machine, whether the 95 % interval of a coefficient holds (0 or 1), and the share
    of its future `parts` in which that of a point or length does.
    """
    hits: dict[str, list[float]] = {}
    A = np.vstack([np.eye(2 * len(POINTS)), unit_gradients()])
    names = [f"E{axis} of {p}" for p in "abc" for axis in "xy"]
    names += [f"length {'abc'[i]}{'abc'[j]}" for i, j in PAIRS]
    for rng in np.random.default_rng(seed).spawn(machines):
        prediction, covered = predicted(known, read_machine(rng, drift))
        variance = prediction.variance(A)
        half = np.array([coverage_factor(0.95, d) for d in variance.dof])
        half = half * np.sqrt(variance.total)
        errors = make_parts(rng, drift, parts)
        actual = np.concatenate([errors.reshape(parts, -1), length_errors(errors)], axis=1)
        shares = (np.abs(actual - A @ prediction.mean) <= half).mean(axis=0)
        for name, share in zip(names, shares.tolist(), strict=True):
            hits.setdefault(name, []).append(share)
        for name, good in covered.items():
            hits.setdefault(name, []).append(float(good))
    return {name: np.array(found) for name, found in hits.items()}
