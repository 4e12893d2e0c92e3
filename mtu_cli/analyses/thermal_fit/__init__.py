"""`thermal-fit`: drift readings with temperatures to a thermal model per component."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from mtu_cli.analyses.thermal_fit.choice import FEWEST_NESTED, choose, held_out, position_test
from mtu_cli.analyses.thermal_fit.models import Fitted, Library, Spec, centred, fit, library
from mtu_cli.analyses.thermal_fit.result import (
    ComponentDrift,
    Curve,
    PositionTest,
    Residuals,
    ThermalFit,
)
from mtu_cli.analyses.thermal_fit.series import Series, about_means, read_series, sensors_of
from mtu_cli.analyses.thermal_fit.uncertainty import estimate, gradients, noise_share, sensor_noise
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding, InputError, counted, error, finding
from mtu_cli.stats.compressed import effective_number
from mtu_cli.stats.residuals import (
    FEWEST_FOR_NORMALITY,
    condition_number,
    normality_p,
    variance_inflation,
)
from mtu_cli.units import LENGTH, UNITS

METHODS = ("auto", "stepwise", "ridge", "lagged")
_ROUNDING_OF_COUNT = 1e-6
MOST_POINTS = 400
"""Points of one curve of a picture."""


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

    Raises InputError without sensors, where a temperature is not given, or where the readings
    of a component are not more than what is fitted to them.
    """
    sensors = sensors_of(readings)
    share, warnings = 1.0, list[Finding]()
    result: dict[str, ComponentDrift] = {}
    for series in read_series(readings, sensors):
        of, unit = None, "um" if series.dimension == LENGTH else "arcsec"
        if components is not None:
            of, unit = components[series.name]
        lagged = method in ("auto", "lagged")
        lib = library(series, sensors, reference, lagged=lagged, zeroed=zeroed)
        fitted, test = _chosen(lib, method)
        drift = _component(fitted, test, method, of, unit)
        result[series.name] = drift
        share = min(share, noise_share(fitted, sensor_noise(series)))
        warnings += _warnings(lib, drift, method)
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


def _chosen(lib: Library, method: str) -> tuple[Fitted, PositionTest | None]:
    """The model that all cycles choose; with one cycle, the test decides on its powers.

    Raises InputError for fewer readings than any model needs, or where it goes through all of them.
    """
    series, rows = lib.series, lib.all_rows
    if rows.n < rows.levels + 2:
        where = "position and cycle" if lib.zeroed.offsets else "position"
        levels = rows.levels
        what = "a level" if levels == 1 else f"a level at each {where} ({levels})"
        raise _too_few(series, f"{what} and the gradient of one sensor", f"at least {levels + 2}")
    spec = choose(lib, lib.blocks, method)
    test = position_test(lib, spec)
    if len(series.cycles) < 2 and test is not None and test.p < 0.05:
        spec = Spec(kind=spec.kind, degree=lib.most_degree, lags=spec.lags)
    result = fit(lib, rows, spec)
    if rows.n - result.parameters < 1 - _ROUNDING_OF_COUNT:
        count = result.coefficients.size
        # Sensors that depend on each other need fewer.
        enough = f"{len(series.positions) + count + 1} (these are always enough)"
        enough += "" if spec.kind == "stepwise" else ", or --model stepwise"
        raise _too_few(series, f"the {spec.kind} model of {count} gradients", enough)
    return result, test


def _too_few(series: Series, what: str, enough: str) -> InputError:
    return error(
        "too-little-data",
        what=f"{counted(len(series.y), 'reading')} of {series.name} for {what}",
        file=series.files[0] if len(series.files) == 1 else None,
        expected=f"{enough}: one more than is fitted gives the uncertainty",
    )


