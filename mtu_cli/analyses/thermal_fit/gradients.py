"""What each sensor does, with its uncertainty, and which sensors the data do not tell apart.

The model that predicts best is selected or shrunk, and the covariance of its coefficients knows
nothing of that. A gradient's uncertainty is therefore taken from the full model: least squares
of all groups of sensors, with the lags and the degree that were chosen, errors with memory, and
cycles as clusters (`stats.serial`), corrected for the attenuation by the sensors' noise, which
collinear sensors suffer from most. With b the gradient of the model and b_full +- u_full that of
the full one, the mean square error of b is estimated by variance and square of the bias,

    u^2 = u_full^2 + (b - b_full)^2.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.thermal_fit.models import Fitted, lagged_columns
from mtu_cli.analyses.thermal_fit.uncertainty import Rest
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.serial import Block, SerialFit, serial_fit

BINS = 64
"""Readings of a position and cycle that enter; of more, neighbours are averaged."""
MOST_BLOCKS = 48
"""Positions and cycles that enter; more of them are taken evenly."""
BETTER_KNOWN = 0.5
"""Sensors trade their drift where u of their common gradient is at most this share of each u ..."""
TOLD_APART = 0.5
"""... and are not separable where the interval of one reaches this share of the common gradient."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gradient:
    """Of one sensor at a position, mm or rad per degC: `u` and `interval` (95 %), None where the
    readings do not determine it; `by` "cycles" (their scatter) or "model" (of the errors).
    """

    value: float
    u: float | None
    interval: tuple[float, float] | None
    dof: float
    by: str


class Inseparable(NamedTuple):
    """Sensors at a position that only have a gradient together: the drift per degC of the first,
    the others moving with it as they did in the readings.
    """

    position: float | None
    sensors: tuple[str, ...]
    value: float
    u: float | None
    interval: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class Gradients:
    """The model at an observed position, by sensor, and the sensors that are not separable."""

    position: float | None
    gradients: dict[str, float]
    known: dict[str, Gradient] = field(default_factory=dict)
    inseparable: tuple[Inseparable, ...] = ()

    @property
    def u(self) -> dict[str, float | None]:
        """Standard uncertainties by sensor."""
        return {sensor: own.u for sensor, own in self.known.items()}

    @property
    def intervals(self) -> dict[str, tuple[float, float] | None]:
        """95 % intervals by sensor."""
        return {sensor: own.interval for sensor, own in self.known.items()}

    def separable(self, sensor: str | None) -> bool:
        """Whether the readings tell the gradient of a sensor from that of all others."""
        return not any(sensor in group.sensors for group in self.inseparable)


def gradients(found: Fitted, rest: Rest, noise: FloatArray) -> tuple[Gradients, ...]:
    """The model's gradients at every observed position; `noise` (2, g) of a reading of each
    group, as it comes through its lag and as it is read, degC.
    """
    lib = found.lib
    full, movement = _full(found, rest, noise) if found.used.size else (None, None)
    return tuple(
        _at(found, p, full, movement) if full is not None and movement is not None
        else Gradients(position=position, gradients={})
        for p, position in enumerate(lib.positions)
    )  # fmt: skip


