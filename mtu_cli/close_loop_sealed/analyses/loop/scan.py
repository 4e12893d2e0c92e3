"""All candidates and checks on one table: the statistics that the gate judges."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.close_loop_sealed.stats.column_groups import MemberColumns, Packed, packed
from mtu_cli.close_loop_sealed.stats.direction_noise import DirectionNoise
from mtu_cli.close_loop_sealed.stats.family_gate import Gate, gate_of
from mtu_cli.close_loop_sealed.stats.loop_frame import Frame
from mtu_cli.close_loop_sealed.stats.loop_null import NullModel, draw
from mtu_cli.close_loop_sealed.stats.profile_ratio import Ratios, ratios, unit_information
from mtu_cli.close_loop_sealed.stats.remainder import Remainder
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.streams import stream

BATCH = 200
SCATTER_CHECKS = ("column-variance", "part-variance")


@dataclass(frozen=True, kw_only=True)
class Scan:
    """What is tested, in order: `columns` the members of the mean candidates, then the axes of
    `offsets`, then the drawn checks; `scatters` and the variance checks have p of their own.

    `names` are those of all candidates: mean, offset, scatter; `least` (S,) the variance of
    rounding; `turns` what is known to scatter parts does along `directions`, turn and growth.
    `parts_scatter`: the model has scatter of parts, how large is not known before. `readings`: the
    parts are passes of one run.
    """

    frame: Frame
    dof: FloatArray
    whitening: FloatArray
    names: tuple[str, ...]
    columns: tuple[tuple[MemberColumns, ...], ...]
    base: tuple[MemberColumns, ...]
    offsets: tuple[int, ...]
    scatters: tuple[str, ...]
    remainder: Remainder
    null: NullModel
    operation: np.ndarray
    directions: FloatArray
    predicted_dof: float
    least: FloatArray
    parts_scatter: bool = False
    readings: bool = False
    turns: tuple[DirectionNoise, ...] = ()

    @property
    def tested(self) -> int:
        """Candidates whose statistic is drawn."""
        return len(self.columns) + len(self.offsets)

    def flat(self) -> list[MemberColumns]:
        """The members of all mean candidates, end to end."""
        return [member for members in self.columns for member in members]

    def walk(self) -> Iterator[tuple[int, int, MemberColumns]]:
        """Each of them with its candidate's index and its own."""
        m = 0
        for index, members in enumerate(self.columns):
            for member in members:
                yield index, m, member
                m += 1

    def owners(self) -> list[int]:
        """The candidate's index of each of them."""
        return [index for index, _, _ in self.walk()]

    def pack(self, found: Sequence[MemberColumns] = ()) -> Packed:
        """The mean candidates beside what was found."""
        return packed(
            self.frame.strata,
            self.dof,
            self.whitening,
            self.columns,
            (*self.base, *found),
            self.least,
        )


def drawn_statistics(
    scan: Scan, pack: Packed, y: FloatArray, grand: FloatArray
) -> tuple[FloatArray, Ratios, FloatArray]:
    """Statistics (B, F + C), the ratios of the mean candidates, log Bayes of offsets (B, A')."""
    found = ratios(pack, y, len(scan.columns))
    offset, log_bayes = _offsets(scan, y, grand)
    checks = scan.remainder.statistics(y)
    return np.concatenate([found.ratio, offset, checks], axis=1), found, log_bayes


def _offsets(scan: Scan, y: FloatArray, grand: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Likelihood ratios (B, A') of a mean error, against the scatter of parts and columns."""
    strata = scan.frame.strata
    P, H, _ = strata.shape
    T, BF = np.zeros((len(y), len(scan.offsets))), np.zeros((len(y), len(scan.offsets)))
    for i, axis in enumerate(scan.offsets):
        squares, sign = [], []
        for kind, s in (("part", 1.0), ("column", 1.0), ("interaction", -1.0)):
            stratum = strata.find(kind, axis)  # type: ignore[arg-type]  # a Kind
            if stratum is None:
                continue
            n = max(float(scan.dof[strata.all.index(stratum)]), 1.0)
            squares.append((np.sum(y[:, stratum.slice] ** 2, axis=1) / n, n))
            sign.append(s)
        values = np.array([s * v for s, (v, _) in zip(sign, squares, strict=True)])
        largest = np.max(np.abs(values), axis=0)
        level = np.maximum(values.sum(axis=0), 0.5 * largest)
        spread = np.array([v**2 / n for v, n in squares]).sum(axis=0)
        common = scan.null.common[axis * (1 + strata.lines)]
        variance = level + common @ common
        # Without any scatter every part says the same.
        nu = np.where(level > 0, level**2 / np.maximum(spread, 1e-300), P - 1.0)
        nu = np.maximum(nu, 1.0)
        t2 = grand[:, axis] ** 2 * P * H / np.maximum(variance, 1e-300)
        T[:, i] = nu * np.log1p(t2 / nu)
        BF[:, i] = unit_information(T[:, i], nu, 1)
    return T, BF


def calibrated(scan: Scan, samples: int, seed: int, key: int = 0) -> Gate:
    """The gate of a scan: its statistics on drawn tables in which nothing is undeclared.

    `key` tells the draws of one gate of a call from those of another.
    """
    return _calibrated(scan, scan.pack(), samples, (seed, key))


def beside_found(gate: Gate, scan: Scan, pack: Packed) -> Gate:
    """The gate of what is left beside what was found, by the random numbers of the first one.

    Of a complete table the statistics have the same distribution whatever the variances of its
    strata. Filling in mixes them, and what was found may have been the most of one: drawn anew.
    """
    if scan.frame.completion.complete:
        return gate
    return _calibrated(scan, pack, len(gate.null), gate.stream)


def _calibrated(scan: Scan, pack: Packed, samples: int, numbers: tuple[int, int]) -> Gate:
    seed, key = numbers
    rng = stream(seed, 6, 2, key)
    empty = [s.slice for s, n in zip(scan.frame.strata.all, scan.dof, strict=True) if n <= 0]
    found = []
    for first in range(0, samples, BATCH):
        y, grand = draw(scan.frame, scan.null, min(BATCH, samples - first), rng)
        for place in empty:
            y[:, place] = 0.0
        found.append(drawn_statistics(scan, pack, pack.without_found(y), grand)[0])
    closed = len(scan.scatters) + len(SCATTER_CHECKS)
    return replace(gate_of(np.concatenate(found), rng, independent=closed), stream=numbers)


__all__ = ["Scan", "beside_found", "calibrated", "drawn_statistics"]