def _component(
    found: Fitted, test: PositionTest | None, method: str, of: str | None, unit: str
) -> ComponentDrift:
    lib, spec, series, rows = found.lib, found.spec, found.lib.series, found.lib.all_rows
    G = np.array([found.gradient(p) for p in range(len(series.positions))])
    modelled = np.sum(lib.Z[:, found.columns[1:-1]] * G[series.place], axis=1)
    starts = series.piece_starts if lib.zeroed.offsets else series.place_starts
    residual, _ = about_means(series.y - modelled, starts)
    drift, _ = about_means(series.y, starts)
    before, after = float(np.mean(drift**2)), float(np.mean(residual**2))
    lag1 = found.autocorrelation(rows)
    number = effective_number(rows.n, lag1)
    condition, vif = _collinearity(found)
    squares = found.group_shares(rows)
    sensor_u, curves = sensor_noise(series), []
    for (p, c), run in series.runs.items():
        shown = slice(run.start, run.stop, max(1, -(-(run.stop - run.start) // MOST_POINTS)))
        time = series.time[shown]
        time = np.arange(len(time), dtype=float) if np.isnan(time).any() else time
        y, left = series.y[shown], residual[shown]
        curves.append(Curve(series.positions[p], series.cycles[c], time, y, y - left))
    return ComponentDrift(
        name=series.name,
        unit=UNITS[unit],
        model="lagged" if any(spec.lags) else spec.kind,
        estimate=estimate(found, residual, of, UNITS[unit], sensor_u),
        positions=tuple(p for p in series.positions if p is not None),
        n=rows.n,
        cycles=series.cycles,
        groups=tuple(group for group in lib.groups if len(group) > 1),
        r2_fit=float("nan") if series.still else 1 - after / before,
        rms_before=float(np.sqrt(before)),
        rms_after=float(np.sqrt(after)),
        held_out=held_out(lib, method),
        position_test=test,
        condition=condition,
        vif=vif,
        residuals=Residuals(normality_p(residual, number), lag1, number),
        shares={
            lib.groups[j][0]: float(np.sqrt(squares[j]))
            for j in np.argsort(-squares, kind="stable")
            if squares[j] > 0
        },
        at_positions=gradients(found, sensor_u),
        zeroed=lib.zeroed,
        curves=tuple(curves),
    )


def _collinearity(found: Fitted) -> tuple[float, dict[str, float | None]]:
    """Condition number and VIF of the groups in the model, about the means of the positions."""
    columns = np.asarray(found.columns[1:-1], int)[found.used]
    if not len(columns):
        return 1.0, {}
    rows = found.lib.all_rows.by_position.values()
    stacked = np.vstack([centred(item, columns) for item in rows])
    factors = variance_inflation(stacked).tolist()
    return condition_number(stacked), {
        sensor: factor if np.isfinite(factor) else None
        for factor, j in zip(factors, found.used, strict=True)
        for sensor in found.lib.groups[j]
    }


def _warnings(lib: Library, drift: ComponentDrift, method: str) -> Iterator[Finding]:
    """Of one component's model: held-out evidence, sensors, cycles, lags, readings."""
    name, series, held = drift.name, lib.series, drift.held_out
    if (count := len(drift.cycles)) < FEWEST_NESTED:
        cycles = "the readings have no cycles" if count < 2 else "there are two cycles"
        expected = "three cycles or more, column 'cycle'"
        yield finding("not-held-out", component=name, cycles=cycles, expected=expected)
    if held is not None and held.after > held.before:
        yield finding("no-better", component=name, effect="increase the rms")
    # Sensors whose gradients are reliable together only, of the position with the most.
    for group in max((at.inseparable for at in drift.at_positions), key=len, default=()):
        first, *others = group.sensors
        value, u = (each / drift.unit.to_internal for each in (group.value, group.u or 0.0))
        shown = f"{value:.4g} ± {u:.2g}" if u > 0 else f"{value:.4g}"
        where = "" if group.position is None else f" at {group.position:g} mm"
        text = f"reliable together only, {shown} {drift.unit.name} per degC of {first}{where}"
        facts = {"what": f"{name}: {first}", "others": others, "consequence": text}
        yield finding("not-separable", component=name, **facts)
    if lib.zeroed.offsets and lib.zeroed.by != "setting":
        p = lib.zeroed.p
        why = "the first reading of each is 0" if p is None else f"p = {p:.1g}"
        reason = f"the probe was zeroed in every cycle ({why}): each has an offset of its own"
        yield finding("order-of-cycles", component=name, reason=reason)
    timed = len(lib.time_constants) > 1
    if (method == "auto" and not timed) or (method == "lagged" and drift.model != "lagged"):
        reason = "no time constant lowers the error of held-out cycles enough"
        reason = reason if timed else "no times are given that run on within the cycles"
        yield finding("no-effect-of-temperature", component=name, what="lags", reason=reason)
    if not drift.estimate.sensors:
        reason = "none explains the drift"
        reason += " (the readings do not differ, so that r2 is undefined)" if series.still else ""
        yield finding("no-effect-of-temperature", component=name, what="sensor", reason=reason)
    if drift.residuals.normality_p is None:
        number = drift.residuals.effective
        few = f"{number:.3g} of them count as independent"
        reason = few if number < FEWEST_FOR_NORMALITY else "they are 0"
        what = "the normality of the residuals"
        yield finding("not-tested", what=what, items=name, component=name, reason=reason)
    if series.every > 1:
        reason = f"of {series.total} readings every {series.every}th of a cycle is fitted"
        yield finding("not-used", what="readings", names=[name], reason=reason)
    for sensor, (low, high) in zip(lib.sensors, series.range.tolist(), strict=True):
        if low == high:
            where = f" at {low:g} degC"
            yield finding("sensor-still", sensor=sensor, where=where, consequence="left out")
