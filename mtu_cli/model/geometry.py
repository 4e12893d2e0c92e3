"""Planes, circles and spheres through measured points, with the gradient of the radius.

Distances are orthogonal (geometric fits). Circle and sphere minimise sum d_i^2,
d_i = |p_i - c| - r, by Gauss-Newton from the algebraic fit of Kasa 1976 (Gander, Golub &
Strebel 1994, BIT 34, 558-578). Coordinates are centred and scaled first.

Gradients are those of the minimum itself (implicit function theorem on grad sum d_i^2 = 0): with
u_i the unit vectors from the centre, P_i = I - u_i u_i' and the Hessian H of sum d_i^2 / 2,

    d(c, r)/dp_i = H^-1 [u_i u_i' + d_i/|p_i - c| P_i; u_i'].
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.stats.least_squares import FloatArray, batched_least_squares, least_squares

ITERATIONS = 100
HALVINGS = 12
STEP = 1e-13
"""A step that moves the figure by this share of the points' extent ends the iteration."""
UPHILL = 1e-9
"""Share by which the sum of squares may grow in a step, by rounding."""
ROUNDING = 16 * float(np.finfo(np.float64).eps)
SAME = 1e-9
"""Share of the extent below which points, or eigenvalues of a plane, are not distinguished."""
DIMENSIONS = {"circle": 2, "sphere": 3}
KINDS = {d: kind for kind, d in DIMENSIONS.items()}


class GeometryError(Exception):
    """The points do not determine the figure; the message says why, in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RoundFit:
    """A least-squares circle or sphere of n points (n, d), mm.

    `centre` (d,), `radius` with its `radius_gradient` (n, d), `residuals` (n,) = |p - c| - r and
    unit vectors `away` (n, d) from the centre (in the plane, for a circle in space).
    """

    centre: FloatArray
    radius: float
    residuals: FloatArray
    away: FloatArray
    radius_gradient: FloatArray

    @property
    def form(self) -> float:
        """Range of the residuals: the form error about the least-squares figure."""
        return float(np.ptp(self.residuals))


def fit_circle(points: FloatArray) -> RoundFit:
    """The least-squares circle of `points` (n, 2), or (n, 3): in their least-squares plane.

    In space the gradient is that in the plane: points that move tilt it by the order of their
    heights above it over the radius.

    Raises GeometryError where the points do not determine it.
    """
    if points.shape[1] == 2:
        return fit_round(points)
    centroid, _, e = fit_plane(points)
    flat = fit_round((points - centroid) @ e.T)
    return replace(
        flat,
        centre=centroid + flat.centre @ e,
        away=flat.away @ e,
        radius_gradient=flat.radius_gradient @ e,
    )


def fit_plane(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The least-squares plane of `points` (n, 3): through their centroid (3,), across the smallest
    principal moment of their coordinates about it. Centroid, normal (3,) and two directions in the
    plane (2, 3).

    Raises GeometryError for points on a line, or in a cloud without a flattest direction.
    """
    centroid, q, _ = _centred(points)
    _, singular, Vt = np.linalg.svd(q, full_matrices=True)
    extent = np.zeros(3)
    extent[: len(singular)] = singular / singular[0]
    if extent[1] < SAME:
        raise GeometryError("the points lie on a line")
    if extent[1] - extent[2] < SAME:
        raise GeometryError("the points lie in no plane")
    return centroid, Vt[2], Vt[:2]


