"""A table as a likelihood: its errors in their strata, with what was known of their scatter; fits
and marginal likelihoods of models.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from mtu_cli.analyses.close_loop.design import Design, Kernel, Member, kernels_of, smooth_covariance
from mtu_cli.analyses.close_loop.strata import PADDING, Closures, Missing, Strata, strata_of
from mtu_cli.model.effect_library import Candidate
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.alignment import small_motions
from mtu_cli.stats.least_squares import BoolArray, FloatArray
from mtu_cli.stats.outliers import NORMAL_MAD, median_polish, outlying

QUANTILES = (np.arange(12) + 0.5) / 12
ZELLNER_SIOW = 1 / chdtri(1, 1 - QUANTILES)
"""Quantiles of g/n where g ~ inverse gamma(1/2, n/2): a Cauchy law of sizes in units of the
information of one observation (Zellner & Siow 1980)."""
TINY, ROUNDING = 1e-9, 1e-12

Columns = tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Generalised least squares: sizes `beta` (k,) of unit columns, `covariance` (k, k), residual
    (N,), weights (S,) = 1/variance and degrees of freedom (S,) of the strata.
    """

    columns: Columns
    beta: FloatArray
    covariance: FloatArray
    residual: FloatArray
    weights: FloatArray
    dof: FloatArray

    def sizes(self, member: Member) -> FloatArray:
        """Of a member's parameters and then its margins'; 0 of one that is not estimable."""
        sizes = dict(zip(self.columns, self.beta.tolist(), strict=True))
        pairs = zip(member.indices, member.factors, strict=True)
        return np.array([sizes[i] / factor if i in sizes else 0.0 for i, factor in pairs])


