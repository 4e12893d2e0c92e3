"""Thermal models of one component: the columns that they choose from, and their fit.

Columns are sensors, or groups of them, with and without lag; fits are to compressed rows of any
cycles.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.special import fdtrc

from mtu_cli.analyses.thermal_fit.series import Series, about_means
from mtu_cli.stats.compressed import Compressed, compress, effective_number, mean_products, together
from mtu_cli.stats.lag import lag_of_moments
from mtu_cli.stats.least_squares import FloatArray, LeastSquares, least_squares, polynomial
from mtu_cli.stats.ridge import ridge
from mtu_cli.stats.stepwise import stepwise

ALIKE = 0.999
"""Correlation from which on two sensors are one to any fit (Valdes et al.)."""
MOST_LAGS = 7
MOST_BLOCKS = 12
"""Cycles up to which each is held out alone; more are held out in this many blocks, because each
block's model is chosen by holding out the others in turn: the square of their number of fits.
"""
OFFSET_P, OFFSET_SHARE = 0.001, 0.7
"""Level of the test of cycles' offsets, and their least share of what is left without them."""
ROUNDING = 1e-12
"""Share of a sum's terms, or of the readings, that is rounding."""

EMPTY = np.zeros((0, 0))

Pieces = dict[tuple[int, int], Compressed]
"""Compressed rows by (position index, cycle index)."""


