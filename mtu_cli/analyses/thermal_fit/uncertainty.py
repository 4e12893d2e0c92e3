"""A fitted thermal model with its uncertainty, for every command that predicts.

Residuals are split by their memory. Noise of one reading of the instrument is no error of the
machine: it does not carry over to the next reading. What does carry over, the mean e_i e_(i+1),
is drift that the model does not follow: the machine's state, shared by the points of a part. The
coefficients' covariance is scaled so that it accounts for what held-out cycles show beyond that.

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
from typing import NamedTuple

import numpy as np
from scipy.special import comb, fdtri

from mtu_cli.analyses.thermal_fit.design import Design
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.stats.covariance import covariance_root, positive_part
from mtu_cli.stats.coverage import PROBABILITY, coverage_factor, t_interval
from mtu_cli.stats.least_squares import FloatArray, effective_number, polynomial
from mtu_cli.stats.resolution import rounding_variance
from mtu_cli.stats.selection import Fitted, held_out_products
from mtu_cli.stats.serial import Block, SerialFit
from mtu_cli.units import Unit

NORMAL_QUARTILE = 0.6744897501960817
SIGNIFICANT = 3.0
MOST_LOST = 5.0
"""The largest correction of a variance for the fit: few effective residuals determine it poorly."""
_NOTHING = 1e-9
BINS = 64
"""Readings of a position and cycle that enter; of more, neighbours are averaged."""
MOST_BLOCKS = 48
"""Positions and cycles that enter; more of them are taken evenly."""
BETTER_KNOWN = 0.5
"""Sensors trade their drift where u of their common gradient is at most this share of each u ..."""
INSEPARABLE = 0.5
"""... and are not separable where the interval of one reaches this share of the common gradient."""


class Gradient(NamedTuple):
    """What sensors do at a position: the model's `value`, mm or rad per degC of the first, with its
    `u` and 95 % `interval` (None where the readings do not determine it), u `by` "cycles" (their
    scatter) or "model" (of the errors). Several `sensors` are not separable: they only have one
    together, the others moving with the first as they did in the readings.
    """

    position: float | None
    sensors: tuple[str, ...]
    value: float
    u: float | None
    interval: tuple[float, float] | None
    by: str


def estimate(
    design: Design,
    fit: Fitted,
    residual: FloatArray,
    of: str | None,
    unit: Unit,
    sensor_u: FloatArray,
) -> ThermalEstimate:
    """The model in powers of mm and sensors, with the covariances of coefficients and of the
    `residual` (n,); `sensor_u` (s,) of all sensors, degC.
    """
    used = fit.used
    members = np.flatnonzero((design.average[:, used] != 0).any(axis=1))
    spread = design.average[np.ix_(members, used)]
    # From powers of (p - c)/h to powers of p.
    (c, h), m = design.scale, fit.spec.degree + 1
    T = np.array([[comb(k, j) * (-c) ** max(k - j, 0) / h**k for k in range(m)] for j in range(m)])
    terms = np.concatenate([used + k * len(design.groups) for k in range(m)])
    products = held_out_products(fit.panel, fit.spec)
    n, cycles = len(design.y), fit.panel.cycles
    square, lag = fit.mean_products(cycles)
    square *= n / max(n - fit.parameters, 1.0)
    number = effective_number(n, lag / square if square > 0 else 0.0)
    # Correlated residuals count as fewer: s^2 (1 + r)/(1 - r).
    scale, coefficient_dof = square * n / number, max(number - fit.parameters, 1.0)
    if products is not None and products[1] > 0:
        # Where held-out cycles show significantly more (5 %, F), the difference over their mean
        # x'C x is taken.
        excess = (max(products[0], 0.0) - max(lag, 0.0)) / products[1]
        between = max(len(cycles) - 1.0, 1.0)
        if excess > scale * float(fdtri(between, coefficient_dof, PROBABILITY)):
            scale, coefficient_dof = excess, between
    root = np.kron(T, spread) @ covariance_root(fit.unit_covariance[np.ix_(terms, terms)])
    slow, leftover_dof = _slow(design, fit, residual, products)
    places = [position for position in design.positions if position is not None]
    return ThermalEstimate(
        component=design.name,
        of=of,
        unit=unit,
        sensors=tuple(design.sensors[s] for s in members),
        reference=design.reference,
        coefficients=T @ fit.coefficients[:, used] @ spread.T,
        covariance=scale * root @ root.T,
        coefficient_dof=coefficient_dof,
        leftover=T @ _as_polynomial(polynomial(fit.panel.x, m - 1), slow) @ T.T,
        leftover_dof=leftover_dof,
        time_constants=time_constants(design, fit)[members],
        sensor_u=sensor_u[members],
        temperature_range=design.span[members],
        position_range=(min(places), max(places)) if places else None,
    )


def _slow(
    design: Design, fit: Fitted, residual: FloatArray, products: tuple[float, float] | None
) -> tuple[FloatArray, float]:
    """Covariance (positions, positions) of what carries over between readings, and its dof.

    Positions that were read at the same times are correlated as they show; others are not.
    """
    n, count = len(residual), len(design.positions)
    first, pairs = np.zeros((count, count)), np.zeros((count, count))
    second, triples = 0.0, 0
    for c in fit.panel.cycles:
        series = [(p, residual[rows]) for (p, cycle), rows in design.runs.items() if cycle == c]
        second += sum(float(e[:-2] @ e[2:]) for _, e in series)
        triples += sum(max(len(e) - 2, 0) for _, e in series)
        for (i, a), (j, b) in product(series, series):
            if len(a) == len(b):
                first[i, j] += float(a[:-1] @ b[1:])
                pairs[i, j] += len(a) - 1
    slow = first / np.maximum(pairs, 1)
    slow = (slow + slow.T) / 2
    mean = float(np.trace(slow)) / count
    if mean <= 0 or not triples:
        return np.zeros((count, count)), np.inf
    memory = second / triples / mean
    # What white noise alone may show has no memory to correct for.
    if mean > SIGNIFICANT * float(np.mean(residual**2)) / np.sqrt(n):
        # Corrected for the degrees of freedom of the fit, by the effective number, but no further
        # than held-out cycles show.
        number = effective_number(n, memory)
        loss = number / max(number - fit.parameters, number / MOST_LOST)
        if products is not None:
            loss = max(min(loss, products[0] / mean), n / max(n - fit.parameters, 1.0))
        slow *= loss
    # Variances lose information to memory with its square (Bayley & Hammersley 1946).
    return slow, max(effective_number(n, memory**2) - fit.parameters, 1.0)


def _as_polynomial(V: FloatArray, slow: FloatArray) -> FloatArray:
    """Covariance (m, m) of the leftover as a polynomial of the powers V (positions, m), which of
    fewer powers than positions carries their mean variance all the same.
    """
    W = np.linalg.pinv(V)
    D = positive_part(W @ slow @ W.T)
    total, carried = float(np.trace(slow)), float(np.einsum("pi,ij,pj->", V, D, V))
    if carried > _NOTHING * total:
        return D * (max(total, carried) / carried)
    level = np.zeros_like(D)
    level[0, 0] = max(total, 0.0) / len(V)
    return level


def time_constants(design: Design, fit: Fitted) -> FloatArray:
    """Of every sensor (s,), min; 0 of one that the model does not use."""
    used = fit.used
    lags = np.asarray(fit.spec.variants, int)[used]
    return np.asarray((design.average[:, used] != 0) @ design.time_constants[lags])


def sensor_noise(design: Design) -> FloatArray:
    """Upper estimate (s,) of the standard deviation of a single temperature reading, degC.

    From second differences, which a slow temperature hardly has and white noise has with
    variance 6 u^2; by their median, because a heater that switches makes some large ones.
    Draughts count as noise here: see `noise_share`. The rounding of a reading is noise, too.
    """
    second = np.vstack([np.diff(design.T[rows], n=2, axis=0) for rows in design.runs.values()])
    if not len(second):
        return np.zeros(len(design.sensors))
    rounding = np.sqrt([rounding_variance(T) for T in design.T.T])
    middle = np.median(np.abs(second), axis=0) / (NORMAL_QUARTILE * np.sqrt(6.0))
    return np.asarray(np.maximum(middle, rounding))


def _through_lags(design: Design, fit: Fitted) -> FloatArray:
    """Share (s,) of the noise of a reading that comes through the lag of each sensor."""
    constants = time_constants(design, fit)
    slow = np.sqrt(design.step / (2 * np.where(constants > 0, constants, np.inf)))
    return np.where((constants > 0) & (slow > 0), np.minimum(slow, 1.0), 1.0)


def noise_share(design: Design, fit: Fitted, sensor_u: FloatArray) -> float:
    """The largest share of `sensor_u` (s,) that the residuals allow for, 1 at most.

    The noise of the sensors makes residuals without memory, of variance sum_s g_s^2 u_s^2; so
    does the instrument. The mean e_i^2 less e_i e_(i+1) over all positions bounds both together.
    """
    noise = sensor_u * _through_lags(design, fit)
    rows = fit.panel.rows(fit.panel.cycles)
    squares = np.sum((fit.slopes @ design.average.T * noise) ** 2, axis=1)
    expected = sum(item.n * float(squares[p]) for p, item in rows.items())
    square, lag = fit.mean_products(fit.panel.cycles)
    if expected <= 0:
        return 1.0
    return float(np.sqrt(np.clip((square - lag) * len(design.y) / expected, 0.0, 1.0)))


def gradients(
    design: Design, fit: Fitted, sensor_u: FloatArray
) -> tuple[list[Gradient], list[Gradient]]:
    """The model's gradients of every sensor at every observed position, and of the sensors that
    are not separable; `sensor_u` (s,) as the residuals allow for it, degC.
    """
    single, several = list[Gradient](), list[Gradient]()
    if not fit.used.size:
        return single, several
    full, movement, width = _full(design, fit, sensor_u)
    powers = polynomial(fit.panel.x, fit.spec.degree)

    def gradient(p: int, sensors: tuple[str, ...], weights: FloatArray) -> Gradient:
        """Of the combination `weights` (g,) of the groups' gradients at a position."""
        combination = full.combinations((weights @ levers)[None])
        value = float(weights @ fit.slopes[p])
        u, interval = float(np.hypot(combination.u[0], value - combination.value[0])), None
        if np.isfinite(u):
            interval = t_interval(value, u, float(combination.dof[0]))
        by = "cycles" if combination.clustered[0] else "model"
        return Gradient(design.positions[p], sensors, value, u if interval else None, interval, by)

    for p, power in enumerate(powers):
        levers = np.zeros((len(design.groups), len(full.transform)))
        levers[:, : len(power) * width] = np.kron(power, np.eye(len(levers), width))
        for s, j in np.argwhere(design.average).tolist():
            if j in fit.used:
                weights = np.eye(len(levers))[j] * design.average[s, j]
                single.append(gradient(p, (design.sensors[s],), weights))
        for group, weights in _inseparable(full, levers, movement):
            sensors = [s for j in group for s in np.flatnonzero(design.average[:, j])]
            if len(sensors) > 1 and set(group) & set(fit.used.tolist()):
                several.append(gradient(p, tuple(design.sensors[s] for s in sensors), weights))
    return single, several


