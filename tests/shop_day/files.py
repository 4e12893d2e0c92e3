"""A shop day's measured points, and the machine and part as their files state them."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shop_day.day import Floats, ShopDay


def write_csv(
    day: ShopDay, repeats: Floats, path: Path, *, cells: NDArray[np.bool_] | None = None
) -> Path:
    """One row a measured point; `repeats` (P, H, 2, R) or (P, H, 2), um.

    All covariates of the day become columns. `cells` (P, H): false where a hole was not measured.
    """
    values = repeats[..., None] if repeats.ndim == 3 else repeats
    head = ["part", "feature", "repeat", "x_mm", "y_mm", "operation"]
    lines = [",".join([*head, *day.covariates])]
    logged = [day.full(name) for name in day.covariates]
    for p, part in enumerate(day.parts):
        for h, feature in enumerate(day.features):
            if cells is not None and not cells[p, h]:
                continue
            own = [day.operations[day.operation[h]]]
            own += [f"{column[p, h]:.10g}" for column in logged]
            for r in range(values.shape[-1]):
                x, y = day.places[h, :2] + values[p, h, :, r] / 1000
                lines.append(",".join([part, feature, str(r + 1), f"{x:.9f}", f"{y:.9f}", *own]))
    path.write_text("\n".join(lines) + "\n")
    return path


ZERO_MACHINE = """\
schema: mtu/machine/1
name: a machine without known errors
components:
  dx: {unit: um, coefficients: [0]}
  dy: {unit: um, coefficients: [0]}
equations: {Ex: dx, Ey: dy}
"""


def write_machine(path: Path, *, scatter: float | None = None, repeat: float = 0.0) -> Path:
    """A machine without errors. `scatter`: one whose passes scatter by so many um, with 10 degrees
    of freedom; `repeat` likewise of single readings, with many.
    """
    path.write_text(ZERO_MACHINE if scatter is None else _scattering_machine(scatter, repeat))
    return path


def _scattering_machine(scatter: float, repeat: float) -> str:
    many = ", repeat_dof: 300" if repeat else ""
    return f"""\
schema: mtu/machine/1
name: a machine whose passes scatter
components:
  dx: &scatter {{unit: um, coefficients: [0], covariance: [[0]], pass_dof: 10,
    pass_covariance: [[{scatter**2}]], s_repeat: {repeat:g}{many}}}
  dy: *scatter
equations: {{Ex: dx, Ey: dy}}
"""


def write_part(day: ShopDay, path: Path) -> Path:
    """The part file: 24 features with x, y, z."""
    lines = ["schema: mtu/part/1", "name: plate with 24 holes", "features:"]
    for name, (x, y, z) in zip(day.features, day.places.tolist(), strict=True):
        lines.append(f"  '{name}': {{x_mm: {x!r}, y_mm: {y!r}, z_mm: {z!r}}}")
    path.write_text("\n".join(lines) + "\n")
    return path
