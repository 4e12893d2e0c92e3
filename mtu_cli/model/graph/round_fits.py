"""Circles and spheres of least squared distances through the points of many trials at once.

A circle (d = 2) or sphere (d = 3) as P(q) = A |q|^2 + b.q + D = 0 with |b|^2 - 4 A D = 1: its
radius is 1/(2|A|), its centre -b/(2A), and the distance of a point from it is
2P/(1 + sqrt(1 + 4AP)) (Chernov & Lesort 2005, J. Math. Imaging Vision 23, 239-252). Of a short
arc the centre and radius are known badly and together, A, D and the direction of b well and
apart. The origin is the first point, where |b| is close to 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.model.graph.vectors import tangents, vector_dot
from mtu_cli.stats.least_squares import FloatArray, batched_least_squares

ITERATIONS = 200
HALVINGS = 12
STEP = 1e-13
"""A step that moves the figure by this share of the points' extent ends the iteration."""
UPHILL = 1e-9
"""Share by which the sum of squares may grow in a step, by rounding."""


@dataclass(frozen=True, slots=True)
class Figure:
    """`A` (m,), `n` (d, m) the unit vector of b, `D` (m,)."""

    A: FloatArray
    n: FloatArray
    D: FloatArray

    @property
    def size(self) -> FloatArray:
        """|b| (m,): distance of the centre from the origin, over the radius."""
        found: FloatArray = np.sqrt(1.0 + 4.0 * self.A * self.D)
        return found

    @property
    def radius(self) -> FloatArray:
        """(m,)."""
        found: FloatArray = 0.5 / np.abs(self.A)
        return found

    def centre(self) -> FloatArray:
        """(d, m)."""
        found: FloatArray = -(self.size / (2.0 * self.A)) * self.n
        return found

    def distances(self, q: FloatArray, squares: FloatArray) -> FloatArray:
        """Of points q (d, n, m) of |q|^2 (n, m) from the figure, (n, m); on one side positive."""
        P = self.A * squares
        P += self.D
        P += vector_dot(q, self.size * self.n)
        s = P * (4.0 * self.A)
        s += 1.0
        np.sqrt(s, out=s)
        s += 1.0
        P *= 2.0
        P /= s
        return P

    def at(self, members: NDArray[np.bool_]) -> Figure:
        """Of some of the trials."""
        return Figure(self.A[members], self.n[:, members], self.D[members])

    def put(self, members: NDArray[np.intp], other: Figure) -> None:
        """Takes some of the trials from another."""
        self.A[members], self.n[:, members], self.D[members] = other.A, other.n, other.D


class Points(NamedTuple):
    """Points q (d, n, m) and |q|^2 (n, m)."""

    q: FloatArray
    squares: FloatArray

    def at(self, members: NDArray[np.bool_]) -> Points:
        """Of some of the trials."""
        return Points(self.q[:, :, members], self.squares[:, members])


def round_figure(q: FloatArray, centre: FloatArray, radius: FloatArray, *, free: bool) -> Figure:
    """The circle or sphere of least squared distances of points q (d, n, m), the first at 0.

    The iteration (Gauss-Newton, with shorter steps where a whole one leads up) starts from
    `centre` (d,) and `radius` (m,), which stays where it is not `free`. Every trial ends by
    itself; one that does not come to an end is nan.
    """
    d, _, m = q.shape
    A = 0.5 / radius
    away = float(np.linalg.norm(centre))
    start = np.broadcast_to((-centre / away)[:, None], (d, m))
    found = Figure(A, start.copy(), A * away**2 - 0.25 / A)
    least = (STEP * np.abs(q).max(axis=(0, 1))) ** 2
    active = np.arange(m)
    now, left = found, Points(q, vector_dot(q, q))
    gaps, before = now.distances(*left), np.full(m, np.nan)
    for _ in range(ITERATIONS):
        X = _design(left, now, gaps, free=free)
        step, explained = batched_least_squares(X, -gaps)
        now, gaps = _downhill(left, now, step, gaps, least)
        # What the next step would explain, as they become shorter.
        more = explained * np.fmin(explained / before, 1.0) > least
        found.put(active, now)
        if not more.any():
            return found
        if not more.all():
            active, now, left, gaps = active[more], now.at(more), left.at(more), gaps[:, more]
            explained, least = explained[more], least[more]
        before = explained
    found.A[active] = np.nan
    return found


def _design(points: Points, at: Figure, gaps: FloatArray, *, free: bool) -> FloatArray:
    """Derivatives (k, n, m) of the distances by D, by turning n, and by A where it is `free`.

    From P = d + A d^2: with s = 1 + 2 A d, dd/dP = 1/s and dd/dA = (|q|^2 - d^2)/s; the length
    of b follows A and D: d|b| = 2 (A dD + D dA)/|b|.
    """
    q, squares = points
    size, directions = at.size, tangents(at.n)
    along = vector_dot(q, (2.0 / size) * at.n)
    X = np.empty((len(q) + free, *gaps.shape))
    np.multiply(at.A, along, out=X[0])
    X[0] += 1.0
    for row, direction in zip(X[1:], directions, strict=False):
        vector_dot(q, size * direction, out=row)
    if free:
        np.multiply(gaps, gaps, out=X[-1])
        np.subtract(squares, X[-1], out=X[-1])
        along *= at.D
        X[-1] += along
    s = 2.0 * at.A * gaps
    s += 1.0
    X /= s
    return X


def _downhill(
    points: Points, at: Figure, step: FloatArray, gaps: FloatArray, rounding: FloatArray
) -> tuple[Figure, FloatArray]:
    """The figure a step further, and the distances from it. A step that makes their squares
    larger is halved.
    """
    bound = (1.0 + UPHILL) * np.einsum("nm,nm->m", gaps, gaps) + rounding
    for _ in range(HALVINGS):
        after = _moved(at, step)
        gaps = after.distances(*points)
        steep = ~(np.einsum("nm,nm->m", gaps, gaps) <= bound)
        if not steep.any():
            break
        step[:, steep] *= 0.5
    return after, gaps


def _moved(at: Figure, step: FloatArray) -> Figure:
    d = len(at.n)
    A = at.A + step[d] if len(step) > d else at.A
    n = at.n + sum(
        angle * direction for angle, direction in zip(step[1:d], tangents(at.n), strict=True)
    )
    return Figure(A, n / np.sqrt(vector_dot(n, n)), at.D + step[0])
