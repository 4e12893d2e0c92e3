"""The machine and the part of a shop day as their files state them."""

from __future__ import annotations

from pathlib import Path

from shop_day.day import ShopDay

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
