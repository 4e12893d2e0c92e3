"""Components of variance of grouped readings: passes with random intercept and slope.

The model of one error component read in G passes is

    y_gi = x_i' b + z_i' d_g + e_gi,    d_g ~ N(0, D),    e_gi ~ N(0, s_repeat^2),

with x = [1, p, p^2, ...] and z = [1, p - c], c the mean position. D is the pass-to-pass
covariance, K that of the two passes of a run there and back, s_repeat the repeatability. They
are estimated from mean squares, whose distributions are known exactly on a balanced design:
within passes (nu_w degrees of freedom) and between the passes' own coefficients (nu_b). See
Searle, Casella & McCulloch, Variance Components (1992), ch. 4, for the moment equations.

Passes there and back: the axis is as warm on its way back as it was on its way there. With f_r
there and g_r back, the deviations of level and slope of run r = 1 .. P from the mean of their
direction, m_r = (f_r + g_r)/2 and h_r = (f_r - g_r)/2 have independent mean squares S_m and S_h of
P - 1 degrees of freedom each. Then S = S_m + S_h is the mean square of single passes,
K = S_m - S_h the covariance of the two of a run, S_m/P that of the mean of all, whose passes are
independent only where K = 0 (the split-plot analysis with runs as whole plots: Box, Hunter &
Hunter, Statistics for Experimenters, 9.1).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mtu_cli.stats.covariance import as_covariance, bounded, positive_part
from mtu_cli.stats.groups import group_least
from mtu_cli.stats.least_squares import (
    RANK_TOLERANCE,
    BoolArray,
    FloatArray,
    IntArray,
    LeastSquares,
    least_squares,
    polynomial,
)

ROUNDING = 1e-12
"""Share of the terms of a sum below which it is rounding."""
ARITHMETIC = 32 * float(np.finfo(np.float64).eps)
"""Scatter below this share of the largest reading is arithmetic, not measurement."""
FEWEST_ROUNDINGS = 32
"""Operations, each rounded, between a reading and a figure, if it is never summed."""
FEW_PASSES = 3
"""Below so many degrees of freedom between passes D is never taken as negative."""
FEWEST_RUNS = 2
"""One run has nothing to differ from."""
OWN_SLOPE_SPAN = 0.3
"""A pass over less than this share of the measured range has no slope of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PassFit:
    """The mixed model of one component; q = 2 random columns with an axis, 1 without.

    `plain` is the ordinary least-squares fit of all readings as repeats (Gilsinn & Ling 2004,
    eqs. (5)-(11)). `covariance` (k, k) is that of its coefficients under the mixed model, `D`
    (q, q) the pass-to-pass covariance at `center`, `D_moment` the same before its negative part is
    set to zero, the unbiased estimate; `s2` the repeatability variance, of `within_dof`.
    `between` (q, q) is the mean square of the passes' own coefficients, of `pass_dof`. `pairs`
    (P, 2) are the passes there and back of P runs, of which `half_differences` (q, q) is the mean
    square S_h, None of fewer than two: the units that were repeated are then the runs.
    `pass_coefficients` (G, q) are the passes' own intercepts (at the centre) and slopes,
    `deviations` (G, q) the same less their mean by direction, whose squares are divided by
    `divisor` for `between`. `separated` is False where the data cannot tell D from s2.
    `pooled_rss` with `pooled_dof` is the residual sum of squares of one line a direction.
    `rounding` is what sums of the readings may be off by arithmetic alone.
    """

    plain: LeastSquares
    covariance: FloatArray
    center: float
    s2: float
    D: FloatArray
    D_moment: FloatArray
    between: FloatArray
    within_dof: int
    within_rss: float
    groups: IntArray
    group_direction: FloatArray
    pass_coefficients: FloatArray
    deviations: FloatArray
    pooled_rss: float
    pooled_dof: int
    rounding: float
    separated: bool = False
    pass_dof: int = 0
    divisor: int = 0
    pairs: IntArray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    half_differences: FloatArray | None = None

    @property
    def n_passes(self) -> int:
        """Number of passes G."""
        return len(self.groups)