class Likelihood:
    """The errors of a table in its strata, `y` (N,), and their means `grand` (A,), in units of the
    design's scale, with the columns of its candidates; given motions of whole parts that `scatter`,
    each a line, the last of each axis.

    `n` (S,) are the degrees of freedom of the strata, with those (`extra_dof`) of what is known
    beforehand, of which `extra` are the sums of squares; `R0` (S,) all sums of squares; `least`
    (S,) variances that rounding alone gives. `kernels`: random functions -1, -2 ...
    """

    def __init__(
        self, table: ResidualTable, candidates: Sequence[Candidate], scatter: Sequence[str] = ()
    ) -> None:
        measured = np.isfinite(table.errors).all(axis=2) & table.there
        gaps = Missing(measured, table.free_lines)
        errors = np.moveaxis(gaps.filled(np.moveaxis(table.errors, -1, 0)), 0, -1)
        steps = table.steps
        inner = max(float(np.std(gaps.interaction(E))) for E in np.moveaxis(errors, 2, 0))
        largest = float(np.abs(errors).max())
        sizes = (inner, float(np.std(errors)), float(steps.max()), largest)
        scale = next((size for size in sizes if size > ROUNDING * max(largest, 1e-300)), 1.0)
        errors, steps = errors / scale, steps / scale
        strata = _strata(table, errors, scatter)
        # Degrees of freedom: less the missing cells and what a datum freed.
        P, _, A = strata.shape
        n, axis, labels = strata.sizes.copy(), np.array(strata.axis), strata.labels()
        n[strata.of("interaction")] -= np.sum(~measured)
        of_axis, _, j = strata.cells
        lost = np.zeros(len(n))
        for motion in table.motions:
            Q = motion.Q.reshape(len(motion.columns), A, -1)
            of_basis = np.einsum("hak,ahj->akj", Q, strata.of_features[:, motion.columns])
            share = np.sum(of_basis**2, axis=1)[of_axis, j]
            lost += np.bincount(labels, share, len(n)) * len(motion.rows) / P
        # A stratum that the datum takes whole is rounding.
        n = np.where(n - lost > 1e-6 * n, np.maximum(n - lost, 1.0), 0.0)
        self.design = Design(table, strata, candidates, scale, gaps)
        kernels = (k for k in kernels_of(table, strata) if all(n[s] > 0 for s in k.directions))
        self.kernels = {-1 - k: kernel for k, kernel in enumerate(kernels)}
        y = strata.coordinates(errors)
        # What sums of equal numbers leave is rounding.
        y[(n[labels] == 0) | (np.abs(y) < ROUNDING * largest / scale)] = 0.0
        self.y = y
        variance = np.zeros(A)
        for s in strata.of("interaction"):
            part = y[strata.slices[s]]
            variance[axis[s]] = part @ part / max(n[s], 1.0)
        least = steps[axis] ** 2 / 12
        # Repeats that scatter less than half a step share their rounding: so do means of features.
        first = strata.at[:, 0]
        means = np.isin(np.arange(len(axis)), labels[first[first >= 0]])
        shared = means & (variance[axis] < steps[axis] ** 2 / 4)
        self.least = np.maximum(np.where(shared, P * least, least), TINY**2)
        # What the model's D tells of the parts' scatter, but for the lines of `scatter`.
        self.extra, self.extra_dof = np.zeros((2, len(n)))
        F, nu = table.of_part / scale, min(float(table.pass_dof), 1e4)
        lines = [sum(axis[t] == a for t in strata.of("line")) - len(scatter) for a in range(A)]
        for s in (*strata.of("part"), *strata.of("line")) if F.shape[3] else ():
            a, line = strata.axis[s], int(strata.place[strata.slices[s].start]) % strata.shape[1]
            if n[s] == 0 or line > lines[a]:
                continue
            direction = strata.of_features[a][:, line]
            size = float(np.mean(np.sum(np.einsum("h,phr->pr", direction, F[:, :, a]) ** 2, 1)))
            if size > 0:
                self.extra_dof[s], self.extra[s] = nu, nu * (variance[a] + size)
        self.n, self.grand = n + self.extra_dof, errors.mean(axis=(0, 1))
        self.R0 = np.array([y[part] @ y[part] for part in strata.slices]) + self.extra
        self._b = np.zeros((len(n), 0))
        self._none: dict[Columns, FloatArray] = {}
        self._nothing = np.zeros((1, 0), int), np.zeros((len(n), 1, 0, 0))

    @property
    def b(self) -> FloatArray:
        """Products (S, K) of the errors with all columns."""
        columns = self.design.columns
        if (count := self._b.shape[1]) < columns.count:
            products = columns.products(np.arange(count, columns.count), self.y[None])[:, :, 0]
            self._b = np.concatenate([self._b, products], axis=1)
        return self._b

    def closure(self, model: Sequence[int]) -> Columns:
        """Columns of a model: those of its members, then those of their margins."""
        items = [self.design.members[m] for m in model if m >= 0]
        terms = dict.fromkeys(i for item in items for i in item.terms)
        return tuple(terms | dict.fromkeys(i for item in items for i in item.low))

    def smooth(self, fit: Fit, kernel: Kernel) -> Columns:
        """The directions of a random function as columns; its variance is the likeliest given a
        fit.
        """
        _, amplitude = self.kernel_gain(fit, kernel)
        columns, result = self.design.columns, list[int]()
        for s, (V, k) in kernel.directions.items():
            part = self.design.strata.slices[s]
            at, means = np.arange(part.start, part.stop), np.zeros((len(k), len(self.grand)))
            precisions = fit.weights[s] / (amplitude * k)
            result += columns.add_alone(at, V.T, means, precisions).tolist()
        return tuple(result)

    def weights(self, R: FloatArray, dof: FloatArray) -> FloatArray:
        """1/variance of the strata from their sums of squares; 0 of one that is not estimable."""
        least, estimable = (x.reshape(-1, *[1] * (R.ndim - 1)) for x in (self.least, self.n > 0))
        return np.asarray(np.where(estimable, dof / np.maximum(R, dof * least + TINY**3), 0.0))

    def profile(
        self, columns: Columns, smooth: Columns, added: Closures
    ) -> tuple[FloatArray, FloatArray]:
        """Residual sums of squares (S, M) of models, the strata's variances at the maximum of each,
        and the effective number of entries (M, w + k) that inform each column. All have the k
        `columns` and those of `smooth` effects, each its `added` (M, w) ones. What a prior takes
        off a size counts as residual.
        """
        shared = (*columns, *smooth, *self.design.common)
        k = added[0].shape[1] + len(columns)
        models, G = self.design.columns.crossed(added, shared)
        ridge = self.design.columns.precisions[models]
        b, squares = self.b[:, models], np.einsum("smii->smi", G)
        n, floor = self.n[:, None], TINY * self.R0[:, None] + TINY**2
        R = np.broadcast_to(self.R0[:, None], (len(n), len(models)))
        for _ in range(5):
            w = self.weights(R, n)
            information = np.einsum("sm,smi->mi", w, squares)
            diagonal = ridge + TINY * information
            A = np.einsum("sm,smij->mij", w, G) + diagonal[:, None] * np.eye(models.shape[1])
            beta = np.linalg.solve(A, np.einsum("sm,smi->mi", w, b)[..., None])[..., 0]
            reduction = 2 * b - np.einsum("smij,mj->smi", G, beta)
            penalty = beta**2 * ridge / np.maximum(information, 1e-300)
            R = self.R0[:, None] - np.einsum("mi,smi->sm", beta, reduction)
            R = np.maximum(R + np.einsum("mi,smi->sm", penalty, squares), floor)
        info = self.weights(R, n)[..., None] * squares[:, :, :k]
        number = np.einsum("smi,s->mi", info, self.n) / np.maximum(info.sum(0), 1e-300)
        return R, number

    def log_likelihood(self, columns: Columns) -> float:
        """Largest log likelihood of a model against none, the strata's variances maximised."""
        R, _ = self.profile(columns, (), self._nothing)
        least = self.least * self.n + TINY**2
        ratio = np.maximum(R[:, 0], least) / np.maximum(self.R0, least)
        return float(-0.5 * self.n @ np.log(ratio))

    def evidence(
        self, columns: Columns, smooth: Columns = (), closures: Closures | None = None
    ) -> FloatArray:
        """Log marginal likelihood (M,) of models against none: of the `columns` with each of some
        `closures` added, given the columns of `smooth` effects.

        Sizes have a g-prior with the Zellner-Siow law of g, so that the evidence is not bounded
        (Liang et al. 2008); the strata's variances are maximised; every column is paid for,
        margins too.
        """
        added, inner = closures or self._nothing
        added = np.where(np.isin(added, columns), PADDING, added)
        R, number = self.profile(columns, smooth, (added, inner))
        if smooth not in self._none:
            self._none[smooth] = self.profile((), smooth, self._nothing)[0]
        total = self._none[smooth][None]
        nonzero = np.pad(added != PADDING, ((0, 0), (0, len(columns))), constant_values=True)
        k = nonzero.sum(axis=1)
        n = (number * nonzero).sum(axis=1) / np.maximum(k, 1)
        g = n * ZELLNER_SIOW[:, None]
        floor = (self.least * self.n)[None, :, None] + TINY**2
        rss = np.maximum(R + (total - R) / (1 + g[:, None]), floor)
        logs = -0.5 * np.einsum("s,gsm->gm", self.n, np.log(rss / np.maximum(total, floor)))
        logs -= 0.5 * k * np.log1p(g)
        return np.asarray(np.logaddexp.reduce(logs) - np.log(len(g)))

    def fit(self, columns: Columns) -> Fit:
        """Generalised least squares, each stratum's variance its residual sum of squares over the
        residual degrees of freedom.
        """
        units, columns = self.design.columns, tuple(columns) + self.design.common
        at, X = np.array(columns, int), units.dense(columns)
        G, b, ridge = units.products(at, X), self.b[:, at], np.diag(units.precisions[at])
        w = self.weights(self.R0, self.n)
        for _ in range(6):
            A = np.einsum("s,sij->ij", w, G)
            V = np.linalg.inv(A + ridge + TINY * np.diag(np.diag(A)))
            beta = V @ (w @ b)
            R = self.R0 - 2 * b @ beta + np.einsum("i,sij,j->s", beta, G, beta)
            leverage = w * np.einsum("ij,sji->s", V, G)
            dof = np.maximum(self.n - leverage, 1.0)
            w = self.weights(np.maximum(R, TINY * self.R0), dof)
        residual = self.y - beta @ X
        return Fit(columns=columns, beta=beta, covariance=V, residual=residual, weights=w, dof=dof)

    def mean(self, fit: Fit, a: int) -> tuple[float, float, float]:
        """The mean over the table along axis `a`, in units of the scale, its variance and degrees
        of freedom: parts and features both scatter, v = m_part + m_feature - m_interaction over P H
        (Satterthwaite 1946), and the coefficients are uncertain.
        """
        strata = self.design.strata
        P, H, _ = strata.shape
        m: dict[str, tuple[float, float]] = {}
        for s, kind in enumerate(strata.kinds):
            if strata.axis[s] == a and kind != "line" and fit.weights[s] > 0:
                m[kind] = (1 / fit.weights[s], fit.dof[s])
        mean = float(self.grand[a])
        if "part" not in m:
            return mean, np.nan, np.nan
        outer = [m[kind] for kind in ("part", "feature") if kind in m]
        inner = [m["interaction"]] if len(outer) > 1 and "interaction" in m else []
        v = max(sum(x for x, _ in outer) - sum(x for x, _ in inner), *(x for x, _ in outer))
        nu = v**2 / sum(x**2 / d for x, d in outer + inner)
        return mean, float(v / (P * H) + self.design.mean_variance[a]), float(nu)

    def level(self, fit: Fit, a: int) -> tuple[float, float]:
        """What a fit leaves of the mean along axis `a`, with u (nan: not testable)."""
        mean, u2, _ = self.mean(fit, a)
        slopes = self.design.columns.means[np.array(fit.columns, int), a]
        u2 += float(slopes @ fit.covariance @ slopes)
        return mean - float(slopes @ fit.beta), float(np.sqrt(u2))

    def kernel_deviance(
        self, fit: Fit, kernel: Kernel, Y: FloatArray, variances: FloatArray
    ) -> FloatArray:
        """Twice the log likelihood ratio (c, B) of one more variance component given a fitted
        model, on coordinates Y (B, N), at some variances (c,) over the stratum's.
        """
        result = np.zeros((len(variances), len(Y)))
        for s, (V, k) in kernel.directions.items():
            part = Y[:, self.design.strata.slices[s]]
            least = fit.dof[s] * self.least[s] + TINY**2
            total = np.maximum((part**2).sum(axis=1) + self.extra[s], least)
            z2 = (part @ V) ** 2
            spread = 1 + variances[:, None] * k
            rest = np.maximum(total - z2.sum(axis=1), TINY * total) + (1 / spread) @ z2.T
            result += fit.dof[s] * np.log(total / rest) - np.log(spread).sum(axis=1)[:, None]
        return result

    def kernel_gain(self, fit: Fit, kernel: Kernel) -> tuple[float, float]:
        """Log Bayes factor of a random function given a fitted model, its amplitude averaged over
        the law that sizes of columns have, a Cauchy law in units of the information of one
        coordinate; and its likeliest variance.
        """
        c = np.tan(np.pi / 2 * QUANTILES) ** 2 * kernel.informed
        logs = 0.5 * self.kernel_deviance(fit, kernel, fit.residual[None], c)[:, 0]
        return float(np.logaddexp.reduce(logs) - np.log(len(c))), float(c[int(np.argmax(logs))])


