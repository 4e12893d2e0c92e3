"""Do two sets of columns of the same rows scatter alike? A jackknife test of their ratio."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.stats.family import holm
from mtu_cli.stats.least_squares import FloatArray

FEWEST_ROWS = 4
"""Fewer rows say nothing about a scatter."""


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
    and two-sided `p` of no difference (nan if neither scatters); `p_familywise` over all tests
    made together. `rows` were compared.
    """

    ratio: float
    p: float
    p_familywise: float
    rows: int


def scatter_ratio(first: Side, second: Side) -> ScatterRatio:
    """Compares the scatter of two sides over the same rows, at least `FEWEST_ROWS`.

    theta = log(P2/P1), P the sum of the squared deviations from the columns' means less the
    noise. Its standard error is the jackknife's over the rows (Miller, Ann. Math. Statist. 39
    (1968) 567), with the noise's own uncertainty; theta over it is referred to Student's t with
    rows - 2 degrees of freedom. Columns may be correlated in any way, on each side in its own,
    and the sides with each other. Where a side has no more scatter than noise, the difference of
    the noises is added to the quieter side instead. A side that does not scatter at all leaves a
    sign test over the rows.

    Raises ValueError for too few rows or sides of different length.
    """
    rows = len(first.values)
    if rows < FEWEST_ROWS or len(second.values) != rows:
        raise ValueError(f"{rows} and {len(second.values)} rows cannot be compared")
    raw = (_squares(first.values), _squares(second.values))
    left = [float(q.sum() - side.noise.sum()) for q, side in zip(raw, (first, second), strict=True)]
    ratio = max(left[1], 0.0) / left[0] if left[0] > 0 else float("nan")
    if not (raw[0].any() and raw[1].any()):
        moved = int(np.count_nonzero(raw[0] + raw[1]))
        p = min(2.0 ** (1 - moved), 1.0) if moved else float("nan")
        return ScatterRatio(ratio=ratio, p=p, p_familywise=p, rows=rows)
    q1, q2 = raw[0] - first.noise, raw[1] - second.noise
    if min(_without(q1).min(), _without(q2).min()) <= 0:
        apart = second.noise - first.noise
        q1, q2 = raw[0] + np.maximum(apart, 0.0), raw[1] + np.maximum(-apart, 0.0)
    p = _p(q1, q2, first.u2, second.u2)
    return ScatterRatio(ratio=ratio, p=p, p_familywise=p, rows=rows)


def _p(q1: FloatArray, q2: FloatArray, noise1: float, noise2: float) -> float:
    """Two-sided p of log(sum q2 / sum q1), rows (n,) being independent."""
    from scipy.special import stdtr

    n = len(q1)
    apart = np.log(_without(q2) / _without(q1))
    S1, S2 = float(q1.sum()), float(q2.sum())
    u2 = (n - 1) / n * float(((apart - apart.mean()) ** 2).sum())
    u2 += noise1 / S1**2 + noise2 / S2**2
    theta = float(np.log(S2 / S1))
    if u2 == 0:
        return 1.0 if theta == 0 else 0.0
    return float(2 * stdtr(n - 2, -abs(theta) / np.sqrt(u2)))


def _without(q: FloatArray) -> FloatArray:
    """The sum of q (n,) without each row: leaving it out moves the columns' means as well."""
    n = len(q)
    found: FloatArray = q.sum() - n / (n - 1) * q
    return found


def familywise(tests: list[ScatterRatio]) -> list[ScatterRatio]:
    """The tests with p adjusted for all of them (Holm)."""
    adjusted = holm(np.array([test.p for test in tests]))
    return [replace(test, p_familywise=float(p)) for test, p in zip(tests, adjusted, strict=True)]


def _squares(values: FloatArray) -> FloatArray:
    """Summed squared deviations (rows,) from the columns' means."""
    known = np.isfinite(values)
    mean = np.where(known, values, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    away = np.where(known, values - mean, 0.0)
    squares: FloatArray = np.einsum("ij,ij->i", away, away)
    return squares
