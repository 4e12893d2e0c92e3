"""Lengths and right angles as functions of the errors, and an angle's own Monte Carlo."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import InputError, error, finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.trials import Measure, PointTrials
from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.least_squares import FloatArray, IntArray
from mtu_cli.stats.workspace import Workspace


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
    for row, (start, end), direction in zip(gradient, pairs, unit, strict=True):
        row[start] -= direction
        row[end] += direction
    return gradient.reshape(len(pairs), -1)


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

    def measure(differences: FloatArray, work: Workspace) -> FloatArray:
        return length_error(L0, along, differences.reshape(a, m, -1))

    return measure, combine


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
    found: FloatArray = np.full_like(squares, np.nan)
    np.divide(np.einsum("pm,pm->m", u, v), squares, out=found, where=squares > 0)
    return found


def angle_error(placed: tuple[Line, Line], nominal: tuple[Line, Line]) -> FloatArray:
    """dtheta (m,), rad, of a row and a column, less what it is by design.

    dtheta = -b1(column) - b1(row), Gilsinn & Ling 2004, eqs. (24)-(26). Rows and columns that
    are not quite square by design have no error for it.
    """
    found: FloatArray = -(slope(placed[0]) + slope(placed[1]))
    return found + (slope(nominal[0]) + slope(nominal[1]))


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
            found = float(slope((u[:, None], v[:, None]))[0])
            if abs(found) <= LARGEST_SLOPE:
                continue
            axis, most = "xy"[axes[0]], np.degrees(np.arctan(LARGEST_SLOPE))
            degrees = 90.0 if np.isnan(found) else float(np.degrees(np.arctan(found)))
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
"""Share of the largest below which a singular value or a product is rounding."""
PIECE = 8192
"""Trials at a time: all that is known of them stays in the processor's cache."""


class _Line(NamedTuple):
    """What one line needs of the normals of a trial: `matrix` times rows `uses` of them.

    The first `k` rows of the product are the coordinates u along the line. Then follows the
    expectation of u'v given u: as one row where the expected v are the same in every trial
    (`fixed`), else as the k expected v. The next `spreads` rows are L'u. The last row is the
    line's part of the first-order form.

    Where L'w has no part that belongs to both lines there are no rows of it: the coordinates are
    turned to the principal axes of L L', and `sums` (2, k) times their squares are u'u and |L'u|^2.
    """

    matrix: FloatArray
    uses: slice
    k: int
    spreads: int
    fixed: bool
    sums: FloatArray


