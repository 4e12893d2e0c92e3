"""How large a scatter that close-loop found is: in words, in the table, in the report."""

from __future__ import annotations

import math
from typing import Any

from mtu_cli.close_loop_sealed.analyses.loop.found_scatter import ScatterSize
from mtu_cli.close_loop_sealed.reports.close_loop_shown import in_shown_unit
from mtu_cli.reports.document import finite
from mtu_cli.reports.numbers import MISSING, plus_minus, significant


def scatter_text(own: ScatterSize) -> str:
    """Such as "reamed by 4.2 ± 0.2 um, the others by 1.6 um"."""
    name, size, unit, _ = _line(own)
    others = _others(own)
    each, rest = (_each(own, which) for which in (own.by_axis, own.others_by_axis))
    if own.of is None:
        return f"{name} = {size} {unit}{each}"
    beside = "" if others is None else f", the others by {significant(others)} {unit}{rest}"
    return f"{own.of} by {size} {unit}{each}{beside}"


def _each_with_u(own: ScatterSize) -> list[tuple[str, str]]:
    """By axis its size, such as "24.0 ± 4.1", all to be read beside one another."""
    us = own.u_by_axis or (math.nan,) * len(own.by_axis)
    return [
        (axis, plus_minus(_shown(own, s), _shown(own, u)))
        for (axis, s), u in zip(own.by_axis, us, strict=True)
    ]


def _each(own: ScatterSize, by_axis: tuple[tuple[str, float], ...]) -> str:
    axes = ", ".join(f"{axis.upper()} {significant(_shown(own, s))}" for axis, s in by_axis)
    return f" ({axes})" if axes else ""


def one_axis_text(own: ScatterSize, *, turns: bool) -> str:
    """Of what one axis alone has, such as "the scale of X differs from part to part: s = 24.0 ± 4.1
    um/m (Y 0.0 ± 3.2)". Errors along an axis that go with the place along the other one are those
    of that one's direction: it leans over.
    """
    sizes = {axis.upper(): size for axis, size in _each_with_u(own)}
    small, large = (axis.upper() for axis, _ in sorted(own.by_axis, key=lambda found: found[1]))
    unit = own.parameter[1]
    if turns:
        what, other = f"{small} leans over along {large}", f"{large} along {small}"
    else:
        what, other = f"the scale of {large} differs", small
    return f"{what} from part to part: s = {sizes[large]} {unit} ({other} {sizes[small]})"


def scatter_lines(own: ScatterSize) -> list[list[str]]:
    """Name, value, unit, and no interval; of each axis where one of both would be that of none."""
    if not own.axes_unlike:
        return [_line(own)]
    unit = own.parameter[1]
    return [[f"s along {axis}", size, unit, MISSING] for axis, size in _each_with_u(own)]


def _line(own: ScatterSize) -> list[str]:
    value, u, unit = in_shown_unit(own.parameter)
    return [own.parameter[0], plus_minus(value, u), unit, MISSING]


def scatter_document(own: ScatterSize | None) -> dict[str, Any] | None:
    """Of the report: `s` and `u` are null where axes are unlike, as they are true of none."""
    if own is None:
        return None
    value, u, unit = in_shown_unit(own.parameter)
    return {
        "of": own.of,
        "s": None if own.axes_unlike else finite(value),
        "u": None if own.axes_unlike else finite(u),
        "unit": unit,
        "axes_unlike": own.axes_unlike,
        "p_alike": finite(own.p_alike),
        "s_of_others": finite(_others(own)),
        "by_axis": {axis: _shown(own, s) for axis, s in own.by_axis},
        "u_by_axis": {
            axis: finite(_shown(own, u))
            for (axis, _), u in zip(own.by_axis, own.u_by_axis, strict=bool(own.u_by_axis))
        },
        "others_by_axis": {axis: _shown(own, s) for axis, s in own.others_by_axis},
    }


def _others(own: ScatterSize) -> float | None:
    return None if own.others is None else _shown(own, own.others)


def _shown(own: ScatterSize, s: float) -> float:
    return in_shown_unit((*own.parameter[:2], s, 0.0))[0]
