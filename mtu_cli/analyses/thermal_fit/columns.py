"""The columns that thermal models choose from: sensors, or groups of them, with and without lag."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np

from mtu_cli.analyses.thermal_fit.series import Series
from mtu_cli.stats.compressed import Compressed, compress, together
from mtu_cli.stats.lag import lag_of_moments
from mtu_cli.stats.least_squares import FloatArray, LeastSquares, polynomial

ALIKE = 0.999
"""Correlation from which on two sensors are one to any fit (Valdes et al.)."""
MOST_LAGS = 7
MOST_BLOCKS = 12
"""Cycles up to which each is held out alone; more are held out in this many blocks, because each
block's model is chosen by holding out the others in turn: the square of their number of fits.
"""


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


Selection = tuple[list[int], LeastSquares]
"""Groups of sensors that were selected, and their fit."""


@dataclass(frozen=True, kw_only=True)
class Library:
    """Compressed rows 1, columns, reading by (position index, cycle index).

    `groups` are tuples of sensors, `average` (s, g) their means; column 1 + c*g + j is group j
    with the time constant `time_constants[c]`, of which the first is 0. `selections`
    by (position index, cycles, columns) are those already made: held-out cycles in turn and the
    degrees in position ask for the same ones again and again.
    """

    positions: tuple[float | None, ...]
    cycles: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    average: FloatArray
    time_constants: FloatArray
    pieces: dict[tuple[int, int], Compressed]
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

    def columns(self, lags: Sequence[int]) -> list[int]:
        """Constant, one column a group with the time constant of index lags[j], reading."""
        g = len(self.groups)
        own = [1 + lag * g + j for j, lag in enumerate(lags)]
        return [0, *own, len(self.time_constants) * g + 1]


def library(series: Series, sensors: Sequence[str], reference: float, *, lagged: bool) -> Library:
    """The columns of one component, lagged ones too where `lagged` is asked for and time is known.

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
    return Library(
        positions=series.positions,
        cycles=tuple(series.cycles),
        groups=tuple(tuple(sensors[s] for s, _ in group) for group in groups),
        average=average,
        time_constants=constants,
        pieces=pieces,
    )


def _groups(series: Series, moving: Sequence[int]) -> list[list[tuple[int, float]]]:
    """Sensors that go together at |r| >= 0.999 with the first of their group, with their sign."""
    by_position: dict[float | None, list[Compressed]] = {}
    for (position, _), piece in series.pieces.items():
        by_position.setdefault(position, []).append(piece)
    centred = np.vstack([_without_constant(together(items)) for items in by_position.values()])
    own = centred[:, [1 + s for s in moving]]
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


def _without_constant(rows: Compressed) -> FloatArray:
    """The triangular factor less what the constant explains."""
    one = rows.factor[:, :1]
    found: FloatArray = rows.factor - one @ (one.T @ rows.factor) / float(one[:, 0] @ one[:, 0])
    return found


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