def _full(design: Design, fit: Fitted, sensor_u: FloatArray) -> tuple[SerialFit, FloatArray, int]:
    """The fit of all groups to the rows, their covariance (g, g) about their levels, and how many
    columns each power has: the g groups, and other lags of them. Lags are known to a factor only,
    and may be another sensor's: where the model has lags, a group has u_lag b + sum_c (u_c - u_lag)
    b_c of other lags c, the steady state of which is b.
    """
    g, lags = len(design.groups), np.asarray(fit.spec.variants)
    # Other lags are none and the next ones; of a group without lag the mean of all.
    usual = round(float(lags[lags > 0].mean())) if lags.any() else 0
    pairs = [
        (j, other)
        for j, lag in enumerate(lags.tolist())
        for other in ({0, lag - 1, lag + 1} - {lag} if lag else {usual} - {0})
        if other < len(design.time_constants)
    ]
    group, other_lags = np.array(pairs, int).reshape(-1, 2).T
    # What of a sensor's noise is in u_lag, and in u_c - u_lag.
    reading_u = sensor_u * (design.average[:, fit.used] != 0).any(axis=1)
    lagged_u = reading_u * _through_lags(design, fit)
    plain, lagged = (np.sqrt(u**2 @ design.average**2) for u in (reading_u, lagged_u))
    noise = np.append(lagged, plain[group] * (other_lags == 0) - lagged[group])
    change = design.Z[:, 1 + other_lags * g + group] - design.Z[:, 1 + lags[group] * g + group]
    columns = np.column_stack([design.Z[:, fit.columns[1:-1]], change, design.y])
    owner = np.concatenate([np.arange(g), group])
    in_columns = np.equal.outer(owner, owner) * np.outer(noise, noise)
    powers = polynomial(fit.panel.x, fit.spec.degree)
    blocks, squares = [], np.zeros((g, g))
    runs = [(p, c, rows) for (p, c), rows in sorted(design.runs.items())]
    # A single reading does not rise from its level; where all are such, levels are of positions.
    runs = [run for run in runs if run[2].stop - run[2].start > 1] or runs
    sample = np.unique(np.linspace(0, len(runs) - 1, min(len(runs), MOST_BLOCKS)).round())
    for p, c, rows in (runs[int(i)] for i in sample):
        power, n = powers[p], rows.stop - rows.start
        edges = np.unique(np.linspace(0, n, min(n, BINS) + 1).astype(int)[:-1])
        count = np.diff(np.append(edges, n))[:, None]
        Z = np.add.reduceat(columns[rows], edges, axis=0) / count
        centred = Z[:, :g] - Z[:, :g].mean(axis=0)
        squares += centred.T @ centred
        level = np.zeros((len(Z), 0 if design.offsets else len(powers)))
        level[:, p : p + 1] = 1.0
        N = np.kron(np.outer(power, power), in_columns) / count.mean()
        N = np.pad(N, (0, level.shape[1]))
        blocks.append(Block(np.hstack([np.kron(power, Z[:, :-1]), level]), Z[:, -1], c, N))
    return SerialFit(blocks, levels=design.offsets), squares, len(owner)


