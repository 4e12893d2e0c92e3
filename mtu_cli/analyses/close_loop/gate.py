"""The gate: one family-wise test of every effect that a model may lack.

Westfall-Young min-p over candidates, random functions, offsets, scatter effects and remainder
checks, on null tables made from the model's residual.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import fdtrc, gammaincc, log_ndtr, stdtr

from mtu_cli.analyses.close_loop.likelihood import Columns, Fit, Likelihood, lever_of
from mtu_cli.stats.least_squares import BoolArray, FloatArray, IntArray

FREED_SCATTER = {"offset,rotation": "rotation-scatter", "offset,diameter": "scale-scatter"}
"""What a datum takes from each part cannot scatter."""
CHECKS = ("pattern", "walk", "field", "column-variance", "part-variance")
AMPLITUDES = np.geomspace(1e-2, 1e4, 30)
"""Variances of a random function over the stratum's, among which the largest likelihood is."""
LEAST_LEFT = 2e-3
"""Share of a column's information that must remain with base and margins partialled out."""
LEAST_SHARE = 1e-4
"""Of a column's information, from which on a stratum counts."""
ALMOST_ONE = 1 - 1e-9
AT_HAND = 100_000
"""Numbers of null tables that are made at once."""


class Gate:
    """Tests of one table against B null tables that `rng` draws."""

    def __init__(self, likelihood: Likelihood, rng: np.random.Generator, B: int) -> None:
        self.likelihood, self.rng, self.B = likelihood, rng, B
        self.design, self.strata = likelihood.design, likelihood.design.strata
        self.ratios: dict[Columns, dict[str, float]] = {}
        """Beside each model that was tested how many times the rest's a scatter effect's is."""
        self._cache: dict[Columns, tuple[list[str], FloatArray]] = {}
        lag, places = np.arange(self.strata.shape[0]), self.design.table.mean_places
        places = places[:, np.isfinite(places).all(axis=0)]
        distance = np.linalg.norm(places[:, None] - places[None], axis=-1)
        walk = np.exp(-np.abs(np.subtract.outer(lag, lag)) / 2)
        field = np.exp(-distance / (0.15 * max(distance.max(), 1e-300)))
        self.covariances = dict[str, dict[int, FloatArray]]()
        """Covariances (n, n) in the strata if parts walk or features near one another err alike."""
        for name, kind, K in (("walk", "part", walk), ("field", "feature", field)):
            bases = {s: self.strata.directions(s)[1] for s in self.strata.of(kind)}
            self.covariances[name] = {s: basis.T @ K @ basis for s, basis in bases.items()}

    def __call__(self, columns: Columns, scatter: tuple[str, ...] = ()) -> dict[str, float]:
        """Adjusted p given a model of these columns and scatter effects, by name: of candidates,
        named random functions, offsets, scatter effects and checks.
        """
        key = tuple(sorted(columns))
        if key not in self._cache:
            self._cache[key] = self._tests(columns)
        names, T = self._cache[key]
        base = np.isin(names, scatter)
        T = np.where(base, 0.0, T)
        # The best of many members is calibrated by their effective number, as Sidak would.
        number = np.maximum(1 / np.exp(-T[1:]).mean(axis=0) - 1, 0.2)
        inner = np.log1p(-np.exp(-np.maximum(T, 1e-12)))
        family = -np.log(-np.expm1(number * inner) + 1e-300)
        family[:, T[0] == 0] = 0
        null = np.sort(family[1:].max(axis=1, initial=0.0))
        p = (self.B - np.searchsorted(null, family[0], side="left") + 1) / (self.B + 1)
        tested = zip(names, p.tolist(), base, strict=True)
        return {name: value for name, value, in_base in tested if not in_base}

    def _tests(self, columns: Columns) -> tuple[list[str], FloatArray]:
        """Names of all tests of a model, and their -log p (B + 1, k), observed first."""
        design, fit = self.design, self.likelihood.fit(columns)
        Y, cells = self._null(fit)
        at, lp = self._members(columns, fit, Y)
        of = design.owner[at]
        tests = {design.candidates[c].name: lp[:, of == c].max(axis=1) for c in np.unique(of)}
        for kernel in self.likelihood.kernels.values():
            if kernel.name:
                ratios = self.likelihood.kernel_deviance(fit, kernel, Y, AMPLITUDES)
                tests[kernel.name] = one_sided(ratios.max(axis=0))
        tests |= self._offsets(fit)
        scattering, self.ratios[tuple(sorted(columns))] = self._scatter(cells)
        tests |= scattering | self._checks(fit, Y)
        return list(tests), np.reshape(list(tests.values()), (len(tests), len(Y))).T

    # Null tables.

    def _null(self, fit: Fit) -> tuple[FloatArray, FloatArray]:
        """Coordinates (B + 1, N) of the residual and of null tables, refitted as it is; and the
        cells (P, H, A) of the interaction.

        Means of parts and features are rotated, all axes alike; cells of the interaction permuted
        among the parts within each feature, so that heavy tails and features that scatter more
        stay. Where features have no scatter (readings), all are rotated. Prior knowledge of the
        parts' scatter is further coordinates of the sphere on which they turn.
        """
        strata, like, rng = self.strata, self.likelihood, self.rng
        ratio = np.sqrt(like.n / fit.dof)
        Y = np.zeros((self.B + 1, len(fit.residual)))
        crossed = bool(strata.of("feature"))
        for kind in ("part", "line", "feature", *(() if crossed else ("interaction",))):
            group = strata.of(kind)
            # Strata of one size turn alike: an orthonormal basis of g vectors to a random g-frame.
            alike = len({int(strata.sizes[s]) for s in group}) == 1
            for block in [group] if alike else [[s] for s in group]:
                Z = np.stack([fit.residual[strata.slices[s]] * ratio[s] for s in block])
                if count := round(like.extra_dof[block].max()):
                    extra = rng.normal(size=(len(block), count))
                    sizes = np.sqrt(like.extra[block]) * ratio[block]
                    sizes = sizes / np.linalg.norm(extra, axis=1)
                    Z = np.concatenate([Z, extra * sizes[:, None]], axis=1)
                g, n = Z.shape
                R = np.linalg.qr(Z.T)[1]
                frame = np.linalg.qr(rng.normal(size=(self.B, n, min(g, n))))[0]
                signs = rng.choice([-1.0, 1.0], size=(self.B, 1, frame.shape[2]))
                rotations = np.swapaxes((frame * signs) @ R, 1, 2)
                for i, s in enumerate(block):
                    Y[1:, strata.slices[s]] = rotations[:, i, : int(strata.sizes[s])]
        inner = np.isin(strata.labels(), strata.of("interaction"))
        cells = strata.table(np.where(inner, fit.residual * ratio[strata.labels()], 0.0))
        w = fit.weights[strata.labels()]
        X = self.design.columns.dense(fit.columns)
        P, H, _A = strata.shape
        for rows in self._blocks():
            if crossed and inner.any():
                order = np.tile(np.arange(P), (rows.stop - rows.start, H, 1))
                within = np.swapaxes(rng.permuted(order, axis=2), 1, 2)
                mixed = cells[within, np.arange(H)] / np.sqrt(1 - 1 / H)
                Y[rows, inner] = strata.coordinates(mixed)[:, inner]
            if fit.columns:
                Y[rows] -= ((Y[rows] * w) @ X.T) @ fit.covariance @ X
        Y[0] = fit.residual
        return Y, cells

    def _blocks(self) -> Iterator[slice]:
        """Null tables, as many at once as a processor keeps at hand."""
        step = max(1, AT_HAND // int(np.prod(self.strata.shape)))
        for first in range(1, self.B + 1, step):
            yield slice(first, min(first + step, self.B + 1))

    # Tests.

    def _members(self, base: Columns, fit: Fit, Y: FloatArray) -> tuple[IntArray, FloatArray]:
        """-log p of every member (B + 1, M): score statistics given base and margins at the fitted
        null, in each stratum as a normal deviate, with the variance there less what the margins
        explain; pooled by the strata's information (Liptak 1958).
        """
        design, w = self.design, fit.weights
        # Of the null tables, which are random, single precision is enough.
        columns = np.arange(design.columns.count)
        U = design.columns.products(columns, Y.astype(np.float32))
        U[:, :, :1] = design.columns.products(columns, Y[:1])
        at: list[IntArray] = [np.zeros(0, int)]
        lps: list[FloatArray] = [np.zeros((len(Y), 0))]
        sums = [(Y[:, part] ** 2).sum(axis=1) for part in self.strata.slices]
        # Prior knowledge of a stratum turns with its coordinates on one sphere.
        squares = np.where(self.likelihood.extra_dof > 0, fit.dof, w * np.array(sums).T)
        least = np.maximum(w * fit.dof * self.likelihood.least, 1e-300)
        for partials in design.partials(base, w):
            k = partials.terms.shape[1]
            whole = partials.information.sum(axis=0)
            size = np.sqrt(np.maximum(np.einsum("mkk->mk", whole), 1e-300))
            scale = size[:, :, None] * size[:, None, :]
            valid = np.all(size**2 > LEAST_LEFT * partials.unadjusted, axis=1)
            valid &= np.linalg.eigvalsh(whole / scale)[:, 0] > 1e-5
            # What is not separable has no score.
            size[~valid], scale[~valid] = np.inf, np.inf
            information = partials.information / scale
            inverse = np.linalg.inv(information.sum(axis=0) + ~valid[:, None, None] * np.eye(k))
            values, vectors = np.linalg.eigh(information)
            y = w[:, None, None, None] * U[:, partials.nuisance]
            sizes = partials.inverse @ y.sum(axis=0)
            explained = np.einsum("mzn,smzn->smn", sizes, 2 * y - partials.inner @ sizes)
            leverage = np.einsum("mzy,smyz->sm", partials.inverse, partials.inner)
            total = np.zeros((*size.shape, len(Y)))
            informative = values > LEAST_SHARE
            for s in np.flatnonzero(informative.any(axis=(1, 2))).tolist():
                i = np.flatnonzero(informative[s].any(axis=1))
                m = i if len(sizes) > 1 else slice(None)
                score = w[s] * U[s][partials.terms[i]] - partials.slopes[i] @ y[s, m]
                score = (score - partials.rest[s, i] @ sizes[m]) / size[i, :, None]
                divisor = np.where(informative[s, i], values[s, i], np.inf)[:, :, None]
                stat = np.sum((vectors[s, i].transpose(0, 2, 1) @ score) ** 2 / divisor, axis=1)
                residual = np.maximum(squares[:, s] - explained[s, m], least[s])
                ratio = np.clip(stat / residual, 1e-300, ALMOST_ONE)
                power = np.maximum(self.likelihood.n[s] - leverage[s, m] - 1 - k / 2, 0.5)
                deviance = -power[:, None] * np.log1p(-ratio)
                total[i] += score * np.sqrt(deviance / np.maximum(stat, 1e-300))[:, None, :]
            D = np.sum(total * (inverse @ total), axis=1).T[:, valid]
            at.append(partials.members[valid])
            lps.append(-np.log(2) - log_ndtr(-np.sqrt(D)) if k == 1 else D / 2)
        return np.concatenate(at), np.concatenate(lps, axis=1)

    def _offsets(self, fit: Fit) -> dict[str, FloatArray]:
        """-log p of each axis' mean against the scatter of parts and features, and of the level
        that effects leave of it: where these are counted from is arbitrary.
        """
        tests = {}
        for candidate in self.design.candidates:
            if candidate.kind != "offset" or candidate.unavailable:
                continue
            a = self.design.axis(candidate)
            mean, variance, nu = self.likelihood.mean(fit, a)
            if not np.isfinite(variance):
                continue
            level, u = self.likelihood.level(fit, a)
            least = min(abs(mean) / np.sqrt(variance), abs(level) / u)
            # The constant of readings was fitted: what outliers leave in it is none.
            least *= self.design.table.fitted_degree < 0
            tests[candidate.name] = self._of_p(2 * float(stdtr(nu, -least)))
        return tests

    def _scatter(self, cells: FloatArray) -> tuple[dict[str, FloatArray], dict[str, float]]:
        """-log p (B + 1,) of likelihood ratios of one more variance within the interaction, its
        cells (P, H, A) permuted freely; by name how many times the rest's their deviation is.
        """
        table, strata = self.design.table, self.strata
        P, H, A = strata.shape
        inner = strata.of("interaction")
        levers = dict[str, FloatArray | None]()
        """Patterns (H A,) of what scatters from part to part; None: one operation."""
        for c in self.design.candidates if P >= 5 and len(inner) >= A else ():
            if c.kind != "scatter" or c.unavailable or FREED_SCATTER.get(table.datum) == c.name:
                continue
            if c.over is not None:
                levers[c.name] = None
            elif (lever := lever_of(c.name, table.axes, table.mean_places)) is not None:
                levers[c.name] = lever.ravel()
        operation = np.broadcast_to(table.operation == 1, (P, H)).ravel()
        flat = cells.reshape(P * H, A)
        squares = (flat * flat).sum(axis=1)
        result = np.zeros((self.B + 1, len(levers)))
        for rows in (slice(0, 1), *self._blocks()) if levers else ():
            order = np.tile(np.arange(P * H), (rows.stop - rows.start, 1))
            order = self.rng.permuted(order, axis=1) if rows.start else order
            for k, lever in enumerate(levers.values()):
                if lever is None:
                    result[rows, k] = squares[order] @ operation
                else:
                    of_parts = flat[order].reshape(len(order), P, H * A) @ lever
                    result[rows, k] = (of_parts**2).sum(axis=1)
        n = float(sum(self.likelihood.n[s] for s in inner))
        total = max(float(squares.sum()), 1e-300)
        kurtosis = max(float(np.mean((flat * flat * (flat.size / total)) ** 2)) - 3, 0.0)
        result = np.clip(result, 1e-9 * total, ALMOST_ONE * total)
        tests, ratios = {}, {}
        for k, (name, lever) in enumerate(levers.items()):
            share = float(operation.mean())
            a, b = (n * share, n * (1 - share)) if lever is None else (P - 1.0, n - (P - 1.0))
            if min(a, b) <= 0:
                continue
            part, rest = result[:, k], total - result[:, k]
            L = n * np.log(total / n) - a * np.log(part / a) - b * np.log(rest / b)
            L = L / (1 + kurtosis / 2) if lever is None else np.where(part / a > rest / b, L, 0.0)
            ratios[name] = float(np.sqrt(part[0] / a / (rest[0] / b)))
            tests[name] = one_sided(L)
        return tests, ratios

    def _checks(self, fit: Fit, Y: FloatArray) -> dict[str, FloatArray]:
        """Remainder checks: one pattern part x feature, a walk of the parts, a smooth
        field, both; where the residual is more than rounding.
        """
        strata, like = self.strata, self.likelihood
        P, H, _ = strata.shape
        checks = {}
        squares = np.array([np.sum(Y[0, part] ** 2) for part in strata.slices])
        rough = squares > fit.dof * like.least
        inner = [s for s in strata.of("interaction") if rough[s]]
        if P > 3 and H > 3 and inner:
            # Singular values are the same in all orthonormal coordinates.
            within = np.isin(strata.labels(), inner)
            share = np.zeros(len(Y))
            for rows in (slice(0, 1), *self._blocks()):
                E = strata.placed(np.where(within, Y[rows], 0.0))
                E = E if P <= H else np.swapaxes(E, 2, 3)
                values = np.linalg.eigvalsh(E @ np.swapaxes(E, 2, 3))
                share[rows] = (values[..., -1] / np.maximum(values.sum(-1), 1e-300)).max(axis=1)
            checks["pattern"] = gamma_log_p(share)
        for name, kernels in self.covariances.items():
            group = [s for s in kernels if rough[s]]
            if not group or min(like.n[s] for s in group) < 4:
                continue
            total = np.zeros(len(Y))
            for s in group:
                y = Y[:, strata.slices[s]]
                form = np.einsum("bn,bn->b", y @ kernels[s], y)
                total += form / np.maximum(np.einsum("bn,bn->b", y, y), 1e-300)
            checks[name] = gamma_log_p(total)
        return checks | self._variances(fit, squares, inner, rough)

    def _variances(
        self, fit: Fit, squares: FloatArray, inner: list[int], rough: BoolArray
    ) -> dict[str, FloatArray]:
        """F tests that features differ by more than single entries scatter, or parts by more than
        the model expects; where it expects nothing, than single entries. Less is ordinary: errors
        of single holes, setting up. `squares` (S,) are the residual sums of the strata.
        """
        strata, like, tests = self.strata, self.likelihood, dict[str, FloatArray]()
        P, H, _ = strata.shape
        entries = {strata.axis[s]: (squares[s] / fit.dof[s], fit.dof[s]) for s in inner}
        points = self.design.table.component is None
        for name, kind, n in (("column-variance", "feature", P), ("part-variance", "part", H)):
            group = [s for s in strata.of(kind) if rough[s] and strata.axis[s] in entries]
            p = list[float]()
            for s in group if points else ():
                variance, dof = entries[strata.axis[s]]
                ordinary, own = (1 + n) * variance, fit.dof[s]
                if known := like.extra_dof[s]:
                    ordinary, dof, own = like.extra[s] / known, known, max(own - known, 1.0)
                p.append(float(fdtrc(own, dof, squares[s] / own / ordinary)))
            if p:
                tests[name] = self._of_p(min(p) * len(p))
        return tests

    def _of_p(self, p: float) -> FloatArray:
        """-log p (B + 1,) of a test whose p is known, observed first."""
        lp = self.rng.exponential(size=self.B + 1)
        lp[0] = -np.log(np.clip(p, 1e-300, 1.0))
        return lp


def one_sided(ratio: FloatArray) -> FloatArray:
    """-log p of twice a log likelihood ratio of a variance that may be 0: by half it is 0 without
    it, by half chi^2 with one degree of freedom (Self & Liang 1987).
    """
    return np.asarray(-log_ndtr(-np.sqrt(np.maximum(ratio, 0.0))))


def gamma_log_p(x: FloatArray) -> FloatArray:
    """-log p (rows,) of a statistic by a gamma law fitted to its null rows."""
    mean, var = x[1:].mean(), max(float(x[1:].var()), 1e-300)
    low = x[1:].min() - 0.1 * abs(x[1:].min())
    shape, scale = (mean - low) ** 2 / var, var / max(mean - low, 1e-300)
    # Null rows that are all alike, as of readings without any scatter, are no null.
    if mean <= low:
        return np.zeros(len(x))
    return -np.log(np.maximum(gammaincc(shape, np.maximum(x - low, 0.0) / scale), 1e-300))
