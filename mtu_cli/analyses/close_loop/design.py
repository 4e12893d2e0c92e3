"""What does not depend on the errors: the candidates' columns in the strata, and kernels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, product
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.close_loop.strata import NONE, PADDING, Closures, Columns, Missing, Strata
from mtu_cli.model.effect_library import BoundTemplate, Candidate, Levers
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.kernels import wiener
from mtu_cli.stats.least_squares import BoolArray, FloatArray, IntArray, polynomial

STEP_RAD = 0.35
"""Angle between neighbouring members of a searched parameter."""
FINE = 8
"""Finer values a step of the library's grid, from which members at equal angles are chosen."""
SCALES = {"log": (np.log, np.exp), "frequency": (np.reciprocal, np.reciprocal)}
"""By the grid, the scale in which its values are even, and back."""
AROUND = 9
"""Finer members around one of the grid."""
SAME_RAD = 0.03
"""Angle below which two members are one."""
EMPTY = 1e-9
"""Share of a column's size below which its coordinates in the strata are rounding."""
LEAST_LEFT = 1e-6
"""Share of a column that must remain with the margins partialled out."""
DEPENDENT = 1e-4
LEAST_KNOWN = 0.01
"""Standard deviation of the coefficients along a direction, over that of an entry, below which the
direction is left out.
"""
FEW = 30
"""Values of a grid up to which all stay, weighed by the arc that each stands for."""
SEEN = 0.25
"""Share of a wave's amplitude that the targets must see."""
FEWEST_PLACES = 6
"""Different places along an axis from which on a smooth profile is a candidate."""
RANK = 1e-4
"""Share of a kernel's largest eigenvalue below which its directions are left out."""


@dataclass(slots=True, kw_only=True, eq=False)
class Member:
    """One form of a candidate at one value of what is searched (nan where nothing is), on one of
    what its family is over.

    `columns` (k, n) of its parameters, the effect's and then its margins', are what is not zero at
    the coordinates `at` (n,), `means` (k, A) theirs over the table; `basis` is an orthonormal basis
    of the effect with the margins partialled out. `terms` and `low` (of margins)
    are indices of the design's columns; of each parameter `indices` is the column (-1: within
    rounding of 0) and `factors` its lever over the unit column. `prior` is its share of the
    candidate's.
    """

    form: BoundTemplate
    value: float
    chosen: int
    at: IntArray
    columns: FloatArray
    means: FloatArray
    basis: FloatArray
    prior: float = 1.0
    around: tuple[float, ...] = ()
    candidate: int = NONE
    terms: tuple[int, ...] = ()
    low: tuple[int, ...] = ()
    indices: tuple[int, ...] = ()
    factors: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Kernel:
    """A random function: in each stratum of its `directions` V and k covariance V diag(k) V' of the
    coordinates, the mean of the eigenvalues over them 1; a profile `along` one has a name.
    """

    directions: dict[int, tuple[FloatArray, FloatArray]]
    name: str = ""
    axis: str = ""
    along: str = ""
    informed: float = 1.0
    """Coordinates of its stratum over those that it moves: that many inform each of them."""


class Partial(NamedTuple):
    """`members` (M,) with columns `terms` x (M, k), less what `nuisance` columns z (M or 1, z)
    explain in all strata at once, by `slopes` (M, k, z): their `information` (S, M, k, k) in the
    strata, `unadjusted` (M, k) in all, and the products `rest` (S, M, k, z) with z there. The
    columns z have the products `inner` (S, M or 1, z, z), by the weights of the strata, and the
    covariance `inverse`.
    """

    members: IntArray
    terms: IntArray
    nuisance: IntArray
    slopes: FloatArray
    information: FloatArray
    unadjusted: FloatArray
    rest: FloatArray
    inner: FloatArray
    inverse: FloatArray


