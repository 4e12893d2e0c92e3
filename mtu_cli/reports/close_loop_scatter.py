"""How large a scatter that close-loop found is: in words, in the table, in the report."""

from __future__ import annotations

from typing import Any

from mtu_cli.analyses.close_loop.found_scatter import ScatterSize
from mtu_cli.reports.close_loop_shown import in_shown_unit
from mtu_cli.reports.document import finite
from mtu_cli.reports.numbers import MISSING, plus_minus, significant


def scatter_text(own: ScatterSize) -> str:
    """Such as "reamed by 4.2 ± 0.2 um, the others by 1.6 um"."""
    name, size, unit, _ = scatter_line(own)
    others = _others(own)
    each, rest = (_each(own, which) for which in (own.by_axis, own.others_by_axis))
    if own.of is None:
        return f"{name} = {size} {unit}{each}"
    beside = "" if others is None else f", the others by {significant(others)} {unit}{rest}"
    return f"{own.of} by {size} {unit}{each}{beside}"


def _each(own: ScatterSize, by_axis: tuple[tuple[str, float], ...]) -> str:
    axes = ", ".join(f"{axis.upper()} {significant(_shown(own, s))}" for axis, s in by_axis)
    return f" ({axes})" if axes else ""


def scatter_line(own: ScatterSize) -> list[str]:
    """Name, value, unit, and no interval."""
    value, u, unit = in_shown_unit(own.parameter)
    return [own.parameter[0], plus_minus(value, u), unit, MISSING]


def scatter_document(own: ScatterSize | None) -> dict[str, Any] | None:
    """Of the report."""
    if own is None:
        return None
    value, u, unit = in_shown_unit(own.parameter)
    return {
        "of": own.of,
        "s": finite(value),
        "u": finite(u),
        "unit": unit,
        "s_of_others": finite(_others(own)),
        "by_axis": {axis: _shown(own, s) for axis, s in own.by_axis},
        "others_by_axis": {axis: _shown(own, s) for axis, s in own.others_by_axis},
    }


def _others(own: ScatterSize) -> float | None:
    return None if own.others is None else _shown(own, own.others)


def _shown(own: ScatterSize, s: float) -> float:
    return in_shown_unit((*own.parameter[:2], s, 0.0))[0]
