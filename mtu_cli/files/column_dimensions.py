"""What the names of columns tell of their dimensions."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

from mtu_cli.files.covariates import is_temperature
from mtu_cli.language.term_dimensions import Columns
from mtu_cli.units import DEGREE, LENGTH, MINUTE, Unit

POSITIONS = ("x", "y", "z")


class Dimensions(NamedTuple):
    """Exponents of length, temperature and time."""

    length: int = 0
    degree: int = 0
    minute: int = 0


NUMBER = Dimensions()
PLACE = Dimensions(length=LENGTH)
TEMPERATURE = Dimensions(degree=1)
TIME = Dimensions(minute=1)
_KNOWN = {"dir_x": NUMBER, "dir_y": NUMBER, "dir_z": NUMBER, "sequence": NUMBER,
          "time_min": TIME} | dict.fromkeys(POSITIONS, PLACE)  # fmt: skip


def column_dimensions(name: str) -> Dimensions | None:
    """Those of a position or a column of the contract; None for a user's own column, whatever its
    name ends with: the parameter of an effect has its unit for each step of it.
    """
    return TEMPERATURE if is_temperature(name) else _KNOWN.get(name)


def columns_of(known: Mapping[str, Dimensions | None], parameters: Mapping[str, Unit]) -> Columns:
    """What an equation's check knows: `known` dimensions of columns by name, and the units of the
    `parameters` of an effect.
    """
    sure = {name: found for name, found in known.items() if found is not None}
    bases = {DEGREE: "degree", MINUTE: "minute"}
    return Columns(
        stated=parameters,
        lengths={name: found.length for name, found in sure.items()},
        per={
            base: {name: getattr(found, key) for name, found in sure.items()}
            | {name: -1 if unit.per == base else 0 for name, unit in parameters.items()}
            for base, key in bases.items()
        },
    )


def own_columns(names: Iterable[str], taken: Collection[str]) -> dict[str, Dimensions | None]:
    """Of the names of an equation those of positions and columns; `taken` are other things."""
    return {name: column_dimensions(name) for name in names if name not in taken}