class Design:
    """Candidates and members of a table; errors are in units of `scale` (mm).

    The first members, which are `tested`, are those of the grid; finer ones follow them. `common`
    columns are in every model: the polynomial removed from the readings, and the coefficients;
    `mean_variance` (A,) is that of the mean by the coefficients.
    """

    def __init__(
        self,
        table: ResidualTable,
        strata: Strata,
        candidates: Sequence[Candidate],
        scale: float,
        gaps: Missing,
    ) -> None:
        self.table, self.strata, self.scale, self.gaps = table, strata, scale, gaps
        self.candidates, self.columns = tuple(candidates), Columns(strata)
        self.members = list[Member]()
        self._around: dict[int, tuple[int, ...]] = {}
        self._fine: dict[int, tuple[tuple[int, ...], FloatArray, tuple[float, float]]] = {}
        powers = table.fitted_powers.T
        at, X = strata.of_levers([{0: power[None, None]} for power in powers], 1)
        X = X[:, np.linalg.norm(X[0], axis=1) > EMPTY]
        indices, _ = self.columns.add(at, X[0], np.zeros((X.shape[1], len(table.axes))))
        common = indices.tolist()
        factors = np.moveaxis(table.common, (3, 2), (0, 1))
        if len(factors):
            at, X = strata.of_levers([dict(enumerate(factor[:, None])) for factor in factors], 1)
            U, sizes, units = np.linalg.svd(X[0], full_matrices=False)
            uncertain = sizes > LEAST_KNOWN * scale
            means = (U[:, uncertain] / sizes[uncertain]).T @ factors.copy().mean(axis=(2, 3))
            precisions = (scale / sizes[uncertain]) ** 2
            common += self.columns.add_alone(at, units[uncertain], means, precisions).tolist()
        self.common = tuple(common)
        self.mean_variance = (table.common.mean(axis=(0, 1)) ** 2).sum(axis=-1) / scale**2
        for c, candidate in enumerate(candidates):
            if candidate.kind == "offset":
                continue
            found = (self.grid_members(form) for form in candidate.forms)
            distinct = _distinct_members([x for items in found for x in _at_equal_angles(items)])
            total = sum(item.prior for item in distinct)
            for _, group in groupby(distinct, key=lambda item: id(item.form)):
                for m in self.add(c, list(group)):
                    self.members[m].prior /= total
        tested = self.members[:]
        self.tested = len(tested)
        self.owner = np.array([member.candidate for member in tested], int)
        self.prior = np.array([member.prior for member in tested])
        self.closures = self.closures_of(range(self.tested))
        self._widths = np.array([(len(x.terms), len(x.low)) for x in tested], int).reshape(-1, 2)

    def members_at(self, form: BoundTemplate, values: FloatArray) -> list[Member]:
        """The members of a form at some values, but for those that are not estimable."""
        levers = [lever for x in (form, *form.margins) for lever in x.columns(values)]
        k, G = len(form.parameters), len(values if form.chosen is None else form.chosen)
        table, (P, H, A) = self.table, self.strata.shape
        means, squares = np.zeros((G, len(levers), A)), np.zeros((G, len(levers)))
        for i, lever in enumerate(levers):
            for a, v in lever.items():
                means[:, i, a] = v.mean(axis=(1, 2))
                squares[:, i] += np.mean(v**2, axis=(1, 2)) * P * H
            lever = _freed_lever(lever, table) if table.motions else lever
            levers[i] = {a: self.gaps.filled(v) for a, v in lever.items()}
        at, X = self.strata.of_levers(levers, G)
        if form.scale == "frequency":
            # Of a wave that all targets see at its zeros one column is rounding.
            squares[:, :k] = squares[:, :k].max(axis=1, keepdims=True)
        X[np.linalg.norm(X, axis=2) <= EMPTY * np.sqrt(squares)] = 0.0
        # What no column has is no direction: most columns are of one stratum.
        live = X.any(axis=(0, 1))
        at, X = at[live], X[:, :, live]
        sound, inner = _bases(X[:, :k], X[:, k:])
        width = np.any(inner, axis=2).sum(axis=1)
        # Periods: columns are of the same size for all of them.
        if form.scale == "frequency":
            sizes = np.linalg.norm(X[:, :k], axis=2)
            sound &= np.sum(sizes**2, axis=1) >= 2 * (SEEN * sizes.max()) ** 2
        return [
            Member(
                form=form,
                value=float(values[g if form.chosen is None else 0]),
                chosen=int(g),
                at=at,
                columns=X[g],
                means=means[g],
                basis=inner[g, -width[g] :],
            )
            for g in np.flatnonzero(sound)
        ]

    def grid_members(self, form: BoundTemplate) -> list[Member]:
        """The members at the values of a form's grid, finer where members may lie between."""
        values, (to, back) = form.grid, SCALES.get(form.scale, (np.asarray, np.asarray))
        if form.scale != "between":
            at = np.linspace(0, len(values) - 1, FINE * (len(values) - 1) + 1)
            values = np.asarray(back(np.interp(at, np.arange(len(values)), to(values))))
        return self.members_at(form, values)

    def fine(self, member: Member) -> tuple[tuple[int, ...], FloatArray, tuple[float, float]]:
        """All members of the grid of a member's form, finer ones too, in their order, the arc (n,)
        that each stands for, and the ends of the grid, where a wave may lack a column.
        """
        if (key := id(member.form)) not in self._fine:
            every = sorted(self.grid_members(member.form), key=lambda item: item.value)
            items, _, arcs = neighbours(every)
            limits = every[0].value, every[-1].value
            self._fine[key] = self.add(member.candidate, items), arcs, limits
        return self._fine[key]

    def add(self, c: int, members: Sequence[Member]) -> tuple[int, ...]:
        """The indices of members of one form of candidate c, their columns added to all others."""
        X = np.concatenate([member.columns for member in members])
        means = np.concatenate([member.means for member in members])
        indices, factors = self.columns.add(members[0].at, X, means)
        k, first, shape = len(members[0].form.parameters), len(self.members), (len(members), -1)
        rows = zip(indices.reshape(shape).tolist(), factors.reshape(shape).tolist(), strict=True)
        for member, (at, units) in zip(members, rows, strict=True):
            member.indices, member.factors = tuple(at), tuple(units)
            terms, low = (dict.fromkeys(i for i in ids if i != NONE) for ids in (at[:k], at[k:]))
            member.terms, member.low = tuple(terms), tuple(i for i in low if i not in terms)
            member.candidate = c
            # Thousands of members would fill the memory with what the columns hold.
            member.columns = member.basis = np.zeros((0, 0))
        self.members += members
        return tuple(range(first, len(self.members)))

    def closures_of(self, members: Sequence[int]) -> Closures:
        """Those of some members, filled up with columns of zeros."""
        closures = [(*self.members[m].terms, *self.members[m].low) for m in members]
        result = np.full((len(closures), max(map(len, closures), default=0)), PADDING)
        for row, columns in zip(result, closures, strict=True):
            row[: len(columns)] = columns
        return result, self.columns.cross(result[:, :, None], result[:, None])

    def axis(self, candidate: Candidate) -> int:
        """The axis of a candidate of one; the first of errors that have none."""
        return self.table.axes.index(candidate.axis or self.table.axes[0])

    def partials(self, base: Sequence[int], w: FloatArray) -> Iterator[Partial]:
        """The tested members with a column that those of a model, `base`, lack, by their number of
        columns: less what those of the model, the common ones and their margins explain, with the
        weights w (S,) of the strata.
        """
        all_closures, all_inner = self.closures
        for k, width in np.unique(self._widths, axis=0).tolist():
            members = np.flatnonzero((self._widths == (k, width)).all(axis=1))
            members = members[~np.isin(all_closures[members, :k], base).all(axis=1)]
            if not len(members):
                continue
            closures = all_closures[members, : k + width]
            # Views: what is padded in `low` is so in the closures.
            terms, low = closures[:, :k], closures[:, k:]
            low[np.isin(low, base)] = PADDING
            inner = all_inner[:, members, : k + width, : k + width]
            models, G = self.columns.crossed((closures, inner), (*base, *self.common))
            G *= w[:, None, None, None]
            # Margins that are alike are partialled out once.
            once = slice(1 if (low == low[0]).all() else None)
            z, zz = models[once, k:], G[:, once, k:, k:]
            xx, xz = G[:, :, :k, :k], G[:, :, :k, k:]
            A = zz.sum(axis=0)
            diagonal = 1e-10 * np.einsum("mzz->mz", A) + self.columns.precisions[z]
            inverse = np.linalg.inv(A + diagonal[:, None] * np.eye(z.shape[1]))
            slopes = xz.sum(axis=0) @ inverse
            rest = xz - slopes @ zz
            across = slopes.transpose(0, 2, 1)
            information = xx - rest @ across - (xz @ across).transpose(0, 1, 3, 2)
            unadjusted = np.einsum("smkk->mk", xx)
            yield Partial(members, terms, z, slopes, information, unadjusted, rest, zz, inverse)

    def around(self, m: int) -> tuple[int, ...]:
        """Finer members around one of the grid."""
        if m not in self._around:
            parent = self.members[m]
            finer = self.members_at(parent.form, np.array(parent.around)) if parent.around else []
            self._around[m] = self.add(parent.candidate, finer) if finer else ()
        return self._around[m]


