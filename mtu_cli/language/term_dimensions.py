"""Dimensions of the equations of machines: every term is a length, and what is per kelvin or minute
has its temperature or time, and nothing else has.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

from mtu_cli.language.dimensions import (
    SAME,
    UNKNOWN,
    Scale,
    base_scales,
    check_arguments,
    exponent,
    first_column,
    length_scale,
    shown,
    terms,
)
from mtu_cli.language.errors import EquationError
from mtu_cli.language.tree import Node, names
from mtu_cli.units import DEGREE, MINUTE, PARAMETER_UNITS, Unit, dimension_name


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """What is known of the columns of the data: `lengths` by name are exponents of length.

    `per` has exponents of temperature (K) and time (min) of all names, where they are known.
    `stated` are the names whose own unit is stated in the file, and it: only beside them a column
    is known, for without them ``0.004*dir_x`` is 0.004 mm and right.
    """

    stated: Mapping[str, Unit] = field(default_factory=dict)
    lengths: Mapping[str, int] = field(default_factory=dict)
    per: Mapping[str, Mapping[str, int | None]] = field(default_factory=dict)


def check_dimension(
    node: Node,
    wanted: int,
    dimensions: Mapping[str, int | None],
    columns: Columns | None = None,
) -> None:
    """Raises EquationError at the first term whose dimension is not `wanted`, or the first
    function of plain numbers with an argument that is none.

    `dimensions` gives the exponent of length of each name; None, or no entry, is unknown.
    """
    columns = Columns() if columns is None else columns
    beside = {**dimensions, **columns.lengths}
    for term in terms(node):
        stated = next((name for name in names(term) if name in columns.stated), None)
        scale = length_scale(dimensions if stated is None else beside)
        if stated is not None:
            _check_per(term, stated, columns, partial(_lacking, term, wanted, scale))
        found = exponent(term, scale)
        if found is not UNKNOWN and found != wanted:
            hint = "its lever arm beside it as a factor (a position or a named constant)"
            raise EquationError(
                f"this term is {dimension_name(found)}, its equation is {dimension_name(wanted)}",
                first_column(term),
                hint if found < wanted else f"a term that is {dimension_name(wanted)}",
                shown(term),
            )
    for scale in (length_scale(beside), *base_scales(columns.per).values()):
        check_arguments(node, scale)


FACTOR = {DEGREE: "a temperature, such as (T_spindle_degC - 20)", MINUTE: "a time in min"}
DIVIDED = {
    DEGREE: "the temperature divided by a number of K, such as (T_spindle_degC - 20)/10",
    MINUTE: "the time divided by a number of min, such as time_min/60",
}


def _lacking(term: Node, wanted: int, scale: Scale) -> int:
    """Lengths that a term lacks, which may be none; 0 where that is not known."""
    try:
        found = exponent(term, scale)
    except EquationError:
        # That is told where its temperatures and times are right.
        return 0
    return 0 if found is UNKNOWN else wanted - int(found)


def _check_per(term: Node, stated: str, columns: Columns, lacking: Callable[[], int]) -> None:
    """What is per kelvin or minute has its temperature or time, and once; what is not has none.

    A literal or a constant beside them may have any unit, so that anything may be meant. `lacking`
    gives the lengths that the term lacks beside them.
    """
    scales = base_scales(columns.per)
    found = {base: exponent(term, scale) for base, scale in scales.items()}
    beyond = {base: own for base, own in found.items() if own is not UNKNOWN and abs(own) >= SAME}
    for base, own in beyond.items():
        if own < 0:
            what = f"this term is per {base}, its equation is not"
            hint = f"{FACTOR[base]}, beside it as a factor"
            raise EquationError(what, first_column(term), hint, shown(term))
    unit = columns.stated[stated]
    if not beyond or _is_power(beyond, unit):
        return
    words = " and ".join(scales[base].words(own) for base, own in beyond.items())
    hint = _right(unit, stated, beyond, scales, lacking())
    raise EquationError(f"this term has {words} too many", first_column(term), hint, shown(term))


def _is_power(beyond: Mapping[str, float], unit: Unit) -> bool:
    """Whether it is the square or a higher power alone, which no unit can be per."""
    return unit.per is None and len(beyond) == 1 and max(beyond.values()) > 1


def _right(
    unit: Unit, stated: str, beyond: Mapping[str, float], scales: Mapping[str, Scale], lacking: int
) -> str:
    """What would make a term right that has a temperature or a time too many."""
    base = next(iter(beyond))
    if unit.per == base:
        return f"one factor that is {scales[base].words(1)} beside a unit per {base}"
    ways = [DIVIDED[other] for other in beyond]
    units = units_per(base, unit, lacking) if unit.per is None else []
    if not units:
        return " and ".join(ways)
    own = f"{stated} in {' or '.join(units)}"
    if len(ways) == 2:
        return f"{own}, and {ways[1]}"
    return own if lacking else f"{own}, or {ways[0]}"


def units_per(base: str, unit: Unit, lacking: int = 0) -> list[str]:
    """Units per kelvin or time that a parameter in `unit` is meant to have, where its term has so
    many lengths too few; none if there is none: um/K of um and of mm, um/m/K with one too many.
    """
    found = [
        name
        for name, own in PARAMETER_UNITS.items()
        if own.per == base and own.dimension == unit.dimension + lacking
    ]
    alike = [name for name in found if name.startswith(f"{unit.name}/")]
    alike = alike or [name for name in found if not name.startswith("arcsec")]
    return alike or found
