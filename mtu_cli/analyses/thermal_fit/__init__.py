"""`thermal-fit`: drift readings with temperatures to a thermal model per component."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.thermal_fit.design import Design, about_means, sensors_of
from mtu_cli.analyses.thermal_fit.models import choose
from mtu_cli.analyses.thermal_fit.uncertainty import (
    Gradient,
    estimate,
    gradients,
    noise_share,
    sensor_noise,
)
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding, counted, error, finding
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray, effective_number
from mtu_cli.stats.selection import FEWEST_NESTED, Fitted, HeldOut, held_out
from mtu_cli.stats.serial import collinearity, normality_p
from mtu_cli.units import SMALL, UNITS, Unit

METHODS = ("auto", "stepwise", "ridge", "lagged")
_ROUNDING_OF_COUNT = 1e-6
MOST_POINTS = 400
"""Points of one curve of a picture."""


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
class ComponentDrift:
    """The thermal model of one component and the evidence for it.

    `groups` are sensors that move alike (|r| >= 0.999), the first of each standing for all;
    `gradients` of every sensor of the model at every position, `inseparable` ones of several;
    `condition` and `vif` (by sensor, None: infinite) of the standardised sensors of the model;
    `shares` (by sensor) the root mean square of its part of the modelled drift. Cycles have
    `offsets` of their own where the probe was zeroed in each (`by`: setting, first readings or
    test). `normality_p` (D'Agostino & Pearson's K^2 of as many as are independent) and
    `lag1` autocorrelation are of the residuals.
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
    def rms_unit(self) -> Unit:
        """Of reported root mean squares: um of a length, arcsec of an angle."""
        return SMALL[self.unit.dimension]


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalFit:
    """All components whose drift was read; `reference` in degC."""

    components: dict[str, ComponentDrift]
    sensors: tuple[str, ...]
    reference: float
    method: str
    warnings: tuple[Finding, ...]


def thermal_fit(
    readings: Readings,
    components: Mapping[str, tuple[str | None, str]] | None,
    *,
    reference: float,
    method: str = "auto",
    zeroed: str = "auto",
) -> ThermalFit:
    """Thermal models of all components that drift readings were given for.

    `components` are (axis, unit) of the machine's, None without a machine: then positions are
    taken as they stand, and lengths are reported in um, angles in arcsec. `reference` in degC;
    `method` one of METHODS; `zeroed` auto (the first readings or a test decide), cycle or never.
    Valdes et al., eqs. (4)-(8), (13), and beyond: whole cycles are held out.

    Raises InputError without sensors, or where the readings of a component are not more than what
    is fitted to them.
    """
    import pandas as pd

    sensors = sensors_of(readings)
    share, warnings = 1.0, list[Finding]()
    result: dict[str, ComponentDrift] = {}
    lagged = method in ("auto", "lagged")
    for code in pd.unique(readings.code):
        rows = np.flatnonzero(readings.code == code)
        design = Design(readings, rows, sensors, reference, lagged=lagged, zeroed=zeroed)
        of, unit = None, SMALL[design.dimension].name
        if components is not None:
            of, unit = components[design.name]
        panel = design.panel
        fitted = Fitted(panel, panel.cycles, choose(design, panel.blocks, method))
        if len(design.y) - fitted.parameters < 1 - _ROUNDING_OF_COUNT:
            levels = sum(x.levels for x in panel.rows(panel.cycles).values())
            what = f"{counted(len(design.y), 'reading')} of {design.name}"
            expected = f"{levels + fitted.coefficients.size + 1} for the {fitted.spec.kind} model"
            raise error("too-little-data", what=what, file=design.file, expected=expected)
        drift, bound = _component(design, fitted, method, of, unit)
        result[design.name], share = drift, min(share, bound)
        warnings += _warnings(design, drift)
    numbers = [name for name, values in readings.covariates.items() if values.dtype != object]
    if odd := [name for name in numbers if not is_temperature(name)]:
        reason = "a sensor is T_<sensor>_degC, of letters a to z, digits and _"
        warnings.append(finding("not-used", what="columns", names=odd, reason=reason))
    # Sensors are the same for all components: the one that shows least noise bounds it.
    for name, drift in result.items():
        bounded = replace(drift.estimate, sensor_u=drift.estimate.sensor_u * share)
        result[name] = replace(drift, estimate=bounded)
    return ThermalFit(
        components=result,
        sensors=sensors,
        reference=reference,
        method=method,
        warnings=tuple(dict.fromkeys(warnings)),
    )


