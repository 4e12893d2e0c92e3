"""The result of `thermal-fit`, in internal units (mm or rad; degC, min), and its warnings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.thermal_fit.choice import FEWEST_NESTED, Candidate, HeldOut, PositionTest
from mtu_cli.analyses.thermal_fit.gradients import Gradients
from mtu_cli.analyses.thermal_fit.models import Library, Zeroed
from mtu_cli.analyses.thermal_fit.series import Series
from mtu_cli.findings import Finding, finding
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.residuals import FEWEST_FOR_NORMALITY
from mtu_cli.units import ARCSEC, LENGTH, UM, Unit

OVER_FIT = 2.0
LEAST_GAIN, GAIN_P = 0.05, 0.05
"""Fall of the held-out rms from which on a model is of use whatever its cycles' scatter, and the
level at which a smaller one is told from none."""
FAR = 1.0
"""degC beyond the reference from which on it counts as not read."""
NOT_ZEROED = Zeroed(offsets=False, by="setting")
NOTHING = "no-effect-of-temperature"


class Intercept(NamedTuple):
    """What the readings show at the reference temperature, in one cycle or in all (None)."""

    position: float | None
    value: float
    cycle: str | None = None


class Share(NamedTuple):
    """Root mean square of a sensor's part of the modelled drift; None where its twin has it."""

    sensor: str
    rms: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Residuals:
    """Of the fitted readings: `normality_p` (D'Agostino & Pearson's K^2 on the effective
    number), `lag1` autocorrelation, `effective` number of independent residuals.
    """

    normality_p: float | None
    lag1: float
    effective: float


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

    `groups` are sensors that move alike (|r| >= 0.999), the first of each standing
    for all; `condition` and `vif` (by sensor, None: infinite) of the standardised sensors of
    the model; `shares` (by sensor) the root mean square of its part of the modelled drift.
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
    at_positions: tuple[Gradients, ...]
    intercepts: tuple[Intercept, ...]
    curves: tuple[Curve, ...]
    zeroed: Zeroed = NOT_ZEROED
    without_lag: bool = False

    @property
    def size(self) -> float:
        """Of the unit."""
        return self.unit.to_internal

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
    def by_share(self) -> tuple[Share, ...]:
        """The sensors of the model, the one with the largest part of the drift first."""
        shares = [Share(name, self.shares.get(name)) for name in self.estimate.sensors]
        return tuple(sorted(shares, key=lambda share: -(share.rms or 0.0)))

    def twins(self, sensor: str) -> tuple[str, ...]:
        """The other sensors that `sensor` stands for."""
        return next((group[1:] for group in self.groups if group[:1] == (sensor,)), ())

    def chosen(self, candidate: Candidate) -> bool:
        """Whether a candidate is the model; without a lag a lagged model is ridge."""
        kind = "lagged" if self.without_lag else self.model
        return (kind, self.estimate.degree) == (candidate.model, candidate.degree)

    @property
    def gradients(self) -> Iterator[SensorGradient]:
        """Of every position and sensor; one without a sensor where the model has none."""
        model = self.estimate
        if not model.sensors:
            yield SensorGradient(drift=self)
        for own in self.at_positions:
            for i, sensor in enumerate(model.sensors):
                span, known = model.temperature_range, own.known.get(sensor)
                yield SensorGradient(
                    drift=self,
                    position=own.position,
                    sensor=sensor,
                    stands_for=self.twins(sensor),
                    value=own.gradients.get(sensor),
                    u=known.u if known else model.gradient_u(i, own.position or 0.0),
                    interval=known.interval if known else None,
                    by=known.by if known else None,
                    separable=own.separable(sensor),
                    share=self.shares.get(sensor),
                    lag=float(model.time_constants[i]),
                    vif=self.vif.get(sensor),
                    temperatures=None if span is None else span[i],
                )

    def shown(self, value: float) -> str:
        """A length or angle of two digits in the component's unit."""
        size = value / self.unit.to_internal
        return f"{float(f'{size:.2g}'):g} {self.unit.name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorGradient:
    """What a sensor does at an observed position of a component; all None without a `sensor`.

    Sensors it `stands_for` are indistinguishable from it; `value` per degC with its `u` and
    95 % `interval`, `by` the scatter of cycles or the model of errors; `share`
    the rms of its part of the modelled drift; `lag` in min (0: none); `vif` None: infinite.
    """

    drift: ComponentDrift
    position: float | None = None
    sensor: str | None = None
    stands_for: tuple[str, ...] | None = None
    value: float | None = None
    u: float | None = None
    interval: tuple[float, float] | None = None
    by: str | None = None
    separable: bool | None = None
    share: float | None = None
    lag: float | None = None
    vif: float | None = None
    temperatures: FloatArray | None = None


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


def component_warnings(
    series: Series, lib: Library, drift: ComponentDrift, method: str
) -> Iterator[Finding]:
    """Warnings of one component's model."""
    name = drift.name
    yield from _of_held_out(lib, drift)
    yield from _of_inseparable(drift)
    if drift.zeroed.offsets and drift.zeroed.by != "setting":
        yield finding("order-of-cycles", component=name, reason=_offsets(drift))
    if (reason := _without_lags(series, lib, drift, method)) is not None:
        yield finding(NOTHING, component=name, what="lags", reason=reason)
    if len(drift.positions) == 1 and (axis := drift.estimate.of) is not None:
        reason = f"it was read at {drift.positions[0]:g} mm only, and is taken as the same"
        what = f"the drift along {axis}"
        yield finding("not-tested", what=what, items=name, component=name, reason=reason)
    yield from _of_reference(drift)
    yield from _of_files(series, name)
    if not drift.estimate.sensors:
        reason = "none explains the drift"
        reason += " (the readings do not differ, so that r2 is undefined)" if series.still else ""
        yield finding(NOTHING, component=name, what="sensor", reason=reason)
    if drift.residuals.normality_p is None:
        number = drift.residuals.effective
        few = f"{number:.3g} of them count as independent"
        reason = few if number < FEWEST_FOR_NORMALITY else "they are 0"
        what = "the normality of the residuals"
        yield finding("not-tested", what=what, items=name, component=name, reason=reason)


