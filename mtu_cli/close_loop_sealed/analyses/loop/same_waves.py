"""Waves of many pitches as the places of the features see them: what each leaves of the data, and
which are the same there.

On places that are whole multiples of a step s apart f, 1/s - f and f + k/s are the same
(sampling at even distances: Shannon, Proc. IRE 37 (1949) 10-21); on others none need be. It is
found from the columns at the places, without asking for a step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.model.effect_search import Waves
from mtu_cli.close_loop_sealed.stats.batched_squares import batched_squares_left
from mtu_cli.stats.least_squares import FloatArray

SAME = 1e-4
"""Share of a wave up to which another one leaves nothing of it: a hundredth of its amplitude."""
DEPENDENT = 1e-6
"""Share of the largest column below which nothing is left of one beside those before it."""
SAMPLED = 64
ENTRIES = 2_000_000
"""Numbers that the columns of the pitches looked at together may take."""
HINT = 0.05
"""Share of a wave that is left at the nearest of the frequencies, a 64th of a period off at the
ends, by another that is the same: a hundredth at most where places are even."""
POINTS, SHRINK, ZOOMS = 9, 0.3, 16
"""Frequencies to each side and between, and how the distance to the sides shrinks, so that what
is the same is known to 1e-8 of the resolution."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WaveFits:
    """Fits of `waves` of any frequency (1/mm) to z (n,): |z - A e|^2 is what errors e (D - 1,) of
    all places but the first, less its own, leave of the data. `first` (D,) are the features that
    stand for the places, `axis` that of the errors. Nothing is left of columns up to `least`.
    """

    waves: Waves
    axis: int
    first: NDArray[np.intp]
    A: FloatArray
    z: FloatArray
    least: float

    @classmethod
    def of(
        cls,
        *,
        waves: Waves,
        axis: int,
        first: NDArray[np.intp],
        A: FloatArray,
        z: FloatArray,
        ends: tuple[float, float],
    ) -> WaveFits:
        """`ends` are the lowest and the highest frequency."""
        bare = cls(waves=waves, axis=axis, first=first, A=A, z=z, least=0.0)
        columns = bare.columns(np.linspace(*ends, SAMPLED))
        size = float(np.sqrt(np.einsum("knm,knm->km", columns, columns)).max(initial=0.0))
        return cls(waves=waves, axis=axis, first=first, A=A, z=z, least=DEPENDENT * size)

    def columns(self, frequencies: FloatArray) -> FloatArray:
        """Columns (k, n, G) of G frequencies."""
        count = len(frequencies)
        found = []
        for column in self.waves.columns(1.0 / frequencies):
            lever = column[self.axis][:, 0, :]
            at = np.broadcast_to(lever, (count, lever.shape[1]))[:, self.first]
            found.append(self.A @ (at[:, 1:] - at[:, :1]).T)
        return np.stack(found)

    def left(self, frequencies: FloatArray) -> FloatArray:
        """What each of G frequencies leaves (G,) of the data."""
        return self._over(
            frequencies, lambda X: batched_squares_left(X, self.z[:, None], self.least)
        )

    def same_as(self, frequency: float, frequencies: FloatArray) -> list[float]:
        """Frequencies that are the same as this one at these places (all but `SAME` of it), between
        the ends of `frequencies` (G,), which are no farther apart than a 32nd of the inverse span.
        """
        own = self.columns(np.array([frequency]))
        whole = float(np.sum(own**2))
        if not whole > 0:
            return []

        def share(X: FloatArray) -> FloatArray:
            left = [batched_squares_left(X, y, self.least) for y in own]
            found: FloatArray = np.sum(left, axis=0) / whole
            return found

        at = self._nearest(frequencies, share)
        at = at[self._over(at, share) <= SAME]
        step = float(np.diff(frequencies).max(initial=0.0))
        same: list[float] = []
        for f in at.tolist():
            if all(abs(f - other) > step / 2 for other in (frequency, *same)):
                same.append(f)
        return same

    def _nearest(
        self, frequencies: FloatArray, share: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """The frequencies (M,) where the least is left, of those all around."""
        left = self._over(frequencies, share)
        around = np.concatenate([[np.inf], left, [np.inf]])
        least = (left <= around[:-2]) & (left <= around[2:]) & (left < HINT)
        at = frequencies[least]
        low, high = float(frequencies[0]), float(frequencies[-1])
        half = float(np.diff(frequencies).max(initial=0.0))
        for _ in range(ZOOMS):
            tried = np.clip(at + half * np.linspace(-1, 1, POINTS)[:, None], low, high)
            left = self._over(tried.ravel(), share).reshape(tried.shape)
            at = np.take_along_axis(tried, left.argmin(axis=0)[None], axis=0)[0]
            half *= SHRINK
        return at

    def _over(self, frequencies: FloatArray, of: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """`of` the columns of a few frequencies after the other."""
        few = max(1, ENTRIES // max(self.waves.along.size, 1) // 4)
        parts = [
            of(self.columns(frequencies[i : i + few])) for i in range(0, len(frequencies), few)
        ]
        return np.concatenate([np.zeros(0), *parts])
