"""Readings of error components to estimates, one component and one instrument at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.findings import InputError, finding
from mtu_cli.model.estimates import ComponentEstimate, from_centre
from mtu_cli.model.instruments import at_both_ways, combine
from mtu_cli.model.passes import Passes, PassKey, passes_of
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed import IntArray, PassFit, fit_passes
from mtu_cli.stats.pass_tests import (
    FTest,
    Shift,
    lack_of_fit,
    pass_scatter,
    pass_trend,
    reversal,
    trend_units,
)
from mtu_cli.units import UNITS, Unit

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings


@dataclass(frozen=True, kw_only=True)
class InstrumentFit:
    """One component as one instrument read it; arrays in mm, rad and the readings' order.

    `group` (n,) is the pass of each reading among the passes `read`; `passes` are those of the fit,
    in its order, which leaves out what broke off early; all three None where no pass is given. The
    tests on the passes are made when they are first asked for: predictions need not all of them.
    """

    role: str
    position: FloatArray
    error: FloatArray
    direction: FloatArray
    group: IntArray | None
    read: Passes | None
    passes: Passes | None
    fit: PassFit

    @property
    def keys_read(self) -> tuple[PassKey, ...]:
        """Of all passes, those that broke off early too; none where no pass is given."""
        return () if self.read is None else self.read.keys

    @property
    def way(self) -> int | None:
        """The direction that all readings have, +1 forward or -1; None of both, or of none."""
        found = np.unique(self.direction).astype(int).tolist()
        return found[0] if found in ([1], [-1]) else None

    @cached_property
    def scatter(self) -> FTest | None:
        """Whether the passes differ by more than repeatability."""
        return pass_scatter(self.fit)

    @cached_property
    def trend(self) -> Shift | None:
        """The drift a pass."""
        return None if self.passes is None else pass_trend(self.fit, self.passes.order)

    @property
    def trend_of_files(self) -> bool:
        """Whether the order in which files are given, and no times, makes the trend what it is."""
        passes = self.passes
        if passes is None or passes.timed:
            return False
        return passes.files_in_turn(trend_units(self.fit))

    @cached_property
    def reversal(self) -> Shift | None:
        """The mean reversal value."""
        if self.passes is None:
            return None
        return reversal(self.fit, self.passes.order, timed=self.passes.timed)

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
        ways, reversals = [fit.way for fit in fits], [fit.reversal for fit in fits]
        estimates = at_both_ways(estimates, ways, reversals)
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
        finding(
            "too-little-data",
            what=f"the readings of {name!r} by {fit.role} do not scatter, so that they have no "
            "weight beside the others",
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
    runs = None if read is None else read.runs[group]
    fit = fit_passes(error, position, component.degree, group, direction, runs)
    return InstrumentFit(
        role=role,
        position=position,
        error=error,
        direction=direction,
        group=group,
        read=read,
        # Passes that broke off early do not take part in what compares passes.
        passes=read.only(fit.groups) if read is not None and fit.separated else read,
        fit=fit,
    )


def _passes(
    readings: Readings, rows: IntArray, without_axis: bool
) -> tuple[IntArray, Passes] | tuple[None, None]:
    """The pass of every reading, and the passes; None where a reading has none. A component
    without a position is read once a pass: readings without a number are passes of their own.
    """
    numbers, sign = readings.pass_number[rows], readings.direction[rows].astype(np.int64)
    if not readings.has_pass[rows].all():
        if not without_axis:
            return None, None
        numbers, sign = np.arange(1, len(rows) + 1), np.zeros(len(rows), np.int64)
    return passes_of(readings, rows, numbers, sign)


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