def _full(found: Fitted, rest: Rest, noise: FloatArray) -> tuple[SerialFit, FloatArray]:
    """The fit of all groups, with and without their lags, to the kept rows, and the covariance
    (g, g) of the groups about their levels.

    Lags are known to a factor only, may be another sensor's, and one that smooths the noise of a
    sensor may be none: where the model has lags, a group has u_lag b + sum_c (u_c - u_lag) b_c
    of other lags c, the steady state of which is b.
    """
    lib, spec, kept = found.lib, found.spec, rest.kept
    places = [(p, c) for p in range(len(lib.positions)) for c in range(len(lib.cycles))]
    rows = {(p, c): kept.at(lib.positions[p], c) for p, c in places}
    there = [key for key in places if len(rows[key]) > 1]
    there = [there[i] for i in _evenly(len(there), MOST_BLOCKS)]
    blocks, squares = [], np.zeros((len(lib.groups), len(lib.groups)))
    change, of, through = _other_lags(found, rest, noise)
    whose = np.concatenate([np.arange(len(lib.groups)), of])
    in_columns = np.equal.outer(whose, whose) * np.outer(through, through)
    for p, c in there:
        here = rows[p, c]
        edges = np.unique(np.linspace(0, len(here), min(len(here), BINS) + 1).astype(int)[:-1])
        count = np.diff(np.append(edges, len(here)))[:, None]
        columns = np.column_stack([rest.rise[here], change[here], kept.error[here]])
        Z = np.add.reduceat(columns, edges, axis=0) / count
        rise, y = Z[:, : len(lib.groups)], Z[:, -1]
        centred = rise - rise.mean(axis=0)
        squares += centred.T @ centred
        power = lib.powers(spec.degree)[p]
        X = [np.kron(power, rise), np.kron(power, Z[:, len(lib.groups) : -1])]
        if not lib.zeroed.offsets:
            X.append(np.tile(np.arange(len(lib.positions)) == p, (len(Z), 1)).astype(float))
        joined = np.hstack(X)
        N = np.zeros((joined.shape[1],) * 2)
        size = len(power) * len(through)
        N[:size, :size] = np.kron(np.outer(power, power), in_columns) / count.mean()
        order = _powers_first(len(power), len(lib.groups), len(of))
        N[:size, :size] = N[np.ix_(order, order)]
        blocks.append(Block(joined, y, c, N))
    return serial_fit(blocks, levels=lib.zeroed.offsets), squares


def _powers_first(powers: int, groups: int, others: int) -> np.ndarray:
    """Where the columns of each power stand, groups of all powers before the others of all."""
    index = np.arange(powers * (groups + others)).reshape(powers, -1)
    found: np.ndarray = np.concatenate([index[:, :groups].ravel(), index[:, groups:].ravel()])
    return found


def _other_lags(
    found: Fitted, rest: Rest, noise: FloatArray
) -> tuple[FloatArray, np.ndarray, FloatArray]:
    """u_c - u_lag (n, k) of the kept rows for other lags c of each group, whose (k,) they are, and
    what of a sensor's noise (g + k,) is in the columns of the groups and in these, degC.

    Others are no lag and the next time constants; of a group without lag the mean of all lags.
    Through another lag comes next to nothing.
    """
    lib, kept, lags = found.lib, rest.kept, np.asarray(found.spec.lags)
    if not lags.any():
        return np.zeros((len(kept.error), 0)), np.zeros(0, int), noise[0]
    usual = round(float(lags[lags > 0].mean()))
    pairs = [
        (j, other)
        for j, lag in enumerate(lags.tolist())
        for other in ({0, lag - 1, lag + 1} - {lag} if lag else {usual})
        if other < len(lib.time_constants)
    ]
    of, others = np.array(pairs).T
    change = np.zeros((len(kept.error), len(pairs)))
    offset = rest.reference * lib.average.sum(axis=0)
    for position in lib.positions:
        here = np.flatnonzero(
            np.isnan(kept.position) if position is None else kept.position == position
        )
        groups = kept.temperature[here] @ lib.average
        every = lagged_columns(groups, kept.time[here], lib.time_constants)
        columns = every.reshape(len(here), -1, len(lags))[:, others, of] - offset[of]
        change[here] = columns - rest.rise[np.ix_(here, of)]
    return change, of, np.append(noise[0], noise[1, of] * (others == 0) - noise[0, of])


def _evenly(count: int, most: int) -> np.ndarray:
    found: np.ndarray = np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))
    return found


def _at(found: Fitted, p: int, full: SerialFit, movement: FloatArray) -> Gradients:
    lib = found.lib
    g, power = len(lib.groups), lib.powers(found.spec.degree)[p]
    L = np.zeros((g, len(full.transform)))
    L[:, : g * len(power)] = np.kron(power, np.eye(g))
    own = full.combinations(L)
    model = found.gradient(p)
    known: dict[str, Gradient] = {}
    values: dict[str, float] = {}
    for j in found.used:
        u = float(np.hypot(own.u[j], model[j] - own.value[j]))
        for sensor, share in _members(lib.average[:, j], lib.sensors):
            values[sensor] = float(model[j] * share)
            size = abs(share)
            known[sensor] = _gradient(
                values[sensor], u * size, float(own.dof[j]), bool(own.clustered[j])
            )
    return Gradients(
        position=lib.positions[p],
        gradients=values,
        known=known,
        inseparable=tuple(_inseparable(found, p, full, L, movement, model)),
    )


