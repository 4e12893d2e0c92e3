"""A fitted thermal model with its uncertainty, for every command that predicts.

What the model leaves over is split by its memory. Noise of one reading of the instrument is no
error of the machine: it does not carry over to the next reading. What does carry over, the mean
e_i e_(i+1), is drift that the model does not follow: the machine's state, shared by the points
of a part. The coefficients' covariance is scaled so that it accounts for what held-out cycles
show beyond that.

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
from itertools import product

import numpy as np
from scipy.special import comb, fdtri

from mtu_cli.analyses.thermal_fit.choice import Unseen, unseen
from mtu_cli.analyses.thermal_fit.models import Fitted, Library, through_places
from mtu_cli.analyses.thermal_fit.result import Gradients, Inseparable, Interval
from mtu_cli.analyses.thermal_fit.series import Series
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.stats.compressed import effective_number
from mtu_cli.stats.covariance import covariance_root, positive_part
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.resolution import rounding_variance
from mtu_cli.stats.serial import Block, SerialFit, serial_fit
from mtu_cli.units import Unit

NORMAL_QUARTILE = 0.6744897501960817
SIGNIFICANT = 3.0
MOST_LOST = 5.0
"""Few effective residuals say little of what fitting took: no more than this is made up for."""
_NOTHING = 1e-9


def estimate(
    found: Fitted, residual: FloatArray, of: str | None, unit: Unit, sensor_u: FloatArray
) -> ThermalEstimate:
    """The model in powers of mm and sensors, with the covariances of coefficients and of the
    `residual` (n,); `sensor_u` (s,) of all sensors, degC.
    """
    lib, spec, used = found.lib, found.spec, found.used
    members = np.flatnonzero((lib.average[:, used] != 0).any(axis=1))
    spread = lib.average[np.ix_(members, used)]
    # From powers of (p - c)/h to powers of p.
    (c, h, _), m = lib.frame, spec.degree + 1
    T = np.array([[comb(k, j) * (-c) ** max(k - j, 0) / h**k for k in range(m)] for j in range(m)])
    kept = np.concatenate([used + m * len(lib.groups) for m in range(spec.degree + 1)])
    held = unseen(lib, spec)
    scale, coefficient_dof = _coefficient_scale(found, held)
    root = np.kron(T, spread) @ covariance_root(found.unit_covariance[np.ix_(kept, kept)])
    slow, leftover_dof = _slow(residual, found, held)
    places = [position for position in lib.series.positions if position is not None]
    return ThermalEstimate(
        component=lib.series.name,
        of=of,
        unit=unit,
        sensors=tuple(lib.sensors[s] for s in members),
        reference=lib.reference,
        coefficients=T @ found.coefficients[:, used] @ spread.T,
        covariance=scale * root @ root.T,
        coefficient_dof=coefficient_dof,
        leftover=T @ _as_polynomial(lib, spec.degree, slow) @ T.T,
        leftover_dof=leftover_dof,
        time_constants=time_constants(found)[members],
        sensor_u=sensor_u[members],
        temperature_range=lib.series.range[members],
        position_range=(min(places), max(places)) if places else None,
    )


def time_constants(found: Fitted) -> FloatArray:
    """Of every sensor (s,), min; 0 of one that the model does not use."""
    lib, used = found.lib, found.used
    lags = np.asarray(found.spec.lags, int)[used]
    of_sensors: FloatArray = (lib.average[:, used] != 0) @ lib.time_constants[lags]
    return of_sensors


def _coefficient_scale(found: Fitted, held: Unseen | None) -> tuple[float, float]:
    """What the unit covariance is multiplied by, and its degrees of freedom.

    Residuals that follow each other tell less than their number: s^2 (1 + r)/(1 - r). Where
    held-out cycles show significantly more (5 %, F), the difference over their mean x'C x is taken.
    """
    rows = found.lib.all_rows
    square, product = found.mean_products(rows)
    square *= rows.n / max(rows.n - found.parameters, 1.0)
    number = effective_number(rows.n, product / square if square > 0 else 0.0)
    within = square * rows.n / number, max(number - found.parameters, 1.0)
    if held is None or held.leverage <= 0:
        return within
    beyond = (max(held.product, 0.0) - max(product, 0.0)) / held.leverage
    between = max(len(found.lib.series.cycles) - 1.0, 1.0)
    limit = within[0] * float(fdtri(between, within[1], 0.95))
    return within if beyond <= limit else (beyond, between)


def _slow(residual: FloatArray, found: Fitted, held: Unseen | None) -> tuple[FloatArray, float]:
    """Covariance (positions, positions) of what carries over between readings, and its dof.

    Positions that were read at the same times are correlated as they show; others are not.
    """
    series, n = found.lib.series, len(residual)
    count = len(series.positions)
    first, pairs = np.zeros((count, count)), np.zeros((count, count))
    second, triples = 0.0, 0
    for c in range(len(series.cycles)):
        own = [(p, residual[rows]) for (p, cycle), rows in series.runs.items() if cycle == c]
        second += sum(float(e[:-2] @ e[2:]) for _, e in own)
        triples += sum(max(len(e) - 2, 0) for _, e in own)
        for (i, one), (j, other) in product(own, own):
            if len(one) == len(other):
                first[i, j] += float(one[:-1] @ other[1:])
                pairs[i, j] += len(one) - 1
    slow = first / np.maximum(pairs, 1)
    slow = (slow + slow.T) / 2
    mean = float(np.trace(slow)) / count
    if mean <= 0 or not triples:
        return np.zeros((count, count)), np.inf
    memory = second / triples / mean
    noise = float(np.mean(residual**2)) / np.sqrt(n)
    # What white noise alone may show has no memory to correct for.
    if mean > SIGNIFICANT * noise:
        # Fitting takes of it: degrees of freedom as the effective number has them, but no more
        # than held-out cycles show.
        number = effective_number(n, memory)
        lost = number / max(number - found.parameters, number / MOST_LOST)
        if held is not None:
            lost = max(min(lost, held.product / mean), n / max(n - found.parameters, 1.0))
        slow *= lost
    # Variances lose information to memory with its square (Bayley & Hammersley 1946).
    return slow, max(effective_number(n, memory**2) - found.parameters, 1.0)


def _as_polynomial(lib: Library, degree: int, slow: FloatArray) -> FloatArray:
    """Covariance (m, m) of the leftover as a polynomial of the model's powers, which of fewer
    powers than positions carries their mean variance all the same.
    """
    V = lib.powers(degree)
    W = through_places(V)
    D = positive_part(W @ slow @ W.T)
    wanted, carried = float(np.trace(slow)), float(np.einsum("pi,ij,pj->", V, D, V))
    if carried > _NOTHING * wanted:
        return D * (max(wanted, carried) / carried)
    level = np.zeros_like(D)
    level[0, 0] = max(wanted, 0.0) / len(V)
    return level


def sensor_noise(series: Series) -> FloatArray:
    """Upper estimate (s,) of the standard deviation of a single temperature reading, degC.

    From second differences, which a slow temperature hardly has and white noise has with
    variance 6 u^2; by their median, because a heater that switches makes some large ones.
    Draughts count as noise here: see `noise_share`. The rounding of a reading is noise, too.
    """
    inside = series.piece[2:] == series.piece[:-2]
    if not inside.any():
        return np.zeros(series.T.shape[1])
    second = np.abs(np.diff(series.T, n=2, axis=0)[inside])
    rounding = np.sqrt([rounding_variance(T) for T in series.T.T])
    middle = np.median(second, axis=0) / (NORMAL_QUARTILE * np.sqrt(6.0))
    return np.asarray(np.maximum(middle, rounding))


def through_lags(found: Fitted) -> FloatArray:
    """Share (s,) of the noise of a reading that comes through the lag of each sensor."""
    constants = time_constants(found)
    slow = np.sqrt(found.lib.step / (2 * np.where(constants > 0, constants, np.inf)))
    return np.where((constants > 0) & (slow > 0), np.minimum(slow, 1.0), 1.0)


def noise_share(found: Fitted, sensor_u: FloatArray) -> float:
    """What part of `sensor_u` (s,) the residuals leave room for, 1 at most.

    The noise of the sensors makes residuals without memory, of variance sum_s g_s^2 u_s^2; so
    does the instrument. The mean e_i^2 less e_i e_(i+1) over all positions bounds both together.
    """
    lib, noise = found.lib, sensor_u * through_lags(found)
    rows = lib.all_rows.by_position
    expected = sum(
        item.n * float(np.sum((lib.average @ found.gradient(p) * noise) ** 2))
        for p, item in rows.items()
    )
    square, product = found.mean_products(lib.all_rows)
    if expected <= 0:
        return 1.0
    return float(np.sqrt(np.clip((square - product) * lib.all_rows.n / expected, 0.0, 1.0)))


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
    """The fit of all groups to the rows, and their covariance (g, g) about their levels. Lags are
    known to a factor only, and may be another sensor's: where the model has lags, a group has
    u_lag b + sum_c (u_c - u_lag) b_c of other lags c, the steady state of which is b.
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
    """The groups (k,) of k other lags (none and the next ones, of a group without lag the mean of
    all), these lags, and what of a sensor's noise is in u_lag and u_c - u_lag, (g + k,) degC.
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
    at most BETTER_KNOWN of the u of each that joins (in the same measure, |v_j| u_j). A set is
    inseparable where the 95 % half-width of a member reaches TOLD_APART of the common gradient.
    Sensors that are one to the fit (|r| >= 0.999) always are.
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
