"""The result of `thermal-fit`, in internal units: mm or rad; degC, min."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from mtu_cli.analyses.thermal_fit.models import Zeroed
from mtu_cli.findings import Finding
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import ARCSEC, LENGTH, UM, Unit

NOT_ZEROED = Zeroed(offsets=False, by="setting")
Interval = tuple[float, float]


class Residuals(NamedTuple):
    """Of the fitted readings: `normality_p` (D'Agostino & Pearson's K^2 on the effective
    number), `lag1` autocorrelation, `effective` number of independent residuals.
    """

    normality_p: float | None
    lag1: float
    effective: float


class Curve(NamedTuple):
    """One position and cycle for pictures: arrays (n,), at most some hundred of them.

    `time` in min (counted readings where no time is given), `measured` and `modelled` drift.
    """

    position: float | None
    cycle: str
    time: FloatArray
    measured: FloatArray
    modelled: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """Root mean squares over readings of cycles that took no part in fit or choice.

    `before` without temperature, `after` with the model, `ordinary` with ordinary least squares
    on all sensors; `r2` = 1 - after^2/before^2. The `cycles` (name, before, after) were held out
    in so many `blocks`.
    """

    before: float
    after: float
    ordinary: float
    r2: float
    cycles: tuple[tuple[str, float, float], ...]
    blocks: int

    @property
    def reduction(self) -> float:
        """1 - after/before; nan where the readings do not differ."""
        return 1.0 - self.after / self.before if self.before > 0 else float("nan")


class PositionTest(NamedTuple):
    """Whether the drift depends on position: F and its p."""

    F: float
    p: float


class Inseparable(NamedTuple):
    """Sensors at a position that only have a gradient together: the drift per degC of the first,
    the others moving with it as they did in the readings.
    """

    position: float | None
    sensors: tuple[str, ...]
    value: float
    u: float | None
    interval: Interval | None


@dataclass(frozen=True, slots=True)
class Gradients:
    """The model at an observed position by sensor, mm or rad per degC: `u` and 95 % `intervals`
    (None where the readings do not determine it), u `by` "cycles" (their scatter) or "model" (of
    the errors); and the sensors that are not separable.
    """

    position: float | None
    gradients: dict[str, float]
    u: dict[str, float | None] = field(default_factory=dict)
    intervals: dict[str, Interval | None] = field(default_factory=dict)
    by: dict[str, str] = field(default_factory=dict)
    inseparable: tuple[Inseparable, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentDrift:
    """The thermal model of one component and the evidence for it.

    `groups` are sensors that move alike (|r| >= 0.999), the first of each standing
    for all; `condition` and `vif` (by sensor, None: infinite) of the standardised sensors of
    the model; `shares` (by sensor) the root mean square of its part of the modelled drift.
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
    position_test: PositionTest | None
    condition: float
    vif: dict[str, float | None]
    residuals: Residuals
    shares: dict[str, float]
    at_positions: tuple[Gradients, ...]
    curves: tuple[Curve, ...]
    zeroed: Zeroed = NOT_ZEROED

    @property
    def size2(self) -> float:
        """Its square."""
        return self.unit.to_internal**2

    @property
    def rms_unit(self) -> str:
        """Of reported root mean squares: um of a length, arcsec of an angle."""
        return "um" if self.unit.dimension == LENGTH else "arcsec"

    @property
    def rms_size(self) -> float:
        """mm or rad in one of it."""
        return UM if self.unit.dimension == LENGTH else ARCSEC

    @property
    def by_share(self) -> list[str]:
        """The sensors of the model, the one with the largest part of the drift first."""
        return sorted(self.estimate.sensors, key=lambda name: -self.shares.get(name, 0.0))

    def twins(self, sensor: str) -> tuple[str, ...]:
        """The other sensors that `sensor` stands for."""
        return next((group[1:] for group in self.groups if group[:1] == (sensor,)), ())

    @property
    def gradients(self) -> Iterator[dict[str, Any]]:
        """What every sensor does at every position; one without a sensor where the model has none.
        `value` per degC with its `u` (`by` the scatter of cycles or the model of errors).
        """
        model, span = self.estimate, self.estimate.temperature_range
        if not model.sensors:
            yield {"drift": self}
        for at in self.at_positions:
            for i, sensor in enumerate(model.sensors):
                yield {
                    "drift": self,
                    "position": at.position,
                    "sensor": sensor,
                    "stands_for": self.twins(sensor),
                    "value": at.gradients.get(sensor),
                    "u": at.u.get(sensor),
                    "interval": at.intervals.get(sensor),
                    "by": at.by.get(sensor),
                    "separable": not any(sensor in group.sensors for group in at.inseparable),
                    "share": self.shares.get(sensor),
                    "lag": float(model.time_constants[i]),
                    "vif": self.vif.get(sensor),
                    "temperatures": None if span is None else span[i],
                }


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalFit:
    """All components whose drift was read; `reference` in degC."""

    components: dict[str, ComponentDrift]
    sensors: tuple[str, ...]
    reference: float
    method: str
    warnings: tuple[Finding, ...]