def _members(average: FloatArray, sensors: tuple[str, ...]) -> list[tuple[str, float]]:
    return [(sensors[s], float(average[s])) for s in np.flatnonzero(average)]


def _gradient(value: float, u: float, dof: float, clustered: bool) -> Gradient:
    by = "cycles" if clustered else "model"
    if not np.isfinite(u):
        return Gradient(value=value, u=None, interval=None, dof=dof, by=by)
    U = coverage_factor(0.95, dof) * u
    return Gradient(value=value, u=u, interval=(value - U, value + U), dof=dof, by=by)


def _inseparable(
    found: Fitted, p: int, full: SerialFit, L: FloatArray, movement: FloatArray, model: FloatArray
) -> Iterator[Inseparable]:
    """Groups of sensors that the readings do not tell apart at a position.

    A set of sensors moves along with its first, by slopes v_j = S_1j/S_11 (S the covariance of
    the temperatures). Sets join, the closest first, where the common gradient sum_j v_j b_j has
    at most BETTER_KNOWN of the u of each that joins (in the same measure, |v_j| u_j): what they
    share is known, and not whose it is. A set is inseparable where the 95 % half-width of a
    member reaches TOLD_APART of the common gradient: the data then do not tell a sensor that
    carries all of it from one that carries none. Sensors that are one to the fit (|r| >= 0.999)
    always are.
    """
    lib = found.lib
    scale = np.sqrt(np.diag(movement))
    R = movement / np.maximum(np.outer(scale, scale), 1e-300)
    own = full.combinations(L * scale[:, None])
    half = own.u * np.array([coverage_factor(0.95, dof) for dof in own.dof])
    for members in _joined(R, scale, L, full, own.u):
        lead = max(members, key=lambda j: float(scale[j]))
        v = np.zeros(len(L))
        v[members] = R[lead, members] * scale[members] / scale[lead]
        common = full.combinations((v @ L)[None])
        least = TOLD_APART * abs(float(common.value[0])) * scale[lead]
        together = len(members) > 1 and not half[members].max() <= least
        for group in [members] if together else [[j] for j in members]:
            group = sorted(group, key=lambda j: j != lead)
            names = [name for j in group for name, _ in _members(lib.average[:, j], lib.sensors)]
            if len(names) < 2 or not set(group) & set(found.used.tolist()):
                continue
            w = v if together else np.eye(len(L))[group[0]]
            value = float(w @ model)
            known = full.combinations((w @ L)[None])
            u = float(np.hypot(known.u[0], value - known.value[0]))
            total = _gradient(value, u, float(known.dof[0]), bool(known.clustered[0]))
            yield Inseparable(lib.positions[p], tuple(names), value, total.u, total.interval)


def _joined(
    R: FloatArray, scale: FloatArray, L: FloatArray, full: SerialFit, u: FloatArray
) -> list[list[int]]:
    """Sets of groups of sensors whose gradient together is known better; `u` (g,) of each."""
    sets = [[j] for j in range(len(L))]
    while pairs := [(a, b) for i, a in enumerate(sets) for b in sets[i + 1 :]]:
        along = np.zeros((len(pairs), len(L)))
        for row, (a, b) in zip(along, pairs, strict=True):
            members = [*a, *b]
            row[members] = R[members[0], members]
        of_pair = full.combinations((along * scale) @ L).u
        least = np.array([min(u[a].min(), u[b].min()) for a, b in pairs])
        finite = np.isfinite(of_pair)
        ratio = np.where(finite, np.where(finite, of_pair, 0.0) / least, np.inf)
        best = int(np.argmin(ratio))
        if not ratio[best] <= BETTER_KNOWN:
            break
        a, b = pairs[best]
        sets = [*(each for each in sets if each not in (a, b)), sorted([*a, *b])]
    return sets
