"""`thermal-fit`: drift readings with temperatures to a thermal model per component."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.thermal_fit.choice import choose, group_shares, lags_sought
from mtu_cli.analyses.thermal_fit.columns import Library, Rows, library
from mtu_cli.analyses.thermal_fit.enough import check_fitted, check_least
from mtu_cli.analyses.thermal_fit.evidence import (
    autocorrelation,
    constant,
    held_out,
    position_test,
)
from mtu_cli.analyses.thermal_fit.models import Fitted, Spec, fit, sum_of_squares
from mtu_cli.analyses.thermal_fit.reading import columns_beside, read_series
from mtu_cli.analyses.thermal_fit.result import (
    ComponentDrift,
    Curve,
    Gradients,
    Intercept,
    PositionTest,
    Residuals,
    ThermalFit,
)
from mtu_cli.analyses.thermal_fit.series import Series
from mtu_cli.analyses.thermal_fit.uncertainty import (
    Conventions,
    Rest,
    estimate,
    residuals,
    sensor_noise_share,
)
from mtu_cli.analyses.thermal_fit.warnings import (
    component_warnings,
    sensor_warnings,
)
from mtu_cli.findings import Finding
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.stats.autocorrelation import effective_number
from mtu_cli.stats.residuals import condition_number, normality_p, variance_inflation
from mtu_cli.units import LENGTH, UNITS

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings

METHODS = ("auto", "stepwise", "ridge", "lagged")
ROUNDING = 1e-9
MOST_POINTS = 400
"""Points of one curve of a picture."""


def thermal_fit(
    blocks: Iterable[Readings],
    components: Mapping[str, tuple[str | None, str]] | None,
    *,
    reference: float,
    method: str = "auto",
) -> ThermalFit:
    """Thermal models of all components that drift readings were given for.

    `components` are (axis, unit) of the machine's, None without a machine: then positions are
    taken as they stand, and readings of lengths are told in um, of angles in arcsec. `reference`
    in degC; `method` one of METHODS. Valdes et al., eqs. (4)-(8), (13), and beyond: whole cycles
    are held out.

    Raises InputError without sensors, where a temperature is not given, or where the readings
    of a component are not of one kind or not more than what is fitted to them.
    """
    shares, warnings = [1.0], list[Finding]()
    others, every = columns_beside(blocks)
    series, sensors = read_series(every, reference)
    found: dict[str, ComponentDrift] = {}
    for name, own in series.items():
        told = "um" if own.dimension == LENGTH else "arcsec"
        of, unit = (None, told) if components is None else components[name]
        lib = library(own, sensors, reference, lagged=method in ("auto", "lagged"))
        conventions = Conventions(of=of, unit=UNITS[unit], sensors=sensors, reference=reference)
        drift, rest = _component(own, lib, conventions, method)
        found[name] = drift
        shares.append(sensor_noise_share(lib, rest, drift.estimate))
        warnings += component_warnings(own, lib, drift, method)
        warnings += sensor_warnings(own, sensors, rest, drift)
    return ThermalFit(
        components={name: _with_noise(item, min(shares)) for name, item in found.items()},
        sensors=sensors,
        not_used=others,
        reference=reference,
        method=method,
        warnings=tuple(dict.fromkeys(warnings)),
    )


def _with_noise(drift: ComponentDrift, share: float) -> ComponentDrift:
    """Sensors are the same for all components: the one that shows least noise bounds it."""
    estimate = replace(drift.estimate, sensor_u=drift.estimate.sensor_u * share)
    return replace(drift, estimate=estimate)


def _component(
    series: Series, lib: Library, conventions: Conventions, method: str
) -> tuple[ComponentDrift, Rest]:
    check_least(series)
    rows = lib.rows(range(len(lib.cycles)))
    spec, test = _spec(lib, rows, method)
    found = fit(lib, rows, spec)
    check_fitted(series, spec, found)
    rest = residuals(series, lib, spec, found, conventions.reference)
    model = estimate(series, lib, spec, found, rows, rest, conventions)
    evidence, candidates = held_out(lib, method)
    r2, rms_before, rms_after = _explained(series, lib, rows, spec, found)
    condition, vif = _collinearity(lib, rows, spec, found)
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
        residuals=_normality(series, rest, autocorrelation(lib, rows, spec, found)),
        shares=_shares(lib, rows, spec, found),
        at_positions=_gradients(lib, model),
        intercepts=tuple(Intercept(lib.positions[p], a) for p, a in found.intercepts.items()),
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


def _explained(
    series: Series, lib: Library, rows: Rows, spec: Spec, found: Fitted
) -> tuple[float, float, float]:
    """r^2 of the fit, and the readings' rms about their means without and with the model."""
    before = sum_of_squares(lib, rows, spec, constant(lib, rows, spec))
    after = sum_of_squares(lib, rows, spec, found)
    n = series.n
    r2 = 1 - after / before if not series.still else float("nan")
    return r2, float(np.sqrt(before / n)), float(np.sqrt(after / n))


def _normality(series: Series, rest: Rest, lag1: float) -> Residuals:
    number = effective_number(series.n, lag1)
    return Residuals(normality_p=normality_p(rest.residual, number), lag1=lag1, effective=number)


def _collinearity(
    lib: Library, rows: Rows, spec: Spec, found: Fitted
) -> tuple[float, dict[str, float | None]]:
    """Condition number and VIF of the groups in the model, about the means of the positions."""
    used = np.flatnonzero((found.coefficients != 0).any(axis=0))
    own = np.asarray(lib.columns(spec.lags)[1:-1], int)[used]
    if not len(own):
        return 1.0, {}
    centred = []
    for item in rows.values():
        one = item.factor[:, :1]
        columns = item.factor[:, own]
        centred.append(columns - one @ (one.T @ columns) / float(one[:, 0] @ one[:, 0]))
    stacked = np.vstack(centred)
    factors = variance_inflation(stacked)
    return condition_number(stacked), {
        sensor: float(factors[i]) if np.isfinite(factors[i]) else None
        for i, j in enumerate(used)
        for sensor in lib.groups[j]
    }


def _shares(lib: Library, rows: Rows, spec: Spec, found: Fitted) -> dict[str, float]:
    """Root mean square of each group's part of the drift, under its first sensor's name."""
    squares = group_shares(lib, rows, spec, found)
    order = np.argsort(-squares, kind="stable")
    return {lib.groups[j][0]: float(np.sqrt(squares[j])) for j in order if squares[j] > 0}


def _gradients(lib: Library, model: ThermalEstimate) -> tuple[Gradients, ...]:
    places = lib.places
    values = np.polynomial.polynomial.polyval(places, model.coefficients).reshape(
        len(model.sensors), len(places)
    )
    # A sensor that is not used at a position comes out as a residue of rounding.
    values[np.abs(values) < ROUNDING * np.abs(values).max(initial=0.0)] = 0.0
    return tuple(
        Gradients(position, dict(zip(model.sensors, values[:, i].tolist(), strict=True)))
        for i, position in enumerate(lib.positions)
    )


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