def _component(
    design: Design, fit: Fitted, method: str, of: str | None, unit: str
) -> tuple[ComponentDrift, float]:
    """The model with its evidence, and the share of the sensors' noise that residuals allow for."""
    panel, spec, y = design.panel, fit.spec, design.y
    modelled = np.empty_like(y)
    for (p, _), rows in design.runs.items():
        modelled[rows] = design.Z[rows][:, fit.columns[1:-1]] @ fit.slopes[p]
    places = [*design.runs.values()] if design.offsets else design.places
    residual, drift = about_means(y - modelled, places), about_means(y, places)
    before, after = float(np.mean(drift**2)), float(np.mean(residual**2))
    square, lag = fit.mean_products(panel.cycles)
    lag1 = lag / square if square > 0 else 0.0
    sensor_u, curves = sensor_noise(design), []
    share = noise_share(design, fit, sensor_u)
    for (p, c), run in design.runs.items():
        sample = slice(run.start, run.stop, max(1, -(-(run.stop - run.start) // MOST_POINTS)))
        time, measured = design.time[sample], y[sample]
        time = np.arange(len(time), dtype=float) if np.isnan(time).any() else time
        predicted = measured - residual[sample]
        curves.append(Curve(design.positions[p], design.cycles[c], time, measured, predicted))
    columns = [fit.columns[1 + j] for j in fit.used.tolist()]
    items = panel.rows(panel.cycles).values()
    inner = np.vstack([item.inner(columns) for item in items])
    condition, factors = collinearity(inner)
    squares = fit.shares(panel.cycles)
    single, several = gradients(design, fit, sensor_u * share)
    result = ComponentDrift(
        name=design.name,
        unit=UNITS[unit],
        model=spec.kind if spec.kind != "lagged" or any(spec.variants) else "ridge",
        estimate=estimate(design, fit, residual, of, UNITS[unit], sensor_u),
        positions=tuple(p for p in design.positions if p is not None),
        n=len(y),
        cycles=design.cycles,
        groups=tuple(group for group in design.groups if len(group) > 1),
        r2_fit=1 - after / before if before > 0 and not design.still else float("nan"),
        rms_before=float(np.sqrt(before)),
        rms_after=float(np.sqrt(after)),
        held_out=held_out(panel, lambda blocks: choose(design, blocks, method)),
        condition=condition,
        vif={
            sensor: factor if np.isfinite(factor) else None
            for factor, j in zip(factors.tolist(), fit.used, strict=True)
            for sensor in design.groups[j]
        },
        normality_p=normality_p(residual, effective_number(len(y), lag1)),
        lag1=lag1,
        shares={
            design.groups[j][0]: float(np.sqrt(squares[j]))
            for j in np.argsort(-squares, kind="stable")
            if squares[j] > 0
        },
        gradients=tuple(single),
        inseparable=tuple(several),
        curves=tuple(curves),
        offsets=design.offsets,
        by=design.by,
    )
    return result, share


def _warnings(design: Design, drift: ComponentDrift) -> Iterator[Finding]:
    """Of one component's model: held-out evidence, sensors, cycles, readings."""
    name, rms = drift.name, drift.held_out
    if (count := len(drift.cycles)) < FEWEST_NESTED:
        cycles = "the readings have no cycles" if count < 2 else "there are two cycles"
        expected = "three cycles or more, column 'cycle'"
        yield finding("not-held-out", component=name, cycles=cycles, expected=expected)
    if rms is not None and rms.after > rms.before:
        yield finding("no-better", component=name, effect="increase the rms")
    # Sensors whose gradients are reliable together only, of the position with the most.
    by_place = [[x for x in drift.inseparable if x.position == p] for p in design.positions]
    for group in max(by_place, key=len):
        first, *rest = group.sensors
        value, u = (each / drift.unit.to_internal for each in (group.value, group.u or 0.0))
        figure = f"{value:.4g} ± {u:.2g}" if u > 0 else f"{value:.4g}"
        where = "" if group.position is None else f" at {group.position:g} mm"
        text = f"reliable together only, {figure} {drift.unit.name} per degC of {first}{where}"
        facts = {"what": f"{name}: {first}", "others": rest, "consequence": text}
        yield finding("not-separable", component=name, **facts)
    if drift.offsets and drift.by != "setting":
        why = "offsets explain most of what is left without them"
        why = "the first reading of each is 0" if drift.by == "first readings" else why
        reason = f"the probe was zeroed in every cycle ({why}): each has an offset of its own"
        yield finding("order-of-cycles", component=name, reason=reason)
    if not drift.estimate.sensors:
        reason = "none explains the drift"
        reason += " (the readings do not differ, so that r2 is undefined)" if design.still else ""
        yield finding("no-effect-of-temperature", component=name, reason=reason)
    if drift.normality_p is None:
        reason = "they are 0, or too few of them count as independent"
        what = "the normality of the residuals"
        yield finding("not-tested", what=what, items=name, component=name, reason=reason)
    if design.every > 1:
        reason = f"of {design.readings} readings every {design.every}th of a cycle is fitted"
        yield finding("not-used", what="readings", names=[name], reason=reason)
    for sensor, (low, high) in zip(design.sensors, design.span.tolist(), strict=True):
        if low == high:
            where = f" at {low:g} degC"
            yield finding("sensor-still", sensor=sensor, where=where, consequence="left out")
