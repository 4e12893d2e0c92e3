"""Readings of error components to estimates, one component and one instrument at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.errors import InputError, Problem
from mtu_cli.model.estimates import ComponentEstimate, between_passes, from_centre
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed import IntArray, PassFit, fit_passes
from mtu_cli.stats.pass_tests import (
    FTest,
    Shift,
    lack_of_fit,
    pass_scatter,
    pass_trend,
    reversal,
)
from mtu_cli.units import UNITS, Unit

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings


@dataclass(frozen=True, slots=True, kw_only=True)
class InstrumentFit:
    """One component as one instrument read it; arrays in mm, rad and the readings' order.

    `keys` (G, 2) are the (pass, direction) of the fit's passes, in its order.
    """

    role: str
    position: FloatArray
    error: FloatArray
    direction: FloatArray
    group: IntArray | None
    keys: tuple[tuple[int, int], ...]
    starts: FloatArray
    ends: FloatArray
    setups: tuple[str, ...]
    fit: PassFit
    scatter: FTest | None
    trend: Shift | None
    reversal: Shift | None
    lack_of_fit: FTest | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentFit:
    """A component, its fit by every instrument that read it, and the combined estimate.

    `agreement_p` is the p value that the instruments agree, None with one instrument.
    """

    name: str
    unit: Unit
    instruments: tuple[InstrumentFit, ...]
    estimate: ComponentEstimate
    agreement_p: float | None


def fit_component(readings: Readings, name: str, component: Any) -> ComponentFit:
    """Fits one component from all its readings.

    `component` is the machine file's entry: `of`, `unit`, `degree`. Readings of several
    instruments (ball bar, laser) are fitted apart, each with its own variances, and combined
    by generalised least squares with the inverse of their covariances as weights.

    Raises InputError for one of several instruments whose readings show no scatter.
    """
    code = readings.components.index(name)
    rows = np.flatnonzero(readings.code == code)
    unit = UNITS[component.unit]
    by_role: dict[str, list[int]] = {}
    for row in rows:
        by_role.setdefault(readings.roles[readings.file_index[row]], []).append(int(row))
    fits = tuple(
        _fit_instrument(readings, np.array(chosen), role, component)
        for role, chosen in by_role.items()
    )
    estimates = [_estimate(name, component, unit, fit) for fit in fits]
    if len(fits) > 1:
        _check_weights(readings, name, fits, estimates)
    estimate, agreement = combine(estimates)
    return ComponentFit(
        name=name, unit=unit, instruments=fits, estimate=estimate, agreement_p=agreement
    )


def _check_weights(
    readings: Readings,
    name: str,
    fits: Sequence[InstrumentFit],
    estimates: Sequence[ComponentEstimate],
) -> None:
    """Without scatter an instrument has no weight against the others."""
    problems = [
        Problem(
            what=f"the readings of {name!r} by {fit.role} show no scatter: they cannot be "
            "weighed against the other instruments'",
            file=", ".join(s.shown for s in readings.sources if s.role == fit.role) or None,
            expected="more readings, with all their digits",
        )
        for fit, estimate in zip(fits, estimates, strict=True)
        if not (np.diag(estimate.covariance) > 0).all()
    ]
    if problems:
        raise InputError(problems)


def _fit_instrument(readings: Readings, rows: IntArray, role: str, component: Any) -> InstrumentFit:
    position = readings.position_mm[rows].astype(np.float64)
    if component.of is None:
        position = np.zeros(len(rows))
    error = readings.error[rows]
    direction = readings.direction[rows].astype(np.float64)
    group, keys = _passes(readings, rows, component.of is None)
    fit = fit_passes(error, position, component.degree, group, direction)
    order, starts, ends, setups = _pass_times(readings, rows, group, len(keys))
    if fit.separated:
        # Passes that broke off early do not take part in what compares passes.
        kept = fit.groups
        order, starts, ends = order[kept], starts[kept], ends[kept]
        keys = tuple(keys[g] for g in kept)
        setups = tuple(setups[g] for g in kept)
    return InstrumentFit(
        role=role,
        position=position,
        error=error,
        direction=direction,
        group=group,
        keys=keys,
        starts=starts,
        ends=ends,
        setups=setups,
        fit=fit,
        scatter=pass_scatter(fit),
        trend=pass_trend(fit, order) if fit.separated else None,
        reversal=reversal(fit),
        lack_of_fit=lack_of_fit(error, position, component.degree, group),
    )


def _passes(
    readings: Readings, rows: IntArray, without_axis: bool
) -> tuple[IntArray | None, tuple[tuple[int, int], ...]]:
    """The pass of every reading: one (pass, direction), forward before reverse.

    A component without a position is read once a pass, so that readings without a pass
    number are passes of their own.
    """
    if not readings.has_pass[rows].all():
        if not without_axis:
            return None, ()
        return np.arange(len(rows)), tuple((i + 1, 0) for i in range(len(rows)))
    numbers = readings.pass_number[rows].astype(np.int64)
    signs = readings.direction[rows].astype(np.int64)
    pairs = np.column_stack([numbers, -signs])
    distinct, group = np.unique(pairs, axis=0, return_inverse=True)
    keys = tuple((int(number), int(-sign)) for number, sign in distinct)
    return group.reshape(-1).astype(np.int64), keys


def _pass_times(
    readings: Readings, rows: IntArray, group: IntArray | None, count: int
) -> tuple[FloatArray, FloatArray, FloatArray, tuple[str, ...]]:
    """Order in time, first and last time, and set-up of every pass."""
    starts, ends = np.full(count, np.nan), np.full(count, np.nan)
    setups = [""] * count
    if group is None:
        return np.zeros(0), starts, ends, ()
    labels = readings.covariates.get("setup")
    times = readings.time_min[rows]
    for g in range(count):
        inside = group == g
        if np.isfinite(times[inside]).all():
            starts[g], ends[g] = times[inside].min(), times[inside].max()
        if labels is not None:
            setups[g] = str(labels[rows[inside][0]])
    order = starts if np.isfinite(starts).all() else np.arange(count, dtype=np.float64)
    return order, starts, ends, tuple(setups)


def _estimate(name: str, component: Any, unit: Unit, found: InstrumentFit) -> ComponentEstimate:
    fit = found.fit
    k = len(fit.plain.coefficients)
    T = from_centre(fit.center, k, len(fit.D))
    low, high = float(found.position.min()), float(found.position.max())
    return ComponentEstimate(
        name=name,
        of=component.of,
        unit=unit,
        coefficients=fit.plain.coefficients,
        covariance=fit.covariance,
        pass_covariance=T @ fit.D_moment @ T.T,
        s_repeat=float(np.sqrt(fit.s2)),
        pass_dof=float(fit.pass_dof),
        repeat_dof=float(fit.within_dof) if fit.within_dof else np.inf,
        n_passes=fit.n_passes if fit.separated else None,
        independent_covariance=fit.plain.s2 * fit.plain.unscaled_covariance,
        independent_s=float(np.sqrt(fit.plain.s2)),
        position_range=None if component.of is None else (low, high),
    )


def combine(estimates: Sequence[ComponentEstimate]) -> tuple[ComponentEstimate, float | None]:
    """One estimate from several instruments' and the p value that they agree.

    b = (sum C_i^-1)^-1 sum C_i^-1 b_i. The scatter of passes and of visits is pooled by
    degrees of freedom: an instrument's own noise stays in s_repeat, which is then an upper
    bound of the machine's.
    """
    if len(estimates) == 1:
        return estimates[0], None
    first = estimates[0]
    weights = [np.linalg.inv(item.covariance) for item in estimates]
    C = np.linalg.inv(np.sum(weights, axis=0))
    b = C @ np.sum([w @ e.coefficients for w, e in zip(weights, estimates, strict=True)], axis=0)
    passes = np.array([item.pass_dof for item in estimates])
    repeats = np.array([item.repeat_dof for item in estimates])
    D = _pooled([item.pass_covariance for item in estimates], passes)
    s2 = _pooled([np.array(item.s_repeat**2) for item in estimates], repeats)
    ranges = [item.position_range for item in estimates if item.position_range is not None]
    independent = [w for w in (item.independent_covariance for item in estimates) if w is not None]
    combined = ComponentEstimate(
        name=first.name,
        of=first.of,
        unit=first.unit,
        coefficients=b,
        covariance=(C + C.T) / 2,
        pass_covariance=D,
        s_repeat=float(np.sqrt(s2)),
        pass_dof=float(passes.sum()),
        repeat_dof=float(repeats.sum()),
        independent_covariance=np.linalg.inv(np.sum([np.linalg.inv(w) for w in independent], 0)),
        independent_s=float(
            np.sqrt(np.mean([(item.independent_s or 0.0) ** 2 for item in estimates]))
        ),
        position_range=(min(r[0] for r in ranges), max(r[1] for r in ranges)) if ranges else None,
    )
    return combined, agreement(estimates[0], estimates[1])


def agreement(a: ComponentEstimate, b: ComponentEstimate) -> float:
    """p value that two instruments read the same line.

    T^2 = d' (C_a + C_b)^-1 d with d = b_a - b_b, referred to F with the effective degrees of
    freedom of its covariance (Yao, Biometrika 52 (1965) 139, with Welch's weights taken over
    all coefficients): a chi-square would reject far too often, the covariances being estimated.
    """
    from scipy.special import fdtrc

    d = a.coefficients - b.coefficients
    inverse = np.linalg.inv(a.covariance + b.covariance)
    k = len(d)
    sources = [source for item in (a, b) for source in _sources(item)]
    shares = [float(np.trace(part @ inverse)) / k for part, _ in sources]
    nu = 1.0 / sum(share**2 / dof for share, (_, dof) in zip(shares, sources, strict=True))
    if nu <= k - 1:
        return 1.0
    F = float(d @ inverse @ d) * (nu - k + 1) / (nu * k)
    return float(fdtrc(k, nu - k + 1, F))


def _sources(item: ComponentEstimate) -> list[tuple[FloatArray, float]]:
    """The mean squares that make up C, with their degrees of freedom."""
    S = between_passes(item)
    if S is None or item.n_passes is None:
        return [(item.covariance, item.pass_dof or item.repeat_dof)]
    of_passes = S / item.n_passes
    return [(of_passes, item.pass_dof), (item.covariance - of_passes, item.repeat_dof)]


def _pooled(values: Sequence[FloatArray], dofs: FloatArray) -> FloatArray:
    """Mean weighted by degrees of freedom; those without any have no say."""
    finite = np.where(np.isinf(dofs), 1e9, dofs)
    if finite.sum() == 0:
        return np.zeros_like(values[0])
    pooled: FloatArray = np.tensordot(finite / finite.sum(), np.array(values), axes=1)
    return pooled
