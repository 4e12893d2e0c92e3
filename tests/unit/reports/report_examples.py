"""Results like those of Gilsinn & Ling 2004, from seeded readings, for the tests of reports."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mtu_cli.analyses.predictions import (
    LengthsResult,
    OrthogonalityResult,
    PointsResult,
    predict_lengths,
    predict_orthogonality,
    predict_points,
)
from mtu_cli.files.machine import LoadedMachine, load_machine
from mtu_cli.files.part import LoadedPart, load_part
from mtu_cli.files.readings import read_readings
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.fit import MachineFit, estimates_from_fit, fit_machine
from mtu_cli.model.machine_model import MachineModel, build_model
from mtu_cli.model.settings import Settings

SETTINGS = Settings(trials=20_000, threads=1)

SAYS = {
    "dx_x": "X positioning", "dy_x": "Y straightness of X", "dy_y": "Y positioning",
    "dx_y": "X straightness of Y", "ex_x": "roll of X", "ey_x": "pitch of X", "ez_x": "yaw of X",
    "ex_y": "pitch of Y", "ey_y": "roll of Y", "ez_y": "yaw of Y",
}  # fmt: skip
LINES = {
    "dx_x": (-5.83, -0.0189), "dy_x": (4.17, -0.00378), "dy_y": (0.435, -0.0183),
    "dx_y": (3.40, -0.00388), "ex_x": (-7.10, 0.00078), "ey_x": (-1.26, -0.0063),
    "ez_x": (6.31, -0.0059), "ex_y": (-13.55, -0.0012), "ey_y": (8.21, 0.0078),
    "ez_y": (3.11, -0.0116),
}  # fmt: skip
AXIS_ANGLE = (-6.99, -6.43, -7.39, -6.76, -6.79)

EQUATIONS = """equations:
  Ex: dx_x + dx_y + z*ey_x + y*ez_x + z*ey_y + y*ez_y - y*axy
  Ey: dy_x + dy_y - z*ex_x - x*ez_x - z*ex_y
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Example:
    """One machine from its files to its model."""

    machine: LoadedMachine
    fit: MachineFit
    estimates: Estimates
    model: MachineModel
    part: LoadedPart

    def points(self, settings: Settings = SETTINGS) -> PointsResult:
        return predict_points(self.model, self.part, settings)

    def lengths(self, settings: Settings = SETTINGS) -> LengthsResult:
        return predict_lengths(self.model, self.part, settings)

    def angles(self, settings: Settings = SETTINGS) -> OrthogonalityResult:
        return predict_orthogonality(self.model, self.part, settings)


def example(
    folder: Path,
    *,
    passes: int | None = 5,
    directions: bool = True,
    roles: tuple[str, ...] = ("lbb",),
    stated: str = "",
    equation: str = "",
    degree: int = 1,
) -> Example:
    """The paper's machine read in `passes` (None: no pass column) by every role.

    `stated` adds components to the machine file, `equation` an equation. dy_y drifts from
    pass to pass, dx_x has a reversal, ez_y is bent.
    """
    machine = load_machine(_machine(folder, stated, equation, degree))
    files = []
    for number, role in enumerate(roles):
        path = folder / f"{role}.csv"
        path.write_text(_readings(7 + number, passes, directions), encoding="utf-8")
        files.append((path, role))
    readings = read_readings(files, machine.machine.components, for_fit=True)
    fit = fit_machine(machine, readings)
    estimates = estimates_from_fit(machine, fit)
    return Example(
        machine=machine,
        fit=fit,
        estimates=estimates,
        model=build_model(machine, estimates),
        part=load_part(_part(folder)),
    )


def unit(name: str) -> str:
    return "um" if name.startswith("d") else "arcsec"


def _machine(folder: Path, stated: str, equation: str, degree: int) -> Path:
    lines = ["schema: mtu/machine/1", "name: test machine", "constants: {z: 127.0}", "components:"]
    for name, says in SAYS.items():
        lines.append(
            f"  {name}: {{of: {name[-1]}, unit: {unit(name)}, degree: {degree}, says: {says}}}"
        )
    lines.append("  axy: {unit: arcsec, says: angle between X and Y}")
    path = folder / "machine.yaml"
    text = "\n".join([*lines, *filter(None, [stated])]) + "\n" + EQUATIONS + equation
    path.write_text(text, encoding="utf-8")
    return path


def _readings(seed: int, passes: int | None, directions: bool) -> str:
    rng = np.random.default_rng(seed)
    header = ["component", "error", "unit", "position_mm"]
    header += ["pass"] * (passes is not None) + ["direction"] * directions
    rows = [",".join(header)]
    for name, (level, slope) in LINES.items():
        size = 1.0 if unit(name) == "um" else 1.4
        for number in range(1, (passes or 1) + 1):
            for sign in (1, -1) if directions else (0,):
                shift = size * rng.normal(0, 0.7) + (0.6 * number if name == "dy_y" else 0.0)
                shift += 0.9 * sign if name == "dx_x" else 0.0
                tilt = size * rng.normal(0, 0.004)
                for p in np.linspace(0, 150, 8):
                    bent = 2.0 * ((p - 75) / 75) ** 2 if name == "ez_y" else 0.0
                    y = level + slope * p + shift + tilt * (p - 75) + bent
                    y += rng.normal(0, 0.6 * size)
                    cells = [name, f"{y:.6f}", unit(name), f"{p:.4f}"]
                    cells += [str(number)] * (passes is not None) + [str(sign)] * directions
                    rows.append(",".join(cells))
    for number, angle in enumerate(AXIS_ANGLE, 1):
        cells = ["axy", f"{angle + 0.1 * (seed - 7)}", "arcsec", ""]
        cells += [str(number)] * (passes is not None) + ["1"] * directions
        rows.append(",".join(cells))
    return "\n".join(rows) + "\n"


def _part(folder: Path) -> Path:
    """The 24 holes on the square 10..140 mm; 3, 9, 15, 21 are its corners."""
    side = np.linspace(10, 140, 7)
    places = [(x, 10.0) for x in side[::-1]] + [(10.0, y) for y in side[1:]]
    places += [(x, 140.0) for x in side[1:]] + [(140.0, y) for y in side[-2:0:-1]]
    lines = ["schema: mtu/part/1", "name: test part", "features:"]
    for i, (x, y) in enumerate(places):
        lines.append(f"  '{(20 + i) % 24 + 1}': {{x_mm: {x:.4f}, y_mm: {y:.4f}}}")
    lines += ["lengths:", "  - {from: '3', to: '9', tolerance_um: 12}"]
    lines += ["  - {from: '9', to: '15', tolerance_um: 25}", "  - {from: '3', to: '15'}"]
    lines += ["orthogonality:", "  - id: xy"]
    lines.append("    row: ['21', '22', '23', '24', '1', '2', '3']")
    lines.append("    column: ['3', '4', '5', '6', '7', '8', '9']")
    path = folder / "part.yaml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
