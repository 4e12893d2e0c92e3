"""What the names of columns tell of their dimensions."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from mtu_cli.files.covariates import is_temperature
from mtu_cli.units import Powers, internal

POSITIONS = ("x", "y", "z")


NUMBER = internal()
PLACE = internal(length=1)
TEMPERATURE = internal(degree=1)
TIME = internal(minute=1)
_KNOWN = {"dir_x": NUMBER, "dir_y": NUMBER, "dir_z": NUMBER, "sequence": NUMBER,
          "time_min": TIME} | dict.fromkeys(POSITIONS, PLACE)  # fmt: skip


def column_dimensions(name: str) -> Powers | None:
    """Those of a position or a column of the contract; None for a user's own column, whatever its
    name ends with: the parameter of an effect has its unit for each step of it.
    """
    return TEMPERATURE if is_temperature(name) else _KNOWN.get(name)


def own_columns(names: Iterable[str], taken: Collection[str]) -> dict[str, Powers]:
    """Of the names of an equation the known ones of columns; `taken` are other things."""
    found = {name: column_dimensions(name) for name in names if name not in taken}
    return {name: own for name, own in found.items() if own is not None}
