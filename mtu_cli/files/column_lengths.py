"""Columns that are not to be renamed as they stand: in another unit of length, or of deviations."""

from __future__ import annotations

import re
from collections.abc import Iterable

from mtu_cli.files.column_words import AXES, UNIT, WORDS, meant_by, plain
from mtu_cli.files.unit_text import LENGTHS_ALSO

_TO_MM = {
    "um": "divided by 1000",
    "nm": "divided by 1000000",
    "m": "multiplied by 1000",
    "dm": "multiplied by 100",
    "cm": "multiplied by 10",
    "in": "multiplied by 25.4",
    "ft": "multiplied by 304.8",
    "mil": "multiplied by 0.0254",
}
_ALSO = LENGTHS_ALSO | {"\u03bcm": "um"}
_UNITS = "|".join(sorted((*_TO_MM, *_ALSO), key=len, reverse=True))
_IN_UNIT = re.compile(rf"(.*?[^\W_])(?:[ _.]+in)?(?:[ _./-]+|[ _]*[\[(] *)({_UNITS}) *[\])]?")
_DEVIATION = {*WORDS["error"], "d", "e", "delta", "diff", "difference", "residual", "offset"}


def _parted(other: str) -> tuple[str, str] | None:
    """Name and unit of a column whose name ends with a unit of length other than mm."""
    found = _IN_UNIT.fullmatch(plain(other).strip())
    return None if found is None else (found[1], _ALSO.get(found[2], found[2]))


def renaming(other: str, name: str) -> str:
    """What is expected of the column `other` to be the column `name`: a value in another unit is
    converted.
    """
    parted = _parted(other) if name.endswith(f"_{UNIT}") else None
    converted = "" if parted is None else f"{_TO_MM[parted[1]]} and "
    return f"{other!r} {converted}renamed to {name!r}"


def in_other_unit(other: str, names: Iterable[str]) -> str | None:
    """The one of some names, such as `x_mm`, that a column is in another unit."""
    parted = _parted(other)
    if parted is None:
        return None
    bare = re.sub("[ -]", "_", parted[0])
    words = meant_by(parted[0])
    return next((name for name in names if name in (f"{bare}_{UNIT}", words)), None)


def deviation_along(other: str) -> str | None:
    """The axis along which a column looks like a deviation: x for `dev_x`, `dx` or `error x`."""
    words = [word for word in re.findall("[a-z]+", plain(other)) if word not in (UNIT, *_TO_MM)]
    axes = [word for word in words if word in AXES]
    if len(axes) == 1:
        return axes[0] if any(word in _DEVIATION for word in words) else None
    for word in words if len(words) == 1 else ():
        for own, rest in ((word[-1], word[:-1]), (word[0], word[1:])):
            if own in AXES and rest in _DEVIATION:
                return str(own)
    return None