# A table as a likelihood.

GROSS = 5.5
"""Robust standard deviations of the interaction from which on an entry is excluded."""
ROUNDS = 5
FEWEST_FOR_OUTLIERS = 5
"""Parts from which on one cell can be judged by the others of its feature."""
MOST_SHARE = 0.1
"""Share of the entries beyond which they are no outliers but heavy tails."""
NOTABLE = 0.05
"""Share of the level's predicted variance from which a line's scatter is a stratum."""
SAME = 1e-6
"""Of a direction; less is rounding."""


def outliers(table: ResidualTable) -> BoolArray:
    """Where (P, H, A) single entries are further from what part and feature predict than `GROSS`
    robust standard deviations of the interaction, at least that of rounding.

    Outliers hide others: the search begins without those that are far off the medians of part and
    feature, of readings in each direction, and is repeated without what is excluded.
    """
    errors, lines, least = np.nan_to_num(table.errors), table.free_lines, table.steps
    measured = np.isfinite(table.errors).all(axis=2) & table.there
    mask, most = np.zeros(errors.shape, bool), MOST_SHARE * measured.sum()
    if errors.shape[0] < FEWEST_FOR_OUTLIERS or errors.shape[1] < 2:
        return mask
    (P, H, A), ways = errors.shape, table.direction if table.component else np.zeros(len(lines))
    for a in range(A):
        polished, groups = np.where(measured, errors[..., a], np.nan), np.unique(ways)
        for columns in (ways == way for way in groups):
            polished[:, columns] = median_polish(polished[:, columns])
        start, _ = outlying(polished, P * len(groups) + H, least[a] ** 2 / 12)
        start &= start.sum() <= most
        for _ in range(ROUNDS):
            deviation = np.abs(Missing(measured & ~start, lines).deviation(errors[..., a]))
            spread = max(NORMAL_MAD * float(np.median(deviation[measured])), float(least[a]))
            far = measured & (deviation > GROSS * spread)
            far &= far.sum() <= most
            mask[..., a] |= start & far
            start = mask[..., a] | far
            if (start == mask[..., a]).all() or start.sum() > most:
                break
    return mask


