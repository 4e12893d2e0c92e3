"""Thermal models of one component: the columns that they choose from, and their fit.

Columns are sensors, or groups of them, with and without lag; fits are to compressed rows of any
cycles.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.special import fdtrc

from mtu_cli.analyses.thermal_fit.series import Series
from mtu_cli.stats.compressed import Compressed, compress, effective_number, mean_products, together
from mtu_cli.stats.lag import lag_of_moments
from mtu_cli.stats.least_squares import FloatArray, LeastSquares, least_squares, polynomial
from mtu_cli.stats.ridge import RidgePath, ridge
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
PENALTIES = np.concatenate([[0.0], 10.0 ** np.arange(-8.0, 0.6, 0.5)])
"""Ridge penalties that are tried; 0 is ordinary least squares."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows(Mapping[int, Compressed]):
    """Compressed rows of some `cycles` by position index."""

    cycles: frozenset[int]
    by_position: dict[int, Compressed]

    def __getitem__(self, position: int) -> Compressed:
        return self.by_position[position]

    def __iter__(self) -> Iterator[int]:
        return iter(self.by_position)

    def __len__(self) -> int:
        return len(self.by_position)


@dataclass(frozen=True, slots=True, kw_only=True)
class Zeroed:
    """Whether every cycle has an offset of its own at each position, and by what: "setting",
    "first readings" (all are 0) or "test" of the offsets, F with its p.
    """

    offsets: bool
    by: str
    F: float | None = None
    p: float | None = None


Selection = tuple[list[int], LeastSquares]
"""Groups of sensors that were selected, and their fit."""


