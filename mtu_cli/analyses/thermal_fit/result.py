"""What `thermal-fit` finds, in internal units (mm or rad; degC, min)."""

from __future__ import annotations

from dataclasses import dataclass

from mtu_cli.findings import Finding
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import Unit


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """Root mean squares over readings of cycles that took no part in fit or choice.

    `before` without temperature, `after` with the model, `ordinary` with ordinary least
    squares on all sensors; `r2` = 1 - after^2/before^2. `cycles` holds (cycle, before, after);
    they were held out in so many `blocks`.
    """

    before: float
    after: float
    ordinary: float
    r2: float
    cycles: tuple[tuple[str, float, float], ...]
    blocks: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A model that was tried: its held-out root mean square, None where it cannot be had."""

    model: str
    degree: int
    held_out: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Residuals:
    """Of the fitted readings: `normality_p` (D'Agostino & Pearson's K^2 on the effective
    number), `lag1` autocorrelation, `effective` number of independent residuals.
    """

    normality_p: float | None
    lag1: float
    effective: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionTest:
    """Whether the drift depends on position: F and its p."""

    F: float
    p: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """One position and cycle for pictures: arrays (n,), at most some hundred of them.

    `time` in min (counted readings where no time is given), `measured` and `modelled` drift.
    """

    position: float | None
    cycle: str
    time: FloatArray
    measured: FloatArray
    modelled: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentDrift:
    """The thermal model of one component and the evidence for it.

    `groups` are sensors that cannot be told apart (|r| >= 0.999), the first of each standing
    for all; `condition` and `vif` (by sensor, None: infinite) of the standardised sensors of
    the model; `shares` (by sensor) the root mean square of its part of the modelled drift;
    `at_positions` (position, {sensor: mm or rad per degC}) the model at observed positions.
    `without_lag`: lags were asked for and sought, and none was worth it; the `model` is ridge.
    """

    name: str
    unit: Unit
    model: str
    estimate: ThermalEstimate
    positions: tuple[float, ...]
    n: int
    cycles: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    r2_fit: float
    rms_before: float
    rms_after: float
    held_out: HeldOut | None
    candidates: tuple[Candidate, ...]
    position_test: PositionTest | None
    condition: float
    vif: dict[str, float | None]
    residuals: Residuals
    shares: dict[str, float]
    at_positions: tuple[tuple[float | None, dict[str, float]], ...]
    intercepts: tuple[tuple[float | None, float], ...]
    curves: tuple[Curve, ...]
    without_lag: bool = False

    def shown(self, value: float) -> str:
        """A length or angle of two digits in the component's unit."""
        size = value / self.unit.to_internal
        return f"{float(f'{size:.2g}'):g} {self.unit.name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalFit:
    """All components whose drift was read; `reference` in degC. `not_used` are the columns of
    the readings that are no sensors.
    """

    components: dict[str, ComponentDrift]
    sensors: tuple[str, ...]
    not_used: tuple[str, ...] = ()
    reference: float
    method: str
    warnings: tuple[Finding, ...]
