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

import numpy as np

from mtu_cli.analyses.thermal_fit.models import Fitted
from mtu_cli.analyses.thermal_fit.result import Gradients, Inseparable, Interval
from mtu_cli.analyses.thermal_fit.uncertainty import noise_share, through_lags
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


def gradients(found: Fitted, sensor_u: FloatArray) -> tuple[Gradients, ...]:
    """The model's gradients at every observed position; `sensor_u` (s,) of all sensors, degC."""
    positions = found.lib.series.positions
    if not found.used.size:
        return tuple(Gradients(position, {}) for position in positions)
    full, movement = _full(found, sensor_u)
    return tuple(_at(found, p, full, movement) for p in range(len(positions)))


def _full(found: Fitted, sensor_u: FloatArray) -> tuple[SerialFit, FloatArray]:
    """The fit of all groups, with and without their lags, to the rows, and the covariance (g, g)
    of the groups about their levels.

    Lags are known to a factor only, may be another sensor's, and one that smooths the noise of a
    sensor may be none: where the model has lags, a group has u_lag b + sum_c (u_c - u_lag) b_c
    of other lags c, the steady state of which is b.
    """
    lib, series, g = found.lib, found.lib.series, len(found.lib.groups)
    of, others, through = _other_lags(found, sensor_u)
    lags = np.asarray(found.spec.lags)
    change = lib.Z[:, 1 + others * g + of] - lib.Z[:, 1 + lags[of] * g + of]
    columns = np.column_stack([lib.Z[:, found.columns[1:-1]], change, series.y])
    whose = np.concatenate([np.arange(g), of])
    in_columns = np.equal.outer(whose, whose) * np.outer(through, through)
    powers = lib.powers(found.spec.degree)
    blocks, squares = [], np.zeros((g, g))
    runs = [(key, rows) for key, rows in sorted(series.runs.items()) if rows.stop - rows.start > 1]
    chosen = np.unique(np.linspace(0, len(runs) - 1, min(len(runs), MOST_BLOCKS)).round())
    for (p, c), rows in (runs[int(i)] for i in chosen):
        n = rows.stop - rows.start
        edges = np.unique(np.linspace(0, n, min(n, BINS) + 1).astype(int)[:-1])
        count = np.diff(np.append(edges, n))[:, None]
        Z = np.add.reduceat(columns[rows], edges, axis=0) / count
        rise, power = Z[:, :g], powers[p]
        centred = rise - rise.mean(axis=0)
        squares += centred.T @ centred
        X = [np.kron(power, rise), np.kron(power, Z[:, g:-1])]
        if not lib.zeroed.offsets:
            X.append(np.tile(np.arange(len(powers)) == p, (len(Z), 1)).astype(float))
        joined = np.hstack(X)
        N = np.zeros((joined.shape[1],) * 2)
        # Groups of all powers first, then other lags of all powers.
        order = np.arange(len(power) * len(whose)).reshape(len(power), -1)
        order = np.concatenate([order[:, :g].ravel(), order[:, g:].ravel()])
        of_powers = np.kron(np.outer(power, power), in_columns) / count.mean()
        N[: len(order), : len(order)] = of_powers[np.ix_(order, order)]
        blocks.append(Block(joined, Z[:, -1], c, N))
    return serial_fit(blocks, levels=lib.zeroed.offsets), squares


def _other_lags(found: Fitted, sensor_u: FloatArray) -> tuple[np.ndarray, np.ndarray, FloatArray]:
    """The groups (k,) of k other lags, these, and what of a sensor's noise is in the columns of the
    g groups and in u_c - u_lag, (g + k,) degC.

    Others are no lag and the next time constants; of a group without lag the mean of all lags.
    Through another lag comes next to nothing.
    """
    lib, lags = found.lib, np.asarray(found.spec.lags)
    in_model = (lib.average[:, found.used] != 0).any(axis=1)
    read = sensor_u * noise_share(found, sensor_u) * in_model
    seen = read * through_lags(found)
    plain, lagged = (np.sqrt(noise**2 @ lib.average**2) for noise in (read, seen))
    usual = round(float(lags[lags > 0].mean())) if lags.any() else 0
    pairs = [
        (j, other)
        for j, lag in enumerate(lags.tolist())
        for other in ({0, lag - 1, lag + 1} - {lag} if lag else {usual} - {0})
        if other < len(lib.time_constants)
    ]
    of, others = np.array(pairs, int).reshape(-1, 2).T
    return of, others, np.append(lagged, plain[of] * (others == 0) - lagged[of])


def _at(found: Fitted, p: int, full: SerialFit, movement: FloatArray) -> Gradients:
    lib = found.lib
    power, model = lib.powers(found.spec.degree)[p], found.gradient(p)
    L = np.zeros((len(model), len(full.transform)))
    L[:, : len(model) * len(power)] = np.kron(power, np.eye(len(model)))
    own = full.combinations(L)
    at = Gradients(
        position=lib.series.positions[p],
        gradients={},
        inseparable=tuple(_inseparable(found, p, full, L, movement)),
    )
    for j in found.used.tolist():
        u = float(np.hypot(own.u[j], model[j] - own.value[j]))
        for s in np.flatnonzero(lib.average[:, j]).tolist():
            sensor, share = lib.sensors[s], float(lib.average[s, j])
            at.gradients[sensor] = float(model[j] * share)
            at.u[sensor], at.intervals[sensor] = _known(
                at.gradients[sensor], u * abs(share), float(own.dof[j])
            )
            at.by[sensor] = "cycles" if own.clustered[j] else "model"
    return at


def _known(value: float, u: float, dof: float) -> tuple[float | None, Interval | None]:
    """u and the 95 % interval; None where the readings do not determine them."""
    if not np.isfinite(u):
        return None, None
    U = coverage_factor(0.95, dof) * u
    return u, (value - U, value + U)


def _inseparable(
    found: Fitted, p: int, full: SerialFit, L: FloatArray, movement: FloatArray
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
    lib, model = found.lib, found.gradient(p)
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
            names = [lib.sensors[s] for j in group for s in np.flatnonzero(lib.average[:, j])]
            if len(names) < 2 or not set(group) & set(found.used.tolist()):
                continue
            w = v if together else np.eye(len(L))[group[0]]
            value = float(w @ model)
            known = full.combinations((w @ L)[None])
            u = float(np.hypot(known.u[0], value - known.value[0]))
            of_group = _known(value, u, float(known.dof[0]))
            yield Inseparable(lib.series.positions[p], tuple(names), value, *of_group)


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