class AngleTrials(PointTrials):
    """A Monte Carlo model of one angle, distributed as that of `plain` to rounding.

    dtheta = -u_r'v_r/u_r'u_r - u_c'v_c/u_c'u_c, Gilsinn & Ling 2004, eqs. (24)-(26), with the
    coordinates u along and v across the row and the column. They are jointly normal; so, given
    all u, are the v, with expectation v_0 + K u and covariance L L'. dtheta is linear in v:
    given u it is normal too, with

        expectation -w'(v_0 + K u) and standard deviation |L'w|,  w = (u_r/u_r'u_r, u_c/u_c'u_c).

    So a trial draws the normals behind u and one for all of v. Where the degrees of freedom are
    finite all normals of a trial are scaled alike, as in `plain` (JCGM 101:2008, 6.4.9).

    The first-order form, the control variate, has its own distribution exactly; it is drawn from
    the same u and, for its share in v, the same last normal.
    """

    in_pieces = True

    def __init__(self, plain: PointTrials, lines: tuple[FloatArray, ...]) -> None:
        """`plain` draws the errors of u_r, v_r, u_c, v_c; `lines` are these by design, (k, 1)."""
        self.__dict__.update(plain.__dict__)
        self.work = Workspace()
        u_r, v_r, u_c, v_c = (item[:, 0] for item in lines)
        self.square = float(u_r @ v_r / (u_r @ u_r) + u_c @ v_c / (u_c @ u_c))
        ends = np.cumsum([len(item) for item in lines])
        *factors, of_linear = np.split(plain.factor, ends)
        *errors, first_order = np.split(plain.offset[:, 0], ends)
        mean = [a[:, 0] + b for a, b in zip(lines, errors, strict=True)]
        # Bases of the normals behind u, and of those behind v that u leaves open.
        W, self.at = _bases(factors[0], factors[2])
        self.drawn = len(W)
        left = [_without(factors[i], W) for i in (1, 3)]
        V, of_row = _bases(*left)
        L_r, L_c = (_seen(item, V) for item in left)
        self.shared = of_row if np.any(L_c[:, :of_row]) else 0
        linear = np.insert(of_linear @ W.T, self.at, first_order, axis=1)
        self.rest = float(np.linalg.norm(_without(of_linear, W)))
        # The row's part of the first-order form, and the column's with the constant.
        own = np.arange(len(W) + 1) < self.at
        parts = np.where(own, linear, 0.0), np.where(own, 0.0, linear)
        shared = bool(self.shared)
        self.row = _line(factors[:2], mean[:2], W, self.at, L_r[:, :of_row], shared, parts[0])
        self.column = _line(factors[2:], mean[2:], W, self.at, L_c, shared, parts[1])

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        """Values and first-order values (1, m)."""
        values = self.work.array("values", (1, m))
        linear = self.work.array("linear", (1, m))
        pieces = max(1, round(m / PIECE))
        for i in range(pieces):
            piece = slice(m * i // pieces, m * (i + 1) // pieces)
            self._draw(rng, values[0, piece], linear[0, piece])
        return Draws(values=values, linear=linear)

    def _draw(self, rng: np.random.Generator, values: FloatArray, linear: FloatArray) -> None:
        z = self._normals(rng, len(values))
        np.multiply(z[-1], self.rest, out=linear)
        # A line of no length has no direction: its trials are not finite, which is counted.
        with np.errstate(divide="ignore", invalid="ignore"):
            expected, of_row = self._slope("row", self.row, z, linear)
            slope, of_column = self._slope("column", self.column, z, linear)
            # |L'w|^2 (m,).
            spread = of_row
            if self.shared:
                of_column[: self.shared] += of_row
                spread = np.einsum("ij,ij->j", of_column, of_column)
            else:
                spread += of_column
        expected += slope
        expected -= self.square
        np.sqrt(spread, out=values)
        values *= z[-1]
        values -= expected

    def _normals(self, rng: np.random.Generator, m: int) -> FloatArray:
        """Those of the row, ones, those of the column and the last, scaled to Student's t."""
        z = self.work.array("z", (self.drawn + 2, m))
        rng.standard_normal(out=z[: self.at])
        z[self.at] = 1.0
        rng.standard_normal(out=z[self.at + 1 :])
        if np.isfinite(self.linear_dof[0]):
            # sqrt(dof/chi^2) (m,): normals times it are Student's t.
            half, scale = self.linear_dof[0] / 2, self.work.array("scale", (m,))
            rng.standard_gamma(half, out=scale)
            np.divide(half, scale, out=scale)
            np.sqrt(scale, out=scale)
            z[: self.at] *= scale
            z[self.at + 1 :] *= scale
        return z

    def _slope(
        self, name: str, line: _Line, z: FloatArray, linear: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The slope b1 expected given u (m,), and L'w (spreads, m) or |L'w|^2 (m,); the line's part
        of the first-order form is added to `linear`.
        """
        rows = self.work.array(name, (len(line.matrix), z.shape[1]))
        np.matmul(line.matrix, z[line.uses], out=rows)
        linear += rows[-1]
        u, expected = rows[: line.k], rows[line.k]
        last = len(rows) - 1 - line.spreads
        if not line.fixed:
            np.einsum("ij,ij->j", u, rows[line.k : last], out=expected)
        np.multiply(u, u, out=u)
        sums = self.work.array(f"sums {name}", (len(line.sums), u.shape[1]))
        np.matmul(line.sums, u, out=sums)
        inverse = np.divide(1.0, sums[0], out=sums[0])
        expected *= inverse
        spread = rows[last:-1]
        if not line.spreads:
            spread = sums[1]
            spread *= inverse
        spread *= inverse
        return expected, spread


def _line(
    factors: list[FloatArray],
    mean: list[FloatArray],
    W: FloatArray,
    at: int,
    L: FloatArray,
    shared: bool,
    linear: FloatArray,
) -> _Line:
    """`factors`, `mean`: of the coordinates along and across; `linear` (1, r + 1)."""
    sums = np.ones((1, len(L)))
    if not shared:
        axes, values, _ = np.linalg.svd(L)
        factors, mean = [axes.T @ item for item in factors], [axes.T @ item for item in mean]
        variances = np.zeros((1, len(L)))
        variances[0, : len(values)] = values**2
        sums, L = np.vstack([sums, variances]), np.zeros((len(L), 0))
    # The means ride along as a column before number `at`.
    u, K = np.insert(_seen(factors[0], W), at, mean[0], axis=1), _seen(factors[1], W)
    fixed = not np.any(K)
    expected = mean[1][None, :] @ u if fixed else np.insert(K, at, mean[1], axis=1)
    matrix = np.vstack([u, expected, L.T @ u, linear])
    # A line depends on the other's normals only where their errors are correlated: else half
    # of the product would be zeros.
    used = np.flatnonzero(np.any(matrix != 0.0, axis=0))
    uses = slice(int(used[0]), int(used[-1]) + 1) if len(used) else slice(at, at + 1)
    return _Line(np.ascontiguousarray(matrix[:, uses]), uses, len(u), L.shape[1], fixed, sums)


def _bases(first: FloatArray, second: FloatArray) -> tuple[FloatArray, int]:
    """Orthonormal rows that span those of both, those of `first` before the others; how many."""
    found, counts = np.zeros((0, first.shape[1])), []
    for rows in (first, second):
        _, values, vectors = np.linalg.svd(_without(rows, found), full_matrices=False)
        found = np.vstack([found, vectors[values > ROUNDING * np.linalg.norm(rows)]])
        counts.append(len(found))
    return found, counts[0]


def _without(rows: FloatArray, basis: FloatArray) -> FloatArray:
    """What is left of rows (n, rank) beside the orthonormal `basis`."""
    return rows - (rows @ basis.T) @ basis


def _seen(rows: FloatArray, basis: FloatArray) -> FloatArray:
    """Components (n, len(basis)) of rows, rounding left out."""
    found = rows @ basis.T
    found[np.abs(found) <= ROUNDING * np.linalg.norm(rows)] = 0.0
    return found