@dataclass(frozen=True, kw_only=True)
class Rows:
    """Compressed rows of some cycles by position index, and how many `offsets` more than one level
    were taken out of them there; `selected`: see `_selected`.
    """

    by_position: dict[int, Compressed]
    offsets: dict[int, int]
    selected: dict[int, tuple[list[int], LeastSquares]] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Number of readings."""
        return sum(item.n for item in self.by_position.values())

    @property
    def levels(self) -> int:
        """Levels that are fitted: one a position, or a position and cycle."""
        return len(self.by_position) + sum(self.offsets.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class Zeroed:
    """Whether every cycle has an offset of its own at each position, and by what: "setting",
    "first readings" (all are 0) or "test" of the offsets, F with its p.
    """

    offsets: bool
    by: str
    F: float | None = None
    p: float | None = None


@dataclass(frozen=True, kw_only=True)
class Library:
    """What the models of a component are made of.

    `groups` are tuples of sensors, `average` (s, g) their means. `Z` (n, 2 + k g) are the rows 1,
    columns, reading: column 1 + c g + j is the rise of group j above the reference, degC, with the
    time constant `time_constants[c]`, min, of which the first is 0. Where the probe was `zeroed`
    in every cycle all columns of the `pieces` count from their means there, which frees them of
    its offset (Frisch-Waugh), in fits and in held-out cycles alike. `step` between readings, min.
    """

    series: Series
    sensors: tuple[str, ...]
    reference: float
    groups: tuple[tuple[str, ...], ...]
    average: FloatArray
    time_constants: FloatArray
    step: float
    Z: FloatArray
    pieces: Pieces
    zeroed: Zeroed
    known: dict[frozenset[int], Rows] = field(default_factory=dict)

    @property
    def most_degree(self) -> int:
        """The highest degree in position that the observed positions determine."""
        return len(self.series.positions) - 1

    @cached_property
    def frame(self) -> tuple[float, float, FloatArray]:
        """The middle c of the observed positions (mm; 0 without an axis), their half range h, and
        all powers (positions, positions) of (p - c)/h, which conditions well.
        """
        places = np.array([position or 0.0 for position in self.series.positions])
        middle, half = float(places.max() + places.min()) / 2, float(np.ptp(places)) / 2 or 1.0
        return middle, half, polynomial((places - middle) / half, self.most_degree)

    def powers(self, degree: int) -> FloatArray:
        """Powers (positions, degree + 1) of the position scaled to -1 ... 1."""
        return self.frame[2][:, : degree + 1]

    @cached_property
    def blocks(self) -> tuple[tuple[int, ...], ...]:
        """Cycles that are held out together: each alone, or blocks of those that follow each
        other, as near to one size as can be.
        """
        count = len(self.series.cycles)
        many = min(count, MOST_BLOCKS)
        ends = [block * count // many for block in range(many + 1)]
        return tuple(tuple(range(ends[i], ends[i + 1])) for i in range(many))

    def rows(self, cycles: Iterable[int]) -> Rows:
        """All rows of some cycles."""
        wanted = frozenset(cycles)
        if wanted not in self.known:
            found: dict[int, list[Compressed]] = {}
            for (position, cycle), piece in sorted(self.pieces.items(), key=lambda item: item[0]):
                if cycle in wanted:
                    found.setdefault(position, []).append(piece)
            offsets = {p: len(own) - 1 for p, own in found.items() if self.zeroed.offsets}
            joined = {position: together(own) for position, own in found.items()}
            self.known[wanted] = Rows(by_position=joined, offsets=offsets)
        return self.known[wanted]

    @property
    def all_rows(self) -> Rows:
        """The rows of all cycles."""
        return self.rows(range(len(self.series.cycles)))

    def columns(self, lags: Sequence[int]) -> list[int]:
        """Constant, one column a group with the time constant of index lags[j], reading."""
        g = len(self.groups)
        return [0, *(1 + lag * g + j for j, lag in enumerate(lags)), self.Z.shape[1] - 1]


def library(
    series: Series,
    sensors: tuple[str, ...],
    reference: float,
    *,
    lagged: bool,
    zeroed: str = "auto",
) -> Library:
    """The columns of one component, lagged ones too where `lagged` is asked for and time is known.
    `zeroed`: cycle (an offset each), never, or auto.

    Sensors that never move hold no information: they are left out, and so are all of them
    where the readings differ by rounding only.
    """
    moves = (np.ptp(series.range, axis=1) > 0) & (not series.still)
    groups = _alike(series, np.flatnonzero(moves).tolist())
    average = np.zeros((len(sensors), len(groups)))
    for j, group in enumerate(groups):
        for sensor, sign in group:
            average[sensor, j] = sign / len(group)
    step, constants = _time_constants(series)
    constants = constants if lagged else constants[:1]
    rise = (series.T - reference) @ average
    edges = [*series.place_starts.tolist(), len(rise)]
    columns = [
        np.moveaxis(lag_of_moments(rise[low:high], series.time[low:high], constants), 0, 1)
        for low, high in pairwise(edges)
    ]
    lags = np.concatenate(columns).reshape(len(rise), -1)
    Z = np.column_stack([np.ones(len(rise)), lags, series.y])
    pieces = {key: compress(Z[rows]) for key, rows in series.runs.items()}
    judged = _zeroed(series, pieces, len(groups), zeroed)
    if judged.offsets:
        pieces = {key: about_mean(piece) for key, piece in pieces.items()}
    return Library(
        series=series,
        sensors=sensors,
        reference=reference,
        groups=tuple(tuple(sensors[s] for s, _ in group) for group in groups),
        average=average,
        time_constants=constants,
        step=step,
        Z=Z,
        pieces=pieces,
        zeroed=judged,
    )


def _alike(series: Series, moving: Iterable[int]) -> list[list[tuple[int, float]]]:
    """Sensors that go together at |r| >= 0.999 with the first of their group, with their sign."""
    own, _ = about_means(series.T, series.place_starts)
    length = np.linalg.norm(own, axis=0)
    # A sensor may differ between positions alone.
    own = own / np.where(length > 0, length, 1.0)
    groups: list[list[tuple[int, float]]] = []
    for sensor in moving:
        for group in groups:
            r = float(own[:, sensor] @ own[:, group[0][0]])
            if abs(r) >= ALIKE:
                group.append((sensor, float(np.sign(r))))
                break
        else:
            groups.append([(sensor, 1.0)])
    return groups


def _time_constants(series: Series) -> tuple[float, FloatArray]:
    """The usual step between readings, min (0: unknown); 0, and from twice that powers of two."""
    steps = np.diff(series.time)[np.diff(series.piece) == 0]
    if np.isnan(series.time).any() or not (steps > 0).any():
        return 0.0, np.zeros(1)
    step = float(np.median(steps[steps > 0]))
    ends = np.append(series.piece_starts[1:], len(series.time)) - 1
    longest = float((series.time[ends] - series.time[series.piece_starts]).max())
    count = int(min(max(np.floor(np.log2(longest / (2 * step))) + 1, 0), MOST_LAGS))
    return step, np.concatenate([[0.0], 2 * step * 2.0 ** np.arange(count)])


def about_mean(piece: Compressed) -> Compressed:
    """All columns but the first, the constant, less their means over the rows."""
    one = piece.factor[:, 0]
    transform = np.eye(piece.factor.shape[1])
    transform[0, 1:] = -(one @ piece.factor[:, 1:]) / float(one @ one)
    return piece.columns(transform)


def _zeroed(series: Series, pieces: Pieces, groups: int, asked: str) -> Zeroed:
    """Whether the probe was zeroed in every cycle.

    It was where the first reading of each cycle is 0 at all positions. Else offsets of cycles are
    tested against one level a position, with all sensors free: F with the effective number of
    readings, at OFFSET_P. As memory and noise make small offsets, too, these must also explain
    OFFSET_SHARE of what is left without them.
    """
    if asked != "auto":
        return Zeroed(offsets=asked == "cycle" and len(series.cycles) > 1, by="setting")
    if len(pieces) == len(series.positions) or not groups or series.still:
        return Zeroed(offsets=False, by="test")
    if not series.y[series.piece_starts].any():
        return Zeroed(offsets=True, by="first readings")
    # Lags that are left out shift the levels of cycles: the lag beside which offsets explain least.
    tests = sorted(_offset_tests(series, pieces, groups))
    if not tests:
        return Zeroed(offsets=False, by="test")
    share, F, p = tests[0]
    return Zeroed(offsets=p < OFFSET_P and share > OFFSET_SHARE, by="test", F=F, p=p)


def _offset_tests(
    series: Series, pieces: Pieces, groups: int
) -> Iterator[tuple[float, float, float]]:
    """The share of the sum of squares that offsets of the pieces explain, with F and p: with all
    groups without lag, and with each time constant beside them.
    """
    plain = [*range(1, groups + 1)]
    centred = {key: about_mean(piece) for key, piece in pieces.items()}
    count = next(iter(pieces.values())).factor.shape[1] - 2
    for first in range(1, count + 1, groups):
        columns = [*plain, *(range(first, first + groups) if first > 1 else ())]
        without = within = 0.0
        more, used, judged = len(pieces), len(pieces), []
        for place in range(len(series.positions)):
            keys = [key for key in pieces if key[0] == place]
            rows, inner = (together([of[key] for key in keys]).factor for of in (pieces, centred))
            free = least_squares(rows[:, [0, *columns]], rows[:, -1])
            fitted = least_squares(inner[:, columns], inner[:, -1])
            weights = np.zeros(count + 2)
            weights[columns], weights[-1] = -fitted.coefficients, 1.0
            judged += [(centred[key], weights) for key in keys]
            without, within = without + free.rss, within + fitted.rss
            more, used = more + fitted.rank - free.rank, used + fitted.rank
        square, product = mean_products(judged)
        dof = effective_number(len(series.y), product / square if square > 0 else 0.0) - used
        if more > 0 and dof > 0 and within > 0:
            F = max(without - within, 0.0) / more / (within / dof)
            yield 1 - within / without, F, float(fdtrc(more, dof, F))


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec:
    """A model to be fitted: `kind` stepwise or ridge (lagged where `lags` are not all 0)."""

    kind: str
    degree: int
    lags: tuple[int, ...]
    penalty: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """Coefficients (..., m, g) in powers of the scaled position, of one fit or of one for each of
    several penalties, and `levels` (...) by position index. `unit_covariance` (m*g, m*g) is that
    of one fit for independent errors of variance 1, `parameters` its number of fitted quantities.
    """

    lib: Library
    spec: Spec
    coefficients: FloatArray
    levels: dict[int, FloatArray]
    unit_covariance: FloatArray
    parameters: float

    @property
    def columns(self) -> list[int]:
        """Those of the library that it uses."""
        return self.lib.columns(self.spec.lags)

    @property
    def used(self) -> np.ndarray:
        """Groups of sensors that the model uses."""
        return np.flatnonzero((self.coefficients != 0).any(axis=0))

    def gradient(self, position: int) -> FloatArray:
        """Of every group (..., g) at a position; powers that cancel leave 0 and no rounding."""
        return _gradient(self.lib.powers(self.spec.degree)[position], self.coefficients)

    def weights(self, position: int) -> FloatArray:
        """w (..., 2 + g) such that Z w are the residuals at a position, Z its `columns`.

        A position that the fit has not seen takes the mean level of those that it has.
        """
        mean = np.mean([*self.levels.values()], axis=0)
        level = np.asarray(self.levels.get(position, mean))[..., None]
        parts = [-level, -self.gradient(position), np.ones_like(level)]
        return np.concatenate(parts, axis=-1)

    def sum_of_squares(self, rows: Rows) -> FloatArray:
        """Of the residuals (...) of rows of any cycles."""
        columns, total = self.columns, np.zeros(self.coefficients.shape[:-2])
        for position, item in rows.by_position.items():
            left = item.factor[:, columns] @ self.weights(position).T
            total = total + np.sum(left**2, axis=0)
        return total

    def mean_products(self, rows: Rows) -> tuple[float, float]:
        """Mean e_i^2 and mean e_i e_(i+1) of the residuals of any cycles."""
        own = rows.by_position.items()
        return mean_products((only(x, self.columns), self.weights(p)) for p, x in own)

    def autocorrelation(self, rows: Rows) -> float:
        """Lag-1 autocorrelation of the residuals, pooled over positions."""
        square, product = self.mean_products(rows)
        return product / square if square > 0 else 0.0

    def group_shares(self, rows: Rows) -> FloatArray:
        """Mean square (g,) of each group's part of the modelled drift about its mean."""
        total = np.zeros(len(self.lib.groups))
        for position, item in rows.by_position.items():
            inner = centred(item, self.columns[1:-1])
            total += np.sum(inner**2, axis=0) * self.gradient(position) ** 2
        return total / rows.n


