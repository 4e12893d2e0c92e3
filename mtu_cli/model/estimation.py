"""Readings of error components to estimates, one component and one instrument at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.errors import InputError, Problem
from mtu_cli.model.estimates import ComponentEstimate, from_centre
from mtu_cli.model.instruments import combine
from mtu_cli.model.runs import runs_of, ways
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


PassKey = tuple[int, int, int]
"""(file, pass, direction)."""


@dataclass(frozen=True, kw_only=True)
class InstrumentFit:
    """One component as one instrument read it; arrays in mm, rad and the readings' order.

    `keys` are the (file, pass, direction) of the fit's passes, in its order; `order` (G,) is
    their sequence in time. `read` are those of all passes, as `group` numbers them; the fit leaves
    out what broke off early. The tests on the passes are made when they are first asked for:
    predictions need not all of them.
    """

    role: str
    position: FloatArray
    error: FloatArray
    direction: FloatArray
    group: IntArray | None
    keys: tuple[PassKey, ...]
    read: tuple[PassKey, ...]
    order: FloatArray
    starts: FloatArray
    ends: FloatArray
    setups: tuple[str, ...]
    fit: PassFit

    @cached_property
    def scatter(self) -> FTest | None:
        """Whether the passes differ by more than repeatability."""
        return pass_scatter(self.fit)

    @cached_property
    def trend(self) -> Shift | None:
        """The drift a pass."""
        return pass_trend(self.fit, self.order)

    @cached_property
    def reversal(self) -> Shift | None:
        """The mean reversal value."""
        timed = bool(np.isfinite(self.starts).all())
        return reversal(self.fit, self.order, timed=timed)

    @cached_property
    def lack_of_fit(self) -> FTest | None:
        """Whether free means at the positions fit better than the polynomial."""
        degree = len(self.fit.plain.coefficients) - 1
        return lack_of_fit(self.error, self.position, degree, self.group)


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
    roles = np.array(readings.roles)[readings.file_index[rows]]
    fits = tuple(
        _fit_instrument(readings, rows[roles == role], role, component)
        for role in dict.fromkeys(roles.tolist())
    )
    estimates = [_estimate(name, component, unit, fit) for fit in fits]
    if len(fits) > 1:
        _check_weights(readings, name, fits, estimates)
    estimate, agreement = combine(estimates, [len(fit.error) for fit in fits])
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
    group, read = _passes(readings, rows, component.of is None)
    keys = read
    order, starts, ends, setups = _pass_times(readings, rows, group, len(keys))
    runs = None if group is None else _runs(keys, order, setups)[group]
    fit = fit_passes(error, position, component.degree, group, direction, runs)
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
        read=read,
        order=order,
        starts=starts,
        ends=ends,
        setups=setups,
        fit=fit,
    )


def _passes(
    readings: Readings, rows: IntArray, without_axis: bool
) -> tuple[IntArray | None, tuple[PassKey, ...]]:
    """The pass of every reading: one (file, pass, direction), forward before reverse.

    Files number their passes on their own: pass 1 of two days is two passes. A component
    without a position is read once a pass, so that readings without a pass number are passes
    of their own.
    """
    if not readings.has_pass[rows].all():
        if not without_axis:
            return None, ()
        files = readings.file_index[rows]
        return np.arange(len(rows)), tuple((int(f), i + 1, 0) for i, f in enumerate(files))
    numbers = readings.pass_number[rows].astype(np.int64)
    signs = readings.direction[rows].astype(np.int64)
    triples = np.column_stack([readings.file_index[rows], numbers, -signs])
    order = np.lexsort(triples.T[::-1])
    ordered = triples[order]
    new = np.ones(len(rows), bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    group = np.empty(len(rows), np.int64)
    group[order] = np.cumsum(new) - 1
    return group, tuple((file, number, -sign) for file, number, sign in ordered[new].tolist())


def _runs(keys: tuple[PassKey, ...], order: FloatArray, setups: tuple[str, ...]) -> IntArray:
    """The run there and back of each pass (G,); two passes of a run are of one set-up."""
    files, numbers, signs = np.array(keys, dtype=np.int64).reshape(-1, 3).T
    passes, code = np.unique(np.column_stack([files, numbers]), axis=0, return_inverse=True)
    code = code.reshape(-1)
    first = np.full(len(passes), np.inf)
    np.minimum.at(first, code, order)
    in_time = np.argsort(first, kind="stable")
    run = runs_of(passes, in_time, ways(code, signs, len(passes)))[code]
    _, label = np.unique(np.array(setups, dtype=object), return_inverse=True)
    both = np.column_stack([run, label.reshape(-1)])
    return np.unique(both, axis=0, return_inverse=True)[1].reshape(-1)


def _pass_times(
    readings: Readings, rows: IntArray, group: IntArray | None, count: int
) -> tuple[FloatArray, FloatArray, FloatArray, tuple[str, ...]]:
    """Order in time, first and last time, and set-up of every pass.

    Without times a pass goes forward first: the order of rows is not to matter.
    """
    starts, ends = np.full(count, np.inf), np.full(count, -np.inf)
    if group is None:
        return np.zeros(0), starts, ends, ()
    times = readings.time_min[rows]
    # One reading without a time (nan) leaves its pass without.
    with np.errstate(invalid="ignore"):
        np.minimum.at(starts, group, times)
        np.maximum.at(ends, group, times)
    setups = [""] * count
    labels = readings.covariates.get("setup")
    if labels is not None:
        _, first = np.unique(group, return_index=True)
        setups = [str(label) for label in labels[rows[first]]]
    order = starts if np.isfinite(starts).all() else np.arange(count, dtype=np.float64)
    return order, starts, ends, tuple(setups)


def _estimate(name: str, component: Any, unit: Unit, found: InstrumentFit) -> ComponentEstimate:
    fit = found.fit
    k = len(fit.plain.coefficients)
    T = from_centre(fit.center, k, len(fit.D))
    D = T @ fit.D_moment @ T.T
    halves = None if fit.half_differences is None else T @ fit.half_differences @ T.T
    low, high = float(found.position.min()), float(found.position.max())
    return ComponentEstimate(
        name=name,
        of=component.of,
        unit=unit,
        coefficients=fit.plain.coefficients,
        covariance=fit.covariance,
        pass_covariance=(D + D.T) / 2,
        s_repeat=float(np.sqrt(fit.s2)),
        pass_dof=float(fit.pass_dof),
        repeat_dof=float(fit.within_dof) if fit.within_dof else np.inf,
        n_passes=fit.n_passes if fit.separated else None,
        independent_covariance=fit.plain.s2 * fit.plain.unscaled_covariance,
        independent_s=float(np.sqrt(fit.plain.s2)),
        position_range=None if component.of is None else (low, high),
        half_differences=None if halves is None else (halves + halves.T) / 2,
    )
