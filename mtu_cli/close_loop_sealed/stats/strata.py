"""Error strata of parts x columns x axes: an orthonormal change of coordinates.

In a table whose errors are the sum of a random effect of the part, of a few smooth directions
of the part (its scale, its rotation), of the column, and of a residual, the coordinates of a
stratum are uncorrelated with one variance: the analysis of variance as a rotation (Nelder,
Proc. R. Soc. A 283 (1965) 147). Each stratum's mean square estimates its own variance, which
no model of the machine needs to know.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct

from mtu_cli.stats.least_squares import FloatArray

Kind = Literal["part", "line", "interaction", "column", "reversal"]
DEPENDENT = 1e-6
"""A direction with less than this share of itself left beside the others is none of its own."""


@dataclass(frozen=True, slots=True)
class Stratum:
    """`line` is the direction's number (from 1) in a stratum of kind line, else 0; `start` and
    `size` its place among the coordinates; `lead` the directions whose means over the parts
    stand first in a stratum of columns.
    """

    kind: Kind
    axis: int
    line: int
    start: int
    size: int
    lead: tuple[int, ...] = ()

    @property
    def slice(self) -> slice:
        """Its coordinates."""
        return slice(self.start, self.start + self.size)


@dataclass(frozen=True, kw_only=True)
class Strata:
    """The change of coordinates of tables (..., P, H, A).

    Rows are turned by `of_rows`; `columns` (H, H) is orthonormal, its first vector constant, the
    next `lines` of it the directions along which whole parts differ. `even` and `odd` number
    the vectors of `columns` in the strata of kind column and reversal: what both directions of
    approach have in common, and how they differ. `order` sorts the coordinates of (A, P, H) by
    stratum; the A grand means are in no stratum.
    """

    shape: tuple[int, int, int]
    columns: FloatArray
    lines: int
    even: NDArray[np.int64]
    odd: NDArray[np.int64]
    order: NDArray[np.int64]
    all: tuple[Stratum, ...]

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.order)

    def rotated(self, tables: FloatArray) -> FloatArray:
        """(..., A, P, H): rows and columns in the bases of the strata."""
        return of_rows(np.moveaxis(tables, -1, -3) @ self.columns)

    def coordinates(self, tables: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates (..., size) by stratum, and the grand means (..., A)."""
        P, H, A = self.shape
        turned = self.rotated(tables)
        flat = turned.reshape(*turned.shape[:-3], A * P * H)
        return flat[..., self.order], turned[..., 0, 0] / np.sqrt(P * H)

    def tables(self, coordinates: FloatArray) -> FloatArray:
        """The tables (..., P, H, A) with these coordinates and grand means of 0."""
        P, H, A = self.shape
        flat = np.zeros((*coordinates.shape[:-1], A * P * H))
        flat[..., self.order] = coordinates
        turned = flat.reshape(*coordinates.shape[:-1], A, P, H)
        return np.moveaxis(to_rows(turned) @ self.columns.T, -3, -1)

    def of_columns(self, values: FloatArray, axis: int) -> dict[int, FloatArray]:
        """Coordinates of a function (H,) of the columns along an axis, by stratum."""
        turned = self.columns.T @ values * np.sqrt(self.shape[0])
        return {
            index: turned[self.even if stratum.kind == "column" else self.odd]
            for index, stratum in enumerate(self.all)
            if stratum.axis == axis and stratum.kind in ("column", "reversal")
        }

    @property
    def smooth(self) -> FloatArray:
        """The directions (H, k), orthonormal, in which whole parts differ beside their mean."""
        return self.columns[:, 1 : 1 + self.lines]

    def find(self, kind: Kind, axis: int, line: int = 0) -> Stratum | None:
        """The stratum of a kind, axis and line; None where it is empty."""
        for stratum in self.all:
            if (stratum.kind, stratum.axis, stratum.line) == (kind, axis, line):
                return stratum
        return None


