"""Likelihood of models of mean effects on one table: fits and marginal likelihoods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from mtu_cli.analyses.close_loop.design import Design, Kernel, Member
from mtu_cli.analyses.close_loop.strata import PADDING
from mtu_cli.stats.least_squares import FloatArray, IntArray

QUANTILES = (np.arange(12) + 0.5) / 12
ZELLNER_SIOW = 1 / chdtri(1, 1 - QUANTILES)
"""Quantiles of g/n where g ~ inverse gamma(1/2, n/2): a Cauchy law of sizes in units of the
information of one observation (Zellner & Siow 1980)."""
TINY = 1e-9

Columns = tuple[int, ...]
NO_COLUMNS = np.zeros((1, 0), int)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Generalised least squares: sizes `beta` (k,) of unit columns, `covariance` (k, k), residual
    (N,), weights (S,) = 1/variance and degrees of freedom (S,) of the strata. `shares` (S, k) is
    how much of a column's information comes from each stratum.
    """

    columns: Columns
    beta: FloatArray
    covariance: FloatArray
    residual: FloatArray
    weights: FloatArray
    dof: FloatArray
    shares: FloatArray

    def effective_dof(self, i: int) -> float:
        """Satterthwaite's degrees of freedom of size i."""
        share = self.shares[:, i]
        return float(1 / np.sum(share**2 / self.dof)) if share.any() else np.inf

    def sizes(self, member: Member) -> FloatArray:
        """Of a member's parameters and then its margins'; 0 of one that is not estimable."""
        sizes = dict(zip(self.columns, self.beta.tolist(), strict=True))
        pairs = zip(member.indices, member.factors, strict=True)
        return np.array([sizes[i] / factor if i in sizes else 0.0 for i, factor in pairs])


class Likelihood:
    """Errors `y` (N,) of a design and their means `grand` (A,), in units of its scale.

    `n` (S,) are the degrees of freedom of the strata, with those of what is known beforehand;
    `R0` (S,) the sums of squares; `least` (S,) variances that rounding alone gives.
    """

    def __init__(
        self,
        design: Design,
        y: FloatArray,
        grand: FloatArray,
        n: FloatArray,
        prior: tuple[FloatArray, FloatArray],
        least: FloatArray,
    ) -> None:
        self.design, self.y, self.grand = design, y, grand
        strata = design.strata
        squares = np.array([y[part] @ y[part] for part in strata.slices])
        self.extra, self.extra_dof = prior
        self.n = n + self.extra_dof
        self.R0 = squares + self.extra
        self.least = np.maximum(least, TINY**2)
        self._b = np.zeros((len(n), 0))
        self._none: dict[Columns, FloatArray] = {}

    @property
    def b(self) -> FloatArray:
        """Products (S, K) of the errors with all columns."""
        columns = self.design.columns
        if (count := self._b.shape[1]) < columns.count:
            products = columns.products(self.y[None], count)[:, :, 0]
            self._b = np.concatenate([self._b, products], axis=1)
        return self._b

    def closure(self, members: Sequence[int]) -> Columns:
        """Columns of a model: those of its members, then those of their margins."""
        items = [self.design.members[m] for m in members]
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
        self,
        columns: Columns,
        smooth: Columns = (),
        added: IntArray = NO_COLUMNS,
        inner: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Residual sums of squares (S, M) of models, the strata's variances at the maximum of each,
        and the effective number of entries (M, w + k) that inform each column. All have the k
        `columns` and those of `smooth` effects, each its `added` (M, w) ones, whose products are
        `inner` (S, M, w, w). What a prior takes off a size counts as residual.
        """
        shared = (*columns, *smooth, *self.design.common)
        k = added.shape[1] + len(columns)
        models, G = self.design.columns.crossed(added, shared, inner)
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
        R, _ = self.profile(columns)
        least = self.least * self.n + TINY**2
        ratio = np.maximum(R[:, 0], least) / np.maximum(self.R0, least)
        return float(-0.5 * self.n @ np.log(ratio))

    def evidence(
        self,
        columns: Columns,
        smooth: Columns = (),
        added: IntArray = NO_COLUMNS,
        inner: FloatArray | None = None,
    ) -> FloatArray:
        """Log marginal likelihood (M,) of models against none: of the `columns` with each of those
        `added` (M, w), their products `inner`, given the columns of `smooth` effects.

        Sizes have a g-prior with the Zellner-Siow law of g, so that the evidence is not bounded
        (Liang et al. 2008); the strata's variances are maximised; every column is paid for,
        margins too.
        """
        added = np.where(np.isin(added, columns), PADDING, added)
        R, number = self.profile(columns, smooth, added, inner)
        if smooth not in self._none:
            self._none[smooth] = self.profile((), smooth)[0]
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
        at = np.array(columns, int)
        G, b, ridge = units.gram(at, at), self.b[:, at], np.diag(units.precisions[at])
        w, dof = self.weights(self.R0, self.n), self.n.copy()
        beta, V = np.zeros(0), np.zeros((0, 0))
        for _ in range(6 if columns else 1):
            A = np.einsum("s,sij->ij", w, G)
            V = np.linalg.inv(A + ridge + TINY * np.diag(np.diag(A)))
            beta = V @ (w @ b)
            R = self.R0 - 2 * b @ beta + np.einsum("i,sij,j->s", beta, G, beta)
            leverage = w * np.einsum("ij,sji->s", V, G)
            dof = np.maximum(self.n - leverage, 1.0)
            w = self.weights(np.maximum(R, TINY * self.R0), dof)
        shares = w[:, None] * np.einsum("ij,sjk,ki->si", V, G, V) / np.diag(V)[None, :]
        residual = self.y - beta @ units.dense(columns) if columns else self.y
        return Fit(
            columns=columns, beta=beta, covariance=V, residual=residual, weights=w, dof=dof,
            shares=shares,
        )  # fmt: skip

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
