"""A candidate effect on a table of residuals, and its members with their columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.effects import Kind

FloatArray = NDArray[np.float64]
Column = dict[int, FloatArray]
"""Lever of one parameter by index of the axis, in the smallest shape that broadcasts to (P, H)."""
CENTRED = 1e-6
"""Share of a column's size below which its mean is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """One concrete set of columns: one covariate, one value of the searched parameter, ...

    `columns` hold one lever a parameter in mm (rad for angular components) per internal unit of
    the parameter. `parameters` are (name, unit). `equations` are final text, linear in the
    parameters; evaluated, they give the columns back. They are empty where the equation language
    cannot say the effect: `chosen` then is the feature, part or operation. `tangent` holds the
    derivatives of the columns with respect to log(searched), where that is continuous (of waves
    over many places the second ones behind the first). `alike`
    are other values of what was searched that make the same columns on this table. `centred` are
    the axes along which the equation has no mean over the cells of a table where some are missing,
    or of the one that these columns were cut from.
    """

    columns: tuple[Column, ...]
    parameters: tuple[tuple[str, str], ...]
    equations: dict[str, str]
    searched: dict[str, float]
    covariate: str | None
    tangent: tuple[Column, ...] = ()
    chosen: str | None = None
    alike: tuple[float, ...] = ()
    centred: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A candidate effect by name (``backlash-x``) with all its members.

    `unavailable` says why this data cannot test it; it has no members then. `notes` tell what
    was left out, and which columns are copies of others.
    """

    name: str
    family: str
    axis: str | None
    says: str
    separates: str | None
    members: tuple[Member, ...]
    kind: Kind
    unavailable: str | None = None
    notes: tuple[str, ...] = ()


def centred_axes(columns: Sequence[Column], there: NDArray[np.bool_]) -> frozenset[int]:
    """The axes along which no column (P or 1, H or 1) has a mean over the cells `there` (P, H)."""
    found: dict[int, bool] = {}
    if not there.any():
        return frozenset()
    for column in columns:
        for axis, values in column.items():
            kept = tuple(i for i in (0, 1) if values.shape[i] == 1)
            weights = there.sum(axis=kept, keepdims=True) / there.sum()
            mean, square = float(np.sum(weights * values)), float(np.sum(weights * values**2))
            found[axis] = found.get(axis, True) and abs(mean) <= CENTRED * math.sqrt(square)
    return frozenset(axis for axis, centred in found.items() if centred)