def _strata(table: ResidualTable, errors: FloatArray, moving: Sequence[str]) -> Strata:
    """With a line for each motion of whole parts in `moving`, and of readings the bends of each
    pass: the REML estimate of their variance, from differences between passes.
    """
    P, H, A = errors.shape
    readings = table.component is not None
    # By axis orthonormal directions (H, k) along which whole parts move beside their level.
    lines = [table.free_lines[:, 1:]] * A if readings else []
    for F in () if readings else np.moveaxis(table.of_part.mean(axis=0), 1, 0):
        size = max(float(np.sum(F.mean(axis=0) ** 2)) * H, 1e-300)
        U, s, _ = np.linalg.svd(F - F.mean(axis=0), full_matrices=False)
        lines.append(U[:, s**2 > NOTABLE * size][:, :2])
    levers = (lever_of(name, table.axes, table.mean_places) for name in moving)
    for lever in (x for x in levers if x is not None):
        for a in range(A):
            rest = lever[:, a] - lever[:, a].mean()
            rest = rest - lines[a] @ (lines[a].T @ rest)
            if (size := float(np.linalg.norm(rest))) > SAME:
                lines[a] = np.column_stack([lines[a], rest / size])
    along = table.along if readings and P >= 3 else None
    if along is None:
        # Along a line of a single part nothing is separable from its scatter, unless that is known.
        estimable = P > 1 or table.of_part.shape[3] > 0
        return strata_of(
            P, lines, features_scatter=not readings, moving=len(moving), lines_known=estimable
        )
    rough = smooth_covariance(along)
    strata = strata_of(P, lines, features_scatter=False, roughness=rough)
    y, (_, i, j) = strata.coordinates(errors), strata.cells
    inner = np.isin(strata.labels(), strata.of("interaction")) & (i > 0)
    squares, count = (np.bincount(j[inner], w, H) for w in (y[inner] ** 2, np.ones(inner.sum())))
    grid = np.concatenate([[0.0], np.geomspace(0.01, 1000, 40)])
    spread = 1 + grid[:, None] * strata.bends
    rss = np.maximum((squares / spread).sum(axis=1), 1e-300)
    deviance = (count * np.log(spread)).sum(axis=1) + count.sum() * np.log(rss)
    return replace(strata, spread=np.sqrt(spread[int(np.argmin(deviance)), j]))


def lever_of(name: str, axes: tuple[str, ...], places: FloatArray) -> FloatArray | None:
    """The unit pattern (H, A) of a small turn or growth of a whole part."""
    if not {*axes} <= {*AXES} or ("rotation" in name and not {"x", "y"} <= {*axes}):
        return None
    at = tuple(AXES.index(axis) for axis in axes)
    q = places[:, at] - places[:, at].mean(axis=0)
    if "rotation" in name:
        q = small_motions(places, at, "offset,rotation")[:, -1].reshape(q.shape)
    size = np.linalg.norm(q)
    return q / size if size > 0 else None
