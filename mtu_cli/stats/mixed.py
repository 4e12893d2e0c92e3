"""Components of variance of grouped readings: passes with random intercept and slope.

The model of one error component read in G passes is

    y_gi = x_i' b + z_i' d_g + e_gi,    d_g ~ N(0, D),    e_gi ~ N(0, s_repeat^2),

with x = [1, p, p^2, ...] and z = [1, p - c], c the mean position. D is the pass-to-pass
covariance, K that of the two passes of a run there and back, s_repeat the repeatability. They
are estimated from mean squares, whose distributions are known exactly on a balanced design:
within passes (nu_w degrees of freedom) and between the passes' own coefficients (nu_b). See
Searle, Casella & McCulloch, Variance Components (1992), ch. 4, for the moment equations.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import LeastSquares, least_squares, polynomial
from mtu_cli.stats.pass_design import PassDesign, pass_design
from mtu_cli.stats.pass_lines import between_passes, own_lines, rounding_of
from mtu_cli.stats.pass_pairs import bounded, covariance_in_runs, half_differences
from mtu_cli.stats.positive_part import positive_part

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ROUNDING = 1e-12
"""Share of the terms of a sum below which it is what rounding left of them."""
FEW_PASSES = 3
"""Below so many degrees of freedom between passes D is never taken as negative."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PassFit:
    """The mixed model of one component; q = 2 random columns with an axis, 1 without.

    `plain` is the ordinary least-squares fit of all readings as repeats (Gilsinn & Ling 2004,
    eqs. (5)-(11)). `covariance` (k, k) is that of its coefficients under the mixed model, D
    (q, q) the pass-to-pass covariance at `center`, `s2` the repeatability variance. `D_moment`
    is D before its negative part is set to zero, the unbiased moment estimate. `between` (q, q)
    is the mean square of the passes' own coefficients with `pass_dof` degrees of freedom,
    `within_dof` belongs to `s2`. `pairs` (P, 2) are the passes there and back of P runs, of which
    `half_differences` (q, q) is the mean square S_h (see `pass_pairs`), None of fewer than two:
    the units that were repeated are then the runs.
    `pass_coefficients` (G, q) are the passes' own intercepts (at the centre) and slopes,
    `deviations` (G, q) the same less their mean by direction, `divisor` what the sum of their
    squares is divided by for `between`. `separated` is False where the
    data cannot tell D from s2.
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
    pass_dof: int
    within_dof: int
    within_rss: float
    separated: bool
    groups: IntArray
    group_direction: FloatArray
    pass_coefficients: FloatArray
    deviations: FloatArray
    divisor: int
    pairs: IntArray
    half_differences: FloatArray | None
    pooled_rss: float
    pooled_dof: int
    rounding: float

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
    """Fits one component; all arrays are (n,), in internal units and mm.

    `group` is the pass of each reading (None: passes are not known), `direction` is +1, -1
    or 0 (not given), `runs` the run there and back that it is of (None: all passes are
    independent); both are constant within a pass. With three passes or more direction is a
    fixed effect of their coefficients, so that reversal does not enter D. Without an axis,
    give degree 0. Where the passes differ in what no pass determines by itself (single
    readings along an axis), D is not separated.
    """
    plain = least_squares(polynomial(position, degree), y)
    center = float(position.mean())
    if group is None:
        return _single(y, plain, center)
    design = pass_design(position, center, degree, group, direction, runs)
    found = _separated(y, design, plain, center) if design.dof_between > 0 else None
    return _single(y, plain, center, design) if found is None else found


def _separated(
    y: FloatArray, design: PassDesign, plain: LeastSquares, center: float
) -> PassFit | None:
    """Pass-to-pass scatter told from repeatability; None where the readings cannot."""
    rows, G = design.rows, len(design.ids)
    stage = own_lines(y[rows], design.Z[rows], design.common, design.own, G)
    found = between_passes(stage, design.fixed)
    if found is None:
        return None
    between, of_repeatability, deviations = found
    D = positive_part(between, of_repeatability, stage.s2)
    # Two or three may agree by chance far better than repeatability allows: D is not negative.
    within = stage.s2 * of_repeatability
    moment = D if design.dof_between < FEW_PASSES else between - within
    K = covariance_in_runs(deviations, design.pairs, between)
    pooled = _line_a_direction(y, design)
    choices = ((moment, K), (D, K), (D, bounded(K, D)))
    return PassFit(
        plain=plain,
        covariance=_coefficient_covariance(plain, design, stage.s2, choices),
        center=center,
        s2=stage.s2,
        D=D,
        D_moment=moment,
        between=between,
        pass_dof=design.dof_between,
        within_dof=stage.dof,
        within_rss=stage.rss,
        separated=True,
        groups=design.ids,
        group_direction=design.sign,
        pass_coefficients=stage.coefficients,
        deviations=deviations,
        divisor=G - design.fixed.shape[1],
        pairs=design.pairs,
        half_differences=half_differences(moment + within, K, design.pairs, G),
        pooled_rss=pooled.rss,
        pooled_dof=pooled.dof,
        rounding=rounding_of(y),
    )


def _line_a_direction(y: FloatArray, design: PassDesign) -> LeastSquares:
    """The fit that takes all passes of one direction as one."""
    lines = [design.Z[design.rows] * column[design.own, None] for column in design.fixed.T]
    return least_squares(np.column_stack([*lines, design.common]), y[design.rows])


def _single(
    y: FloatArray, plain: LeastSquares, center: float, design: PassDesign | None = None
) -> PassFit:
    """One pass, or none known: all scatter counts as repeatability."""
    q = min(2, len(plain.coefficients))
    empty = np.zeros((0, q))
    return PassFit(
        plain=plain,
        covariance=plain.s2 * plain.unscaled_covariance,
        center=center,
        s2=plain.s2,
        D=np.zeros((q, q)),
        D_moment=np.zeros((q, q)),
        between=np.zeros((q, q)),
        pass_dof=0,
        within_dof=plain.dof,
        within_rss=plain.rss,
        separated=False,
        groups=np.zeros(0, np.int64) if design is None else design.ids,
        group_direction=np.zeros(0) if design is None else design.sign,
        pass_coefficients=empty,
        deviations=empty,
        divisor=0,
        pairs=np.zeros((0, 2), np.int64),
        half_differences=None,
        pooled_rss=plain.rss,
        pooled_dof=plain.dof,
        rounding=rounding_of(y),
    )


def _coefficient_covariance(
    plain: LeastSquares,
    design: PassDesign,
    s2: float,
    choices: Iterable[tuple[FloatArray, FloatArray]],
) -> FloatArray:
    """Covariance of plain least squares under V = s2 I + Z D Z' by pass, Z K Z' within a run.

    (X'X)^-1 X' V X (X'X)^-1; on a balanced design this is the between mean square over G, or that
    of the runs' means over their number.
    The first of the `choices` of D and K, the unclipped, keeps it unbiased; the clipped D, and then
    a K within it, which always give a covariance, stand in only where the result is none.
    """
    X, Z, codes = design.X, design.Z, design.codes
    inverse = plain.unscaled_covariance
    cross = np.zeros((int(codes.max()) + 1, X.shape[1], Z.shape[1]))
    for column in range(X.shape[1]):
        for other in range(Z.shape[1]):
            cross[:, column, other] = np.bincount(codes, X[:, column] * Z[:, other])
    A = inverse @ cross
    there, back = A[design.all_pairs.T]
    for D, K in choices:
        of_runs = 2 * np.einsum("gij,jk,glk->il", there, K, back)
        total: FloatArray = s2 * inverse + np.einsum("gij,jk,glk->il", A, D, A) + of_runs
        total = (total + total.T) / 2
        sizes = s2 * np.diag(inverse) + np.einsum("gij,jk,gik->i", *map(np.abs, (A, D, A)))
        # What the passes do not scatter in is 0, not the rounding of sums that cancel.
        still = np.abs(np.diag(total)) <= ROUNDING * sizes
        total[still] = total[:, still] = 0.0
        if np.linalg.eigvalsh(_correlation(total)).min() >= -1e-9:
            break
    return total


def _correlation(S: FloatArray) -> FloatArray:
    scale = np.sqrt(np.abs(np.diag(S)))
    scale[scale == 0] = 1.0
    correlation: FloatArray = S / np.outer(scale, scale)
    return correlation