@dataclass(frozen=True, kw_only=True)
class Library:
    """Compressed rows 1, columns, reading by (position index, cycle index).

    `groups` are tuples of sensors, `average` (s, g) their means; column 1 + c*g + j is group j
    with the time constant `time_constants[c]`, of which the first is 0. `selections`
    by (position index, cycles, columns) are those already made: held-out cycles in turn and the
    degrees in position ask for the same ones again and again. Where the probe was `zeroed` in
    every cycle, all columns are counted from their means in each piece, which frees them of its
    offset (Frisch-Waugh), in fits and in held-out cycles alike.
    """

    positions: tuple[float | None, ...]
    cycles: tuple[str, ...]
    sensors: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    average: FloatArray
    time_constants: FloatArray
    pieces: dict[tuple[int, int], Compressed]
    zeroed: Zeroed
    selections: dict[tuple[int, frozenset[int], tuple[int, ...]], Selection] = field(
        default_factory=dict
    )

    @property
    def most_degree(self) -> int:
        """The highest degree in position that the observed positions determine."""
        return len(self.positions) - 1

    @cached_property
    def places(self) -> FloatArray:
        """Observed positions (positions,), mm; 0 for a component without any."""
        return np.array([0.0 if position is None else position for position in self.positions])

    @cached_property
    def frame(self) -> tuple[float, float]:
        """Middle c and half range h: polynomials are in (p - c)/h, which conditions well."""
        half = float(np.ptp(self.places)) / 2
        return float(self.places.max() + self.places.min()) / 2, half if half > 0 else 1.0

    @cached_property
    def _powers(self) -> FloatArray:
        middle, half = self.frame
        return polynomial((self.places - middle) / half, self.most_degree)

    def powers(self, degree: int) -> FloatArray:
        """Powers (positions, degree + 1) of the position scaled to -1 ... 1."""
        return self._powers[:, : degree + 1]

    @cached_property
    def blocks(self) -> tuple[tuple[int, ...], ...]:
        """Cycles that are held out together: each alone, or blocks of those that follow each
        other, as near to one size as can be.
        """
        count = len(self.cycles)
        many = min(count, MOST_BLOCKS)
        ends = [block * count // many for block in range(many + 1)] if many else [0]
        return tuple(tuple(range(low, high)) for low, high in pairwise(ends))

    def rows(self, cycles: Iterable[int]) -> Rows:
        """All rows of some cycles by position index."""
        wanted = frozenset(cycles)
        found: dict[int, list[Compressed]] = {}
        for (position, cycle), piece in self.pieces.items():
            if cycle in wanted:
                found.setdefault(position, []).append(piece)
        return Rows(
            cycles=wanted,
            by_position={position: together(found[position]) for position in sorted(found)},
        )

    def levels(self, rows: Rows) -> int:
        """Levels that are fitted to rows: one a position, or a position and cycle."""
        if not self.zeroed.offsets:
            return len(rows)
        return sum(cycle in rows.cycles for _, cycle in self.pieces)

    def columns(self, lags: Sequence[int]) -> list[int]:
        """Constant, one column a group with the time constant of index lags[j], reading."""
        g = len(self.groups)
        own = [1 + lag * g + j for j, lag in enumerate(lags)]
        return [0, *own, len(self.time_constants) * g + 1]


def library(
    series: Series, sensors: Sequence[str], reference: float, *, lagged: bool, zeroed: str = "auto"
) -> Library:
    """The columns of one component, lagged ones too where `lagged` is asked for and time is known.
    `zeroed`: cycle (an offset each), never, or auto.

    Sensors that never move hold no information: they are left out, and so are all of them
    where the readings differ by rounding only.
    """
    span = series.range()
    moving = [s for s in range(len(sensors)) if span[s, 1] > span[s, 0] and not series.still]
    groups = _groups(series, moving)
    average = np.zeros((len(sensors), len(groups)))
    for j, group in enumerate(groups):
        for sensor, sign in group:
            average[sensor, j] = sign / len(group)
    constants = _time_constants(series) if lagged else np.zeros(1)
    pieces = (
        _lagged_pieces(series, average, constants, reference)
        if len(constants) > 1 or (series.complete and series.shuffled)
        else _plain_pieces(series, average)
    )
    judged = _zeroed(series, pieces, len(groups), zeroed)
    if judged.offsets:
        pieces = {key: about_mean(piece) for key, piece in pieces.items()}
    return Library(
        positions=series.positions,
        cycles=tuple(series.cycles),
        sensors=tuple(sensors),
        zeroed=judged,
        groups=tuple(tuple(sensors[s] for s, _ in group) for group in groups),
        average=average,
        time_constants=constants,
        pieces=pieces,
    )


def about_mean(piece: Compressed) -> Compressed:
    """All columns but the first, the constant, less their means over the rows."""
    one = piece.factor[:, 0]
    transform = np.eye(piece.factor.shape[1])
    transform[0, 1:] = -(one @ piece.factor[:, 1:]) / float(one @ one)
    return piece.columns(transform)


def _zeroed(
    series: Series, pieces: Mapping[tuple[int, int], Compressed], groups: int, asked: str
) -> Zeroed:
    """Whether the probe was zeroed in every cycle.

    It was where the first reading of each cycle is 0 at all positions. Else offsets of cycles are
    tested against one level a position, with all sensors free: F of the sums of squares, with
    the effective number of readings, at OFFSET_P. As drift with memory and the noise of sensors
    make small offsets, too, these must also explain OFFSET_SHARE of what is left without them.
    """
    if asked != "auto":
        return Zeroed(offsets=asked == "cycle" and len(series.cycles) > 1, by="setting")
    if len(pieces) == len({p for p, _ in pieces}) or not groups or series.still:
        return Zeroed(offsets=False, by="test")
    if _first_are_zero(series):
        return Zeroed(offsets=True, by="first readings")
    tests = [_offset_test(pieces, columns) for columns in _with_lag(pieces, groups)]
    known = [each for each in tests if each is not None]
    # Lags that are left out shift the levels of cycles: the lag beside which offsets explain least.
    F, p, share = min(known, key=lambda each: each[2]) if known else (None, None, 0.0)
    offsets = p is not None and p < OFFSET_P and share > OFFSET_SHARE
    return Zeroed(offsets=offsets, by="test", F=F, p=p)


def _with_lag(pieces: Mapping[tuple[int, int], Compressed], groups: int) -> Iterator[list[int]]:
    """Columns of all groups without lag, and with each time constant beside them."""
    count = next(iter(pieces.values())).factor.shape[1] - 2
    plain = list(range(1, groups + 1))
    yield plain
    for first in range(groups + 1, count + 1, groups):
        yield [*plain, *range(first, first + groups)]


def _offset_test(
    pieces: Mapping[tuple[int, int], Compressed], columns: list[int]
) -> tuple[float, float, float] | None:
    """F of an offset for each piece instead of one level a position, its p, and the share of the
    sum of squares that the offsets explain; None where the readings are too few.
    """
    without = within = 0.0
    rank_without = rank_within = n = 0
    judged = []
    for place in {p for p, _ in pieces}:
        own = [piece for (p, _), piece in pieces.items() if p == place]
        rows, centred_own = together(own), [about_mean(piece) for piece in own]
        free = least_squares(rows.factor[:, [0, *columns]], rows.factor[:, -1])
        inner = together(centred_own)
        fitted = least_squares(inner.factor[:, columns], inner.factor[:, -1])
        weights = np.zeros(inner.factor.shape[1])
        weights[columns], weights[-1] = -fitted.coefficients, 1.0
        judged += [(piece, weights) for piece in centred_own]
        without, within, n = without + free.rss, within + fitted.rss, n + rows.n
        rank_without, rank_within = rank_without + free.rank, rank_within + fitted.rank
    square, product = mean_products(judged)
    number = effective_number(n, product / square if square > 0 else 0.0)
    more = len(pieces) + rank_within - rank_without
    dof = number - len(pieces) - rank_within
    if more < 1 or dof <= 0 or within <= 0:
        return None
    F = max(without - within, 0.0) / more / (within / dof)
    return F, float(fdtrc(more, dof, F)), 1 - within / without


def _first_are_zero(series: Series) -> bool:
    kept = series.kept()
    first = [
        kept.error[rows[0]]
        for position in series.positions
        for c in range(len(series.cycles))
        if len(rows := kept.at(position, c))
    ]
    return len(first) == len(series.pieces) and not np.any(first)


def _groups(series: Series, moving: Sequence[int]) -> list[list[tuple[int, float]]]:
    """Sensors that go together at |r| >= 0.999 with the first of their group, with their sign."""
    columns = [1 + s for s in moving]
    own = np.vstack([centred(rows, columns) for rows in series.by_position()])
    length = np.linalg.norm(own, axis=0)
    # A sensor may differ between positions alone.
    length[length == 0] = 1.0
    R = (own / length).T @ (own / length)
    groups: list[list[tuple[int, float]]] = []
    leaders: list[int] = []
    for i, sensor in enumerate(moving):
        for group, leader in zip(groups, leaders, strict=True):
            if abs(R[i, leader]) >= ALIKE:
                group.append((sensor, float(np.sign(R[i, leader]))))
                break
        else:
            groups.append([(sensor, 1.0)])
            leaders.append(i)
    return groups


def _plain_pieces(series: Series, average: FloatArray) -> dict[tuple[int, int], Compressed]:
    s, g = average.shape
    transform = np.zeros((s + 2, g + 2))
    transform[0, 0] = transform[-1, -1] = 1.0
    transform[1:-1, 1:-1] = average
    place = {position: i for i, position in enumerate(series.positions)}
    cycle = {label: i for i, label in enumerate(series.cycles)}
    return {
        (place[position], cycle[label]): piece.columns(transform)
        for (position, label), piece in series.pieces.items()
    }


def _lagged_pieces(
    series: Series, average: FloatArray, constants: FloatArray, reference: float
) -> dict[tuple[int, int], Compressed]:
    kept = series.kept()
    found = {}
    for p, position in enumerate(series.positions):
        here = np.flatnonzero(
            np.isnan(kept.position) if position is None else kept.position == position
        )
        columns = lagged_columns(kept.temperature[here] @ average, kept.time[here], constants)
        offset = reference * np.tile(average.sum(axis=0), len(constants))
        Z = np.column_stack([np.ones(len(here)), columns - offset, kept.error[here]])
        for c in range(len(series.cycles)):
            rows = Z[kept.cycle[here] == c]
            if len(rows):
                found[p, c] = compress(rows)
    return found


def lagged_columns(group: FloatArray, time: FloatArray, constants: FloatArray) -> FloatArray:
    """Groups (n, g) with each time constant, (n, k*g), constants first; rows of one time that
    follow each other are one moment.
    """
    lagged = lag_of_moments(group, time, constants)
    found: FloatArray = np.moveaxis(lagged, 0, 1).reshape(len(group), -1)
    return found


def group_columns(lib: Library, lags: Sequence[int], T: FloatArray, time: FloatArray) -> FloatArray:
    """Groups (n, g) of temperatures T (n, s), each with its time constant."""
    groups = T @ lib.average
    own, which = np.unique(lags, return_inverse=True)
    if not own.any():
        return groups
    every = lagged_columns(groups, time, lib.time_constants[own])
    found: FloatArray = every.reshape(len(T), len(own), -1)[:, which, np.arange(groups.shape[1])]
    return found


def _time_constants(series: Series) -> FloatArray:
    """0 and powers of two from twice the usual step to the length of a cycle, in min."""
    if not series.complete:
        return np.zeros(1)
    kept = series.kept()
    if np.isnan(kept.time).any():
        return np.zeros(1)
    steps, lengths = [], []
    for position in series.positions:
        for c in range(len(series.cycles)):
            time = kept.time[kept.at(position, c)]
            own = np.diff(time)
            steps += [own[own > 0]]
            lengths += [float(np.ptp(time))] if len(time) else []
    every = np.concatenate(steps)
    if not len(every):
        return np.zeros(1)
    first, last = 2 * float(np.median(every)), max(lengths)
    count = int(min(max(np.floor(np.log2(last / first)) + 1, 0), MOST_LAGS))
    return np.concatenate([[0.0], first * 2.0 ** np.arange(count)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec:
    """A model to be fitted: `kind` stepwise or ridge (lagged where `lags` are not all 0)."""

    kind: str
    degree: int
    lags: tuple[int, ...]
    penalty: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """Coefficients (m, g) in powers of the scaled position, and their unit covariance (m*g, m*g),
    that of errors of variance 1 which are independent. `intercepts` by position index;
    `parameters` number of fitted quantities.
    """

    lib: Library
    spec: Spec
    coefficients: FloatArray
    unit_covariance: FloatArray
    intercepts: dict[int, float]
    parameters: float

    @property
    def used(self) -> np.ndarray:
        """Groups of sensors that the model uses."""
        return np.flatnonzero((self.coefficients != 0).any(axis=0))

    def gradient(self, position: int) -> FloatArray:
        """Of every group (g,) at a position."""
        found: FloatArray = self.lib.powers(self.spec.degree)[position] @ self.coefficients
        return found

    def weights(self, position: int) -> FloatArray:
        """w (k,) such that Z w are the residuals at a position, Z the library's columns.

        A position that the fit has not seen takes the mean intercept of those that it has.
        """
        chosen = self.lib.columns(self.spec.lags)
        w = np.zeros(chosen[-1] + 1)
        level = self.intercepts.get(position)
        w[0] = -(float(np.mean(list(self.intercepts.values()))) if level is None else level)
        w[chosen[1:-1]] = -self.gradient(position)
        w[-1] = 1.0
        return w

    def sum_of_squares(self, rows: Rows) -> float:
        """Of the residuals of rows of any cycles."""
        total = 0.0
        for position, item in rows.items():
            total += float(np.sum((item.factor @ self.weights(position)) ** 2))
        return total

    def mean_products(self, rows: Rows) -> tuple[float, float]:
        """Mean e_i^2 and mean e_i e_(i+1) of the residuals of any cycles."""
        return mean_products((item, self.weights(position)) for position, item in rows.items())

    def autocorrelation(self, rows: Rows) -> float:
        """Lag-1 autocorrelation of the residuals, pooled over positions."""
        square, product = self.mean_products(rows)
        return product / square if square > 0 else 0.0

    def group_shares(self, rows: Rows) -> FloatArray:
        """Mean square (g,) of each group's part of the modelled drift about its mean."""
        columns = self.lib.columns(self.spec.lags)[1:-1]
        total = np.zeros(len(columns))
        for position, item in rows.items():
            squares = np.sum(centred(item, columns) ** 2, axis=0)
            total += squares * self.gradient(position) ** 2
        mean: FloatArray = total / sum(item.n for item in rows.values())
        return mean


def centred(rows: Compressed, columns: list[int] | np.ndarray) -> FloatArray:
    """Columns of a triangular factor less what the constant explains."""
    one, X = rows.factor[:, :1], rows.factor[:, columns]
    found: FloatArray = X - one @ (one.T @ X) / float(one[:, 0] @ one[:, 0])
    return found


def constant(lib: Library, rows: Rows, spec: Spec) -> Fitted:
    """No temperature: the mean reading at every position."""
    g, m = len(lib.groups), spec.degree + 1
    means = {}
    for position, item in rows.items():
        one = item.factor[:, 0]
        means[position] = float(one @ item.factor[:, -1]) / float(one @ one)
    return Fitted(
        lib=lib,
        spec=spec,
        coefficients=np.zeros((m, g)),
        unit_covariance=np.zeros((m * g, m * g)),
        intercepts=means,
        parameters=float(lib.levels(rows)),
    )


def fit(lib: Library, rows: Rows, spec: Spec) -> Fitted:
    """The fit of a spec to some rows."""
    if spec.kind == "stepwise":
        return _fit_stepwise(lib, rows, spec)
    path = ridge_path(lib, rows, spec, np.array([spec.penalty]))
    return Fitted(
        lib=lib,
        spec=spec,
        coefficients=path.coefficients[0].reshape(spec.degree + 1, -1),
        unit_covariance=path.unit_covariance(0),
        intercepts=dict(zip(rows, path.intercepts[0].tolist(), strict=True)),
        parameters=float(path.effective[0]) + lib.levels(rows),
    )


def ridge_path(lib: Library, rows: Rows, spec: Spec, penalties: FloatArray) -> RidgePath:
    """Ridge fits with an intercept a position, for every penalty."""
    chosen = lib.columns(spec.lags)
    P = lib.powers(spec.degree)
    free, X, y, places = [], [], [], list(rows)
    for i, position in enumerate(places):
        factor = rows[position].factor[:, chosen]
        ones = np.zeros((len(factor), len(places)))
        ones[:, i] = factor[:, 0]
        free.append(ones)
        X.append((P[position][None, :, None] * factor[:, None, 1:-1]).reshape(len(factor), -1))
        y.append(factor[:, -1])
    n = sum(item.n for item in rows.values())
    return ridge(np.vstack(free), np.vstack(X), np.concatenate(y), n, penalties)


def path_losses(
    lib: Library, fitted_to: Rows, held: Rows, spec: Spec, path: RidgePath
) -> FloatArray:
    """Residual sums of squares (l,) over held-out rows, for every penalty of a path."""
    chosen = lib.columns(spec.lags)
    places = list(fitted_to)
    B = path.coefficients.reshape(len(path.coefficients), spec.degree + 1, -1)
    total = np.zeros(len(B))
    for position, item in held.items():
        factor = item.factor[:, chosen]
        a = path.intercepts.mean(axis=1)
        if position in fitted_to:
            a = path.intercepts[:, places.index(position)]
        gradient = np.einsum("m,lmg->gl", lib.powers(spec.degree)[position], B)
        left = factor[:, -1:] - factor[:, :1] * a - factor[:, 1:-1] @ gradient
        total += np.einsum("rl,rl->l", left, left)
    return total


def _fit_stepwise(lib: Library, rows: Rows, spec: Spec) -> Fitted:
    """The paper's way: sensors selected at each position, then a polynomial through positions.

    Valdes et al., eqs. (5)-(8) and (13). The intercepts follow from the final coefficients, so
    that a polynomial of fewer powers than positions is not charged with the means.
    """
    chosen = lib.columns(spec.lags)
    g, m = len(lib.groups), spec.degree + 1
    places = list(rows)
    V = lib.powers(spec.degree)[places]
    W = through_places(V)
    gradients = np.zeros((len(places), g))
    unit = np.zeros((m, g, m, g))
    parameters = float(lib.levels(rows))
    for i, position in enumerate(places):
        selected, found = _selected(lib, rows, position, chosen)
        gradients[i, selected] = found.coefficients[1:]
        covariance = np.zeros((g, g))
        covariance[np.ix_(selected, selected)] = found.unscaled_covariance[1:, 1:]
        unit += np.einsum("a,b,jk->ajbk", W[:, i], W[:, i], covariance)
        parameters += len(selected) * m / len(places)
    coefficients = W @ gradients
    return Fitted(
        lib=lib,
        spec=spec,
        coefficients=coefficients,
        unit_covariance=unit.reshape(m * g, m * g),
        intercepts={
            position: _intercept(rows[position].factor[:, chosen], V[i] @ coefficients)
            for i, position in enumerate(places)
        },
        parameters=parameters,
    )


def through_places(V: FloatArray) -> FloatArray:
    """W (m, p) such that W y are the m powers of the least-squares polynomial through values y
    at p places, V (p, m) their powers.
    """
    return np.column_stack([least_squares(V, unit).coefficients for unit in np.eye(len(V))])


def _selected(lib: Library, rows: Rows, position: int, chosen: list[int]) -> Selection:
    """Groups of sensors that stepwise selection takes at one position, and their fit."""
    key = (position, rows.cycles, tuple(chosen))
    if key not in lib.selections:
        more = sum(p == position and c in rows.cycles for p, c in lib.pieces) - 1
        lib.selections[key] = _selection(rows[position], chosen, more if lib.zeroed.offsets else 0)
    return lib.selections[key]


def _selection(rows: Compressed, chosen: list[int], offsets: int) -> Selection:
    """As many `offsets` were taken out of the rows beside their mean."""
    own = Compressed(
        factor=rows.factor[:, chosen],
        n=max(rows.n - offsets, 1),
        lag=rows.lag[np.ix_(chosen, chosen)],
        pairs=rows.pairs,
    )
    columns = [0, *stepwise(own)]
    found = least_squares(own.factor[:, columns], own.factor[:, -1])
    return [column - 1 for column in columns[1:]], found


def _intercept(factor: FloatArray, gradient: FloatArray) -> float:
    """The mean reading less what the sensors explain of it."""
    left = factor[:, -1] - factor[:, 1:-1] @ gradient
    one = factor[:, 0]
    return float(one @ left) / float(one @ one)
