"""Functions of a position: the integrated Wiener process, interpolation with it, shapes that are
linear in their coefficients, and a smooth profile seen in passes.

f is a straight line, which is left free, plus tau times an integrated Wiener process: what has a
generalised covariance of tau^2 |h|^3/12. Given its values at T knots, the expected f in between is
the natural cubic spline through them, and a straight line beyond (Wahba, Spline Models for
Observational Data (1990), ch. 1; kriging: Cressie, Statistics for Spatial Data (1993), 3.4.5).

A profile in passes: its bend at the targets, how rough it is, what repeats.

    y = line of the pass + f(x) + g_run(x) + e,    e ~ N(0, sigma^2),

f and the runs' own bends g are integrated Wiener processes (as above). With a free line a pass
projected out, drift and reversal cannot enter; of T targets m = T - 2 numbers z = G f + noise
remain, and a pure error (sse, nu), to which no profile can contribute. On a balanced design this
is REML. The amplitude of f has no good point estimate of few targets: f is averaged over its
posterior, which holds at any amplitude, 0 included. Spline weights do not depend on the amplitude:
the average is again a table of values at the targets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray, IntArray, least_squares, polynomial
from mtu_cli.stats.mixed_model import lines_by_pass


def wiener(a: FloatArray, b: FloatArray) -> FloatArray:
    """|h|^3/12 (n, m) of all distances h from `a` (n,) to `b` (m,), for tau = 1."""
    return np.abs(np.subtract.outer(a, b)) ** 3 / 12


def weights(knots: FloatArray, position: FloatArray) -> FloatArray:
    """W (n, T): W f(knots) is the natural cubic spline at `position`, beyond the knots a line.

    >>> knots = np.array([0.0, 1.0, 2.0, 4.0])
    >>> W = weights(knots, np.array([1.0, 3.0, 6.0]))
    >>> np.round(W @ (2 + 3 * knots), 9).tolist()
    [5.0, 11.0, 20.0]
    """
    center, half = _scale(knots)
    a, b = (knots - center) / half, (position - center) / half
    fixed = polynomial(a, 1)
    lhs = np.block([[wiener(a, a), fixed], [fixed.T, np.zeros((2, 2))]])
    rhs = np.vstack([wiener(a, b), polynomial(b, 1).T])
    result: FloatArray = np.linalg.solve(lhs, rhs)[: len(knots)].T
    # At a knot the value itself, without rounding.
    at = np.minimum(np.searchsorted(knots, position), len(knots) - 1)
    at_knots = knots[at] == position
    result[at_knots] = np.eye(len(knots))[at[at_knots]]
    return result


def interpolation_covariance(knots: FloatArray, position: FloatArray) -> FloatArray:
    """Covariance (n, n) of f - W f(knots), the error of the interpolation, for tau = 1."""
    center, half = _scale(knots)
    positions = (np.concatenate([knots, position]) - center) / half
    difference = np.hstack([-weights(knots, position), np.eye(len(position))])
    K = difference @ wiener(positions, positions) @ difference.T * half**3
    at_knots = np.isin(position, knots)
    K[at_knots] = K[:, at_knots] = 0.0
    return (K + K.T) / 2


def smooth_root(knots: FloatArray) -> FloatArray:
    """B (T, T - 2): f(knots) is a line plus tau B u, u standard normal, B without a line."""
    center, half = _scale(knots)
    a = (knots - center) / half
    H = np.linalg.qr(polynomial(a, 1), mode="complete")[0][:, 2:]
    return H @ np.linalg.cholesky(H.T @ wiener(a, a) @ H) * half**1.5


def _scale(knots: FloatArray) -> tuple[float, float]:
    """Middle and half of the range: cubes of numbers of order 1 lose no digits."""
    return float(knots[0] + knots[-1]) / 2, float(knots[-1] - knots[0]) / 2


@dataclass(frozen=True, slots=True)
class PolynomialShape:
    """1, p, p^2, ... of the position p; of degree 0 the constant alone."""

    degree: int

    def columns(self, position: FloatArray) -> FloatArray:
        """The columns (n, degree + 1) at n positions, mm."""
        return polynomial(position, self.degree)

    def of_line(self, center: float, q: int) -> FloatArray:
        """T (k, q) from (intercept at the centre, slope) to coefficients."""
        T = np.eye(self.degree + 1, q)
        T[0, 1:] = -center
        return T

    def at_centre(self, center: float) -> FloatArray:
        """T (q, k) from coefficients to level and slope at the centre."""
        k = np.arange(self.degree + 1)
        return np.array([center**k, k * center ** np.maximum(k - 1, 0)])[: len(k)]


AT_MM = 1e-3
"""Distance up to which a point is at a position of a table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableShape:
    """Values at the positions `at` (T,), mm, rising, with natural cubic interpolation.

    `roughness` is the variance tau^2 of the integrated Wiener process that the interpolation leaves
    open, `own` that of a run's own bend, of future readings only, with `own_dof` degrees of
    freedom; both in mm or rad squared per mm^3. `between` is a variance added off the positions.
    """

    at: FloatArray
    roughness: float = 0.0
    between: float = 0.0
    own: float = 0.0
    own_dof: float = np.inf

    def columns(self, position: FloatArray) -> FloatArray:
        """Weights (n, T) of the values at n positions, mm; beyond the table a straight line."""
        return weights(self.at, position)

    def of_line(self, center: float, q: int) -> FloatArray:
        """T (k, q) from (intercept at the centre, slope) to values."""
        return polynomial(self.at - center, 1)[:, :q]

    def at_centre(self, center: float) -> FloatArray:
        """T (2, k) from values to level and slope of the least-squares line at the centre."""
        return np.asarray(np.linalg.pinv(polynomial(self.at - center, 1)), np.float64)

    def interpolation_covariance(self, position: FloatArray) -> FloatArray:
        """Covariance (n, n) of what the values leave open, the same for all parts."""
        off = np.abs(position[:, None] - self.at).min(axis=1) > AT_MM
        return self.roughness * interpolation_covariance(self.at, position) + np.diag(
            off * self.between
        )

    def of_runs(self, position: FloatArray) -> FloatArray:
        """Covariance (n, n) of the bend of one run, its line left out."""
        W = weights(self.at, position) @ smooth_root(self.at)
        return self.own * (W @ W.T + interpolation_covariance(self.at, position))


