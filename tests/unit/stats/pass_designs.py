"""Designs of passes, readings drawn from the mixed model, and its slow plain version."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed_model import PassFit, fit_passes

IntArray = NDArray[np.int64]

PLACES = np.array([10.0, 60.0, 110.0, 160.0, 210.0, 260.0, 310.0, 360.0])
DRIFT = np.array([[4.0, 0.004], [0.004, 1e-4]])
NO_DRIFT = np.zeros((2, 2))


@dataclass(frozen=True)
class Design:
    """Positions (n,), passes (n,) and directions (n,) of the readings."""

    position: FloatArray
    group: IntArray
    direction: FloatArray

    @property
    def n_passes(self) -> int:
        return len(np.unique(self.group))

    def without(self, missing: Collection[tuple[int, int]]) -> Design:
        """The readings of (pass, place) left out."""
        place = np.searchsorted(PLACES, self.position)
        pairs = zip(self.group, place, strict=True)
        kept = np.array([(int(g), int(i)) not in missing for g, i in pairs])
        return Design(self.position[kept], self.group[kept], self.direction[kept])


def balanced(passes: int, *, both: bool = False, places: FloatArray = PLACES) -> Design:
    """Every pass at every place; with `both`, forward and reverse in turn."""
    sign = np.where(np.arange(passes) % 2 == 0, 1.0, -1.0) if both else np.zeros(passes)
    return Design(
        np.tile(places, passes),
        np.repeat(np.arange(passes), len(places)),
        np.repeat(sign, len(places)),
    )


UNBALANCED = {
    "two readings missing": balanced(6).without({(0, 0), (3, 7)}),
    "a short pass": balanced(6).without({(0, i) for i in range(4, 8)}),
    "both directions": balanced(7, both=True).without({(0, 5), (1, 1), (1, 2), (4, 0)}),
}


def drawn(
    design: Design,
    rng: np.random.Generator,
    D: FloatArray = DRIFT,
    s: float = 1.0,
    b: tuple[float, ...] = (3.0, -0.02),
    reversal: float = 0.0,
) -> FloatArray:
    """Readings of the mixed model; D is about the mean position."""
    centred = design.position - design.position.mean()
    lines = rng.multivariate_normal(np.zeros(2), D, size=int(design.group.max()) + 1)
    d = lines[design.group]
    mean = sum(c * design.position**k for k, c in enumerate(b))
    noise = s * rng.standard_normal(len(centred))
    shift = reversal * design.direction / 2
    readings: FloatArray = mean + d[:, 0] + d[:, 1] * centred + noise + shift
    return readings


def fitted(design: Design, y: FloatArray, degree: int = 1) -> PassFit:
    return fit_passes(y, design.position, degree, design.group, design.direction)


@dataclass(frozen=True)
class PlainPasses:
    """The passes' own lines (G, 2) at the mean position, S, and s2 with its dof."""

    lines: FloatArray
    S: FloatArray
    s2: float
    dof: int


def plain_passes(design: Design, y: FloatArray) -> PlainPasses:
    """One pass after the other with the formulas of a textbook."""
    c = design.position.mean()
    lines, signs, rss = [], [], 0.0
    for g in np.unique(design.group):
        inside = design.group == g
        p, values = design.position[inside], y[inside]
        slope = np.sum((p - p.mean()) * values) / np.sum((p - p.mean()) ** 2)
        level = values.mean() + slope * (c - p.mean())
        rss += float(np.sum((values - level - slope * (p - c)) ** 2))
        lines.append((level, slope))
        signs.append(design.direction[inside][0])
    b, sign = np.array(lines), np.array(signs)
    apart = np.concatenate([b[sign == s] - b[sign == s].mean(axis=0) for s in np.unique(sign)])
    dof = len(y) - 2 * len(b)
    return PlainPasses(b, apart.T @ apart / (len(b) - len(np.unique(sign))), rss / dof, dof)


def dense_variance(design: Design, s2: float, D: FloatArray) -> FloatArray:
    """V (n, n): s2 where i = j, plus z_i' D z_j within a pass."""
    n = len(design.position)
    z = np.column_stack([np.ones(n), design.position - design.position.mean()])[:, : len(D)]
    V: FloatArray = s2 * np.eye(n) + (design.group[:, None] == design.group) * (z @ D @ z.T)
    return V


def dense_covariance(design: Design, degree: int, s2: float, D: FloatArray) -> FloatArray:
    """(X'X)^-1 X' V X (X'X)^-1 with every matrix written out."""
    X = np.stack([design.position**k for k in range(degree + 1)], axis=1)
    H = np.linalg.inv(X.T @ X) @ X.T
    C: FloatArray = H @ dense_variance(design, s2, D) @ H.T
    return C
