"""Lengths and right angles as functions of the errors, and a Monte Carlo model of an angle."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import InputError, error, finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.trials import Measure, PointTrials
from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.distributions import t_scales
from mtu_cli.stats.least_squares import FloatArray, IntArray


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


def length_gradient(prediction: Prediction, pairs: IntArray, delta: FloatArray) -> FloatArray:
    """dL/dE (lengths, rows): minus and plus the nominal unit vector, eq. (22)."""
    unit = _along(prediction, delta / np.linalg.norm(delta, axis=1)[:, None])
    gradient = np.zeros((len(pairs), len(prediction.points), len(prediction.axes)))
    each = np.arange(len(pairs))
    gradient[each, pairs[:, 0]] -= unit
    gradient[each, pairs[:, 1]] += unit
    return gradient.reshape(len(pairs), len(prediction.mean))


def _along(prediction: Prediction, delta: FloatArray) -> FloatArray:
    """(lengths, axes) of vectors (lengths, 3) along the prediction's axes."""
    return delta[:, [AXES.index(axis) for axis in prediction.axes]]


def length_measure(
    prediction: Prediction, pairs: IntArray, delta: FloatArray
) -> tuple[Measure, FloatArray]:
    """Length minus nominal, eqs. (20)-(21), and the differences of errors that it needs.

    The sum runs over the prediction's axes: an axis without equation has no error.
    """
    a, m = len(prediction.axes), len(pairs)
    L0, along = np.linalg.norm(delta, axis=1), _along(prediction, delta)
    of_axis = np.eye(len(prediction.mean)).reshape(-1, a, len(prediction.mean))
    combine = np.concatenate([of_axis[pairs[:, 1], j] - of_axis[pairs[:, 0], j] for j in range(a)])
    return lambda errors: length_error(L0, along, errors.reshape(a, m, -1)), combine


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


def contrasts(n: int) -> FloatArray:
    """H (n - 1, n), Helmert's orthonormal contrasts: H 1 = 0, H H' = 1.

    Hu'Hv = sum (u - mean u)(v - mean v), with one direction fewer to draw.
    """
    k = np.arange(1, n)[:, None]
    i = np.arange(n)[None, :]
    return np.where(i < k, 1.0, np.where(i == k, -k, 0.0)) / np.sqrt(k * (k + 1))


def slope(line: Line) -> FloatArray:
    """b1 = sum u v / sum u u (m,) of the least-squares line; nan where u does not vary."""
    u, v = line
    squares = np.einsum("pm,pm->m", u, u)
    result: FloatArray = np.full_like(squares, np.nan)
    np.divide(np.einsum("pm,pm->m", u, v), squares, out=result, where=squares > 0)
    return result


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
                    file=part.source.shown,
                    line=part.line_of("orthogonality", index, kind),
                    path=f"orthogonality[{index}].{kind}",
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
        contrasts of the coordinates as of the n coordinates less their mean. Of b = u'v/u'u it is
        db/dv = u/u'u and db/du = (v - 2 b u)/u'u.
        """
        of_row, of_column = ([prediction.ids.index(i) for i in ids] for ids in (row, column))
        places, index = prediction.points.T, prediction.axes.index
        every = np.eye(len(prediction.mean)).reshape(len(places.T), -1, len(prediction.mean))
        combine, design = [], []
        for line, axis in ((of_row, "x"), (of_row, "y"), (of_column, "y"), (of_column, "x")):
            H = contrasts(len(line))
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
