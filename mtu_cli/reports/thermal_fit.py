"""The report of thermal-fit: a thermal model a component, and the evidence for it.

`coefficients` and what belongs to them are in the component's own `unit`, mm and degC; all
other figures are in um for lengths and arcsec for angles, as their names say. `positions_mm`
is empty and `position_mm` null where the drift does not depend on position. Null degrees of
freedom are infinite, a null variance inflation factor too. `shares` are root mean squares of
the sensors' parts of the modelled drift; parts of sensors that move alike may cancel, so they
need not add up to the drift.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from mtu_cli.analyses.thermal_fit.result import ComponentDrift, HeldOut, ThermalFit
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.reports.document import finite, matrix
from mtu_cli.reports.thermal_figure import figure
from mtu_cli.reports.thermal_shown import by_share, shown_in, twins
from mtu_cli.reports.thermal_table import tables

__all__ = ["document", "figure", "rows", "tables"]


def document(fit: ThermalFit) -> dict[str, Any]:
    """`results` of the report, from which predictions take the thermal models."""
    return {
        "method": fit.method,
        "sensors": list(fit.sensors),
        "columns_not_used": list(fit.not_used),
        "reference_temperature_degC": finite(fit.reference),
        "components": {name: _component(item) for name, item in fit.components.items()},
    }


def _component(item: ComponentDrift) -> dict[str, Any]:
    return {
        "of": item.estimate.of,
        "unit": item.unit.name,
        "model": item.model,
        "degree": item.estimate.degree,
        "positions_mm": [finite(position) for position in item.positions],
        "sensors": list(item.estimate.sensors),
        "groups": [list(group) for group in item.groups],
        **_estimate(item.estimate),
        **_evidence(item),
    }


def _estimate(estimate: ThermalEstimate) -> dict[str, Any]:
    """What a prediction needs, in the component's own unit."""
    f = estimate.unit.to_internal
    temperatures, positions = estimate.temperature_range, estimate.position_range
    return {
        "reference_temperature_degC": finite(estimate.reference),
        "time_constants_min": matrix(estimate.time_constants),
        "coefficients": matrix(estimate.coefficients / f),
        "covariance": matrix(estimate.covariance / f**2),
        "coefficient_dof": finite(estimate.coefficient_dof),
        "leftover_covariance": matrix(estimate.leftover / f**2),
        "leftover_dof": finite(estimate.leftover_dof),
        "sensor_u_degC": matrix(estimate.sensor_u),
        "temperature_range_degC": None if temperatures is None else matrix(temperatures),
        "position_range_mm": None if positions is None else [finite(end) for end in positions],
    }


def _evidence(item: ComponentDrift) -> dict[str, Any]:
    unit, size = shown_in(item.unit)
    test, residuals = item.position_test, item.residuals
    return {
        "n": item.n,
        "cycles": list(item.cycles),
        "r2_fit": finite(item.r2_fit),
        f"rms_before_{unit}": finite(item.rms_before / size),
        f"rms_after_{unit}": finite(item.rms_after / size),
        "held_out": None if item.held_out is None else _held_out(item.held_out, unit, size),
        "candidates": [
            {
                "model": candidate.model,
                "degree": candidate.degree,
                f"rms_held_out_{unit}": _in(candidate.held_out, size),
            }
            for candidate in item.candidates
        ],
        "position_test": None if test is None else {"F": finite(test.F), "p": finite(test.p)},
        "collinearity": {
            "condition_number": finite(item.condition),
            "vif": {name: finite(value) for name, value in item.vif.items()},
        },
        "residuals": {
            "normality_p": finite(residuals.normality_p),
            "lag1_autocorrelation": finite(residuals.lag1),
            "n_effective": finite(residuals.effective),
        },
        **_parts(item, unit, size),
    }


def _parts(item: ComponentDrift, unit: str, size: float) -> dict[str, Any]:
    """What each sensor does, and what the readings show at the reference temperature."""
    return {
        "shares": [
            {"sensor": name, f"rms_{unit}": _in(item.shares.get(name), size)}
            for name in by_share(item)
        ],
        "at_positions": [
            {
                "position_mm": finite(position),
                f"gradients_{unit}_per_degC": {
                    name: finite(value / size) for name, value in gradients.items()
                },
            }
            for position, gradients in item.at_positions
        ],
        "intercepts": [
            {"position_mm": finite(position), f"intercept_{unit}": finite(value / size)}
            for position, value in item.intercepts
        ],
    }


def _held_out(found: HeldOut, unit: str, size: float) -> dict[str, Any]:
    return {
        "by": "cycle",
        "blocks": found.blocks,
        f"rms_before_{unit}": finite(found.before / size),
        f"rms_after_{unit}": finite(found.after / size),
        f"ordinary_{unit}": finite(found.ordinary / size),
        "r2": finite(found.r2),
        "cycles": [
            {
                "cycle": cycle,
                f"rms_before_{unit}": finite(before / size),
                f"rms_after_{unit}": finite(after / size),
            }
            for cycle, before, after in found.cycles
        ],
    }


def _in(value: float | None, size: float) -> float | None:
    return None if value is None else finite(value / size)


CSV_COLUMNS = [
    "component", "of", "unit", "model", "degree", "position_mm", "sensor", "stands_for",
    "gradient_per_degC", "u_gradient_per_degC", "share_rms", "time_constant_min", "vif",
    "temperature_low_degC", "temperature_high_degC",
]  # fmt: skip


def rows(fit: ThermalFit) -> tuple[list[str], Iterable[list[object]]]:
    """One row a component, observed position and sensor, in the component's own unit.

    `stands_for` names the sensors that cannot be told apart from this one. A component whose
    model has no sensor has one row without a sensor.
    """
    return CSV_COLUMNS, (row for item in fit.components.values() for row in _rows(item))


def _rows(item: ComponentDrift) -> Iterator[list[object]]:
    estimate, f = item.estimate, item.unit.to_internal
    first: list[object] = [item.name, estimate.of, item.unit.name, item.model, estimate.degree]
    if not estimate.sensors:
        yield first + [None] * (len(CSV_COLUMNS) - len(first))
    for position, gradients in item.at_positions if estimate.sensors else ():
        for s, sensor in enumerate(estimate.sensors):
            low, high = (
                (None, None)
                if estimate.temperature_range is None
                else map(float, estimate.temperature_range[s])
            )
            yield [
                *first,
                finite(position),
                sensor,
                " ".join(twins(item, sensor)),
                _in(gradients.get(sensor), f),
                finite(estimate.gradient_u(s, position or 0.0) / f),
                _in(item.shares.get(sensor), f),
                float(estimate.time_constants[s]),
                finite(item.vif.get(sensor)),
                low,
                high,
            ]
