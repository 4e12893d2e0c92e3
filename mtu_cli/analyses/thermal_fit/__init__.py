"""`thermal-fit`: drift readings with temperatures to a thermal model per component."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mtu_cli.analyses.thermal_fit.choice import choose, held_out, position_test
from mtu_cli.analyses.thermal_fit.gradients import gradients
from mtu_cli.analyses.thermal_fit.models import Fitted, Library, Spec, centred, fit, library
from mtu_cli.analyses.thermal_fit.result import (
    ComponentDrift,
    Curve,
    PositionTest,
    Residuals,
    ThermalFit,
)
from mtu_cli.analyses.thermal_fit.series import Series, about_means, read_series, sensors_of
from mtu_cli.analyses.thermal_fit.uncertainty import estimate, noise_share, sensor_noise
from mtu_cli.analyses.thermal_fit.warnings import thermal_warnings
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding, InputError, counted, error
from mtu_cli.stats.compressed import effective_number
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.residuals import condition_number, normality_p, variance_inflation
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
    found: dict[str, ComponentDrift] = {}
    for series in read_series(readings, sensors):
        of, unit = None, "um" if series.dimension == LENGTH else "arcsec"
        if components is not None:
            of, unit = components[series.name]
        lagged = method in ("auto", "lagged")
        lib = library(series, sensors, reference, lagged=lagged, zeroed=zeroed)
        fitted, test = _chosen(lib, method)
        drift = _component(fitted, test, method, of, unit)
        found[series.name] = drift
        share = min(share, noise_share(fitted, sensor_noise(series)))
        warnings += thermal_warnings(lib, drift, method)
    # Sensors are the same for all components: the one that shows least noise bounds it.
    for name, drift in found.items():
        bounded = replace(drift.estimate, sensor_u=drift.estimate.sensor_u * share)
        found[name] = replace(drift, estimate=bounded)
    return ThermalFit(
        components=found,
        sensors=sensors,
        not_used=tuple(name for name in readings.covariates if not is_temperature(name)),
        reference=reference,
        method=method,
        warnings=tuple(dict.fromkeys(warnings)),
    )


def _chosen(lib: Library, method: str) -> tuple[Fitted, PositionTest | None]:
    """The model that all cycles choose; with one cycle, the test decides on its powers.

    Raises InputError for fewer readings than any thermal model needs: its levels, which are no
    drift, the gradient of one sensor, and one reading more; or where the model goes through all
    readings, so that its uncertainty would come out as none.
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
    found = fit(lib, rows, spec)
    if rows.n - found.parameters < 1 - _ROUNDING_OF_COUNT:
        count = found.coefficients.size
        # Sensors that depend on each other need fewer.
        enough = f"{len(series.positions) + count + 1} (these are always enough)"
        enough += "" if spec.kind == "stepwise" else ", or --model stepwise"
        raise _too_few(series, f"the {spec.kind} model of {count} gradients", enough)
    return found, test


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
    sensor_u = sensor_noise(series)
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
        curves=_curves(series, series.y - residual),
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


def _curves(series: Series, modelled: FloatArray) -> tuple[Curve, ...]:
    found = []
    for (p, c), rows in series.runs.items():
        n = rows.stop - rows.start
        shown = slice(rows.start, rows.stop, max(1, -(-n // MOST_POINTS)))
        time = series.time[shown]
        time = np.arange(len(time), dtype=float) if np.isnan(time).any() else time
        of = series.positions[p], series.cycles[c]
        found.append(Curve(*of, time, series.y[shown], modelled[shown]))
    return tuple(found)
