"""Lengths and right angles as functions of the errors, and Monte Carlo trials of one future part:
its errors, its measurands, and conformance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import stdtr, stdtrit

from mtu_cli.files.part import LoadedPart, Tolerance
from mtu_cli.findings import InputError, error, finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.settings import Settings
from mtu_cli.stats.blocks import Draws, Workspace
from mtu_cli.stats.composed_variance import Variance
from mtu_cli.stats.covariance import factor_of
from mtu_cli.stats.distributions import NORMAL_DOF, t_scales
from mtu_cli.stats.least_squares import BoolArray, FloatArray, IntArray, quotient
from mtu_cli.units import UM

MANY_ERRORS = 1.5
"""Times as many independent errors as combinations of them: as many normals as these are drawn."""

Measure = Callable[[FloatArray], FloatArray]
"""Combined errors (combinations, m) in mm -> values (outputs, m) of the measurands."""


class PointTrials:
    """A Monte Carlo model: m future parts a block, each with errors at all points.

    `combine` (combinations, rows) says which linear combinations of the errors `measure` needs;
    only these are drawn, normal with the prediction's covariance or, without the `variance` of the
    outputs, with independent errors, as in Gilsinn & Ling 2004, eq. (23). `owner`
    (combinations,) is the output that a combination belongs to. Where the effective degrees of
    freedom of the `variance` are finite its combinations are scaled to Student's t (JCGM 101:2008,
    6.4.9), so that the trials and the first-order interval differ by what the measurand is not
    linear in, and by nothing else. The first-order form, `gradient` (outputs, rows), is drawn along
    and serves as control variate.
    """

    smooth = True

    def __init__(
        self,
        prediction: Prediction,
        names: tuple[str, ...],
        measure: Measure,
        combine: FloatArray,
        owner: IntArray,
        gradient: FloatArray,
        variance: Variance | None,
    ) -> None:
        self.names, self.measure, self.work = names, measure, Workspace()
        mean = combine @ prediction.mean
        self.linear_mean = measure(mean[:, None])[:, 0].copy()
        # The first-order form is drawn as further rows of the same product.
        self.offset = np.concatenate([mean, self.linear_mean])[:, None]
        self.k = len(combine)
        self.owner = np.concatenate([owner, np.arange(len(names))])
        stacked = np.vstack([combine, gradient])
        if variance is None:
            self.factor = stacked * np.sqrt(prediction.independent_variance)
            if MANY_ERRORS * len(mean) < len(prediction.mean):
                self.factor = factor_of(self.factor @ self.factor.T)
            self.dof = np.full(len(names), np.inf)
        else:
            C = stacked @ prediction.covariance @ stacked.T
            lowered = not np.allclose(np.diag(C)[self.k :], variance.total, rtol=1e-9, atol=0.0)
            if lowered:
                C = stacked @ prediction.drawable @ stacked.T
            self.dof, self.factor = variance.dof, factor_of(C)
            if lowered:
                # By a negative D, which the variance is not (`variance_of`): without
                # its negative part, all rows of an output scaled alike.
                drawn = np.sum(self.factor[self.k :] ** 2, axis=1)
                self.factor *= np.sqrt(quotient(variance.total, drawn, 0.0))[self.owner, None]
        self.linear_u = np.sqrt(np.sum(self.factor[self.k :] ** 2, axis=1))[:, None]
        self.u_exists = self.dof > 2
        self.linear_dof = np.where(self.dof < NORMAL_DOF, self.dof, np.inf)
        self.finite = np.flatnonzero(np.isfinite(self.linear_dof))
        # A t of two degrees of freedom or fewer has none.
        dof = np.where(self.u_exists, self.linear_dof, np.nan)
        self.linear_variance = self.linear_u[:, 0] ** 2 / (1.0 - 2.0 / dof)

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        """Values and first-order values (outputs, m)."""
        rows, rank = self.factor.shape
        z = rng.standard_normal(out=self.work.array("z", (rank, m)))
        total = np.matmul(self.factor, z, out=self.work.array("total", (rows, m)))
        if len(self.finite):
            scale = self.work.array("scale", (len(self.names), m))
            scale[:] = 1.0
            for i in self.finite:
                t_scales(float(self.dof[i]), rng, scale[i])
            # Row by row: the scales of all rows at once would be an array as large as `total`.
            for row, i in zip(total, self.owner, strict=True):
                row *= scale[i]
        total += self.offset
        return Draws(values=self.measure(total[: self.k]), linear=total[self.k :])

    def linear_quantiles(self, probability: FloatArray) -> FloatArray:
        """Those (outputs, n) of the first-order values less their mean."""
        return self.linear_u * stdtrit(self.linear_dof[:, None], probability)


@dataclass(frozen=True, slots=True, kw_only=True)
class Conformance:
    """Probability that an error of a future part is within its `tolerance` (um or arcsec), and its
    standard error, 0 of first order; of a position twice the distance from its nominal place.
    """

    tolerance: Tolerance
    probability: float
    se: float = 0.0


def conformance_of(
    tolerance: Tolerance | None, size: float, error: float, u: float, dof: float
) -> Conformance | None:
    """P(low <= error of a future part <= high) with t at the effective degrees of freedom.

    `size` is the tolerance's unit in that of `error` and `u`.
    """
    if tolerance is None:
        return None
    low, high = tolerance.low * size, tolerance.high * size
    if u == 0:
        return Conformance(tolerance=tolerance, probability=float(low <= error <= high))
    ends = np.array([high - error, low - error]) / u
    below = stdtr(dof, ends)
    return Conformance(tolerance=tolerance, probability=float(below[0] - below[1]))


class JointConformance(NamedTuple):
    """Probability that all `lengths` with a tolerance of one part conform; its standard error."""

    lengths: tuple[str, ...]
    probability: float
    se: float


def joint_conformance(
    model: PointTrials, items: Sequence[Conformance | None], settings: Settings
) -> JointConformance | None:
    """That one part conforms in all its toleranced lengths; None of fewer than two. Not the product
    of their probabilities, as the lengths of a part are correlated, nor more than the least.
    """
    conformances = {name: x for name, x in zip(model.names, items, strict=True) if x is not None}
    if len(conformances) < 2:
        return None
    low = np.array([[-np.inf if x is None else x.tolerance.low * UM] for x in items])
    high = np.array([[np.inf if x is None else x.tolerance.high * UM] for x in items])

    def all_within(rng: np.random.Generator, m: int) -> BoolArray:
        values = model.draw(rng, m).values
        return np.all((low <= values) & (values <= high), axis=0, keepdims=True)

    p, se = settings.count(("all_within",), all_within)
    least = min(float(p[0]), *(x.probability for x in conformances.values()))
    return JointConformance(tuple(conformances), least, float(se[0]))


def position_conformance(
    prediction: Prediction, position_um: Sequence[float | None], settings: Settings
) -> tuple[Conformance | None, ...]:
    """P(Ex^2 + Ey^2 <= (T/2)^2) of every feature with a T, by Monte Carlo. A mean square MS of nu
    degrees of freedom has the expectation MS nu/W, W a chi-squared of nu (JCGM 101:2008, 6.4.9):
    every trial draws one W a source, common to the errors along x and y. An axis without equation
    has no error.
    """
    result: list[Conformance | None] = [None] * len(position_um)
    zones = {i: zone for i, zone in enumerate(position_um) if zone is not None}
    axes = [prediction.axes.index(axis) for axis in "xy" if axis in prediction.axes]
    if not (zones and axes):
        return tuple(result)
    rows: IntArray = np.array([[i * len(prediction.axes) + axis for axis in axes] for i in zones])
    factor, dof = _plane_factor(prediction, rows, independent=settings.independent)
    mean, limit = prediction.mean[rows].reshape(-1, 1), np.array([*zones.values()]) * UM / 2

    def inside(rng: np.random.Generator, m: int) -> BoolArray:
        z = rng.standard_normal((len(dof), len(axes), m))
        for source in np.flatnonzero(dof < NORMAL_DOF):
            z[source] *= t_scales(float(dof[source]), rng, np.empty(m))
        errors = (mean + factor @ z.reshape(-1, m)).reshape(len(zones), len(axes), m)
        return np.hypot.reduce(errors, axis=1) <= limit[:, None]

    names = tuple(prediction.ids[i] for i in zones)
    for i, p, se in zip(zones, *settings.count(names, inside), strict=True):
        zone = Tolerance(low=0.0, high=zones[i])
        result[i] = Conformance(tolerance=zone, probability=float(p), se=float(se))
    return tuple(result)


def _plane_factor(
    prediction: Prediction, rows: IntArray, *, independent: bool
) -> tuple[FloatArray, FloatArray]:
    """F (features*axes, K*axes) of K sources, and their degrees of freedom (K,).

    F_k F_k' is the covariance that mean square k gives the errors `rows` (features, axes) of one
    feature: by variances of Ex, Ey and Ex + Ey. Its negative part (a difference of mean squares) is
    left out, and the rows are scaled back to their variances.
    """
    n, a = rows.shape
    if independent:
        variances = prediction.independent_variance[rows]
        return np.vstack([np.diag(np.sqrt(each)) for each in variances]), np.full(1, np.inf)
    picked = np.zeros((n * a, len(prediction.mean)))
    picked[np.arange(n * a), rows.ravel()] = 1.0
    each = prediction.variance(picked)
    squares = (each.squares.of_mean + each.squares.of_part).reshape(-1, n, a)
    sources = squares[..., None] * np.eye(a)
    if a == 2:
        of_sum = prediction.variance(picked[::2] + picked[1::2]).squares
        covariance = (of_sum.of_mean + of_sum.of_part - squares.sum(axis=2)) / 2
        sources[..., 0, 1] = sources[..., 1, 0] = covariance
    values, vectors = np.linalg.eigh(sources)
    factors = vectors * np.sqrt(np.clip(values, 0.0, None))[..., None, :]
    target = np.clip(each.total.reshape(n, a), 0.0, None)
    ratio = np.sqrt(quotient(target, np.sum(factors**2, axis=(0, 3)), 0.0))
    scaled = (factors * ratio[..., None]).transpose(1, 2, 0, 3).reshape(n * a, -1)
    return np.asarray(scaled), each.squares.dof


def differences(points: FloatArray, pairs: IntArray, names: Sequence[str], file: str) -> FloatArray:
    """End minus start (lengths, 3) of nominal `points` (n, 3), mm; 0 along z where neither has it.

    Raises InputError for a length of which one end alone has a z.
    """
    delta = points[pairs[:, 1]] - points[pairs[:, 0]]
    unknown = np.isnan(points[pairs].sum(axis=2))
    for i in np.flatnonzero(unknown[:, 0] != unknown[:, 1])[:1]:
        raise error(
            "missing-key",
            key="z_mm",
            file=file,
            path=f"length {names[i]!r}",
            expected="z_mm of both features, or of the part",
        )
    return np.nan_to_num(delta)


def length_measure(
    prediction: Prediction, pairs: IntArray, delta: FloatArray
) -> tuple[Measure, FloatArray, FloatArray]:
    """Length minus nominal, eqs. (20)-(21), the differences of errors (axes*lengths, rows) that it
    needs, and dL/dE (lengths, rows), the nominal unit vector times them, eq. (22).

    The sums run over the prediction's axes: an axis without equation has no error.
    """
    a, m, rows = len(prediction.axes), len(pairs), len(prediction.mean)
    L0 = np.linalg.norm(delta, axis=1)
    along = delta[:, [AXES.index(axis) for axis in prediction.axes]]
    of_point = np.eye(rows).reshape(-1, a, rows)
    combine = (of_point[pairs[:, 1]] - of_point[pairs[:, 0]]).transpose(1, 0, 2)
    gradient = np.einsum("ma,amr->mr", along / L0[:, None], combine)

    def measure(errors: FloatArray) -> FloatArray:
        return length_error(L0, along, errors.reshape(a, m, -1))

    return measure, combine.reshape(-1, rows), gradient


def length_error(L0: FloatArray, delta: FloatArray, e: FloatArray) -> FloatArray:
    """L - L0 (lengths, n), mm, Gilsinn & Ling 2004, eqs. (20)-(21).

    L - L0 = (2 delta.e + e.e)/(L + L0): no digits are lost to the difference of two lengths.
    `L0` (lengths,) nominal, `delta` (lengths, axes) the ends' nominal difference along the axes
    that have errors, `e` (axes, lengths, n) the difference of the two ends' errors there.
    """
    grown = np.zeros(e.shape[1:])
    for along, slip in zip(delta.T, e, strict=True):
        grown += (2 * along[:, None] + slip) * slip
    length = L0[:, None]
    return grown / (np.sqrt(length**2 + grown) + length)


LARGEST_SLOPE = 0.1
"""Nominal slope b1 of a row or column that still counts as along its axis: holes need not stand in
a line. Its change for its angle's is too large by b1^2, 1 % here.
"""

Line = tuple[FloatArray, FloatArray]
"""Coordinates along and across a line (features, m) or (features, 1), each less its mean, or
`contrasts` of them (features - 1, ...); mm."""


def slope(line: Line) -> FloatArray:
    """b1 = sum u v / sum u u (m,) of the least-squares line; nan where u does not vary."""
    u, v = line
    return quotient(np.einsum("pm,pm->m", u, v), np.einsum("pm,pm->m", u, u))


def angle_error(placed: tuple[Line, Line], nominal: tuple[Line, Line]) -> FloatArray:
    """dtheta (m,), rad, of a row and a column, less what it is by design.

    dtheta = -b1(column) - b1(row), Gilsinn & Ling 2004, eqs. (24)-(26). Rows and columns that
    are not quite square by design have no error for it.
    """
    result: FloatArray = -(slope(placed[0]) + slope(placed[1]))
    return result + (slope(nominal[0]) + slope(nominal[1]))


def check_square(part: LoadedPart, entries: Iterable[int]) -> None:
    """Eqs. (24)-(26) take slopes for angles: rows lie along x, columns along y.

    Raises InputError for every row or column of these `entries` of the part file that does not.
    """
    problems, places = [], part.part.places()
    for index in entries:
        entry = part.part.orthogonality[index]
        for kind, ids, axes in (("row", entry.row, (0, 1)), ("column", entry.column, (1, 0))):
            line = np.array([[places[i][axis] for axis in axes] for i in ids], np.float64)
            u, v = (line - line.mean(axis=0)).T
            b1 = float(slope((u[:, None], v[:, None]))[0])
            if abs(b1) <= LARGEST_SLOPE:
                continue
            axis, most = "xy"[axes[0]], np.degrees(np.arctan(LARGEST_SLOPE))
            degrees = 90.0 if np.isnan(b1) else float(np.degrees(np.arctan(b1)))
            problems.append(
                finding(
                    "contradicts",
                    other=f"the nominal places: {entry.id!r} runs {degrees:.3g} degrees off {axis}",
                    **part.place("orthogonality", index, kind),
                    expected=f"features in a line along {axis}, seen in the plane of x and y, at "
                    f"most {most:.2g} degrees off",
                )
            )
    if problems:
        raise InputError(problems)


ROUNDING = 1e-12
"""Share of the largest below which a singular value is rounding."""


class AngleTrials(PointTrials):
    """A Monte Carlo model of one angle, of half as many normals as all errors have.

    dtheta = -w'v + what it is by design, w = (u_r/u_r'u_r, u_c/u_c'u_c), with the coordinates u
    along and v across the row and the column: Gilsinn & Ling 2004, eqs. (24)-(26). They are jointly
    normal; so, given u, is v, with expectation v_0 + K z, z the normals behind u, and covariance V.
    dtheta is linear in v: given u it is normal too, with

        expectation -w'(v_0 + K z) and variance w'V w.

    So a trial draws z and one normal for all of v, whose variance is of squares of u, once V within
    a line is diagonal, and of what both lines share. Where the degrees of freedom are finite all
    normals of a trial are scaled alike, as in `PointTrials`, whose own `draw` lays the lines
    through all errors. The first-order form, the control variate, has its own distribution exactly;
    it is drawn from the same z and, for its share in v, the same last normal.
    """

    def __init__(
        self,
        prediction: Prediction,
        name: str,
        row: Sequence[str],
        column: Sequence[str],
        *,
        independent: bool,
    ) -> None:
        """The angle of the features `row` and `column`; one in both is drawn once.

        A slope is sum (u - mean u)(v - mean v) / sum (u - mean u)^2, the same of n - 1 orthonormal
        contrasts H (n - 1, n) of the coordinates (H 1 = 0, H H' = 1) as of the n coordinates less
        their mean, with one direction fewer to draw. Of b = u'v/u'u it is db/dv = u/u'u and db/du =
        (v - 2 b u)/u'u.
        """
        from scipy.linalg import helmert

        of_row, of_column = ([prediction.ids.index(i) for i in ids] for ids in (row, column))
        places, index = prediction.points.T, prediction.axes.index
        every = np.eye(len(prediction.mean)).reshape(len(places.T), -1, len(prediction.mean))
        combine, design = [], []
        for line, axis in ((of_row, "x"), (of_row, "y"), (of_column, "y"), (of_column, "x")):
            H = helmert(len(line))
            combine.append(H @ every[line, index(axis)])
            design.append(H @ places[AXES.index(axis), line])
        combined, nominal = np.vstack(combine), np.concatenate(design)
        ends = np.cumsum([len(x) for x in design])[:-1]
        u_r, v_r, u_c, v_c = (x[:, None] for x in design)
        lines = (u_r, v_r), (u_c, v_c)

        def measure(errors: FloatArray) -> FloatArray:
            u_r, v_r, u_c, v_c = np.split(errors + nominal[:, None], ends)
            return angle_error(((u_r, v_r), (u_c, v_c)), lines)[None, :]

        falling = []
        placed = np.split(combined @ prediction.mean + nominal, ends)
        for u, v in (placed[:2], placed[2:]):
            square = u @ u
            falling += [(v - 2 * (u @ v) / square * u) / square, u / square]
        gradient = -(np.concatenate(falling) @ combined)[None, :]
        self.variance = None if independent else prediction.variance(gradient)
        owner = np.zeros(len(nominal), np.int64)
        super().__init__(prediction, (name,), measure, combined, owner, gradient, self.variance)
        self.square = float(slope(lines[0])[0] + slope(lines[1])[0])
        at = np.split(np.arange(self.k), ends)
        order = np.concatenate([at[0], at[2], [self.k], at[1], at[3]])
        means = self.offset + np.append(nominal, 0.0)[:, None]
        self._reduce(self.factor[order], means[order], len(u_r))

    def _reduce(self, factor: FloatArray, means: FloatArray, of_row: int) -> None:
        """The product that draws u, the first-order form and v, which `factor` and `means` (2 n +
        1, ...) are of, and what is made of it. Directions within a line are those of the
        eigenvectors of its part of V: w'V w becomes eigenvalues times squares, and what both
        lines share.
        """
        n = len(factor) // 2
        _, size, normals = np.linalg.svd(factor[:n], full_matrices=False)
        least = ROUNDING * size.max(initial=0.0)
        normals = normals[size > least]
        by_z = factor @ normals.T
        rest = (factor - by_z @ normals)[n:]
        last = np.zeros_like(means)
        last[n] = np.linalg.norm(rest[0])
        # The means are part of the product: this saves a pass over the array.
        product = np.hstack([by_z, last, means])
        self.of_lines, self.lines = np.zeros((4, n)), (slice(of_row), slice(of_row, n))
        v_rest, u, v = rest[1:], product[:n], product[n + 1 :]
        for i, line in enumerate(self.lines):
            d, Q = np.linalg.eigh(v_rest[line] @ v_rest[line].T)
            for rows in (u, v, v_rest):
                rows[line] = Q.T @ rows[line]
            self.of_lines[[i, 2 + i], line] = np.ones(len(d)), d
        row, column = self.lines
        self.twice_shared = 2.0 * v_rest[row] @ v_rest[column].T
        # Of errors that are all independent v has no part in z: u'v needs no v that is drawn.
        self.v_fixed = bool(np.abs(by_z[n + 1 :]).max(initial=0.0) <= least)
        if self.v_fixed:
            v = np.array([v[line, -1] @ u[line] for line in self.lines])
        self.n, self.product = n, np.vstack([product[: n + 1], v])

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        """Values and first-order values (1, m)."""
        n, (drawn, columns) = self.n, self.product.shape
        z = self.work.array("z", (columns, m))
        rng.standard_normal(out=z[:-1])
        if np.isfinite(self.linear_dof[0]):
            z[:-1] *= t_scales(float(self.linear_dof[0]), rng, self.work.array("scale", (m,)))
        z[-1] = 1.0
        rows = np.matmul(self.product, z, out=self.work.array("rows", (drawn, m)))
        u, linear, along = rows[:n], rows[n : n + 1], rows[n + 1 :]
        if not self.v_fixed:
            along = np.array([np.einsum("ij,ij->j", u[x], along[x]) for x in self.lines])
        if shared := bool(self.twice_shared.any()):
            row, column = self.lines
            both = np.einsum("ij,ij->j", u[row], self.twice_shared @ u[column])
        squares = np.multiply(u, u, out=u)
        of_lines = np.matmul(self.of_lines, squares, out=self.work.array("of_lines", (4, m)))
        inverse, spread = of_lines[:2], of_lines[2:]
        values = self.work.array("values", (1, m))
        # A line of no length has no direction: its trials are not finite, which is counted.
        with np.errstate(divide="ignore", invalid="ignore"):
            np.divide(1.0, inverse, out=inverse)
            along *= inverse
            spread *= inverse
            spread *= inverse
            np.add(spread[0], spread[1], out=values[0])
            if shared:
                both *= inverse[0]
                both *= inverse[1]
                values += both
            np.sqrt(np.maximum(values, 0.0, out=values), out=values)
            values *= z[-2]
            values -= along[0]
            values -= along[1]
        values += self.square
        return Draws(values=values, linear=linear)
