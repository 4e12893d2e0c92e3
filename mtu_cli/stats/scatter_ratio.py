"""Do two sets of columns of the same rows scatter alike? A jackknife test of their ratio."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.family import holm
from mtu_cli.stats.least_squares import FloatArray

FEWEST_ROWS = 4
"""Fewer rows say nothing about a scatter."""
RATE = 0.05
CLEAR = 0.5
"""Scatter beyond the noise, over the noise's standard deviation, at which half of it is left."""
DECADES = np.arange(-6.0, 6.01, 0.5)
"""Where the ends of an interval are looked for first, about the ratio with all noise."""
FINE = np.linspace(0, 1, 33)
"""Where each of the closer `LOOKS` between two of them is, in their logarithm."""
LOOKS = 2
BLOCK = 1 << 18
"""Entries that are worked on at a time."""
ROUNDING = 1e-12
"""What rounding leaves of a sum when all of it is taken away."""

Pair = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """`values` (rows, columns), nan where missing, and what measurement adds to the squared
    deviations of each row in expectation: `noise` (rows,), with the variance `u2` of the
    estimate of its sum.
    """

    values: FloatArray
    noise: FloatArray
    u2: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ScatterRatio:
    """`ratio` of the variances, second over first, less their noise (nan if the first has none),
    and two-sided `p` of no difference (nan if neither scatters, or of too few rows);
    `p_familywise` over all tests made together. `rows` were compared.
    """

    ratio: float
    p: float
    p_familywise: float
    rows: int


def scatter_ratio(first: Side, second: Side) -> ScatterRatio:
    """Compares the scatter of two sides over the same rows, at least `FEWEST_ROWS`.

    With P the sum of the squared deviations from the columns' means less its noise N, and
    sd^2 the variance that noise alone gives P1 and P2 together,

        theta = log(P2 + w (N1 + N2)) - log(P1 + w (N1 + N2)),
        w = 1/(1 + (min(P1, P2)/(sd CLEAR))^2),

    the least P being that without any one row. Equal scatter has theta = 0 in expectation
    whatever w, and where a side hardly scatters both logarithms stay finite and steady. The
    standard error is the jackknife's over the rows (Miller, Ann. Math. Statist. 39 (1968) 567)
    with the noise's own uncertainty; theta over it is referred to Student's t of effective
    degrees of freedom (Welch & Satterthwaite, JCGM 100:2008, G.4.1; rows - 2 of the jackknife).
    Columns may be correlated in any way, on each side in its own, and the sides with each other.
    A side that does not scatter at all leaves a sign test over the rows.

    Raises ValueError for too few rows or sides of different length.
    """
    table = _table(first, second)
    left = [float((q - noise).sum()) for q, noise in zip(table.raw, table.noise, strict=True)]
    ratio = max(left[1], 0.0) / left[0] if left[0] > 0 else float("nan")
    p = float(table.p(np.ones(1))[0]) if table.scatters else _sign_test(first.values, second.values)
    return ScatterRatio(ratio=ratio, p=p, p_familywise=p, rows=len(first.values))


def ratio_interval(first: Side, second: Side) -> tuple[float, float]:
    """95 % interval of the ratio of variances: from the least to the largest c for which
    P2 = c P1 is not rejected.

    It begins at 0 where the second side, ends at infinity where the first may not scatter at
    all; (nan, nan) where a side is constant. A side that happens to scatter less than its noise
    counts as one that scatters as much: no small bound is owed to chance.

    Raises ValueError for too few rows or sides of different length.
    """
    table = _table(first, second).at_least_noise()
    if not table.scatters:
        return float("nan"), float("nan")
    below = _lower_end(table.turned())
    return _lower_end(table), 1 / below if below > 0 else float("inf")


