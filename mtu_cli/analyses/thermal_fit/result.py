"""The result of `thermal-fit`, in internal units: mm or rad; degC, min."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from mtu_cli.findings import Finding
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import ARCSEC, LENGTH, UM, Unit

Interval = tuple[float, float]


class Curve(NamedTuple):
    """One position and cycle for pictures: arrays (n,), at most some hundred of them.

    `time` in min (counted readings where no time is given), `measured` and `modelled` drift.
    """

    position: float | None
    cycle: str
    time: FloatArray
    measured: FloatArray
    modelled: FloatArray


class HeldOut(NamedTuple):
    """Root mean squares over readings of cycles that took no part in fit or choice: `before`
    without temperature, `after` with the model, `ordinary` with least squares on all sensors.
    """

    before: float
    after: float
    ordinary: float

    @property
    def r2(self) -> float:
        """1 - after^2/before^2; nan where the readings do not differ."""
        return 1.0 - (self.after / self.before) ** 2 if self.before > 0 else float("nan")

    @property
    def reduction(self) -> float:
        """1 - after/before; nan where the readings do not differ."""
        return 1.0 - self.after / self.before if self.before > 0 else float("nan")


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
    interval: Interval | None
    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentDrift:
    """The thermal model of one component and the evidence for it.

    `groups` are sensors that move alike (|r| >= 0.999), the first of each standing for all;
    `gradients` of every sensor of the model at every position, `inseparable` ones of several;
    `condition` and `vif` (by sensor, None: infinite) of the standardised sensors of the model;
    `shares` (by sensor) the root mean square of its part of the modelled drift. Cycles have
    `offsets` of their own where the probe was zeroed in each (`by`: setting, first readings or
    test). `normality_p` (D'Agostino & Pearson's K^2 on the effective number) and `lag1`
    autocorrelation are of the residuals.
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
    condition: float
    vif: dict[str, float | None]
    normality_p: float | None
    lag1: float
    shares: dict[str, float]
    gradients: tuple[Gradient, ...]
    inseparable: tuple[Gradient, ...]
    curves: tuple[Curve, ...]
    offsets: bool
    by: str

    @property
    def size2(self) -> float:
        """Its unit's square."""
        return self.unit.to_internal**2

    @property
    def rms_unit(self) -> str:
        """Of reported root mean squares: um of a length, arcsec of an angle."""
        return "um" if self.unit.dimension == LENGTH else "arcsec"

    @property
    def rms_size(self) -> float:
        """mm or rad in one of it."""
        return UM if self.unit.dimension == LENGTH else ARCSEC


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalFit:
    """All components whose drift was read; `reference` in degC."""

    components: dict[str, ComponentDrift]
    sensors: tuple[str, ...]
    reference: float
    method: str
    warnings: tuple[Finding, ...]