def fit_passes(
    y: FloatArray,
    position: FloatArray,
    degree: int,
    group: IntArray | None = None,
    direction: FloatArray | None = None,
    runs: IntArray | None = None,
) -> PassFit:
    """Fits one component; all arrays are (n,), in internal units and mm. `group` is the pass of
    each reading (None: not known), `direction` +1, -1 or 0 (not given), `runs` the run there and
    back that it is of (None: all passes are independent); both are constant within a pass. With
    three passes or more direction is a fixed effect of their coefficients, so that reversal does
    not enter D. Without an axis, give degree 0. Where the passes differ in what no pass determines
    by itself (single readings along an axis), D is not separated.
    """
    plain = least_squares(polynomial(position, degree), y)
    center, q = float(position.mean()), min(2, degree + 1)
    design = None
    if group is not None:
        design = _pass_design(position, center, degree, group, direction, runs)
    # A sum of n numbers is rounded n times, by half of the spacing of numbers of its size each.
    rounding = max(len(y), FEWEST_ROUNDINGS) * float(np.spacing(np.abs(y).max(initial=0.0)))
    # One pass, or none known: all scatter counts as repeatability.
    nothing, empty = np.zeros((q, q)), np.zeros((0, q))
    single = PassFit(
        plain=plain,
        covariance=plain.s2 * plain.unscaled_covariance,
        center=center,
        s2=plain.s2,
        D=nothing,
        D_moment=nothing,
        between=nothing,
        within_dof=plain.dof,
        within_rss=plain.rss,
        groups=np.zeros(0, np.int64) if design is None else design.ids,
        group_direction=np.zeros(0) if design is None else design.sign,
        pass_coefficients=empty,
        deviations=empty,
        pooled_rss=plain.rss,
        pooled_dof=plain.dof,
        rounding=rounding,
    )
    return single if design is None or design.dof <= 0 else _separated(y, design, single)


def _separated(y: FloatArray, design: _PassDesign, single: PassFit) -> PassFit:
    """Pass-to-pass scatter beside repeatability; `single` where the readings cannot."""
    rows, G = design.rows, len(design.ids)
    Z, common = design.Z[rows], design.X[rows, design.Z.shape[1] :]
    lines = _between_lines(y[rows], Z, common, design.row_codes, design.fixed)
    if lines is None:
        return single
    coefficients, deviations, between, M, rss, dof = lines
    s2 = rss / max(dof, 1)
    within, D = s2 * M, positive_part(between, M, s2)
    # Two or three may agree by chance far better than repeatability allows: D is not negative.
    moment = D if design.dof < FEW_PASSES else between - within
    K = covariance_in_runs(deviations, design.pairs, between)
    halves = None
    if len(design.pairs) >= FEWEST_RUNS:
        # Passes without a fellow have no covariance: over all of them it is so much less. Where
        # both passes of every run differ by the same it is 0, which rounding may make negative.
        halves = as_covariance((moment + within - 2 * len(design.pairs) / G * K) / 2)
    # One line a direction takes all passes of it as one.
    by_direction = [Z * column[design.row_codes, None] for column in design.fixed.T]
    pooled = least_squares(np.column_stack([*by_direction, common]), y[rows])
    choices = ((moment, K), (D, K), (D, bounded(K, D)))
    return replace(
        single,
        covariance=_coefficient_covariance(single.plain, design, s2, choices),
        s2=s2,
        D=D,
        D_moment=moment,
        between=between,
        pass_dof=design.dof,
        within_dof=dof,
        within_rss=rss,
        separated=True,
        pass_coefficients=coefficients,
        deviations=deviations,
        divisor=G - design.fixed.shape[1],
        pairs=design.pairs,
        half_differences=halves,
        pooled_rss=pooled.rss,
        pooled_dof=pooled.dof,
    )


def _coefficient_covariance(
    plain: LeastSquares,
    design: _PassDesign,
    s2: float,
    choices: Iterable[tuple[FloatArray, FloatArray]],
) -> FloatArray:
    """Covariance of plain least squares under V = s2 I + Z D Z' by pass, Z K Z' within a run,
    (X'X)^-1 X' V X (X'X)^-1; on a balanced design the between mean square over G, or that of the
    runs' means over their number. The first of the `choices` of D and K, the unclipped, keeps it
    unbiased; the clipped D, and then a K within it, stand in only where the result is no
    covariance.
    """
    inverse = plain.unscaled_covariance
    A = inverse @ _products(design.X, design.Z, design.codes, int(design.codes.max()) + 1)
    there, back = A[design.all_pairs.T]
    for D, K in choices:
        of_runs = 2 * np.einsum("gij,jk,glk->il", there, K, back)
        total: FloatArray = s2 * inverse + np.einsum("gij,jk,glk->il", A, D, A) + of_runs
        total = (total + total.T) / 2
        sizes = s2 * np.diag(inverse) + np.einsum("gij,jk,gik->i", *map(np.abs, (A, D, A)))
        # What the passes do not scatter in is 0, not the rounding of sums that cancel.
        still = np.abs(np.diag(total)) <= ROUNDING * sizes
        total[still] = total[:, still] = 0.0
        scale = np.sqrt(np.abs(np.diag(total)))
        scale[scale == 0] = 1.0
        if np.linalg.eigvalsh(total / np.outer(scale, scale)).min() >= -1e-9:
            break
    return total