def _centred(points: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Centroid (d,), coordinates (n, d) about it in units of the scale, and the scale, mm."""
    centroid = points.mean(axis=0)
    q = points - centroid
    scale = float(np.sqrt((q**2).sum(axis=1).mean()))
    if scale <= SAME * float(np.abs(points).max(initial=0.0)):
        raise GeometryError("all points stand at the same place")
    return centroid, q / scale, scale


def fit_round(points: FloatArray) -> RoundFit:
    """The least-squares circle of `points` (n, 2), or sphere of points (n, 3).

    Raises GeometryError where the points do not determine it.
    """
    n, d = points.shape
    straight = GeometryError(f"the {KINDS[d]} could not be fitted: the points hardly bend")
    centroid, q, scale = _centred(points)
    # (c, r) of |p|^2 = 2 c.p + (r^2 - |c|^2), Kasa 1976.
    start = _solved(2 * q, (q**2).sum(axis=1))
    radius = max(float(start[d] + start[:d] @ start[:d]), 0.0) ** 0.5
    with np.errstate(invalid="ignore", divide="ignore"):
        centre, radii = round_figure(q.T[:, :, None], start[:d, None], radius, free=True)
    result = np.append(centre[:, 0], radii)
    if not np.isfinite(result).all():
        raise straight
    for last in (False, True):
        away = q - result[:d]
        distance = np.linalg.norm(away, axis=1)
        if distance.min() == 0:
            raise GeometryError("a point stands at the centre")
        residuals, unit = distance - result[d], away / distance[:, None]
        if not last:
            # The far end of a short arc, to the last digit.
            result = result + _solved(unit, residuals)
    # H and the sides of the gradient, in any unit of length.
    outer = unit[:, :, None] * unit[:, None, :]
    along = outer + (residuals / distance)[:, None, None] * (np.eye(d) - outer)
    H = np.full((d + 1, d + 1), float(n))
    H[:d, :d] = along.sum(axis=0)
    H[:d, d] = H[d, :d] = unit.sum(axis=0)
    least, most = np.linalg.eigvalsh(H)[[0, -1]]
    if least <= ROUNDING * most:
        raise straight
    row = np.linalg.inv(H)[d]
    return RoundFit(
        centre=centroid + scale * result[:d],
        radius=scale * float(result[d]),
        residuals=scale * residuals,
        away=unit,
        radius_gradient=np.einsum("k,ikc->ic", row[:d], along) + row[d] * unit,
    )


def _solved(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Coefficients of `columns` (n, d) and a constant: of a step, d_i = u_i.dc + dr."""
    fit = least_squares(np.column_stack([columns, np.ones(len(columns))]), values)
    if fit.rank < columns.shape[1] + 1:
        # From a centre as far away as this, the points hardly bend.
        flat = "line" if columns.shape[1] == 2 else "plane or a circle"
        raise GeometryError(f"the points lie on a {flat}")
    return fit.coefficients


def round_figure(
    q: FloatArray, centre: FloatArray, start: float | FloatArray, *, free: bool
) -> tuple[FloatArray, FloatArray]:
    """Centre (d, m) and radius (m,) of least squared distances |q - c| - r of points q (d, n, m).

    Gauss-Newton from `centre` (d, m) and a radius, with shorter steps where a whole one leads up;
    the radius stays where it is not `free`. A trial that does not come to an end is nan.
    """
    d, n, m = q.shape
    radius = np.broadcast_to(start, m)
    X = np.ones((d + free, n, m))
    least = (STEP * np.ptp(q, axis=1).max(axis=0)) ** 2
    away = q - centre[:, None]
    far = np.sqrt(np.einsum("dnm,dnm->nm", away, away))
    moves = np.ones(m, bool)
    for _ in range(ITERATIONS):
        X[:d] = away / far
        step, explained = batched_least_squares(X, far - radius)
        bound = (1.0 + UPHILL) * np.sum((far - radius) ** 2, axis=0) + least
        for _ in range(HALVINGS):
            after = centre + step[:d], radius + step[d] if free else radius
            away = q - after[0][:, None]
            far = np.sqrt(np.einsum("dnm,dnm->nm", away, away))
            uphill = ~(np.sum((far - after[1]) ** 2, axis=0) <= bound)
            if not uphill.any():
                break
            step[:, uphill] *= 0.5
        centre, radius = after
        moves = explained > least
        if not moves.any():
            break
    return np.where(moves, np.nan, centre), np.where(moves, np.nan, radius)
