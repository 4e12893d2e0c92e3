"""Klipper: skew of a plane from three measured lengths (SET_SKEW XY=AC,BD,AD).

Klipper (skew_correction.py): side = sqrt(2 AC^2 + 2 BD^2 - 4 AD^2)/2, factor = tan(pi/2 -
acos((AC^2 - side^2 - AD^2)/(2 side AD))), x' = x - y factor. The angle of the corner is that
between the axes, so that the lengths of a rhombus say it: one of more than 90 degrees makes AC
shorter.
"""

from __future__ import annotations

import math
import re

from mtu_cli.findings import error
from mtu_cli.formats.control.errors import Parameters, choice, number_parameter, numeric, refuse

SAYS = (
    "The lengths of a rhombus whose corner A is the angle between the axes as measured: AC is the "
    "shorter diagonal where the angle is more than 90 degrees."
)
DEFAULTS: Parameters = {"plane": "XY", "side": "100"}
PLACES = 6
LINE = re.compile(r"SET_SKEW\s+(XY|XZ|YZ)=([^,\s]+),([^,\s]+),([^,\s]+)")


def write_skew(angle: float, parameters: Parameters) -> str:
    """G-code that sets the skew, read back; `angle` in rad, more than 90 degrees positive.

    Raises InputError where the lengths give it otherwise than to half of `skew_quantum`.
    """
    side = number_parameter(parameters, "side")
    plane = choice(parameters, "plane", ("XY", "XZ", "YZ"))
    diagonals = [side * math.sqrt(2 - 2 * way * math.sin(angle)) for way in (1, -1)]
    lengths = ",".join(f"{x:.{PLACES}f}" for x in (*diagonals, side))
    text = f"; {SAYS}\nSET_SKEW {plane}={lengths}\nSKEW_PROFILE SAVE=mtu\n"
    readback = read_skew(text)
    if abs(readback - angle) > skew_quantum(parameters) / 2:
        raise error("not-writable", reason=f"read back it is {readback:.9g} rad, not {angle:.9g}")
    return text


def read_skew(text: str) -> float:
    """The angle less 90 degrees, rad; raises InputError for lengths of no parallelogram."""
    match = LINE.search(text)
    if match is None:
        refuse("no SET_SKEW XY=AC,BD,AD")
    ac, bd, ad = (numeric(x) for x in match.groups()[1:])
    square = 2 * ac**2 + 2 * bd**2 - 4 * ad**2
    if min(ac, bd, ad, square) <= 0:
        refuse(f"{ac:g}, {bd:g} and {ad:g} are no lengths of a parallelogram")
    side = math.sqrt(square) / 2
    cosine = (ac**2 - side**2 - ad**2) / (2 * side * ad)
    if abs(cosine) >= 1:
        refuse(f"{ac:g}, {bd:g} and {ad:g} are no lengths of a parallelogram")
    return math.acos(cosine) - math.pi / 2


def skew_quantum(parameters: Parameters) -> float:
    """rad: what the last place of the lengths makes of the angle, at most."""
    return 4.0 * 10.0**-PLACES / number_parameter(parameters, "side")