def _gradient(power: FloatArray, coefficients: FloatArray) -> FloatArray:
    """sum_m power_m coefficients (..., m, g); terms that cancel leave 0 and no rounding."""
    terms = power[:, None] * coefficients
    result = terms.sum(axis=-2)
    known = np.abs(result) > ROUNDING * np.abs(terms).sum(axis=-2)
    return np.where(known, result, 0.0)


def only(item: Compressed, columns: Sequence[int]) -> Compressed:
    """Some of the columns."""
    lag = item.lag[np.ix_(columns, columns)]
    return Compressed(factor=item.factor[:, columns], n=item.n, lag=lag, pairs=item.pairs)


def centred(rows: Compressed, columns: Sequence[int] | np.ndarray) -> FloatArray:
    """Columns of a triangular factor less what the constant explains."""
    one, X = rows.factor[:, :1], rows.factor[:, columns]
    result: FloatArray = X - one @ (one.T @ X) / float(one[:, 0] @ one[:, 0])
    return result


def fit(lib: Library, rows: Rows, spec: Spec, penalties: FloatArray | None = None) -> Fitted:
    """The fit of a spec to some rows; a coefficient that is nothing but rounding is 0. With
    `penalties` a fit for each of these (stepwise: one), to predict by.
    """
    if spec.kind == "stepwise":
        return _stepwise(lib, rows, spec)
    columns, P = lib.columns(spec.lags), lib.powers(spec.degree)
    levels, blocks, target = [], [], []
    for i, (position, item) in enumerate(rows.by_position.items()):
        factor = item.factor[:, columns]
        ones = np.zeros((len(factor), len(rows.by_position)))
        ones[:, i] = factor[:, 0]
        levels.append(ones)
        blocks.append(np.kron(P[position], factor[:, 1:-1]))
        target.append(factor[:, -1])
    X, y = np.vstack(blocks), np.concatenate(target)
    tried = np.array([spec.penalty]) if penalties is None else penalties
    path = ridge(np.vstack(levels), X, y, rows.n, tried)
    if penalties is not None:
        return levelled(lib, rows, spec, path.coefficients)
    b = path.coefficients[0]
    b = np.where(np.abs(b) * np.linalg.norm(X, axis=0) > ROUNDING * np.linalg.norm(y), b, 0.0)
    parameters = float(path.effective[0]) + rows.levels
    return levelled(lib, rows, spec, b, path.unit_covariance(0), parameters)