def untested(rows: int) -> ScatterRatio:
    """What too few `rows` leave."""
    nan = float("nan")
    return ScatterRatio(ratio=nan, p=nan, p_familywise=nan, rows=rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Table:
    """Both sides: squared deviations `raw` (rows,) and `noise` (rows,), the variance `u2` of the
    noise's sum, the degrees of freedom `dof` of all deviations.
    """

    raw: Pair
    noise: Pair
    u2: tuple[float, float]
    dof: tuple[int, int]

    @property
    def scatters(self) -> bool:
        """Neither side is constant."""
        return bool(self.raw[0].any() and self.raw[1].any())

    def at_least_noise(self) -> _Table:
        """Sides that scatter less than their noise stretched to scatter as much."""
        found = [
            q * max(1.0, float(noise.sum() / q.sum())) if q.any() else q
            for q, noise in zip(self.raw, self.noise, strict=True)
        ]
        return replace(self, raw=(found[0], found[1]))

    def turned(self) -> _Table:
        """The second side first."""
        return _Table(
            raw=self.raw[::-1], noise=self.noise[::-1], u2=self.u2[::-1], dof=self.dof[::-1]
        )

    def p(self, c: FloatArray) -> FloatArray:
        """Two-sided p (m,) of P2 = c P1 for every c (m,), rows being independent."""
        from scipy.special import stdtr

        n, u1, u2 = len(self.raw[0]), self.u2[0] * c**2, np.full(len(c), self.u2[1])
        N1, N2 = self.noise[0].sum() * c, np.full(len(c), self.noise[1].sum())
        noise = c[:, None] * self.noise[0] + self.noise[1]
        q1 = c[:, None] * (self.raw[0] - self.noise[0])
        q2 = np.broadcast_to(self.raw[1] - self.noise[1], q1.shape)
        least = np.minimum(_without(q1).min(axis=1), _without(q2).min(axis=1))
        w = self._share(least, N1, N2, u1 + u2)
        q1, q2 = q1 + w[:, None] * noise, q2 + w[:, None] * noise
        S1, S2, without1, without2 = q1.sum(axis=1), q2.sum(axis=1), _without(q1), _without(q2)
        there = np.minimum(S1, S2) > 0
        S1, S2 = np.where(there, S1, 1.0), np.where(there, S2, 1.0)
        # Where one row makes all of a side's scatter, the jackknife has no bound: p is 1.
        bound = np.minimum(without1.min(axis=1) / S1, without2.min(axis=1) / S2) > ROUNDING
        ones = np.ones_like(q1)
        apart = np.log(np.divide(without2, without1, out=ones, where=bound[:, None]))
        apart -= apart.mean(axis=1, keepdims=True)
        v = (n - 1) / n * (apart**2).sum(axis=1)
        v1, v2 = u1 * (w / S2 + (1 - w) / S1) ** 2, u2 * (w / S1 + (1 - w) / S2) ** 2
        theta, variance = np.abs(np.log(S2 / S1)), v + v1 + v2
        known = variance > 0
        variance = np.where(known, variance, 1.0)
        loss = v**2 / (n - 2) + v1**2 * _per_dof(N1, u1) + v2**2 * _per_dof(N2, u2)
        dof = variance**2 / np.where(known, loss, 1.0)
        p = np.where(known, 2 * stdtr(dof, -theta / np.sqrt(variance)), theta == 0)
        found: FloatArray = np.where(there, np.where(bound, p, 1.0), 0.0)
        return found

    def _share(
        self, least: FloatArray, N1: FloatArray, N2: FloatArray, u2: FloatArray
    ) -> FloatArray:
        """w, the share of the noise that is left in."""
        variance = 2 * N1**2 / self.dof[0] + 2 * N2**2 / self.dof[1] + u2
        noisy = (variance > 0) & (least > 0)
        clear = np.where(noisy, least, 0.0) / (CLEAR * np.sqrt(np.where(noisy, variance, 1.0)))
        share: FloatArray = 1 / (1 + clear**2)
        return share


def _table(first: Side, second: Side) -> _Table:
    rows = len(first.values)
    if rows < FEWEST_ROWS or len(second.values) != rows:
        raise ValueError(f"{rows} and {len(second.values)} rows cannot be compared")
    return _Table(
        raw=(_squares(first.values), _squares(second.values)),
        noise=(first.noise, second.noise),
        u2=(first.u2, second.u2),
        dof=(_dof(first.values), _dof(second.values)),
    )


def _sign_test(first: FloatArray, second: FloatArray) -> float:
    """Two-sided p of rows that all moved on the same side: a row that has what half of them have
    at most, as those of a coarse resolution do, has not.
    """
    moved = int(np.count_nonzero(_moved(first) | _moved(second)))
    return min(2.0 ** (1 - moved), 1.0) if moved else float("nan")


def _moved(values: FloatArray) -> NDArray[np.bool_]:
    """Rows (n,) that differ from the lower median of some column."""
    known = np.isfinite(values)
    place = (np.maximum(known.sum(axis=0), 1) - 1) // 2
    middle = np.take_along_axis(np.sort(values, axis=0), place[None], axis=0)
    return np.asarray((known & (values != middle)).any(axis=1))


def _per_dof(N: FloatArray, u2: FloatArray) -> FloatArray:
    """1/dof of an estimate N of variance u2 = 2 N^2/dof."""
    return np.divide(u2, 2 * N**2, out=np.zeros_like(N), where=N > 0)


def _lower_end(table: _Table) -> float:
    """The least c for which P2 = c P1 is not rejected; 0 where that is none."""
    q1, q2 = (q - noise for q, noise in zip(table.raw, table.noise, strict=True))
    grid = float(table.raw[1].sum() / table.raw[0].sum()) * 10.0**DECADES
    if min(q1.sum(), q2.sum()) > 0:
        # Of very many rows the whole interval may lie between two points of the grid.
        grid = np.sort(np.append(grid, q2.sum() / q1.sum()))
    p = _in_pieces(table, np.append(0.0, grid))
    if max(p[:2]) > RATE:
        return 0.0
    p = p[1:]
    for _ in range(LOOKS):
        # The last point is the ratio itself or beyond all that is not rejected.
        within = np.flatnonzero(p > RATE)
        first = int(within[0]) if len(within) else len(grid) - 1
        low, high = grid[max(first - 1, 0)], grid[first]
        grid = low * (high / low) ** FINE
        p = _in_pieces(table, grid)
    within = np.flatnonzero(p > RATE)
    return float(grid[within[0]] if len(within) else grid[-1])


def _in_pieces(table: _Table, c: FloatArray) -> FloatArray:
    pieces = np.array_split(c, 1 + len(c) * len(table.raw[0]) // BLOCK)
    return np.concatenate([table.p(piece) for piece in pieces])


def _without(q: FloatArray) -> FloatArray:
    """The sum of q (..., n) without each row: leaving it out moves the columns' means as well."""
    n = q.shape[-1]
    found: FloatArray = q.sum(axis=-1, keepdims=True) - n / (n - 1) * q
    return found


def familywise(tests: list[ScatterRatio]) -> list[ScatterRatio]:
    """The tests with p adjusted for all of them (Holm)."""
    adjusted = holm(np.array([test.p for test in tests]))
    return [replace(test, p_familywise=float(p)) for test, p in zip(tests, adjusted, strict=True)]


def _dof(values: FloatArray) -> int:
    """Degrees of freedom of the deviations from the columns' means."""
    return max(int(np.maximum(np.isfinite(values).sum(axis=0) - 1, 0).sum()), 1)


def _squares(values: FloatArray) -> FloatArray:
    """Summed squared deviations (rows,) from the columns' means."""
    known = np.isfinite(values)
    mean = np.where(known, values, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    away = np.where(known, values - mean, 0.0)
    squares: FloatArray = np.einsum("ij,ij->i", away, away)
    return squares