Shape = PolynomialShape | TableShape


FEWEST_TARGETS = 4
"""Two bends remain beside a line."""
FEWEST_RUNS = 3
"""For bends of single runs."""
AMPLITUDES = np.geomspace(0.03, 300.0, 18)
"""Root mean square of f over the readings, in sigma of one reading."""
_EDGES = np.concatenate([[0.0], np.sqrt(AMPLITUDES[1:] * AMPLITUDES[:-1]), [np.inf]])
LOG_PRIOR = np.log(np.diff(2 / np.pi * np.arctan(_EDGES)))
"""Half-Cauchy, its scale the sigma of one reading: that of unit information (Zellner & Siow)."""
OWN = np.concatenate([[0.0], np.geomspace(0.1, 30.0, 14) ** 2])
"""Variance of a run's own bend, in sigma^2, over which REML looks for it."""
OWN_SHAPES = 6
"""Leading shapes of it: what is beyond has less than a thousandth of its variance."""
SLIGHT = 1e-4
"""Posterior weight of an amplitude that does not count."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SmoothProfile:
    """`bend` (T,) at the `knots` (T,) with its `covariance` (T, T), without its line; f has the
    variance `roughness` tau^2 (per mm^3), the runs' own bends `own`, estimated with `own_dof`.
    `s2` is the variance of one reading, pure error with `rss` and `dof`.
    """

    knots: FloatArray
    bend: FloatArray
    covariance: FloatArray
    roughness: float
    own: float
    own_dof: float
    s2: float
    rss: float
    dof: int

    def bend_at(self, position: FloatArray) -> FloatArray:
        """The bend (n,) at any positions."""
        return weights(self.knots, position) @ self.bend


def smooth_profile(
    position: FloatArray, y: FloatArray, group: IntArray, run: IntArray
) -> SmoothProfile | None:
    """The profile of readings `y` (n,) at `position` (n,) in the passes `group` of the runs `run`.

    None where the targets are fewer than FEWEST_TARGETS, or nothing is read again at one of them.
    """
    knots, at, counts = np.unique(position, return_inverse=True, return_counts=True)
    if len(knots) < FEWEST_TARGETS:
        return None
    N, B = np.eye(len(knots))[at], smooth_root(knots)
    scale = float(counts @ (B**2).sum(axis=1) / counts.sum())
    B /= np.sqrt(scale)
    shapes, sizes, _ = np.linalg.svd(B, full_matrices=False)
    runs, of_run = np.unique(run, return_inverse=True)
    run_columns = (shapes * sizes)[at, :OWN_SHAPES]
    bends = np.einsum("nr,nk->nrk", np.eye(len(runs))[of_run], run_columns).reshape(len(y), -1)
    # What the line of every pass leaves, and how many numbers the lines take.
    codes = np.unique(group, return_inverse=True)[1].astype(np.int64)
    passes, line = int(codes.max()) + 1, polynomial(position - position.mean(), 1)
    columns = lines_by_pass(np.column_stack([N, y, bends]), line, codes, passes)[1]
    places = np.unique(np.column_stack([codes, position]), axis=0)[:, 0].astype(int)
    lines = int(np.minimum(np.bincount(places, minlength=passes), 2).sum())
    T = len(knots)
    MN, My, MF = columns[:, :T], columns[:, T], columns[:, T + 1 :]
    values, vectors = np.linalg.eigh(N.T @ MN)
    nonzero = values > 1e-9 * values[-1]
    G = (vectors[:, nonzero] * np.sqrt(values[nonzero])).T
    to_z = (vectors[:, nonzero] / np.sqrt(values[nonzero])).T @ N.T
    z = to_z @ My
    nu = len(y) - lines - len(z)
    if nu < 1:
        return None
    sse = max(float(My @ My - z @ z), 0.0)
    ratio, run_dof = 0.0, np.inf
    if len(runs) >= FEWEST_RUNS:
        run_z = to_z @ MF
        pure = MF - MN @ np.linalg.lstsq(MN, MF, rcond=1e-9)[0]
        ratio, run_dof, sse = _run_bends(pure, My, sse, nu)
        # What the runs differ in is compared between them, whatever their noise leaves of it.
        run_dof = max(run_dof, len(runs) - 1.0)
        if ratio:
            values, vectors = np.linalg.eigh(np.eye(len(z)) + ratio * run_z @ run_z.T)
            white = (vectors / np.sqrt(values)) @ vectors.T
            G, z = white @ G, white @ z
    s2 = sse / nu
    bend, covariance, amplitude2 = averaged(G, z, B, sse, nu)
    return SmoothProfile(
        knots=knots,
        bend=bend,
        covariance=covariance * s2,
        roughness=amplitude2 * s2 / scale,
        own=ratio * s2 / scale,
        own_dof=run_dof,
        s2=s2,
        rss=sse,
        dof=nu,
    )


def _run_bends(X: FloatArray, y: FloatArray, sse: float, nu: int) -> tuple[float, float, float]:
    """REML of the variance of the runs' bends over sigma^2, by what they add to the pure error
    (`X`, the bends' columns in it); its degrees of freedom, and the pure error without them.
    """
    U, s, _ = np.linalg.svd(X, full_matrices=False)
    nonzero = s > 1e-6 * s[0]
    U, s = U[:, nonzero], s[nonzero]
    e2 = (U.T @ y) ** 2
    d = 1 + np.outer(OWN, s**2)
    rss = (1 / d) @ e2 + max(sse - float(e2.sum()), 0.0)
    with np.errstate(divide="ignore"):
        best = int(np.argmin(np.log(d).sum(axis=1) + nu * np.log(rss)))
    share = OWN[best] * s**2 / d[best]
    dof = float((share**2).sum()) if best else np.inf
    return float(OWN[best]), dof, float(rss[best])


def averaged(
    G: FloatArray, z: FloatArray, B: FloatArray, sse: float, nu: int
) -> tuple[FloatArray, FloatArray, float]:
    """Mean (T,) and covariance (T, T) of f over the posterior of its amplitude, and the mean of
    the amplitude squared; all but the mean in sigma^2. The prior of sigma^2 is 1/sigma^2.
    """
    s2 = sse / nu
    U, sizes, V = np.linalg.svd(G @ B)
    # What no reading sees of f (too few passes at its targets) keeps its prior variance.
    s, Uz = np.zeros((2, len(V)))
    s[: len(sizes)], Uz[: len(U)] = sizes, U.T @ z
    d = 1 + np.outer(AMPLITUDES**2, s**2)
    with np.errstate(divide="ignore"):
        rest = np.log((1 / d) @ Uz**2 + sse)
    log = LOG_PRIOR - np.log(d).sum(axis=1) / 2 - (len(z) + nu) / 2 * rest
    weight = np.exp(log - log.max()) if np.isfinite(log.max()) else np.ones(len(log))
    weight = np.where(weight > SLIGHT * weight.sum(), weight, 0.0)
    weight /= weight.sum()
    basis = B @ V.T
    # Of every amplitude a: mean a^2 s/(1 + a^2 s^2) U'z, variances a^2/(1 + a^2 s^2) of sigma^2.
    means = AMPLITUDES[:, None] ** 2 * s / d * Uz
    variances = AMPLITUDES[:, None] ** 2 / d
    mean = weight @ means
    deviations = means - mean
    spread = (deviations.T * weight) @ deviations / s2 if s2 > 0 else np.zeros((len(s), len(s)))
    covariance = basis @ (np.diag(weight @ variances) + spread) @ basis.T
    return basis @ mean, covariance, float(weight @ AMPLITUDES**2)


MOST_AUTO = 5
"""Highest degree that is chosen: more bends are a table."""


def chosen_degree(
    position: FloatArray, y: FloatArray, group: IntArray | None, run: IntArray | None
) -> int | None:
    """The degree of a polynomial that held-out runs choose for readings as in `smooth_profile`;
    None for the profile itself, a table. 1 of fewer than three runs.

    Every run is left out once, and every shape, fitted to the rest, predicts its readings but for
    their level, which drifts. The simplest shape is chosen that is no worse than the best by more
    than a standard error of the difference, run by run (after the rule of Breiman et al.,
    Classification and Regression Trees (1984), 3.4.3).
    """
    places = len(np.unique(position))
    if group is None or run is None or len(runs := np.unique(run)) < FEWEST_RUNS:
        return min(1, places - 1)
    middle, half = float(position.mean()), float(np.ptp(position)) / 2 or 1.0
    shapes: list[int | None] = [*range(min(MOST_AUTO, places - 1) + 1), None]
    losses = np.full((len(shapes), len(runs)), np.nan)
    for fold, test_run in enumerate(runs):
        train = run != test_run
        test = [np.flatnonzero(group == g) for g in np.unique(group[~train])]
        levels = (group[train, None] == np.unique(group[train])).astype(np.float64)
        for i, degree in enumerate(shapes):
            bend = np.zeros(len(y))
            if degree is None:
                profile = smooth_profile(position[train], y[train], group[train], run[train])
                if profile is None:
                    continue
                bend, degree = profile.bend_at(position), 1
            powers = polynomial((position - middle) / half, degree)[:, 1:]
            fit = least_squares(np.column_stack([levels, powers[train]]), (y - bend)[train])
            rest = y - (bend + powers @ fit.coefficients[levels.shape[1] :])
            losses[i, fold] = np.mean([np.var(rest[rows]) for rows in test])
    candidates = np.flatnonzero(np.isfinite(losses).all(axis=1))
    best = candidates[np.argmin(losses[candidates].mean(axis=1))]
    worse = losses[candidates] - losses[best]
    se = worse.std(axis=1, ddof=1) / np.sqrt(len(runs))
    return shapes[int(candidates[np.flatnonzero(worse.mean(axis=1) <= se)[0]])]
