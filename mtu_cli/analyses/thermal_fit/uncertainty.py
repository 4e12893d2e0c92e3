"""A fitted thermal model with its uncertainty, for every command that predicts.

What the model leaves over is split by its memory. Noise of one reading of the instrument is no
error of the machine: it does not carry over to the next reading. What does carry over, the mean
e_i e_(i+1), is drift that the model does not follow: the machine's state, shared by the points
of a part. The coefficients' covariance is scaled so that it accounts for what held-out cycles
show beyond that.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.special import comb, fdtri

from mtu_cli.analyses.thermal_fit.choice import Unseen, unseen
from mtu_cli.analyses.thermal_fit.models import Fitted, Library, through_places
from mtu_cli.analyses.thermal_fit.series import Series
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.stats.compressed import effective_number
from mtu_cli.stats.covariance import covariance_root, positive_part
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.resolution import rounding_variance
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
    T = _unscaled(lib, spec.degree)
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


def _unscaled(lib: Library, degree: int) -> FloatArray:
    """T (m, m) from powers of (p - c)/h to powers of p."""
    _, c, h = lib.frame
    T = np.zeros((degree + 1, degree + 1))
    for m in range(degree + 1):
        for j in range(m + 1):
            T[j, m] = comb(m, j) * (-c) ** (m - j) / h**m
    return T


def _coefficient_scale(found: Fitted, held: Unseen | None) -> tuple[float, float]:
    """What the unit covariance is multiplied by, and its degrees of freedom.

    Residuals that follow each other tell less than their number: s^2 (1 + r)/(1 - r). Where
    held-out cycles show more than fit and this explain, significantly at 5 % by F, the
    difference over their mean x'C x is taken, known from as many cycles as there are less one.
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
        slow *= _lost_to_fit(found, n, mean, memory, held)
    # Variances lose information to memory with its square (Bayley & Hammersley 1946).
    return slow, max(effective_number(n, memory**2) - found.parameters, 1.0)


def _lost_to_fit(found: Fitted, n: int, mean: float, memory: float, held: Unseen | None) -> float:
    """By what the slow variance `mean` of fitted residuals falls short: fitting takes of it.

    Degrees of freedom as the effective number has them, but no more than held-out cycles show.
    """
    number = effective_number(n, memory)
    lost = number / max(number - found.parameters, number / MOST_LOST)
    if held is None:
        return lost
    return max(min(lost, held.product / mean), n / max(n - found.parameters, 1.0))


def _as_polynomial(lib: Library, degree: int, slow: FloatArray) -> FloatArray:
    """Covariance (m, m) of the leftover as a polynomial of the model's powers.

    A polynomial of fewer powers than positions cannot follow what differs from place to place:
    it then carries the mean variance of the positions all the same.
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
