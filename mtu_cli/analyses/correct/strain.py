"""Strains that a ring of points shows, and what they make of its diameters."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mtu_cli.analyses.correct.quantity import Kind
from mtu_cli.analyses.correct.scatter import ring_space
from mtu_cli.model.geometry import DIMENSIONS
from mtu_cli.stats.least_squares import FloatArray

PAIRS = tuple(combinations(range(3), 2))
SHOWN = 0.05
"""Root mean square over the points, of the lever of a strain of 1 along a direction over the
radius, below which a ring does not show it."""


@dataclass(frozen=True, slots=True)
class Levers:
    """f = `estimator` (p, n) residuals is the strain along the orthonormal `basis` (6, p) of
    (E_xx, E_yy, E_zz, E_xy, E_xz, E_yz); `rest` (n, k) orthonormal, what no strain makes.
    """

    estimator: FloatArray
    basis: FloatArray
    rest: FloatArray


def levers_of(kind: Kind, radius: float, away: FloatArray) -> Levers | None:
    """What a ring of `radius` mm tells of strain; None where the points show nothing of it."""
    Q = ring_space(away, DIMENSIONS[kind])
    if Q is None:
        return None
    levers = [away[:, i] ** 2 for i in range(3)]
    levers += [2 * away[:, i] * away[:, j] for i, j in PAIRS]
    U, sizes, V = np.linalg.svd(Q.T @ (radius * np.column_stack(levers)))
    p = int((sizes > SHOWN * radius * np.sqrt(len(away))).sum())
    if p == 0:
        return None
    return Levers((U[:, :p] / sizes[:p]).T @ Q.T, V[:p].T, Q @ U[:, p:])


def with_u(
    weights: FloatArray, basis: FloatArray, f: FloatArray, V: FloatArray
) -> tuple[float, float]:
    """The sum by `weights` (6,) of the entries of a strain f (p,) along `basis` (6, p), and its
    standard uncertainty by the covariance V (p, p) of f.
    """
    own = basis.T @ weights
    return float(own @ f), float(np.sqrt(own @ V @ own))


def contrasts() -> Iterator[tuple[int, int, bool, FloatArray]]:
    """Of each pair of axes (i, j) 2 E_ij (a shear) and E_ii - E_jj, as weights (6,) of a strain."""
    for k, (i, j) in enumerate(PAIRS):
        shear, stretch = np.zeros((2, 6))
        shear[3 + k], stretch[i], stretch[j] = 2.0, 1.0, -1.0
        yield i, j, True, shear
        yield i, j, False, stretch


def along(e: FloatArray) -> FloatArray:
    """e'E e of a unit vector e (3,), as weights (6,) of a strain."""
    return np.array([*e**2, *(2 * e[i] * e[j] for i, j in PAIRS)])


def entries(E: FloatArray) -> FloatArray:
    """(6,) of a symmetric E (3, 3), in the order of `Levers`."""
    return np.array([*np.diag(E), *(E[i, j] for i, j in PAIRS)])


def matrix(e: FloatArray) -> FloatArray:
    """The symmetric E (3, 3) of its entries (6,)."""
    E = np.diag(e[:3])
    for k, (i, j) in enumerate(PAIRS):
        E[i, j] = E[j, i] = e[3 + k]
    return E