def _inseparable(
    full: SerialFit, levers: FloatArray, movement: FloatArray
) -> Iterator[tuple[list[int], FloatArray]]:
    """Groups of sensors that are not separable at a position, each with the weights
    (g,) of their common gradient, and all others; `levers` (g, k) of the full model.

    A set of sensors moves along with its first, by slopes v_j = S_1j/S_11 (S the covariance of
    the temperatures, `movement`). Sets join, the closest first, where the common gradient
    sum_j v_j b_j has at most BETTER_KNOWN of the u of each that joins (in the same measure,
    |v_j| u_j). A set is inseparable where the 95 % half-width of a member reaches INSEPARABLE of
    the common gradient. Sensors that are one to the fit (|r| >= 0.999) always are.
    """
    scale = np.sqrt(np.diag(movement))
    R = movement / np.maximum(np.outer(scale, scale), 1e-300)
    L = levers * scale[:, None]
    single = full.combinations(L)
    half = single.u * np.array([coverage_factor(PROBABILITY, max(dof, 1.0)) for dof in single.dof])
    sets = [[j] for j in range(len(L))]
    while pairs := [(a, b) for i, a in enumerate(sets) for b in sets[i + 1 :]]:
        along = np.zeros((len(pairs), len(L)))
        for row, (a, b) in zip(along, pairs, strict=True):
            row[[*a, *b]] = R[a[0], [*a, *b]]
        u = full.combinations(along @ L).u
        least = np.array([min(single.u[a].min(), single.u[b].min()) for a, b in pairs])
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.nan_to_num(u / least, nan=np.inf, posinf=np.inf)
        if not ratio.min() <= BETTER_KNOWN:
            break
        a, b = pairs[int(np.argmin(ratio))]
        sets = [*(each for each in sets if each not in (a, b)), sorted([*a, *b])]
    for members in sets:
        lead, v = max(members, key=lambda j: float(scale[j])), np.zeros(len(L))
        members.sort(key=lambda j: j != lead)
        v[members] = R[lead, members] * scale[members] / (scale[lead] or 1.0)
        common = abs(float(full.combinations((v @ levers)[None]).value[0])) * scale[lead]
        if len(members) > 1 and not half[members].max() <= INSEPARABLE * common:
            yield members, v
        else:
            yield from (([j], np.eye(len(L))[j]) for j in members)
