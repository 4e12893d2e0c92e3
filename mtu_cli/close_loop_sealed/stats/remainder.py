"""What no named effect describes: omnibus statistics of what is left of a table.

Each is large where the rest is not what the null says: a pattern that parts and columns share,
parts that follow each other too smoothly, columns whose neighbours agree or that lie on a plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mtu_cli.close_loop_sealed.stats.kernel_ratio import (
    Kernel,
    kernel_log_bayes,
    kernel_of,
    kernel_ratios,
)
from mtu_cli.close_loop_sealed.stats.strata import Strata, of_rows, to_rows
from mtu_cli.stats.least_squares import FloatArray

CLIPPED = 2.5
"""Standard deviations beyond which an entry pulls no further: heavy tails are no pattern."""
CACHED = 200_000
"""Entries of the tables that are turned back at once."""
REACH = (0.12, 0.3)
"""Correlation lengths of smooth fields over the extent of the columns' places."""
COMMON_SHAPE = "common-shape"
DRAWN = (
    "interaction-pattern",
    "serial-correlation",
    "serial-shape",
    "spatial-correlation",
    COMMON_SHAPE,
)
"""The checks that are calibrated by drawing."""


@dataclass(frozen=True, kw_only=True)
class Remainder:
    """The kernels of smooth effects: `serial` over parts (None with fewer than five), `spatial`
    by axis and reach, from the covariances `fields` of a column stratum's coordinates by reach
    under the `whitening` (A, k, k) of the smooth directions.
    """

    strata: Strata
    serial: Kernel | None
    fields: tuple[FloatArray, ...]
    whitening: FloatArray

    @cached_property
    def spatial(self) -> tuple[tuple[Kernel, ...], ...]:
        """Made where it is asked for: most nulls are looked at without."""
        if not self.fields:
            return ()
        axes = range(len(self.whitening))
        return tuple(_whitened(self.strata, self.fields, self.whitening, a) for a in axes)

    def whitened(self, whitening: FloatArray) -> Remainder:
        """The same for other `whitening` (A, k, k) of the smooth directions."""
        return replace(self, whitening=whitening)

    def statistics(self, y: FloatArray) -> FloatArray:
        """The checks `DRAWN` (B, 5) of coordinates `y` (B, N); 0 where one cannot be had."""
        return np.stack(
            [
                self._pattern(y),
                self._serial(y, ("part",)),
                self._serial(y, ("line",)),
                self._spatial(y),
                self._common_shape(y),
            ],
            axis=1,
        )

    def _pattern(self, y: FloatArray) -> FloatArray:
        """Largest squared singular value over the mean: one pattern of columns that parts have
        in different strength, as bending by heat would give.
        """
        P, H, A = self.strata.shape
        if P < 4 or H < 4 or not len(y):
            return np.zeros(len(y))
        # A few tables at a time stay in the processor's cache: half the time of all at once.
        several = max(1, CACHED // (P * H * A))
        return np.concatenate(
            [self._pattern_of(y[first : first + several]) for first in range(0, len(y), several)]
        )

    def _pattern_of(self, y: FloatArray) -> FloatArray:
        strata = self.strata
        P, H, A = strata.shape
        turned = np.zeros((len(y), A * P * H))
        for stratum in strata.all:
            if stratum.kind == "interaction":
                own = y[:, stratum.slice]
                sd = np.sqrt(np.mean(own**2, axis=1, keepdims=True))
                turned[:, strata.order[stratum.slice]] = own / np.maximum(sd, 1e-300)
        tables = to_rows(turned.reshape(len(y), A, P, H)) @ strata.columns.T
        sizes = np.abs(tables).reshape(len(y), A, P * H)
        spread = 1.4826 * np.median(sizes, axis=2, overwrite_input=True)
        limit = CLIPPED * np.maximum(spread, 1e-12)[:, :, None, None]
        np.clip(tables, -limit, limit, out=tables)
        flat = np.moveaxis(tables, 1, 2).reshape(len(y), P, A * H)
        flat -= flat.mean(axis=1, keepdims=True)
        small = flat if P <= A * H else np.swapaxes(flat, 1, 2)
        gram = small @ np.swapaxes(small, 1, 2)
        values = np.linalg.eigvalsh(gram)
        found: FloatArray = values[:, -1] / np.maximum(values.mean(axis=1), 1e-300)
        return found

    def _serial(self, y: FloatArray, kinds: Sequence[str]) -> FloatArray:
        total = np.zeros(len(y))
        if self.serial is None:
            return total
        for stratum in self.strata.all:
            if stratum.kind in kinds:
                total += _largest(kernel_ratios(self.serial, y[:, stratum.slice]))
        return total

    def _spatial(self, y: FloatArray) -> FloatArray:
        totals = np.zeros((max(len(REACH), 1), len(y)))
        for stratum in self.strata.all:
            if stratum.kind == "column" and self.spatial:
                for i, kernel in enumerate(self.spatial[stratum.axis]):
                    totals[i] += _largest(kernel_ratios(kernel, y[:, stratum.slice]))
        found: FloatArray = totals.max(axis=0)
        return found

    def _common_shape(self, y: FloatArray) -> FloatArray:
        """Largest likelihood ratio n log(1 + a / b) of all smooth directions together in the n
        means of an axis over the parts, a the squares along them and b those beside. One effect
        alone, of several in different directions, has the others for scatter.
        """
        found = np.zeros(len(y))
        for stratum in self.strata.all:
            k = len(stratum.lead)
            if stratum.kind == "column" and k > 1 and stratum.size > k:
                squares = y[:, stratum.slice] ** 2
                along, beside = squares[:, :k].sum(axis=1), squares[:, k:].sum(axis=1)
                # Where nothing scatters, rounding does.
                ratio = along / np.maximum(beside, 1e-24 * along + 1e-300)
                found = np.maximum(found, stratum.size * np.log1p(ratio))
        return found

    def unnamed(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """log Bayes factors (A,) of a drift over the parts and of a field over the columns
        that have no name, of coordinates `y` (N,).
        """
        A = self.strata.shape[2]
        drift, field = np.full(A, -np.inf), np.full(A, -np.inf)
        for stratum in self.strata.all:
            own = y[None, stratum.slice]
            if stratum.kind == "part" and self.serial is not None:
                drift[stratum.axis] = kernel_log_bayes(kernel_ratios(self.serial, own))[0]
            elif stratum.kind == "column" and self.spatial:
                ratios = [kernel_ratios(item, own) for item in self.spatial[stratum.axis]]
                if ratios:
                    field[stratum.axis] = kernel_log_bayes(np.concatenate(ratios))[0]
        return drift, field


def _largest(ratios: FloatArray) -> FloatArray:
    found: FloatArray = np.maximum(ratios.max(axis=0), 0.0)
    return found


def remainder_of(strata: Strata, whitening: FloatArray, places: FloatArray) -> Remainder:
    """The kernels for columns at `places` (H, d), mm."""
    P, H, _ = strata.shape
    serial = None
    if P >= 5:
        steps = np.arange(P)
        walk = np.minimum.outer(steps + 1, steps + 1).astype(float)
        serial = kernel_of(of_rows(of_rows(walk).T)[1:, 1:])
    fields: list[FloatArray] = []
    extent = np.ptp(places, axis=0).max(initial=0.0) if len(places) else 0.0
    if H >= 6 and extent > 0:
        distance2 = ((places[:, None] - places) ** 2).sum(axis=2)
        B = strata.columns[:, strata.even]
        fields = [B.T @ np.exp(-0.5 * distance2 / (reach * extent) ** 2) @ B for reach in REACH]
    return Remainder(strata=strata, serial=serial, fields=tuple(fields), whitening=whitening)


def _whitened(
    strata: Strata, fields: Sequence[FloatArray], whitening: FloatArray, axis: int
) -> tuple[Kernel, ...]:
    """The kernels of an axis; their leading coordinates are those of the smooth directions."""
    own = []
    for field in fields:
        k = len(strata.find("column", axis).lead)  # type: ignore[union-attr]  # H >= 6
        W, K = whitening[axis][:k, :k], field.copy()
        K[:k] = W @ K[:k]
        K[:, :k] = K[:, :k] @ W.T
        kernel = kernel_of(K)
        if kernel is not None:
            own.append(kernel)
    return tuple(own)
