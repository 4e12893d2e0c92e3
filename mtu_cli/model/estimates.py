"""Estimates of components and their drifts: coefficients, their covariance, scatter of passes.

A component is linear in its coefficients, whatever its shape along an axis is (`stats.kernels`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mtu_cli.files.machine import Component
from mtu_cli.files.reports_read import ReportedComponent
from mtu_cli.stats.kernels import PolynomialShape, Shape, TableShape
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import SMALL, UNITS, Unit


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalEstimate:
    """The drift of one component, in internal units (mm or rad, per degC and per mm^m).
    `coefficients` (m, s): ascending powers of the position along `of` (one row where the drift does
    not depend on it), one column a sensor. `covariance` (m*s, m*s) of them, powers first, with
    `coefficient_dof`. `leftover` (m, m), with `leftover_dof`, is the covariance of what the model
    leaves, as a polynomial of the same powers, shared by all points of a part. `time_constants`
    (s,) in min, 0 without lag; `sensor_u` (s,) in degC; `temperature_range` (s, 2) in degC and
    `position_range` in mm are the ranges of the fit (None: not known).
    """

    component: str
    of: str | None
    unit: Unit
    sensors: tuple[str, ...]
    reference: float
    coefficients: FloatArray
    covariance: FloatArray
    coefficient_dof: float = np.inf
    leftover: FloatArray
    leftover_dof: float = np.inf
    time_constants: FloatArray
    sensor_u: FloatArray
    temperature_range: FloatArray | None = None
    position_range: tuple[float, float] | None = None

    @property
    def degree(self) -> int:
        """Degree of the polynomial in position; 0: the drift is the same everywhere."""
        return len(self.coefficients) - 1

    def gradients(self, position: FloatArray) -> FloatArray:
        """Drift per degC of each sensor (s, n) at `position` (n,), mm."""
        return np.asarray(np.polynomial.polynomial.polyval(position, self.coefficients))

    def drift(self, position: FloatArray, temperature: Mapping[str, FloatArray]) -> FloatArray:
        """The drift (n,) in mm or rad at `position` (n,) and temperatures (n,), degC, lagged
        already.
        """
        rises = [np.asarray(temperature[sensor]) - self.reference for sensor in self.sensors]
        each = [gradient * u for gradient, u in zip(self.gradients(position), rises, strict=True)]
        return sum(each, np.zeros(len(position)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentEstimate:
    """One component as a polynomial or table of its axis, in internal units (mm or rad, per mm^k).

    `coefficients` (k,) in ascending powers, or values at the positions of `table`; `covariance` C
    (k, k) their covariance, shared by all predictions; `pass_covariance` D (k, k) the pass-to-pass
    covariance, shared by all points of one part; `s_repeat` the repeatability of one visit,
    independent from visit to visit. From readings D is the unbiased moment estimate, which may
    have a negative part: clipped, every interval were too wide where the passes hardly differ.
    `pass_dof` and `repeat_dof` belong to the mean squares behind them (inf: known exactly;
    pass_dof 0: one mean square, with `repeat_dof`, stands behind all of them). `n_passes` is
    given where C is the between-pass mean square over that number. `half_differences` (k, k) is
    the mean square S_h of runs there and back, S = S_m + S_h and C = S_m/runs (see
    `stats.mixed_model`); None where all passes count as independent. `run_covariance` (k, k) is
    K = S_m - S_h of several instruments, which have no mean square in common; it may have a
    negative part, too. `independent_covariance` and `independent_s` are the paper's s^2 (X'X)^-1
    and s. `position_range` in mm is that of the readings; None of none, or without `of`.
    """

    name: str
    of: str | None = None
    unit: Unit
    coefficients: FloatArray
    covariance: FloatArray
    pass_covariance: FloatArray
    s_repeat: float = 0.0
    pass_dof: float = 0.0
    repeat_dof: float = np.inf
    n_passes: int | None = None
    independent_covariance: FloatArray | None = None
    independent_s: float | None = None
    position_range: tuple[float, float] | None = None
    half_differences: FloatArray | None = None
    run_covariance: FloatArray | None = None
    table: TableShape | None = None

    @property
    def shape(self) -> Shape:
        """What the coefficients multiply."""
        return PolynomialShape(len(self.coefficients) - 1) if self.table is None else self.table

    @property
    def degree(self) -> int | None:
        """Degree of the polynomial; None of a table."""
        return len(self.coefficients) - 1 if self.table is None else None


@dataclass(frozen=True, slots=True, kw_only=True)
class JointPasses:
    """Components read in the same passes, or parameters estimated jointly: `covariance`,
    `pass_covariance` and `half_differences` (K, K) replace the components' own; K counts their
    coefficients (`widths` of them each) in the order of `components`.
    """

    components: tuple[str, ...]
    widths: tuple[int, ...]
    covariance: FloatArray
    pass_covariance: FloatArray
    pass_dof: float = np.inf
    n_passes: int | None = None
    half_differences: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectEstimates:
    """Parameters of a machine's effects, estimated jointly, in internal units.

    `names` (K,) are ``effect.parameter``; `values` (K,), `covariance` (K, K) over all of them.
    """

    names: tuple[str, ...]
    units: tuple[Unit, ...]
    values: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimates:
    """All components of a machine, which of them were estimated jointly, and their drifts;
    `effects`: a report's estimates of the machine's effects, where it has any.
    """

    components: dict[str, ComponentEstimate]
    joint: tuple[JointPasses, ...] = ()
    thermal: dict[str, ThermalEstimate] = field(default_factory=dict)
    effects: EffectEstimates | None = None


def between_passes(estimate: ComponentEstimate) -> FloatArray | None:
    """S (k, k), the mean square between passes that C and D come from; None without one.

    Up to degree 1 every coefficient is the mean over the passes, so that S = n C, or
    n C/2 + S_h of runs there and back. Powers that the passes have in common are known from within
    passes: then S = D + s_repeat^2 M, where M = n (P'X'X P)^-1 is the error of the level and slope
    of a pass, P their columns, and (P'X'X P)^-1 is the Schur complement of those powers in
    (X'X)^-1. Of a table X'X counts the readings at its positions.
    """
    C, D, s = estimate.covariance, estimate.pass_covariance, estimate.independent_s
    n, halves, C_ind = estimate.n_passes, estimate.half_differences, estimate.independent_covariance
    if n is None:
        return None
    if estimate.table is not None:
        if C_ind is None or not s:
            return None
        line = estimate.table.of_line(float(np.mean(estimate.table.at)), 2)
        M = n * np.linalg.inv((line.T * (s**2 / np.diag(C_ind))) @ line)
        return D + np.asarray(estimate.s_repeat**2 * line @ M @ line.T)
    k = len(C)
    # D of few passes may be cut to 0 in all; what differs between the ways of a run is not.
    slopes = k > 1 and bool(D[1, 1] or (halves is not None and halves[1, 1]))
    q = 2 if slopes else 1
    if q == k:
        return from_mean(C, n, halves)
    S = D.copy()
    if C_ind is not None and s:
        inverse = C_ind / s**2
        scale = np.sqrt(np.diag(inverse))
        R = inverse / np.outer(scale, scale)
        M = R[:q, :q] - R[:q, q:] @ np.linalg.lstsq(R[q:, q:], R[q:, :q], rcond=None)[0]
        S[:q, :q] += estimate.s_repeat**2 * n * M * np.outer(scale, scale)[:q, :q]
    return S


def covariance_in_run(estimate: ComponentEstimate) -> FloatArray | None:
    """K (k, k), the covariance of level and slope of the passes there and back of one run; None
    where all passes count as independent.
    """
    S, halves = between_passes(estimate), estimate.half_differences
    return estimate.run_covariance if S is None or halves is None else S - 2 * halves


def from_mean(C: FloatArray, n: int, halves: FloatArray | None) -> FloatArray:
    """S (k, k), the mean square between n passes whose mean has the covariance C."""
    return n * C if halves is None else n / 2 * C + halves


def known_component(name: str, entry: Component | ReportedComponent) -> ComponentEstimate:
    """A component whose coefficients a machine file states, without a covariance as known, or a
    report. `u_future`, the standard uncertainty of a future observation that many tables print,
    counts as repeatability or, without an axis, as shared by all points of a part.
    """
    unit, k = UNITS[entry.unit], len(entry.coefficients or ())
    f, q, table = unit.to_internal, min(2, k), None
    if entry.at_mm is not None:
        square = SMALL[unit.dimension].to_internal ** 2
        table = TableShape(
            at=np.asarray(entry.at_mm, float),
            roughness=(entry.roughness_um2_per_mm3 or 0.0) * square,
            between=(entry.between_um2 or 0.0) * square,
            own=(entry.own_um2_per_mm3 or 0.0) * square,
            own_dof=dof_or(getattr(entry, "own_dof", None)),
        )
    T = (table or PolynomialShape(k - 1)).of_line(entry.pass_center_mm or 0.0, q) * f

    def squared(key: str, by: FloatArray) -> FloatArray | None:
        matrix = getattr(entry, key, None)
        return None if matrix is None else by @ np.asarray(matrix, float) @ by.T

    scale = np.eye(k) * f
    fields: dict[str, Any] = {}
    if isinstance(entry, ReportedComponent):
        D, repeat, overall = squared("pass_covariance_moment", T), entry.s_repeat, np.inf
        fields = {
            "n_passes": entry.n_passes,
            "independent_covariance": squared("covariance_independent", scale),
            "independent_s": None if entry.s is None else entry.s * f,
            "position_range": entry.position_range_mm,
            "half_differences": squared("half_difference_mean_square", T),
            "run_covariance": squared("run_covariance", T),
        }
    else:
        D, repeat = squared("pass_covariance", T), entry.s_repeat or 0.0
        overall = dof_or(entry.dof)
        if entry.u_future is not None and entry.of is None:
            D = T @ T.T * entry.u_future**2
        elif entry.u_future is not None:
            repeat = entry.u_future
        if table is not None:
            # A table holds within its positions only.
            fields = {"position_range": (float(table.at[0]), float(table.at[-1]))}
    C, none = squared("covariance", scale), np.zeros((k, k))
    return ComponentEstimate(
        name=name,
        of=entry.of,
        unit=unit,
        coefficients=np.asarray(entry.coefficients, float) * f,
        covariance=none if C is None else C,
        pass_covariance=none if D is None else D,
        s_repeat=repeat * f,
        pass_dof=0.0 if D is None else dof_or(entry.pass_dof, overall),
        repeat_dof=dof_or(entry.repeat_dof, overall),
        table=table,
        **fields,
    )


def dof_or(stated: float | None, missing: float = np.inf) -> float:
    """Degrees of freedom as stated, else `missing`."""
    return missing if stated is None else float(stated)