def levelled(
    lib: Library,
    rows: Rows,
    spec: Spec,
    b: FloatArray,
    unit_covariance: FloatArray = EMPTY,
    parameters: float = np.nan,
) -> Fitted:
    """Coefficients b (..., m*g) with the level that fits the readings best at every position."""
    columns, powers = lib.columns(spec.lags), lib.powers(spec.degree)
    B = b.reshape(*b.shape[:-1], spec.degree + 1, len(lib.groups))
    levels = {}
    for position, item in rows.by_position.items():
        factor = item.factor[:, columns]
        one, modelled = factor[:, 0], factor[:, 1:-1] @ _gradient(powers[position], B).T
        levels[position] = (one @ factor[:, -1] - one @ modelled) / float(one @ one)
    return Fitted(
        lib=lib,
        spec=spec,
        coefficients=B,
        levels=levels,
        unit_covariance=unit_covariance,
        parameters=parameters,
    )


def _stepwise(lib: Library, rows: Rows, spec: Spec) -> Fitted:
    """The paper's way: sensors selected at each position, then a polynomial through positions
    (Valdes et al., eqs. (5)-(8) and (13)). The levels follow from the final coefficients.
    """
    g, m, places = len(lib.groups), spec.degree + 1, list(rows.by_position)
    W = through_places(lib.powers(spec.degree)[places])
    gradients = np.zeros((len(places), g))
    unit = np.zeros((m, g, m, g))
    parameters = float(rows.levels)
    for i, position in enumerate(places):
        chosen, found = _selected(lib, rows, position)
        gradients[i, chosen] = found.coefficients[1:]
        covariance = np.zeros((g, g))
        covariance[np.ix_(chosen, chosen)] = found.unscaled_covariance[1:, 1:]
        unit += np.einsum("a,b,jk->ajbk", W[:, i], W[:, i], covariance)
        parameters += len(chosen) * m / len(places)
    b = np.concatenate([_gradient(row, gradients) for row in W])
    return levelled(lib, rows, spec, b, unit.reshape(m * g, m * g), parameters)


def through_places(V: FloatArray) -> FloatArray:
    """W (m, p) such that W y are the m powers of the least-squares polynomial through values y
    at p places, V (p, m) their powers.
    """
    return np.column_stack([least_squares(V, unit).coefficients for unit in np.eye(len(V))])


def _selected(lib: Library, rows: Rows, position: int) -> tuple[list[int], LeastSquares]:
    """Groups of sensors that stepwise selection takes at one position, whatever the degree."""
    if position not in rows.selected:
        item = only(rows.by_position[position], lib.columns((0,) * len(lib.groups)))
        item = replace(item, n=max(item.n - rows.offsets.get(position, 0), 1))
        columns = [0, *stepwise(item)]
        found = least_squares(item.factor[:, columns], item.factor[:, -1])
        rows.selected[position] = [column - 1 for column in columns[1:]], found
    return rows.selected[position]