def _offsets(drift: ComponentDrift) -> str:
    """Why every cycle has an offset."""
    judged = drift.zeroed
    why = "the first reading of each is 0" if judged.p is None else f"p = {judged.p:.1g}"
    return f"the probe was zeroed in every cycle ({why}): each has an offset of its own"


def _of_inseparable(drift: ComponentDrift) -> Iterator[Finding]:
    """Sensors whose gradients are reliable together only, of the position with the most."""
    groups = max((own.inseparable for own in drift.at_positions), key=len, default=())
    for group in groups:
        first, *others = group.sensors
        size = drift.unit.to_internal
        u = "?" if group.u is None else f"{group.u / size:.2g}"
        shown = f"{group.value / size:.3g} +- {u} {drift.unit.name} per degC"
        where = "" if group.position is None else f" at {group.position:g} mm"
        yield finding(
            "not-separable",
            component=drift.name,
            what=f"{drift.name}: {first}",
            others=others,
            consequence=f"reliable together only, {shown} of {first}{where}",
        )


def _of_files(series: Series, name: str) -> Iterator[Finding]:
    """Rows whose order or cycle is not what the files say at first sight."""
    if series.shuffled and not series.complete:
        reason = "readings of one cycle are not in the order of their times, and too many to be "
        reason += "sorted: their autocorrelation is that of the file"
        yield finding("order-of-cycles", component=name, reason=reason)
    several = {cycle: names for (_, cycle), names in series.files.items() if len(names) > 1}
    if several:
        cycle, names = next(iter(several.items()))
        of = f"cycle {cycle!r}" if cycle else "one cycle without a name"
        files = " and ".join(sorted(names))
        yield finding(
            "order-of-cycles",
            component=name,
            reason=f"{of} is in {files} and counts as one warm-up or cool-down",
            files=files,
            expected="another name for each warm-up in the column 'cycle'",
        )


def _without_lags(series: Series, lib: Library, drift: ComponentDrift, method: str) -> str | None:
    """Why a model has no lags where they were asked for."""
    if method in ("auto", "lagged") and len(lib.time_constants) < 2:
        if not series.complete:
            return "there are too many readings"
        if np.isnan(series.kept().time).any():
            return "no times are given"
        return "the times do not run on within the cycles"
    if method == "lagged" and len(lib.cycles) < 2:
        return "lags are chosen on held-out cycles, and there is one; the model is ridge"
    if drift.without_lag:
        return "no time constant lowers the held-out error enough; the model is ridge"
    return None


def _of_reference(drift: ComponentDrift) -> Iterator[Finding]:
    """Drift that was zeroed far from the reference: its zero is extrapolated."""
    span, reference = drift.estimate.temperature_range, drift.estimate.reference
    if span is None or not len(span):
        return
    beyond = (span[:, 0] > reference + FAR) | (span[:, 1] < reference - FAR)
    if beyond.mean() > 0.5:
        yield finding(
            "outside-measured-range",
            component=drift.name,
            what=f"the reference of {reference:g} degC",
            names=[f"the sensors of {drift.name}"],
            low=float(span[:, 0].min()),
            high=float(span[:, 1].max()),
            unit="degC",
        )


def _of_held_out(lib: Library, drift: ComponentDrift) -> Iterator[Finding]:
    """What the next warm-up may show that the cycles of the fit do not."""
    name, held = drift.name, drift.held_out
    if len(lib.cycles) < FEWEST_NESTED:
        count = "the readings have no cycles" if len(lib.cycles) < 2 else "there are two cycles"
        expected = "three cycles or more, column 'cycle'"
        yield finding("not-held-out", component=name, cycles=count, expected=expected)
    if held is None:
        return
    if drift.rms_after > 0 and held.after > OVER_FIT * drift.rms_after:
        fitted, held_out = drift.shown(drift.rms_after), drift.shown(held.after)
        yield finding("over-fit", component=name, fitted=fitted, held_out=held_out)
    if held.after > held.before:
        yield finding("no-better", component=name, effect="increase the rms")
        return
    small = held.after > (1 - LEAST_GAIN) * held.before
    if drift.estimate.sensors and small and not _consistent(held):
        percent = 100 * (1 - held.after / held.before)
        effect = f"reduce the rms by {percent:.2g} % only, within its scatter"
        yield finding("no-better", component=name, effect=effect)


def _consistent(held: HeldOut) -> bool:
    """Whether the cycles gain beyond their scatter: Student's t of ln(before/after), one-sided.

    Ratios, because a cycle of large drift would be all that differences of squares show.
    """
    from scipy.special import stdtrit

    before, after = np.array([own[1:] for own in held.cycles]).T
    if not (before > 0).all() or not (after > 0).all():
        return True
    gain = np.log(before / after)
    n, s = len(gain), float(np.std(gain, ddof=1))
    return float(gain.mean() * np.sqrt(n)) > float(stdtrit(n - 1, 1 - GAIN_P)) * s


def sensor_warnings(series: Series, sensors: tuple[str, ...]) -> Iterator[Finding]:
    """Sensors that do not move."""
    for name, (low, high) in zip(sensors, series.range().tolist(), strict=True):
        if low == high:
            where = f" at {low:g} degC"
            yield finding("sensor-still", sensor=name, where=where, consequence="left out")
