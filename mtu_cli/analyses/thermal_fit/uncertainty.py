"""A fitted thermal model with its uncertainty, for every command that predicts.

What the model leaves over is split by its memory. Noise of one reading of the instrument is no
error of the machine: it does not carry over to the next reading. What does carry over, the mean
e_i e_(i+1), is drift that the model does not follow: the machine's state, shared by the points
of a part. The coefficients' covariance is scaled so that it accounts for what held-out cycles
show beyond that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import comb, fdtri

from mtu_cli.analyses.thermal_fit.choice import Unseen, unseen_products
from mtu_cli.analyses.thermal_fit.models import (
    Fitted,
    Library,
    Rows,
    group_columns,
    through_places,
)
from mtu_cli.analyses.thermal_fit.series import Kept, Series
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.stats.compressed import effective_number
from mtu_cli.stats.covariance import covariance_root, positive_part
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import Unit

NORMAL_QUARTILE = 0.6744897501960817
SIGNIFICANT = 3.0
MOST_LOST = 5.0
"""Few effective residuals say little of what fitting took: no more than this is made up for."""
_NOTHING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Conventions:
    """What a model is stated in: the axis `of` the component and its unit, the names of all
    sensors and the reference temperature in degC.
    """

    of: str | None
    unit: Unit
    sensors: tuple[str, ...]
    reference: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Rest:
    """Residuals row by row, of the rows that were kept: `modelled` drift with its intercept, `rise`
    (n, g) of all groups of sensors, with their lags; `levels` of zeroed (position, cycle).
    """

    kept: Kept
    modelled: FloatArray
    residual: FloatArray
    rise: FloatArray
    levels: dict[tuple[int, int], float]
    reference: float


def residuals(series: Series, found: Fitted, reference: float) -> Rest:
    """The model at every row that was kept, from the levels of cycles where these have any."""
    kept, lib, spec = series.kept(), found.lib, found.spec
    modelled, rises = np.zeros(len(kept.error)), np.zeros((len(kept.error), len(lib.groups)))
    levels: dict[tuple[int, int], float] = {}
    for p, position in enumerate(lib.positions):
        here = np.flatnonzero(
            np.isnan(kept.position) if position is None else kept.position == position
        )
        columns = group_columns(lib, spec.lags, kept.temperature[here], kept.time[here])
        rise = columns - reference * lib.average.sum(axis=0)
        modelled[here] = found.intercepts[p] + rise @ found.gradient(p)
        rises[here] = rise
        for c in range(len(lib.cycles)) if lib.zeroed.offsets else ():
            own = here[kept.cycle[here] == c]
            if len(own):
                levels[p, c] = float(np.mean(kept.error[own] - modelled[own]))
                modelled[own] += levels[p, c]
    return Rest(
        kept=kept,
        modelled=modelled,
        residual=kept.error - modelled,
        rise=rises,
        levels=levels,
        reference=reference,
    )


def estimate(
    series: Series, found: Fitted, rows: Rows, rest: Rest, conventions: Conventions
) -> ThermalEstimate:
    """The model in powers of mm and sensors, with the covariances of coefficients and rest."""
    lib, spec, used = found.lib, found.spec, found.used
    members = np.flatnonzero((lib.average[:, used] != 0).any(axis=1))
    spread = lib.average[np.ix_(members, used)]
    T = _unscaled(lib, spec.degree)
    kept = np.concatenate([used + m * len(lib.groups) for m in range(spec.degree + 1)])
    unseen = unseen_products(lib, spec)
    scale, coefficient_dof = _coefficient_scale(found, rows, unseen)
    root = np.kron(T, spread) @ covariance_root(found.unit_covariance[np.ix_(kept, kept)])
    slow, leftover_dof = _slow(rest, found, unseen)
    constants = lib.time_constants[np.asarray(spec.lags, int)]
    places = [position for position in lib.positions if position is not None]
    return ThermalEstimate(
        component=series.name,
        of=conventions.of,
        unit=conventions.unit,
        sensors=tuple(conventions.sensors[s] for s in members),
        reference=conventions.reference,
        coefficients=T @ found.coefficients[:, used] @ spread.T,
        covariance=scale * root @ root.T,
        coefficient_dof=coefficient_dof,
        leftover=T @ _as_polynomial(lib, spec.degree, slow) @ T.T,
        leftover_dof=leftover_dof,
        time_constants=(spread != 0) @ constants[used],
        sensor_u=_sensor_noise(lib, rest.kept)[members],
        temperature_range=series.range()[members],
        position_range=(min(places), max(places)) if places else None,
    )


def _unscaled(lib: Library, degree: int) -> FloatArray:
    """T (m, m) from powers of (p - c)/h to powers of p."""
    c, h = lib.frame
    T = np.zeros((degree + 1, degree + 1))
    for m in range(degree + 1):
        for j in range(m + 1):
            T[j, m] = comb(m, j) * (-c) ** (m - j) / h**m
    return T


def _coefficient_scale(found: Fitted, rows: Rows, unseen: Unseen | None) -> tuple[float, float]:
    """What the unit covariance is multiplied by, and its degrees of freedom.

    Residuals that follow each other tell less than their number: s^2 (1 + r)/(1 - r). Where
    held-out cycles show more than fit and this explain, significantly at 5 % by F, the
    difference over their mean x'C x is taken, known from as many cycles as there are less one.
    """
    n = sum(item.n for item in rows.values())
    square, product = found.mean_products(rows)
    square *= n / max(n - found.parameters, 1.0)
    number = effective_number(n, product / square if square > 0 else 0.0)
    within = square * n / number, max(number - found.parameters, 1.0)
    if unseen is None or unseen[2] <= 0:
        return within
    beyond = (max(unseen[1], 0.0) - max(product, 0.0)) / unseen[2]
    between = max(len(found.lib.cycles) - 1.0, 1.0)
    limit = within[0] * float(fdtri(between, within[1], 0.95))
    return within if beyond <= limit else (beyond, between)


def _slow(rest: Rest, found: Fitted, unseen: Unseen | None) -> tuple[FloatArray, float]:
    """Covariance (positions, positions) of what carries over between readings, and its dof.

    Positions that were read at the same times are correlated as they show; others are not.
    """
    lib = found.lib
    count = len(lib.positions)
    runs = [
        [rest.residual[rest.kept.at(position, c)] for position in lib.positions]
        for c in range(len(lib.cycles))
    ]
    first, second = np.zeros((count, count)), 0.0
    pairs, triples = np.zeros((count, count)), 0
    for cycle in runs:
        for i in range(count):
            for j in range(count):
                if i != j and len(cycle[i]) != len(cycle[j]):
                    continue
                first[i, j] += float(cycle[i][:-1] @ cycle[j][1:])
                pairs[i, j] += max(len(cycle[i]) - 1, 0)
            second += float(cycle[i][:-2] @ cycle[i][2:])
            triples += max(len(cycle[i]) - 2, 0)
    slow = first / np.maximum(pairs, 1)
    slow = (slow + slow.T) / 2
    mean = float(np.trace(slow)) / count
    if mean <= 0 or not triples:
        return np.zeros((count, count)), np.inf
    memory = second / triples / mean
    noise = float(np.mean(rest.residual**2)) / np.sqrt(len(rest.residual))
    # What white noise alone may show has no memory to correct for.
    if mean > SIGNIFICANT * noise:
        slow *= _lost_to_fit(found, len(rest.residual), mean, memory, unseen)
    # Variances lose information to memory with its square (Bayley & Hammersley 1946).
    return slow, max(effective_number(len(rest.residual), memory**2) - found.parameters, 1.0)


def _lost_to_fit(found: Fitted, n: int, mean: float, memory: float, unseen: Unseen | None) -> float:
    """By what the slow variance `mean` of fitted residuals falls short: fitting takes of it.

    Degrees of freedom as the effective number has them, but no more than held-out cycles show.
    """
    number = effective_number(n, memory)
    lost = number / max(number - found.parameters, number / MOST_LOST)
    if unseen is None:
        return lost
    return max(min(lost, unseen[1] / mean), n / max(n - found.parameters, 1.0))


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


def _sensor_noise(lib: Library, kept: Kept) -> FloatArray:
    """Upper estimate (s,) of the standard deviation of a single temperature reading, degC.

    From second differences, which a slow temperature hardly has and white noise has with
    variance 6 u^2; by their median, because a heater that switches makes some large ones.
    Draughts count as noise here: see `sensor_noise_share`.
    """
    found = []
    for position in lib.positions:
        for c in range(len(lib.cycles)):
            own = kept.temperature[kept.at(position, c)]
            if len(own) > 2:
                found.append(np.abs(np.diff(own, n=2, axis=0)))
    if not found:
        return np.zeros(kept.temperature.shape[1])
    middle = np.median(np.concatenate(found), axis=0) / (NORMAL_QUARTILE * np.sqrt(6.0))
    # A reading of few digits repeats itself: its rounding is noise all the same.
    result: FloatArray = np.maximum(middle, _resolution(kept.temperature) / np.sqrt(12.0))
    return result


def _resolution(temperature: FloatArray) -> FloatArray:
    """The smallest step (s,) between the values of each sensor; 0 where it never moves."""
    steps = [np.diff(np.unique(np.round(column, 9))) for column in temperature.T]
    return np.array([float(own.min()) if len(own) else 0.0 for own in steps])


def sensor_noise_share(lib: Library, rest: Rest, model: ThermalEstimate) -> float:
    """What part of `model.sensor_u` the residuals leave room for, 1 at most.

    The noise of the sensors makes residuals without memory, of variance sum_s g_s^2 u_s^2; so
    does the instrument. The mean e_i^2 less e_i e_(i+1) over all positions bounds both together.
    """
    white = expected = 0.0
    for p, position in enumerate(lib.positions):
        gradients = np.polynomial.polynomial.polyval(lib.places[p], model.coefficients)
        for c in range(len(lib.cycles)):
            here = rest.kept.at(position, c)
            e = rest.residual[here]
            if len(e) < 2:
                continue
            own = np.diff(rest.kept.time[here])
            white += float(e @ e) - float(e[:-1] @ e[1:]) * len(e) / (len(e) - 1)
            noise = gradients * model.sensor_u * _through(model, own)
            expected += len(e) * float(noise @ noise)
    if expected <= 0:
        return 1.0
    return float(np.sqrt(np.clip(white / expected, 0.0, 1.0)))


def group_noise(lib: Library, rest: Rest, model: ThermalEstimate) -> FloatArray:
    """Noise (2, g) of the groups' columns through their lags and without, degC, no more than the
    residuals leave room for.
    """
    members = [lib.sensors.index(sensor) for sensor in model.sensors]
    steps = np.diff(rest.kept.time[rest.kept.at(lib.positions[0], 0)])
    noise = np.zeros((2, len(lib.sensors)))
    noise[:, members] = model.sensor_u * sensor_noise_share(lib, rest, model)
    noise[0, members] *= _through(model, steps)
    found: FloatArray = np.sqrt(noise**2 @ lib.average**2)
    return found


def _through(model: ThermalEstimate, steps: FloatArray) -> FloatArray:
    """Share (s,) of a reading's noise that comes through the lag of each sensor."""
    slow = model.time_constants > 0
    step = float(np.median(steps)) if len(steps) else 0.0
    if not slow.any() or not step > 0:
        return np.ones(len(slow))
    share = np.sqrt(step / (2 * np.where(slow, model.time_constants, np.inf)))
    return np.where(slow, np.minimum(share, 1.0), 1.0)
