"""Rings that stay oval once the modelled error is taken off.

A squareness or a scale of one axis makes an ellipse of a circle and leaves its diameter. Points
that are strained by a symmetric E (3, 3) lie r u'E u beyond a ring of radius r, u the unit vectors
from its centre: least squares beside centre and radius gives E from the residuals, its covariance
the machine's model and the points' scatter. That it is 0 is tested by F = e' V^-1 e / p, with p
directions of strain that the ring shows (2 of a circle, 5 of a sphere).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import fdtrc

from mtu_cli.analyses.correct.result import Kind, Size
from mtu_cli.analyses.correct.scatter import PointScatter, Squares, pooled, squares_along
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.settings import PROBABILITY
from mtu_cli.stats.least_squares import FloatArray

PAIRS = tuple(combinations(range(3), 2))
SHOWN = 0.05
"""Share of the largest singular value below which a ring does not show a direction of strain."""
ENDLESS = 1e9
"""Degrees of freedom beyond which F is chi^2 / p."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Strain:
    """Of one ring: e = (E_xx, E_yy, E_zz, E_xy, E_xz, E_yz) (6,), its covariance (6, 6) by the
    machine's model, and by a scatter of points of 1 mm^2; `shown` directions of strain, and the
    squares that no strain makes.
    """

    kind: Kind
    id: str
    radius: float
    value: FloatArray
    modelled: FloatArray
    scattered: FloatArray
    shown: int
    rest: Squares | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Oval:
    """A ring that is oval beyond its uncertainty: `longer` (mm, of diameters) along one direction
    than along another. With a `shear` these are the sum and the difference of the two `axes`, the
    other way round where its `size` (rad) is negative; else the first of them and the second.
    """

    kind: Kind
    id: str
    axes: tuple[str, str]
    shear: bool
    longer: float
    size: float


def strain_of(
    kind: Kind, name: str, radius: float, residuals: FloatArray, away: FloatArray, K: FloatArray
) -> Strain | None:
    """The strain of a ring with `residuals` (n,) mm; `away` (n, 3) are unit vectors from the
    centre, `K` (n, n) the modelled covariance of the points along them, mm^2. None where the
    points show nothing of it.
    """
    n, d = len(residuals), 3 if kind == "sphere" else 2
    if n <= d + 1:
        return None
    Q = np.linalg.svd(np.column_stack([away, np.ones(n)]))[0][:, d + 1 :]
    levers = [away[:, i] ** 2 for i in range(3)]
    levers += [2 * away[:, i] * away[:, j] for i, j in PAIRS]
    U, sizes, V = np.linalg.svd(Q.T @ (radius * np.column_stack(levers)))
    p = int((sizes > SHOWN * radius).sum())
    if p == 0:
        return None
    B = (V[:p].T / sizes[:p]) @ U[:, :p].T @ Q.T
    left = Q @ U[:, p:]
    return Strain(
        kind=kind,
        id=name,
        radius=radius,
        value=B @ residuals,
        modelled=B @ K @ B.T,
        scattered=B @ B.T,
        shown=p,
        rest=squares_along(left, residuals, K) if left.shape[1] else None,
    )


def ovals(
    strains: Sequence[Strain], sizes: Sequence[Size], scatter: PointScatter | None
) -> tuple[Oval, ...]:
    """The rings whose strain, in the mean over parts and repeats, is told from 0 at 95 % of all
    together (Bonferroni). What the machine did is taken to be in all of them.
    """
    groups: dict[tuple[Kind, str], list[Strain]] = {}
    for own in strains:
        groups.setdefault((own.kind, own.id), []).append(own)
    found = []
    for (kind, name), group in groups.items():
        dof = min(size.dof for size in sizes if (size.kind, size.id) == (kind, name))
        p = _p(group, dof, scatter)
        if p < (1 - PROBABILITY) / len(groups):
            e = np.mean([own.value for own in group], axis=0)
            found.append(_oval(group[0], e))
    return tuple(found)


def _p(group: Sequence[Strain], dof: float, scatter: PointScatter | None) -> float:
    """Of no strain; 1 where nothing tells how much the points scatter."""
    variance = scatter.variance if scatter is not None else 0.0
    count = len(group)
    if scatter is None or scatter.origin == "form":
        # What is left of a ring beside its strain is the ring's own, and in every repeat.
        rests = [own.rest for own in group if own.rest is not None]
        if not rests:
            return 1.0
        rest, count = pooled(rests, "form"), 1
        variance, dof = rest.variance, min(dof, rest.dof)
    e = np.mean([own.value for own in group], axis=0)
    V = np.mean([own.modelled for own in group], axis=0)
    V = V + variance / count * np.mean([own.scattered for own in group], axis=0)
    shown = max(own.shown for own in group)
    values, vectors = np.linalg.eigh(V)
    values, vectors = values[-shown:], vectors[:, -shown:]
    if values[0] <= 0:
        return 1.0
    square = float(((vectors.T @ e) ** 2 / values).sum())
    return float(fdtrc(shown, min(dof, ENDLESS), square / shown))


def _oval(ring: Strain, e: FloatArray) -> Oval:
    """The pair of axes with the largest difference of diameters."""
    found = []
    for k, (i, j) in enumerate(PAIRS):
        found += [(abs(2 * e[3 + k]), True, i, j, 2 * e[3 + k])]
        found += [(abs(e[i] - e[j]), False, i, j, e[i] - e[j])]
    _, shear, i, j, size = max(found)
    if size < 0 and not shear:
        i, j, size = j, i, -size
    return Oval(
        kind=ring.kind,
        id=ring.id,
        axes=(AXES[i], AXES[j]),
        shear=shear,
        longer=2 * ring.radius * abs(float(size)),
        size=float(size),
    )