def strata_of(
    parts: int, directions: FloatArray, axes: int, reversal: FloatArray | None = None
) -> Strata:
    """Strata of `parts` x H x `axes` with smooth `directions` (H, k) of the columns.

    Directions that are constant, or that depend on those before them, are left out; so many
    are kept that two coordinates at least stay for what is not smooth. `reversal` (H, q) are
    orthonormal columns that tell the two directions of approach of q pairs apart: what they
    span has a stratum of its own, for an error curve is common to both directions.
    """
    basis = _column_basis(directions, reversal)
    H, lines = len(directions), len(basis.smooth) + basis.turned
    label = np.arange(axes * parts * H).reshape(axes, parts, H)
    rest = np.arange(1 + lines, H)
    odd_rest = rest[len(rest) - (basis.odd - basis.turned) :]
    smooth = np.arange(1, 1 + len(basis.smooth))
    turned = np.arange(1 + len(basis.smooth), 1 + lines)
    even = np.concatenate([smooth, rest[: len(rest) - len(odd_rest)]])
    odd = np.concatenate([turned, odd_rest])
    builder = _Builder()
    for axis in range(axes):
        own = label[axis]
        builder.add("part", axis, 0, own[1:, 0])
        for line in range(1, lines + 1):
            builder.add("line", axis, line, own[1:, line])
        builder.add("interaction", axis, 0, own[1:, lines + 1 :])
        builder.add("column", axis, 0, own[0, even], tuple(smooth.tolist()))
        builder.add("reversal", axis, 0, own[0, odd], tuple(turned.tolist()))
    order = np.concatenate(builder.order) if builder.order else np.zeros(0, np.int64)
    return Strata(
        shape=(parts, H, axes),
        columns=basis.vectors,
        lines=lines,
        even=even,
        odd=odd,
        order=order,
        all=tuple(builder.found),
    )


class _Builder:
    """Strata one after the other; empty ones are left out."""

    def __init__(self) -> None:
        self.found: list[Stratum] = []
        self.order: list[NDArray[np.int64]] = []

    def add(
        self,
        kind: Kind,
        axis: int,
        line: int,
        where: NDArray[np.int64],
        lead: tuple[int, ...] = (),
    ) -> None:
        if where.size:
            start = sum(len(item) for item in self.order)
            self.found.append(Stratum(kind, axis, line, start, where.size, lead))
            self.order.append(where.ravel())


def of_rows(tables: FloatArray) -> FloatArray:
    """Tables (..., P, H) with their columns in an orthonormal basis whose first vector is
    constant: cosines (DCT-II).
    """
    found: FloatArray = dct(tables, type=2, norm="ortho", axis=-2)
    return found


def to_rows(turned: FloatArray) -> FloatArray:
    """The tables (..., P, H) that `of_rows` turns into these."""
    found: FloatArray = idct(turned, type=2, norm="ortho", axis=-2)
    return found


@dataclass(frozen=True, slots=True)
class _Basis:
    """`vectors` (H, H): the constant, the `smooth` directions, the `turned` smooth ones of the
    reversals (their mean, and how they grow along the smooth directions), the rest of what is
    common to both directions of approach, the rest of what is not; `odd` counts the reversals.
    """

    vectors: FloatArray
    smooth: tuple[FloatArray, ...]
    turned: int
    odd: int


def _column_basis(directions: FloatArray, reversal: FloatArray | None) -> _Basis:
    H = len(directions)
    odd = np.zeros((H, 0)) if reversal is None else reversal
    chosen = [np.full(H, 1 / np.sqrt(H))]
    for column in directions.T:
        size = np.linalg.norm(column)
        left = column - odd @ (odd.T @ column)
        for _ in range(2):  # twice: the second pass removes the rounding of the first
            for vector in chosen:
                left = left - vector * (vector @ left)
        enough = len(chosen) + odd.shape[1] < H - 2
        if size > 0 and np.linalg.norm(left) > DEPENDENT * size and enough:
            chosen.append(left / np.linalg.norm(left))
    turned = _turned(odd, directions)
    k = turned.shape[1]
    whole = np.concatenate([turned, odd @ _complement(odd.T @ turned)], axis=1) if k else odd
    rest = _complement(np.column_stack([*chosen, whole]))
    order = [np.column_stack(chosen), turned, rest, whole[:, k:]]
    return _Basis(np.concatenate(order, axis=1), tuple(chosen[1:]), k, odd.shape[1])


def _turned(odd: FloatArray, directions: FloatArray) -> FloatArray:
    """Orthonormal (H, k): the mean of the reversals, and their growth along the directions."""
    found: list[FloatArray] = []
    for weight in (np.ones(len(odd)), *directions.T):
        column = odd @ (np.abs(odd).T @ weight)
        size = np.linalg.norm(column)
        for vector in found:
            column = column - vector * (vector @ column)
        if size > 0 and np.linalg.norm(column) > DEPENDENT * size and len(found) + 2 < odd.shape[1]:
            found.append(column / np.linalg.norm(column))
    return np.column_stack(found) if found else odd[:, :0]


def _complement(first: FloatArray) -> FloatArray:
    """Orthonormal columns of what `first` (H, m), orthonormal, does not span."""
    full = np.linalg.qr(first, mode="complete")[0]
    found: FloatArray = full[:, first.shape[1] :]
    return found
