"""Error strata of a crossed table: orthonormal coordinates, each with one variance; columns of
effects in these; cells that were not measured, or are excluded as outliers.

Parts are exchangeable and crossed with features: V = I_P x S + J_P x F for errors (P, H) along one
axis. With C an orthonormal basis over the parts whose first column is constant, and B one over the
features whose first columns are the level and the lines along which whole parts move, the
coordinates C' Y B are independent, and have one variance in each stratum (Nelder 1965).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.model.effect_library import Levers
from mtu_cli.stats.least_squares import BoolArray, FloatArray, IntArray

NONE = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class Strata:
    """Coordinates of tables (P, H, A), ordered by stratum.

    `of_parts` (P, P), `of_features` (A, H, H) are orthonormal. `place` (N,) are the flat indices of
    the coordinates in (A, P, H), and `at` (A, P, H) the coordinate of each; stratum s is the slice
    `slices[s]`, along the axis `axis[s]`; its kind `kinds[s]` is part, line, feature or
    interaction. `spread` (N,) are standard deviations relative to the stratum's; `bends` (H,) the
    variance of each part's bends, by direction of the features (mean 1).
    """

    of_parts: FloatArray
    of_features: FloatArray
    place: IntArray
    at: IntArray
    slices: tuple[slice, ...]
    kinds: tuple[str, ...]
    axis: tuple[int, ...]
    spread: FloatArray
    bends: FloatArray

    @property
    def shape(self) -> tuple[int, int, int]:
        """Parts, features, axes."""
        return len(self.of_parts), self.of_features.shape[1], len(self.of_features)

    @property
    def sizes(self) -> FloatArray:
        """Coordinates in each stratum (S,)."""
        return np.array([part.stop - part.start for part in self.slices], float)

    def labels(self) -> IntArray:
        """The stratum of each coordinate, (N,)."""
        return np.repeat(np.arange(len(self.slices)), self.sizes.astype(int))

    def of(self, kind: str) -> list[int]:
        """The strata of a kind, by axis."""
        return [s for s, label in enumerate(self.kinds) if label == kind]

    def coordinates(self, table: FloatArray) -> FloatArray:
        """Coordinates (..., N) of tables (..., P, H, A)."""
        cells = self.of_parts.T @ np.moveaxis(table, -1, -3) @ self.of_features
        return np.asarray(cells.reshape(*cells.shape[:-3], -1)[..., self.place] / self.spread)

    def of_levers(self, columns: Sequence[Levers], G: int) -> tuple[IntArray, FloatArray]:
        """The coordinates (n,) that columns can reach, given by axis in compact shapes (G or 1,
        P or 1, H or 1), and these (G, k, n).
        """
        values = [column for lever in columns for column in lever.values()]
        axes = sorted({a for lever in columns for a in lever})
        p, h = (max((column.shape[d] for column in values), default=1) for d in (1, 2))
        cells = self.at[axes, :p, :h]
        at = np.sort(cells[cells != NONE])
        P, H, _ = self.shape
        result = np.zeros((G, len(columns), len(at)))
        for k, lever in enumerate(columns):
            for a, column in lever.items():
                _, p, h = column.shape
                cells = self.at[a, :p, :h]
                valid = cells != NONE
                # What is alike in all parts, or features, has the first coordinate alone.
                basis = self.of_features[a]
                turned = np.tensordot(column, basis, 1) if h == H else column * np.sqrt(H)
                turned = self.of_parts.T @ turned if p == P else turned * np.sqrt(P)
                places = cells[valid]
                result[:, k, np.searchsorted(at, places)] = turned[:, valid] / self.spread[places]
        return at, result

    @property
    def cells(self) -> tuple[IntArray, ...]:
        """Axis, row and column (N,) of each coordinate."""
        return np.unravel_index(self.place, self.at.shape)

    def directions(self, s: int) -> tuple[IntArray, FloatArray]:
        """The coordinates (n,) of a stratum that are of the parts, or else alike in all of them,
        and the basis over the parts (P, n), or over the features (H, n), in which these are.
        """
        _, i, j = (index[self.slices[s]] for index in self.cells)
        if self.kinds[s] == "part":
            return np.arange(len(i)), self.of_parts[:, i]
        shared = np.flatnonzero(i == 0)
        basis = self.of_features[self.axis[s]][:, j[shared]]
        return shared, basis / self.spread[self.slices[s]][shared]

    def placed(self, coordinates: FloatArray) -> FloatArray:
        """Coordinates (..., N) by axis and column of the bases (..., A, P, H), 0 of no stratum."""
        full = np.zeros((*coordinates.shape[:-1], self.at.size))
        full[..., self.place] = coordinates * self.spread
        return full.reshape(*coordinates.shape[:-1], *self.at.shape)

    def table(self, coordinates: FloatArray) -> FloatArray:
        """Tables (..., P, H, A) of coordinates (..., N)."""
        cells = self.of_parts @ self.placed(coordinates) @ np.swapaxes(self.of_features, 1, 2)
        return np.moveaxis(cells, -3, -1)


def strata_of(
    P: int,
    lines: Sequence[FloatArray],
    *,
    features_scatter: bool,
    moving: int = 0,
    lines_known: bool = True,
    roughness: FloatArray | None = None,
) -> Strata:
    """The strata of P parts with H features.

    `lines` (H, k) by axis are orthonormal and orthogonal to the level, each with one variance over
    the parts; along the last, which are `moving`, so has their mean, which scatters more
    than the features; where not `lines_known`, they are in no stratum. `features_scatter`: the
    features' means have one; where not, they belong to the strata of the parts (V = I_P x S). The
    mean of all is in none: every effect has an offset beside it. `roughness` (H, H) is the
    covariance of each part's bends.
    """
    from scipy.linalg import helmert

    A, H = len(lines), len(lines[0])
    bases, bends = np.zeros((A, H, H)), np.zeros(H)
    label, kinds, axis = np.full((A, P, H), NONE), list[str](), list[int]()
    first = 1 if features_scatter else 0
    for a, directions in enumerate(lines):
        begin = np.column_stack([np.full(H, 1 / np.sqrt(H)), directions])
        k = begin.shape[1]
        basis, R = np.linalg.qr(begin, mode="complete")
        signs = np.concatenate([np.sign(np.diag(R)), np.ones(H - k)])
        bases[a] = basis * signs
        if roughness is not None and k < H:
            values, turn = np.linalg.eigh(bases[a, :, k:].T @ roughness @ bases[a, :, k:])
            bases[a, :, k:] = bases[a, :, k:] @ turn[:, ::-1]
            bends[k:] = np.maximum(values[::-1], 0.0) / values.mean()
        rest, rows = slice(1, None), [first] * (k - moving) + [0] * moving
        groups = [("part", (rest, slice(0, 1)))]
        groups += [("feature", (slice(0, 1), rest))] if features_scatter else []
        numbers = range(1, k) if lines_known else ()
        groups += [("line", (slice(rows[j], None), slice(j, j + 1))) for j in numbers]
        groups += [("interaction", (slice(first, None), slice(k, None)))]
        for kind, where in groups:
            if label[a][where].size:
                label[a][where] = len(kinds)
                kinds.append(kind)
                axis.append(a)
    flat = label.ravel()
    place = np.argsort(flat, kind="stable")[np.sum(flat == NONE) :]
    ends = np.searchsorted(flat[place], np.arange(len(kinds) + 1)).tolist()
    at = np.full(flat.shape, NONE)
    at[place] = np.arange(len(place))
    return Strata(
        of_parts=helmert(P, full=True).T,
        of_features=bases,
        place=place,
        at=at.reshape(label.shape),
        slices=tuple(map(slice, ends[:-1], ends[1:])),
        kinds=tuple(kinds),
        axis=tuple(axis),
        spread=np.ones(len(place)),
        bends=bends,
    )


PADDING = 0
"""Index of the column of zeros that fills models of unequal size up."""
Closures = tuple[IntArray, FloatArray]
"""The columns (M, w) of members and their margins, and their products (S, M, w, w) in each stratum:
those before some columns became PADDING.
"""
FREE = 1e-9
"""Prior precision of the size of a unit column that is free."""
DIGITS = 6
MARKS = 3
"""Projections by which a column is known."""
AT_ONCE = 1_000_000
"""Numbers of columns whose products are calculated at once."""


class Columns:
    """Unit columns, each stored in the strata where it is not zero; `means` (K, A) are those over
    the table, `precisions` (K,) of their sizes what is known beforehand. The first one is zero.

    A column that is there already, but for sign and size, is not added again.
    """

    def __init__(self, strata: Strata) -> None:
        self.strata = strata
        self.means, self.precisions = np.zeros((1, strata.shape[2])), np.ones(1)
        self._ends = np.array([0, *(part.stop for part in strata.slices)])
        self._values = [np.zeros((1, int(n))) for n in strata.sizes]
        self._rows = np.zeros((len(strata.slices), 1), int)
        """Where a column stands among the values of a stratum; the first row there is zero."""
        self._index: dict[bytes, int] = {}
        self._marks = np.random.default_rng(0).normal(size=(self._ends[-1], MARKS))

    @property
    def count(self) -> int:
        """How many columns there are, K."""
        return len(self.means)

    def add(self, at: IntArray, X: FloatArray, means: FloatArray) -> tuple[IntArray, FloatArray]:
        """Indices and factors (m,) of columns: x = factor * unit column; NONE and nan of zeros.

        `X` (m, n) at the coordinates `at` (n,), `means` (m, A) of the table.
        """
        norms = np.linalg.norm(X, axis=1)
        indices, factors = np.full(len(X), NONE), np.full(len(X), np.nan)
        nonzero = np.flatnonzero(norms)
        units = X[nonzero] / norms[nonzero, None]
        marks = units @ self._marks[at]
        signs = np.where(marks[:, 0] < 0, -1.0, 1.0)
        factors[nonzero] = norms[nonzero] * signs
        keys = np.round(marks * signs[:, None], DIGITS)
        new: list[int] = []
        for i, key in enumerate(keys):
            indices[nonzero[i]] = self._index.setdefault(key.tobytes(), self.count + len(new))
            if indices[nonzero[i]] == self.count + len(new):
                new.append(i)
        fresh = nonzero[new]
        units, precisions = units[new] * signs[new, None], np.full(len(fresh), FREE)
        self.add_alone(at, units, means[fresh] / factors[fresh, None], precisions)
        return indices, factors

    def add_alone(
        self, at: IntArray, units: FloatArray, means: FloatArray, precisions: FloatArray
    ) -> IntArray:
        """Indices (m,) of unit columns (m, n) at the coordinates `at` (n,), with means (m, A); no
        others share them, as each has its prior precision in `precisions` (m,).
        """
        rows, ends = np.zeros((len(self._values), len(units)), int), np.searchsorted(at, self._ends)
        for s in np.flatnonzero(np.diff(ends)):
            block = units[:, ends[s] : ends[s + 1]]
            nonzero = np.flatnonzero(block.any(axis=1))
            values = np.zeros((len(nonzero), self._values[s].shape[1]))
            values[:, at[ends[s] : ends[s + 1]] - self._ends[s]] = block[nonzero]
            rows[s, nonzero] = len(self._values[s]) + np.arange(len(nonzero))
            self._values[s] = np.concatenate([self._values[s], values])
        first = self.count
        self._rows = np.concatenate([self._rows, rows], axis=1)
        self.means = np.concatenate([self.means, means])
        self.precisions = np.concatenate([self.precisions, precisions])
        return np.arange(first, self.count)

    def cross(self, one: IntArray, other: IntArray) -> FloatArray:
        """Products (S, ...) in each stratum of pairs of columns with these indices."""
        one, other = np.broadcast_arrays(one, other)
        result = np.zeros((len(self._values), *one.shape))
        for values, rows, products in zip(self._values, self._rows, result, strict=True):
            cells = np.argwhere((rows[one] > 0) & (rows[other] > 0))
            for chunk in np.array_split(cells, 1 + len(cells) * values.shape[1] // AT_ONCE):
                at = tuple(chunk.T)
                pairs = values[rows[one[at]]], values[rows[other[at]]]
                products[at] = np.einsum("kn,kn->k", *pairs)
        return result

    def crossed(self, closures: Closures, shared: Sequence[int]) -> Closures:
        """The columns (M, w + k) of models: those (M, w) of each, and then those (k,) that all of
        them share; and their products.
        """
        added, inner = closures
        w, common = added.shape[1], np.array(shared, int)
        nonzero = added != PADDING
        shared_columns = self.dense(shared)
        across = self.products(added, shared_columns)
        G = np.empty((*inner.shape[:2], w + len(common), w + len(common)))
        G[:, :, :w, :w], G[:, :, :w, w:], G[:, :, w:, :w] = inner, across, np.swapaxes(across, 2, 3)
        G[:, :, :w, :w] *= nonzero[:, :, None] & nonzero[:, None]
        G[:, :, w:, w:] = self.products(common, shared_columns)[:, None]
        return np.hstack([added, np.tile(common, (len(added), 1))]), G

    def products(self, columns: IntArray, Y: FloatArray) -> FloatArray:
        """Products (S, ..., m) in each stratum of columns (...) with coordinates Y (m, N), in Y's
        precision.
        """
        result = np.zeros((len(self._values), *columns.shape, len(Y)))
        for s, part in enumerate(self.strata.slices):
            values, rows, Z = self._values[s], self._rows[s, columns], Y[:, part].T
            nonzero = (rows > 0) & Z.any()
            if 2 * nonzero.sum() > len(values):  # Of most of them: without a copy.
                result[s] = (values.astype(Z.dtype, copy=False) @ Z)[rows]
            else:
                result[s, nonzero] = values[rows[nonzero]].astype(Z.dtype) @ Z
        return result

    def dense(self, indices: Sequence[int]) -> FloatArray:
        """Columns as coordinates (k, N)."""
        pairs = zip(self._values, self._rows[:, list(indices)], strict=True)
        return np.concatenate([values[at] for values, at in pairs], axis=1)


class Missing:
    """Cells without a value, by where there are values (P, H): those of a table are filled in so
    that the interaction there is 0 (Yates 1933), which is as if they were left out where parts and
    features are free. `lines` (H, k), orthonormal, are what each part is free in.
    """

    def __init__(self, measured: BoolArray, lines: FloatArray) -> None:
        self.measured, self.lines = measured, lines
        self.cells = p, h = np.nonzero(~measured)
        within = (np.eye(len(lines)) - lines @ lines.T)[h[:, None], h[None]]
        self.M = ((p[:, None] == p[None]) - 1 / len(measured)) * within
        self.inverse = np.linalg.pinv(self.M, rcond=1e-9, hermitian=True) if len(p) else self.M

    def filled(self, table: FloatArray) -> FloatArray:
        """Tables (..., P, H) with their missing cells filled in, whatever stood there; those that
        are alike in all parts, or features, as they are.
        """
        if self.measured.all() or table.shape[-2:] != self.measured.shape:
            return table
        p, h = self.cells
        Y = np.where(self.measured, table, 0.0)
        E = self.interaction(Y)[..., p, h]
        result = Y.copy()
        result[..., p, h] = -E @ self.inverse
        return result

    def deviation(self, table: FloatArray) -> FloatArray:
        """A table (P, H) less what its measured cells predict; of a missing one in proportion to
        its standard deviation, as large as the residual would be if only that were missing, and 0
        where nothing predicts it.
        """
        filled = self.filled(table)
        result, size = self.interaction(filled), np.diag(self.M)
        known = np.abs(np.einsum("ij,ji->i", self.M, self.inverse) - 1) < 1e-6
        factor = np.sqrt(size / np.where(known, np.diag(self.inverse), np.inf))
        result[self.cells] = factor * (table - filled)[self.cells]
        return result

    def interaction(self, table: FloatArray) -> FloatArray:
        """Tables (..., P, H) less the means of the features and what each part has of the lines."""
        rest = table - table.mean(axis=-2, keepdims=True)
        return np.asarray(rest - (rest @ self.lines) @ self.lines.T)
