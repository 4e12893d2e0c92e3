"""Tables of errors in the coordinates in which candidate effects are tested."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import numpy as np

from mtu_cli.close_loop_sealed.stats.column_groups import NOTHING
from mtu_cli.close_loop_sealed.stats.crossed import Completion, Freeing
from mtu_cli.close_loop_sealed.stats.direction_noise import DirectionNoise, direction_noise
from mtu_cli.close_loop_sealed.stats.expected_squares import ExpectedSquares, expected_squares
from mtu_cli.close_loop_sealed.stats.mean_squares import LEAST, EntryNoise, MeanSquares
from mtu_cli.close_loop_sealed.stats.strata import Strata, of_rows
from mtu_cli.stats.least_squares import FloatArray

MINOR = 2e-3
"""Share of a column below which it is not tested in a stratum, where filling or freeing smears
it.
"""
CACHED = 1 << 17
"""Entries of the tables that are turned at once."""
Parts = Mapping[int, FloatArray]
"""The tables of a column, by the number of their axis."""
Coordinates = dict[int, FloatArray]
"""The coordinates of a column, by the number of the stratum that they lie in."""


def grouped(
    turned: Callable[[Sequence[Parts]], list[Coordinates]], members: Sequence[Sequence[Parts]]
) -> list[tuple[Coordinates, ...]]:
    """The columns of each member turned, all of them together."""
    found = iter(turned([column for member in members for column in member]))
    return [tuple(islice(found, len(member))) for member in members]


@dataclass(frozen=True, kw_only=True)
class Frame:
    """From tables (..., P, H, A) to coordinates by stratum: completed, freed, rotated."""

    strata: Strata
    completion: Completion
    freeing: Freeing | None

    def coordinates(self, tables: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates (..., N) by stratum and grand means (..., A) of freed and filled tables."""
        freed = tables if self.freeing is None else self.freeing(tables)
        return self.strata.coordinates(self.completion.fill(freed))

    @cached_property
    def squares(self) -> ExpectedSquares:
        """The mean squares that components of variance give in tables of this frame."""
        return expected_squares(self.strata, self.completion, self.freeing)

    def noise(
        self,
        y: FloatArray,
        dof: FloatArray,
        nominal: FloatArray,
        predicted: FloatArray,
        predicted_dof: float = np.inf,
    ) -> EntryNoise:
        """The noise of entries by the interaction of coordinates `y` (N,) with `dof` (S,) degrees
        of freedom, of `nominal` (S,) that the table has; variances and `dof` 0 where it has none.

        `predicted` (d, d) is the covariance of a part's coordinates by the machine, known with
        `predicted_dof`: of parts that were filled in by less than their lines, some of it is in
        the interaction. What is left when it is taken off is as uncertain as both were, the leak
        by one degree of freedom a part that leaks: it has fewer of them (Satterthwaite).
        """
        P, _, A = self.strata.shape
        d = A * (1 + self.strata.lines)
        square, n, whole = np.zeros(A), np.zeros(A), np.ones(A)
        for s, stratum in enumerate(self.strata.all):
            if stratum.kind == "interaction" and min(dof[s], nominal[s]) > 0:
                n[stratum.axis], whole[stratum.axis] = dof[s], nominal[s]
                square[stratum.axis] = np.sum(y[stratum.slice] ** 2) / dof[s]
        if self.freeing is None and self.completion.complete:
            part = np.diag(np.repeat(square, d // A)) if P > 1 else np.full((d, d), np.nan)
            squares = MeanSquares(interaction=square, rest=square, turned=square, part=part)
            return EntryNoise(variance=square, dof=n, squares=squares)
        from scipy.optimize import nnls

        leaks = np.nan_to_num(self._noise_of(np.zeros(A), predicted, nominal).interaction)
        left = np.maximum(square - leaks, LEAST * square)
        # Divided by the largest: nnls takes little for nothing.
        largest = max(float(square.max(initial=0.0)), 1e-300)
        # Freeing mixes the axes: a mean square may hold noise of another one.
        variance = nnls((self.squares.interaction[:A] / whole).T, left / largest)[0] * largest
        squares = self._noise_of(variance, np.zeros((d, d)), nominal)
        doubt = square**2 + leaks**2 * (n / predicted_dof + np.maximum(n / self._leaking - 1, 0))
        n = n * np.divide(left**2, doubt, out=np.ones(A), where=doubt > 0)
        return EntryNoise(variance=variance, dof=n, squares=squares)

    @property
    def _leaking(self) -> int:
        """Parts of whose scatter some is in the interaction, 1 at least."""
        incomplete = int((~self.completion.observed).any(axis=1).sum())
        return max(incomplete if self.freeing is None else len(self.completion.observed), 1)

    def _noise_of(self, interaction: FloatArray, part: FloatArray, dof: FloatArray) -> MeanSquares:
        none, nothing = np.zeros_like(interaction), np.zeros_like(part)
        return self.squares.of(
            interaction=interaction, column=none, reversal=none, part=part, common=nothing, dof=dof
        )

    def direction_noise(
        self, directions: FloatArray, predicted: FloatArray
    ) -> tuple[DirectionNoise, ...]:
        """How far parts go along `directions` (D, A, 1 + k) by the noise of entries and by the
        machine's own scatter of parts, `predicted` (d, d).
        """
        return direction_noise(self.strata, self.completion, self.freeing, directions, predicted)

    def column(self, parts: Parts) -> Coordinates:
        """The coordinates of one column, see `columns`."""
        (found,) = self.columns([parts])
        return found

    def columns(self, columns: Sequence[Parts]) -> list[Coordinates]:
        """Columns' coordinates by stratum, from their tables by axis, where they can be tested.

        Each table is as large as it needs to be: (P, 1), (1, H), (P, H), or (1, 1), which is in no
        stratum.
        """
        whole = self.whole_columns(columns)
        if self.freeing is None and self.completion.complete:
            return whole
        found = []
        for column in whole:
            squares = {i: float(values @ values) for i, values in column.items()}
            least = MINOR * sum(squares.values())
            found.append({i: values for i, values in column.items() if squares[i] > least})
        return found

    def whole_columns(self, columns: Sequence[Parts]) -> list[Coordinates]:
        """As `columns`, in all strata: what an effect is taken off by and estimated with.

        Left in a stratum, what is minor beside the rest of the column may be no small part of
        the errors there.
        """
        found, tables = [], []
        for parts in columns:
            own, rest = self._direct(parts)
            found.append(own)
            tables.append(rest)
        places = [i for i, rest in enumerate(tables) if rest]
        for i, own in zip(places, self._of_tables([tables[i] for i in places]), strict=True):
            found[i] |= own
        return [self._significant(own, parts) for own, parts in zip(found, columns, strict=True)]

    def _direct(self, parts: Parts) -> tuple[Coordinates, Parts]:
        """What of a column is known without its table, and the rest."""
        P, H, _ = self.strata.shape
        if self.freeing is not None or self._needs_filling(parts):
            return {}, parts
        found: Coordinates = {}
        rest: Coordinates = {}
        for axis, values in parts.items():
            if values.shape == (P, H) and P > 1 and H > 1:
                rest[axis] = values
            elif values.shape[0] == P and P > 1:
                turned = of_rows(values)[1:, 0] * np.sqrt(H)
                found |= self._of_parts(turned, axis)
            elif values.shape[-1] == H and H > 1:
                found |= self.strata.of_columns(values[0], axis)
        return found, rest

    def means(self, parts: Parts) -> FloatArray:
        """Means (A,) of a column over all cells, completed as the errors are."""
        P, H, A = self.strata.shape
        found = np.zeros(A)
        for axis, values in parts.items():
            found[axis] = values.mean()
        if self._needs_filling(parts):
            table = np.zeros((P, H, A))
            for axis, values in parts.items():
                table[:, :, axis] = values
            found = self.completion.fill(table).mean(axis=(0, 1))
        return found

    def _needs_filling(self, parts: Parts) -> bool:
        if self.completion.complete:
            return False
        if not self.completion.connected:
            return True
        return any(min(values.shape) > 1 for values in parts.values())

    def _of_parts(self, turned: FloatArray, axis: int) -> Coordinates:
        part = self.strata.find("part", axis)
        return {} if part is None else {self.strata.all.index(part): turned}

    def _of_tables(self, columns: Sequence[Parts]) -> Iterator[Coordinates]:
        """Many at a time: each by itself would take most of its time to begin."""
        several = max(1, CACHED // max(int(np.prod(self.strata.shape)), 1))
        for first in range(0, len(columns), several):
            own = columns[first : first + several]
            tables = np.zeros((len(own), *self.strata.shape))
            for table, parts in zip(tables, own, strict=True):
                for axis, values in parts.items():
                    table[:, :, axis] = values
            y, _ = self.coordinates(tables)
            for row in y:
                yield {i: row[stratum.slice] for i, stratum in enumerate(self.strata.all)}

    def _significant(self, found: Coordinates, parts: Parts) -> Coordinates:
        """Without the strata in which a column is the rounding of a rotation alone."""
        P, H, _ = self.strata.shape
        # As `mean`, which takes longer to begin than to sum; of thousands of columns that counts.
        total = sum(float((v**2).sum()) / v.size for v in parts.values()) * P * H
        squares = {index: float(values @ values) for index, values in found.items()}
        least = max(NOTHING * total, 1e-300)
        return {index: found[index] for index, size in squares.items() if size > least}