class _PassDesign(NamedTuple):
    """Columns X (n, k) and Z (n, q) of all readings, and the passes that determine all of Z.

    Passes that broke off early have no slope: they count in the coefficients and their
    covariance, but not in the scatter of slopes. `codes` (n,) are the passes of all readings,
    `all_pairs` (P, 2) those there and back; `rows` (n,) the readings of passes that determine Z;
    `row_codes` (rows,) number those passes, `ids` and `sign` (G,) are theirs, `pairs` those of them
    there and back, `fixed` (G, 1 or 2) the columns of direction: 1, and +-1/2 where both were read;
    `dof` are the degrees of freedom of the scatter between them.
    """

    X: FloatArray
    Z: FloatArray
    codes: IntArray
    all_pairs: IntArray
    rows: BoolArray
    row_codes: IntArray
    ids: IntArray
    sign: FloatArray
    pairs: IntArray
    fixed: FloatArray
    dof: int


def _pass_design(
    position: FloatArray,
    center: float,
    degree: int,
    group: IntArray,
    direction: FloatArray | None,
    runs: IntArray | None,
) -> _PassDesign:
    """The columns of readings at `position` (n,), the other arguments as `fit_passes` has them.

    Passes have a slope of their own where most of them, three or more, span enough of the range.
    """
    ids, first, codes = np.unique(group, return_index=True, return_inverse=True)
    G = len(ids)
    low, high = group_least(position, codes, G), -group_least(-position, codes, G)
    whole = high - low > OWN_SLOPE_SPAN * float(np.ptp(position))
    sloped = degree >= 1 and (whole.all() or (whole.sum() >= 3 and whole.mean() > 0.5))
    if not sloped:
        whole = np.ones(G, bool)
    rows = whole[codes]
    sign = np.zeros(G) if direction is None else direction[first]
    run = np.arange(G) if runs is None else runs[first]
    signs = sign[whole]
    fixed = np.ones((len(signs), 1))
    if (signs > 0).any() and (signs < 0).any() and len(signs) > 2:
        fixed = np.column_stack([fixed, signs / 2])
    pairs = pairs_of(run[whole], signs)
    dof = len(signs) - fixed.shape[1]
    if len(pairs) >= FEWEST_RUNS:
        # Runs are the units. The two passes of a single run differ by S_h at least: independent.
        dof = min(dof, len(signs) - len(pairs) - 1)
    return _PassDesign(
        X=polynomial(position, degree),
        Z=polynomial(position - center, int(sloped)),
        codes=codes,
        all_pairs=pairs_of(run, sign),
        rows=rows,
        row_codes=(np.cumsum(whole) - 1)[codes[rows]],
        ids=ids[whole].astype(np.int64),
        sign=signs,
        pairs=pairs,
        fixed=fixed,
        dof=dof,
    )


def _between_lines(
    y: FloatArray, Z: FloatArray, common: FloatArray, codes: IntArray, fixed: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float, int] | None:
    """Lines of the passes `codes` over Z, with the higher powers `common` to all of them, compared:
    the passes' own coefficients (G, q) less the common powers, their deviations (G, q) from the
    mean by direction and mean square S (q, q), E S = D + s2 M, M, and the rss and dof of s2.

    The common columns and y are first freed from every pass's own line (Frisch-Waugh), so that
    nothing larger than the readings is ever formed. M holds the error of each pass's own line and
    what the error of the common powers carries into lines over different positions. None where
    these are not determined within passes but needed to compare them.
    """
    G, k = len(fixed), common.shape[1]
    lines, residual = lines_by_pass(np.column_stack([common, y]), Z, codes, G)
    # What the lines took out whole would come back as a column of rounding errors.
    absorbed = np.linalg.norm(residual[:, :k], axis=0) <= 1e-10 * np.linalg.norm(common, axis=0)
    residual[:, :k][:, absorbed] = 0.0
    shared = least_squares(residual[:, :k], residual[:, k])
    rounding = len(y) * float(ARITHMETIC * np.abs(y).max()) ** 2
    dof = len(y) - G * Z.shape[1] - shared.rank
    # Residuals of the passes' lines on `fixed`, without a matrix of all by all of them.
    by_fixed = np.linalg.solve(fixed.T @ fixed, fixed.T)
    coefficients = lines[:, :, k] - lines[:, :, :k] @ shared.coefficients
    deviations = coefficients - fixed @ (by_fixed @ coefficients)
    means = np.einsum("fg,gia->fia", by_fixed, lines[:, :, :k])
    carried = lines[:, :, :k] - np.einsum("gf,fia->gia", fixed, means)
    null, most = shared.null_space, np.abs(lines[:, :, :k]).max(axis=0)
    if (np.abs(carried @ null) > 1e-9 * (most @ np.abs(null))).any():
        return None
    precisions = _products(Z, Z, codes, G)
    redundancy = 1.0 - np.einsum("gf,fg->g", fixed, by_fixed)
    of_lines = np.einsum("g,gij->ij", redundancy, np.linalg.inv(precisions))
    of_powers = np.einsum("gia,ab,gjb->ij", carried, shared.unscaled_covariance, carried)
    if np.einsum("gi,gij,gj->", deviations, precisions, deviations) <= rounding:
        deviations = np.zeros_like(deviations)
    # One reading a pass: nothing repeats within it, all scatter is pass-to-pass.
    rss = shared.rss if dof > 0 and shared.rss > rounding else 0.0
    S, M = (
        square / (G - fixed.shape[1])
        for square in (deviations.T @ deviations, of_lines + of_powers)
    )
    return coefficients, deviations, S, M, rss, max(dof, 0)


