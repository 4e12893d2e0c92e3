"""`thermal-fit`: drift readings with temperatures to a thermal model per component."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.thermal_fit.choice import (
    PositionTest,
    choose,
    held_out,
    lags_sought,
    position_test,
)
from mtu_cli.analyses.thermal_fit.gradients import gradients
from mtu_cli.analyses.thermal_fit.models import (
    Fitted,
    Library,
    Rows,
    Spec,
    centred,
    constant,
    fit,
    library,
)
from mtu_cli.analyses.thermal_fit.result import (
    ComponentDrift,
    Curve,
    Intercept,
    Residuals,
    ThermalFit,
    component_warnings,
    sensor_warnings,
)
from mtu_cli.analyses.thermal_fit.series import Series, read_series
from mtu_cli.analyses.thermal_fit.uncertainty import (
    Conventions,
    Rest,
    estimate,
    group_noise,
    residuals,
    sensor_noise_share,
)
from mtu_cli.files.covariates import is_temperature
from mtu_cli.findings import Finding, InputError, counted, error
from mtu_cli.stats.compressed import effective_number
from mtu_cli.stats.residuals import condition_number, normality_p, variance_inflation
from mtu_cli.units import LENGTH, UNITS

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings

METHODS = ("auto", "stepwise", "ridge", "lagged")
ZEROED = ("auto", "cycle", "never")
_ROUNDING_OF_COUNT = 1e-6
MOST_POINTS = 400
"""Points of one curve of a picture."""


def thermal_fit(
    blocks: Iterable[Readings],
    components: Mapping[str, tuple[str | None, str]] | None,
    *,
    reference: float,
    method: str = "auto",
    zeroed: str = "auto",
) -> ThermalFit:
    """Thermal models of all components that drift readings were given for.

    `components` are (axis, unit) of the machine's, None without a machine: then positions are
    taken as they stand, and lengths are reported in um, angles in arcsec. `reference` in degC;
    `method` one of METHODS; `zeroed` one of ZEROED (auto: the first readings or a test decide).
    Valdes et al., eqs. (4)-(8), (13), and beyond: whole cycles are held out.

    Raises InputError without sensors, where a temperature is not given, or where the readings
    of a component are not of one kind or not more than what is fitted to them.
    """
    blocks = list(blocks)
    series, sensors = read_series(blocks, reference)
    shares, warnings = [1.0], list[Finding]()
    found: dict[str, ComponentDrift] = {}
    for name, own in series.items():
        told = "um" if own.dimension == LENGTH else "arcsec"
        of, unit = (None, told) if components is None else components[name]
        lib = library(own, sensors, reference, lagged=method in ("auto", "lagged"), zeroed=zeroed)
        conventions = Conventions(of=of, unit=UNITS[unit], sensors=sensors, reference=reference)
        drift, rest = _component(own, lib, conventions, method)
        found[name] = drift
        shares.append(sensor_noise_share(lib, rest, drift.estimate))
        warnings += component_warnings(own, lib, drift, method)
        warnings += sensor_warnings(own, sensors)
    return ThermalFit(
        components={name: _with_noise(item, min(shares)) for name, item in found.items()},
        sensors=sensors,
        not_used=tuple(name for name in blocks[0].covariates if not is_temperature(name)),
        reference=reference,
        method=method,
        warnings=tuple(dict.fromkeys(warnings)),
    )


def _check_least(series: Series, lib: Library) -> None:
    """Raises InputError for fewer readings than any thermal model needs.

    The smallest has its levels, which are no drift, and the gradient of one sensor, and one more
    reading is left to tell s^2.
    """
    levels = lib.levels(lib.rows(range(len(lib.cycles))))
    if series.n < levels + 2:
        where = "position and cycle" if lib.zeroed.offsets else "position"
        what = "a level" if levels == 1 else f"a level at each {where} ({levels})"
        what += " and the gradient of one sensor"
        raise _too_few(series, what, f"at least {levels + 2}")


def _check_fitted(series: Series, found: Fitted) -> None:
    """Raises InputError where the model has taken up all readings: it then goes through them, and
    its uncertainty would come out as none.
    """
    if series.n - found.parameters >= 1 - _ROUNDING_OF_COUNT:
        return
    spec, gradients = found.spec, found.coefficients.size
    what = f"the {spec.kind} model of {gradients} gradients"
    # Sensors that depend on each other need fewer.
    enough = f"{len(series.positions) + gradients + 1} (these are always enough)"
    raise _too_few(
        series, what, enough if spec.kind == "stepwise" else f"{enough}, or --model stepwise"
    )


def _too_few(series: Series, what: str, enough: str) -> InputError:
    files = sorted({name for names in series.files.values() for name in names})
    return error(
        "too-little-data",
        what=f"{counted(series.n, 'reading')} of {series.name} for {what}",
        file=files[0] if len(files) == 1 else None,
        expected=f"{enough}: one more than is fitted gives the uncertainty",
    )


def _with_noise(drift: ComponentDrift, share: float) -> ComponentDrift:
    """Sensors are the same for all components: the one that shows least noise bounds it."""
    estimate = replace(drift.estimate, sensor_u=drift.estimate.sensor_u * share)
    return replace(drift, estimate=estimate)


def _component(
    series: Series, lib: Library, conventions: Conventions, method: str
) -> tuple[ComponentDrift, Rest]:
    _check_least(series, lib)
    rows = lib.rows(range(len(lib.cycles)))
    spec, test = _spec(lib, rows, method)
    found = fit(lib, rows, spec)
    _check_fitted(series, found)
    rest = residuals(series, found, conventions.reference)
    model = estimate(series, found, rows, rest, conventions)
    evidence, candidates = held_out(lib, method)
    r2, rms_before, rms_after = _explained(series, rows, found)
    condition, vif = _collinearity(rows, found)
    drift = ComponentDrift(
        name=series.name,
        unit=conventions.unit,
        model="lagged" if any(spec.lags) else spec.kind,
        estimate=model,
        positions=tuple(float(p) for p in lib.positions if p is not None),
        n=series.n,
        cycles=lib.cycles,
        groups=tuple(group for group in lib.groups if len(group) > 1),
        r2_fit=r2,
        rms_before=rms_before,
        rms_after=rms_after,
        held_out=evidence,
        candidates=candidates,
        position_test=test,
        condition=condition,
        vif=vif,
        residuals=_normality(series, rest, found.autocorrelation(rows)),
        shares=_shares(rows, found),
        at_positions=gradients(found, rest, group_noise(lib, rest, model)),
        intercepts=_intercepts(found, rest),
        zeroed=lib.zeroed,
        curves=_curves(lib, rest),
        without_lag=method == "lagged" and lags_sought(lib) and not any(spec.lags),
    )
    return drift, rest


def _spec(lib: Library, rows: Rows, method: str) -> tuple[Spec, PositionTest | None]:
    """The model that all cycles choose; with one cycle, the test decides on its powers."""
    best, _ = choose(lib, lib.blocks, method)
    spec = best.spec
    test = position_test(lib, spec, rows)
    if len(lib.cycles) < 2 and test is not None and test.p < 0.05:
        spec = Spec(kind=spec.kind, degree=lib.most_degree, lags=spec.lags)
    return spec, test


def _explained(series: Series, rows: Rows, found: Fitted) -> tuple[float, float, float]:
    """r^2 of the fit, and the readings' rms about their means without and with the model."""
    before = constant(found.lib, rows, found.spec).sum_of_squares(rows)
    after = found.sum_of_squares(rows)
    n = series.n
    r2 = 1 - after / before if not series.still else float("nan")
    return r2, float(np.sqrt(before / n)), float(np.sqrt(after / n))