def _freed_lever(lever: Levers, table: ResidualTable) -> Levers:
    """What a table's datum leaves of a column."""
    _, H, A = table.errors.shape
    G, p = (max(values.shape[d] for values in lever.values()) for d in (0, 1))
    full = np.zeros((p, H, A, G))
    for a, values in lever.items():
        full[:, :, a] = np.moveaxis(np.broadcast_to(values, (G, p, H)), 0, -1)
    return dict(enumerate(np.moveaxis(table.without_datum(full), (2, 3), (0, 1))))


def _bases(X: FloatArray, Z: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Of columns X (G, k, n) beside margins Z (G, m, n) orthonormal bases (G, k, n), the first zero
    where columns are; and whether (G,) they are independent and none is rounding.
    """
    sizes = (np.linalg.norm(columns, axis=2)[..., None] for columns in (X, Z))
    X, Z = (x / np.where(size > 0, size, 1.0) for x, size in zip((X, Z), sizes, strict=True))
    nonzero: BoolArray = np.any(X, axis=2)
    if Z.shape[1]:
        Zt = Z.transpose(0, 2, 1)
        gram = Z @ Zt + 1e-12 * np.eye(Z.shape[1])
        X = X - np.linalg.solve(gram, Z @ X.transpose(0, 2, 1)).transpose(0, 2, 1) @ Z
    rest = np.einsum("gkn,gkn->gk", X, X)
    sound = nonzero.any(axis=1) & np.all((rest > LEAST_LEFT) | ~nonzero, axis=1)
    values, vectors = np.linalg.eigh(X @ X.transpose(0, 2, 1))
    # Zero columns are zero eigenvalues, which stand first.
    zero = np.arange(X.shape[1]) < (~nonzero).sum(axis=1)[:, None]
    sound &= np.all((values > DEPENDENT**2) | zero, axis=1)
    scale = np.where(zero | (values <= 0), 0.0, 1 / np.sqrt(np.maximum(values, 1e-300)))
    return sound, (vectors * scale[:, None, :]).transpose(0, 2, 1) @ X


def _angles(products: FloatArray) -> FloatArray:
    """The largest principal angles of pairs of subspaces, by the products (g, k, k) of bases."""
    s = np.linalg.svd(products, compute_uv=False)
    return np.asarray(np.arccos(np.clip(s[:, -1], -1.0, 1.0)))


def neighbours(items: Sequence[Member]) -> tuple[list[Member], FloatArray, FloatArray]:
    """Members of a form with all columns, in their order, the angles (n - 1,) between each and the
    next, and the arc (n,) that each stands for.
    """
    width = max(len(item.basis) for item in items)
    items = [item for item in items if len(item.basis) == width]
    bases = np.array([item.basis for item in items])
    arcs = _angles(bases[:-1] @ bases[1:].transpose(0, 2, 1))
    ends = np.concatenate([arcs[:1], arcs, arcs[-1:]]) if len(arcs) else np.ones(2)
    return items, arcs, (ends[1:] + ends[:-1]) / 2


def _at_equal_angles(members: list[Member]) -> list[Member]:
    """Members at equal angles along what is searched; few stay all, weighed by their arcs."""
    if len(members) < 2 or not members[0].form.searched:
        return members
    members, arcs, weights = neighbours(members)
    if len(members) < FEW:
        for item, weight in zip(members, weights.tolist(), strict=True):
            item.prior = weight
        return members
    angle = np.concatenate([[0.0], np.cumsum(arcs)])
    at = np.linspace(0, angle[-1], max(2, round(angle[-1] / STEP_RAD) + 1))
    selection = np.unique(np.minimum(np.searchsorted(angle, at - 1e-9), len(members) - 1))
    middles = (selection[1:] + selection[:-1]) // 2
    lows, highs = np.append(selection[:1], middles), np.append(middles, selection[-1:])
    windows = lows[:, None] + (highs - lows)[:, None] * np.arange(AROUND) // (AROUND - 1)
    for i, window in zip(selection, windows.tolist(), strict=True):
        members[i].around = tuple(members[q].value for q in dict.fromkeys(window))
    return [members[i] for i in selection]


def _distinct_members(members: list[Member]) -> list[Member]:
    """Without members that span what an earlier one spans."""
    if not members:
        return []
    coordinates = np.unique(np.concatenate([item.at for item in members]))
    widths = np.array([len(item.basis) for item in members])
    distinct = np.ones(len(members), bool)
    for k in np.unique(widths):
        group = np.flatnonzero(widths == k)
        # Thousands of them are compared, and single precision tells the same from others.
        bases = np.zeros((len(group), k, len(coordinates)), np.float32)
        for basis, i in zip(bases, group, strict=True):
            basis[:, np.searchsorted(coordinates, members[i].at)] = members[i].basis
        pairs = product(np.moveaxis(bases, 1, 0), repeat=2)
        squares = np.asarray(sum((one @ other.T) ** 2 for one, other in pairs))
        least = np.array([STEP_RAD / 2 if members[i].around else SAME_RAD for i in group])
        # The least cosine of all is at most their root mean square.
        close = np.tril(squares > k * np.cos(least)[:, None] ** 2, -1)
        for n in np.flatnonzero(close.any(axis=1)):
            rivals = close[n] & distinct[group]
            distinct[group[n]] = np.all(_angles(bases[rivals] @ bases[n].T) >= least[n])
    return [item for item, keep in zip(members, distinct, strict=True) if keep]


# Kernels.


def kernels_of(table: ResidualTable, strata: Strata) -> Iterator[Kernel]:
    """Without a name a walk of the parts and a field over the features, of each axis and of all of
    them at once; and smooth profiles along each coordinate.
    """
    parts, features = strata.of("part"), strata.of("feature")
    lag, places = np.arange(len(table.parts)), table.mean_places
    axes = [i for i in range(3) if np.isfinite(places[:, i]).all() and np.ptp(places[:, i]) > 0]
    nameless = list[tuple[list[int], FloatArray]]()
    if len(lag) > 3:
        nameless.append((parts, np.minimum.outer(lag, lag) + 1.0))
    if features and len(axes) > 1 and len(places) > FEWEST_PLACES:
        distance = np.linalg.norm(places[:, None, axes] - places[None, :, axes], axis=-1)
        nameless.append((features, np.exp(-0.5 * (distance / (0.3 * distance.max())) ** 2)))
    for of_kind, K in nameless:
        bases = {s: _directions(strata, s, K) for s in of_kind}
        for group in [[s] for s in of_kind] + [of_kind] * (len(of_kind) > 1):
            yield Kernel(directions={s: bases[s] for s in group})
    for i in axes:
        if len(np.unique(np.round(places[:, i], 6))) < FEWEST_PLACES:
            continue
        K, along = smooth_covariance(places[:, i]), "xyz"[i]
        for a, name in enumerate(table.axes):
            of_axis = [s for s in (*features, *strata.of("interaction")) if strata.axis[s] == a]
            positioning = along == name or table.component is not None
            for s in of_axis[:1]:
                V, k = _directions(strata, s, K)
                yield Kernel(
                    name=f"profile-{name}" if positioning else f"profile-{name}-{along}",
                    axis=name if positioning else f"{name}{along}",
                    along=along,
                    directions={s: (V, k)},
                    informed=len(V) / float(np.any(V != 0.0, axis=1).sum()),
                )


def smooth_covariance(places: FloatArray) -> FloatArray:
    """Covariance (H, H) of an integrated Wiener process about its line, at places (H,)."""
    u = (places - places.mean()) / np.ptp(places)
    Q = np.linalg.qr(polynomial(u, 1))[0]
    M = np.eye(len(u)) - Q @ Q.T
    return np.asarray(M @ wiener(u, u) @ M)


def _directions(strata: Strata, s: int, K: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvectors and values in a stratum of a covariance over parts (P, P), of a stratum of the
    parts, or else of one over features (H, H) that is alike in all parts.
    """
    shared, basis = strata.directions(s)
    inner = basis.T @ K @ basis
    values, vectors = np.linalg.eigh((inner + inner.T) / 2)
    values = np.maximum(values, 0.0)
    leading = np.flatnonzero(values > RANK * values[-1])[::-1]
    full = np.zeros((int(strata.sizes[s]), len(leading)))
    full[shared] = vectors[:, leading]
    return full, values[leading] * (len(shared) / values.sum())
