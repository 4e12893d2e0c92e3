"""Tables of errors in the coordinates in which candidate effects are tested."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mtu_cli.stats.column_groups import NOTHING
from mtu_cli.stats.crossed import Completion, Freeing
from mtu_cli.stats.direction_noise import DirectionNoise, direction_noise
from mtu_cli.stats.expected_squares import ExpectedSquares, expected_squares
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mean_squares import LEAST, EntryNoise, MeanSquares
from mtu_cli.stats.strata import Strata, of_rows

MINOR = 2e-3
"""Share of a column below which it is not tested in a stratum, where filling or freeing smears
it.
"""


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

    def column(self, parts: Mapping[int, FloatArray]) -> dict[int, FloatArray]:
        """A column's coordinates by stratum, from its tables by axis, where it can be tested.

        Each is as large as it needs to be: (P, 1), (1, H), (P, H), or (1, 1), which is in no
        stratum.
        """
        found = self.whole_column(parts)
        if self.freeing is None and self.completion.complete:
            return found
        least = MINOR * sum(float(values @ values) for values in found.values())
        return {i: values for i, values in found.items() if float(values @ values) > least}

    def whole_column(self, parts: Mapping[int, FloatArray]) -> dict[int, FloatArray]:
        """As `column`, in all strata: what an effect is taken off by and estimated with.

        Left in a stratum, what is minor beside the rest of the column may be no small part of
        the errors there.
        """
        P, H, _ = self.strata.shape
        if self.freeing is not None or self._needs_filling(parts):
            return self._of_table(parts)
        found: dict[int, FloatArray] = {}
        for axis, values in parts.items():
            if values.shape == (P, H) and P > 1 and H > 1:
                found |= self._of_table({axis: values})
            elif values.shape[0] == P and P > 1:
                turned = of_rows(values)[1:, 0] * np.sqrt(H)
                found |= self._of_parts(turned, axis)
            elif values.shape[-1] == H and H > 1:
                found |= self.strata.of_columns(values[0], axis)
        return self._significant(found, parts)

    def means(self, parts: Mapping[int, FloatArray]) -> FloatArray:
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

    def _needs_filling(self, parts: Mapping[int, FloatArray]) -> bool:
        if self.completion.complete:
            return False
        if not self.completion.connected:
            return True
        return any(min(values.shape) > 1 for values in parts.values())

    def _of_parts(self, turned: FloatArray, axis: int) -> dict[int, FloatArray]:
        part = self.strata.find("part", axis)
        return {} if part is None else {self.strata.all.index(part): turned}

    def _of_table(self, parts: Mapping[int, FloatArray]) -> dict[int, FloatArray]:
        table = np.zeros(self.strata.shape)
        for axis, values in parts.items():
            table[:, :, axis] = values
        y, _ = self.coordinates(table)
        found = {index: y[stratum.slice] for index, stratum in enumerate(self.strata.all)}
        return self._significant(found, parts)

    def _significant(
        self, found: dict[int, FloatArray], parts: Mapping[int, FloatArray]
    ) -> dict[int, FloatArray]:
        """Without the strata in which a column is the rounding of a rotation alone."""
        P, H, _ = self.strata.shape
        total = sum(float(np.mean(values**2)) for values in parts.values()) * P * H
        squares = {index: float(values @ values) for index, values in found.items()}
        least = max(NOTHING * total, 1e-300)
        return {index: found[index] for index, size in squares.items() if size > least}
