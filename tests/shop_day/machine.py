"""The machine of a shop day as its file states it, and the errors that it has in truth.

`known=False`: a machine whose components are zero, without uncertainty. `known=True`: components
from an earlier fit, with coefficient covariance and pass-to-pass covariance; what the machine
does that day is drawn from both.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from shop_day.day import CENTRE, Floats, ShopDay

URAD_UM_PER_MM = 1e-3
"""An angle of 1 urad moves a point at 1 mm by 1e-3 um."""


class Known(NamedTuple):
    """A line in the position along `of`: level at the centre, um, and slope, um/mm, with the
    standard uncertainties of both and their standard deviations from pass to pass.
    """

    of: str
    level: float
    slope: float
    u_level: float
    u_slope: float
    s_level: float
    s_slope: float


KNOWN = {
    "dx_x": Known("x", -8.0, -0.019, 0.15, 0.003, 0.3, 0.003),
    "dy_x": Known("x", 4.0, -0.004, 0.15, 0.002, 0.2, 0.002),
    "dy_y": Known("y", -1.5, -0.018, 0.15, 0.003, 0.3, 0.003),
    "dx_y": Known("y", 3.0, -0.004, 0.15, 0.002, 0.2, 0.002),
}
AXY_URAD, U_AXY_URAD = -33.0, 3.0
ZERO_MACHINE = """\
schema: mtu/machine/1
name: a machine without known errors
components:
  dx: {unit: um, coefficients: [0]}
  dy: {unit: um, coefficients: [0]}
equations: {Ex: dx, Ey: dy}
"""


def write_machine(
    path: Path, *, known: bool = False, scatter: float | None = None, repeat: float = 0.0
) -> Path:
    """The machine file; see `geometric_errors` for what belongs into the data of a known one.

    `scatter`: one without errors whose passes scatter by so many um, with 10 degrees of freedom;
    `repeat` likewise of single readings, with many.
    """
    text = _known_machine() if known else ZERO_MACHINE
    if scatter is not None:
        text = _scattering_machine(scatter, repeat)
    path.write_text(text)
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


def predicted_errors(day: ShopDay) -> Floats:
    """What the known machine's file predicts, (H, 2) um."""
    lines = {name: (item.level, item.slope) for name, item in KNOWN.items()}
    return _combined(day, {name: np.array(pair) for name, pair in lines.items()}, AXY_URAD)


def geometric_errors(day: ShopDay, rng: np.random.Generator) -> Floats:
    """Errors of the known machine on that day, (P, H, 2) um: one draw of its coefficients for
    the day, one of its state for every part.
    """
    shared = {
        name: rng.normal([item.level, item.slope], [item.u_level, item.u_slope])
        for name, item in KNOWN.items()
    }
    axy = rng.normal(AXY_URAD, U_AXY_URAD)
    found = []
    for _ in range(day.P):
        states = {
            name: pair + rng.normal(0, [KNOWN[name].s_level, KNOWN[name].s_slope])
            for name, pair in shared.items()
        }
        found.append(_combined(day, states, axy))
    return np.array(found)


def _combined(day: ShopDay, lines: dict[str, Floats], axy: float) -> Floats:
    at = {
        name: level + slope * (day.places[:, "xy".index(KNOWN[name].of)] - CENTRE)
        for name, (level, slope) in lines.items()
    }
    turned = URAD_UM_PER_MM * axy * day.places[:, 1]
    return np.column_stack([at["dx_x"] + at["dx_y"] - turned, at["dy_x"] + at["dy_y"]])


def _known_machine() -> str:
    lines = ["schema: mtu/machine/1", "name: a machine with known errors", "components:"]
    for name, item in KNOWN.items():
        b0 = item.level - item.slope * CENTRE
        # Of intercept and slope, from the level at the centre and the slope, uncorrelated.
        spread = np.array([[1.0, -CENTRE], [0.0, 1.0]]) * [item.u_level, item.u_slope]
        covariance = (spread @ spread.T).tolist()
        states = [[item.s_level**2, 0.0], [0.0, item.s_slope**2]]
        lines.append(
            f"  {name}: {{of: {item.of}, unit: um, coefficients: [{b0!r}, {item.slope!r}], "
            f"covariance: {covariance!r}, s_repeat: 0, pass_covariance: {states!r}, "
            f"pass_center_mm: {CENTRE!r}}}"
        )
    lines.append(
        f"  axy: {{unit: urad, coefficients: [{AXY_URAD!r}], covariance: [[{U_AXY_URAD**2!r}]], "
        "s_repeat: 0}"
    )
    lines.append("equations: {Ex: dx_x + dx_y - y*axy, Ey: dy_x + dy_y}")
    return "\n".join(lines) + "\n"