def _products(A: FloatArray, B: FloatArray, codes: IntArray, G: int) -> FloatArray:
    """A_g'B_g (G, a, b) of the rows of every pass."""
    products = np.empty((G, A.shape[1], B.shape[1]))
    for i in range(A.shape[1]):
        for j in range(B.shape[1]):
            products[:, i, j] = np.bincount(codes, A[:, i] * B[:, j], G)
    return products


def lines_by_pass(
    columns: FloatArray, Z: FloatArray, codes: IntArray, G: int
) -> tuple[FloatArray, FloatArray]:
    """Least-squares lines (G, q, m) of the columns (n, m) in every pass, and what they leave.

    Z (n, q) is [1] or [1, z], `codes` (n,) are the passes 0 to G - 1, none of them empty. Level at
    the pass's own mean z and slope are apart: both come in closed form, for all passes at once. A
    pass of one z has slope 0.
    """
    order = np.argsort(codes, kind="stable")
    starts = np.searchsorted(codes[order], np.arange(G))

    def sums(values: FloatArray) -> FloatArray:
        return np.add.reduceat(values[order], starts, axis=0)

    counts = np.bincount(codes, minlength=G)[:, None]
    level = sums(columns) / counts
    rest = columns - level[codes]
    if Z.shape[1] == 1:
        return level[:, None], rest
    z = Z[:, 1:]
    middle = sums(z) / counts
    t = z - middle[codes]
    square = sums(t * t)
    varies = square > RANK_TOLERANCE**2 * sums(z * z)
    slope = sums(t * rest) * np.divide(1.0, square, out=np.zeros_like(square), where=varies)
    rest -= t * slope[codes]
    return np.stack([level - middle * slope, slope], axis=1), rest


def pairs_of(runs: IntArray, sign: FloatArray) -> IntArray:
    """(P, 2) the pass there and the pass back of every run (`runs` (G,), directions `sign` (G,))
    that has one of each; of several passes one way the last there and the first back.
    """
    order = np.lexsort([-sign, runs])
    first, second = order[:-1], order[1:]
    valid = (runs[first] == runs[second]) & (sign[first] > 0) & (sign[second] < 0)
    return np.column_stack([first[valid], second[valid]]).astype(np.int64)


def covariance_in_runs(deviations: FloatArray, pairs: IntArray, between: FloatArray) -> FloatArray:
    """K (q, q), the covariance of the passes there and back of a run, from their `deviations`
    (G, q) and the mean square S = `between` of all; 0 of fewer than two runs.

    Where some passes have no fellow S is not of the same passes: K then stays within -S and S.
    """
    q = deviations.shape[1]
    if len(pairs) < FEWEST_RUNS:
        return np.zeros((q, q))
    there, back = (passes - passes.mean(axis=0) for passes in (deviations[way] for way in pairs.T))
    product = there.T @ back / (len(pairs) - 1)
    K: FloatArray = (product + product.T) / 2
    return K if 2 * len(pairs) == len(deviations) else bounded(K, between)


def joint_passes(
    fits: Sequence[PassFit], T: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """What the same G passes of several components have in common, by T (K, sum q) from levels and
    slopes to the coefficients of all: the covariance (K, K) of these between components, D and S_h
    of all; S_h None where passes are independent.
    """
    from scipy.linalg import block_diag

    n, pairs = fits[0].n_passes, fits[0].pairs
    deviations = np.column_stack([fit.deviations for fit in fits])
    S = deviations.T @ deviations / fits[0].divisor
    K = 2 * len(pairs) / n * covariance_in_runs(deviations, pairs, S)
    inside = block_diag(*(np.ones_like(fit.D) for fit in fits)) > 0
    off, off_runs = np.where(inside, 0.0, S), np.where(inside, 0.0, K)
    D = T @ (block_diag(*(fit.D_moment for fit in fits)) + off) @ T.T
    halves = [fit.half_differences for fit in fits if fit.half_differences is not None]
    S_h = T @ (block_diag(*halves) + (off - off_runs) / 2) @ T.T if halves else None
    between = (T @ (off + off_runs) @ T.T) / n
    return between, (D + D.T) / 2, None if S_h is None else as_covariance(S_h)