def _normality(series: Series, rest: Rest, lag1: float) -> Residuals:
    number = effective_number(series.n, lag1)
    return Residuals(normality_p=normality_p(rest.residual, number), lag1=lag1, effective=number)


def _collinearity(rows: Rows, found: Fitted) -> tuple[float, dict[str, float | None]]:
    """Condition number and VIF of the groups in the model, about the means of the positions."""
    columns = np.asarray(found.lib.columns(found.spec.lags)[1:-1], int)[found.used]
    if not len(columns):
        return 1.0, {}
    stacked = np.vstack([centred(item, columns) for item in rows.values()])
    factors = variance_inflation(stacked)
    return condition_number(stacked), {
        sensor: float(factors[i]) if np.isfinite(factors[i]) else None
        for i, j in enumerate(found.used)
        for sensor in found.lib.groups[j]
    }


def _shares(rows: Rows, found: Fitted) -> dict[str, float]:
    """Root mean square of each group's part of the drift, under its first sensor's name."""
    squares, groups = found.group_shares(rows), found.lib.groups
    order = np.argsort(-squares, kind="stable")
    return {groups[j][0]: float(np.sqrt(squares[j])) for j in order if squares[j] > 0}


def _intercepts(found: Fitted, rest: Rest) -> tuple[Intercept, ...]:
    """What the readings show at the reference temperature; of zeroed ones, in each cycle."""
    lib = found.lib
    if lib.zeroed.offsets:
        return tuple(
            Intercept(lib.positions[p], level, lib.cycles[c])
            for (p, c), level in rest.levels.items()
        )
    return tuple(Intercept(lib.positions[p], a) for p, a in found.intercepts.items())


def _curves(lib: Library, rest: Rest) -> tuple[Curve, ...]:
    found = []
    for position in lib.positions:
        for c, cycle in enumerate(lib.cycles):
            here = rest.kept.at(position, c)
            here = here[:: max(1, -(-len(here) // MOST_POINTS))]
            time = rest.kept.time[here]
            found.append(
                Curve(
                    position=position,
                    cycle=cycle,
                    time=np.arange(len(here), dtype=float) if np.isnan(time).any() else time,
                    measured=rest.kept.error[here],
                    modelled=rest.modelled[here],
                )
            )
    return tuple(found)
