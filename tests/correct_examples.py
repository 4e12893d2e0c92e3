"""A ring measured on virtual machines whose error at every place is written here, too."""

from collections.abc import Callable
from pathlib import Path
from textwrap import dedent

import numpy as np
from made_tables import made_points
from model_examples import part_of, stated
from numpy.typing import NDArray

from mtu_cli.files.part import LoadedPart
from mtu_cli.files.readings import Points
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.stats.least_squares import FloatArray

ErrorAt = Callable[[FloatArray, FloatArray], FloatArray]
"""Errors (n, 3) mm at places (n, 3) mm and temperatures (n,) degC."""

ANGLES = 2 * np.pi * np.arange(11) / 11
DIAMETER = 180.0124
ROUNDING = 1e-9
"""Relative: doubles of 200 mm round by 3e-14 mm, and what is told of them is 1e-4 mm or more."""
ROUNDING_MM = 1e-12
"""Some tens of the roundings of 3e-14 mm that a coordinate of 200 mm goes through."""

MACHINE = """\
components:
  px: {of: x, unit: um, coefficients: [2, -0.06], covariance: [[0.04, 0], [0, 1e-6]],
       pass_covariance: [[0.2, 0], [0, 4e-6]], s_repeat: 0.4, dof: 8}
  py: {of: y, unit: um, coefficients: [1, -0.05], covariance: [[0.04, 0], [0, 1e-6]],
       pass_covariance: [[0.3, 0], [0, 4e-6]], s_repeat: 0.5, dof: 8}
  sq: {unit: urad, coefficients: [50], u_future: 1}
  grow: {unit: um/m, coefficients: [-11], u_future: 0.5}
equations:
  Ex: px + y*sq + grow*x*(T_scale_degC - 20)
  Ey: py + grow*y*(T_scale_degC - 20)
"""


def machine(folder: Path) -> MachineModel:
    """A planar machine whose scales shrink with their temperature."""
    return stated(folder, MACHINE)


def error_at(place: FloatArray, temperature: FloatArray) -> FloatArray:
    """The error of that machine, from its printed coefficients."""
    x, y = place[:, 0], place[:, 1]
    warm = -11e-6 * (temperature - 20)
    Ex = 2e-3 - 0.06e-3 * x + 50e-6 * y + warm * x
    Ey = 1e-3 - 0.05e-3 * y + warm * y
    return np.column_stack([Ex, Ey, np.zeros(len(x))])


def ring_places(
    centre: tuple[float, float] = (200.0, 180.0), diameter: float = 180.0
) -> FloatArray:
    """Places (11, 3) on a ring, z 0."""
    x, y = diameter / 2 * np.cos(ANGLES), diameter / 2 * np.sin(ANGLES)
    return np.column_stack([centre[0] + x, centre[1] + y, np.zeros(11)])


def ring_part(folder: Path, more: str = "", **ring: str) -> LoadedPart:
    """The ring as a part file: features r0 to r10 on a circle `ring`; `more` lines."""
    keys = {"calibrated_mm": str(DIAMETER)} | ring
    names = ", ".join(f"r{i}" for i in range(11))
    features = "".join(
        f"  r{i}: {{x_mm: {x:.9f}, y_mm: {y:.9f}}}\n" for i, (x, y, _) in enumerate(ring_places())
    )
    given = ", ".join(f"{key}: {value}" for key, value in keys.items() if value)
    circle = f"circles: [{{id: ring, features: [{names}]{', ' if given else ''}{given}}}]\n"
    return part_of(folder, f"features:\n{features}{circle}{dedent(more)}")


def seen(true: FloatArray, error: ErrorAt, temperature: FloatArray) -> FloatArray:
    """What the machine reads for `true` places: m = t + E(m), solved by iteration."""
    measured = true.copy()
    for _ in range(60):
        measured = true + error(measured, temperature)
    return measured


def ring_points(
    measured: FloatArray,
    parts: list[str],
    repeats: list[int] | None = None,
    covariates: dict[str, FloatArray | NDArray[np.object_]] | None = None,
    *,
    time: FloatArray | None = None,
) -> Points:
    """Points of rings (rings*11, 3), one ring an entry of `parts`."""
    nominal = np.tile(ring_places(), (len(parts), 1))
    measured = measured.copy()
    measured[:, 2] = nominal[:, 2] = np.nan
    return made_points(
        np.repeat(parts, 11).tolist(),
        np.tile(np.arange(11), len(parts)),
        [f"r{i}" for i in range(11)],
        measured,
        nominal,
        repeat=np.repeat(repeats or [-1] * len(parts), 11),
        time=np.nan if time is None else time,
        covariates=covariates,
    )


def rings(count: int, warm: float = 1.5) -> tuple[FloatArray, FloatArray, FloatArray]:
    """True places of rings of the calibrated diameter, what is read, temperatures."""
    true = np.tile(ring_places(diameter=DIAMETER), (count, 1))
    temperature = 20.0 + warm * np.repeat(np.arange(count), 11) + 0.01 * np.arange(11 * count)
    return true, seen(true, error_at, temperature), temperature
