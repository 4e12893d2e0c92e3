"""Thermal fits built by hand for the tests of their report, from made-up sensors."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from mtu_cli.analyses.thermal_fit.result import (
    ComponentDrift,
    Curve,
    Gradients,
    HeldOut,
    PositionTest,
    Residuals,
    ThermalFit,
)
from mtu_cli.findings import finding
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.model.fit import through_positions
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UNITS

REFERENCE = 20.0
POSITIONS = (0.0, 75.0, 200.0, 300.0)
SENSORS = ("T_01_degC", "T_02_degC", "T_spindle_degC", "T_05_degC", "T_room_degC")
GRADIENTS = np.array(
    [
        [-3.5, 0.4, 0.8, 4.02],
        [19.6, 11.7, 12.3, 5.03],
        [-14.0, -2.75, -3.8, 18.3],
        [-8.5, -1.7, -1.9, 1.3],
        [0.2, 0.1, -0.3, 0.25],
    ]
)
"""um per degC of each sensor at each position."""
LAGS = np.array([0.0, 12.0, 40.0, 0.0, 0.0])
CYCLES = ("Mon-up", "Mon-down", "Tue-up", "Tue-down")
READINGS = 60
MINUTES = 190.0


def temperatures(cycle: int) -> FloatArray:
    """(READINGS, 5) degC of a warm-up (even) or cool-down of six degrees."""
    t = np.linspace(0.0, MINUTES, READINGS)
    rise = np.column_stack(
        [6 * w * (1 - np.exp(-t / tau)) for w, tau in
         ((0.95, 35), (1.0, 60), (0.9, 90), (0.8, 140), (0.6, 20))]
    )  # fmt: skip
    return REFERENCE + (rise if cycle % 2 == 0 else rise[-1] - rise)


def curves(estimate: ThermalEstimate, positions: tuple[float | None, ...], noise: float
           ) -> tuple[Curve, ...]:  # fmt: skip
    """Drawn from the model with noise in mm or rad; each cycle starts a day after the last."""
    rng = np.random.default_rng(4)
    found = []
    for c, cycle in enumerate(CYCLES):
        table = temperatures(c)
        named = {name: table[:, s] for s, name in enumerate(estimate.sensors)}
        for position in positions:
            modelled = estimate.drift(np.full(READINGS, position or 0.0), named)
            found.append(
                Curve(
                    position=position,
                    cycle=cycle,
                    time=1440.0 * c + np.linspace(0.0, MINUTES, READINGS),
                    measured=modelled + rng.normal(0.0, noise, READINGS),
                    modelled=modelled,
                )
            )
    return tuple(found)


def ranges(count: int) -> FloatArray:
    """(count, 2) degC that the sensors read."""
    table = np.vstack([temperatures(c) for c in range(len(CYCLES))])[:, :count]
    return np.column_stack([table.min(axis=0), table.max(axis=0)])


def cubic() -> ComponentDrift:
    """A length along y: four positions, degree 3, five sensors, one of which has a twin."""
    unit = UNITS["um"]
    f = unit.to_internal
    coefficients = through_positions(np.array(POSITIONS), GRADIENTS.T * f, 3)
    count = coefficients.size
    scale = np.repeat(300.0 ** -np.arange(4.0), 5) * f
    estimate = ThermalEstimate(
        component="pos_y", of="y", unit=unit, sensors=SENSORS, reference=REFERENCE,
        coefficients=coefficients, covariance=np.diag((0.05 * scale) ** 2),
        coefficient_dof=float(960 - count), leftover=np.diag([(0.3 * f) ** 2, 0.0, 0.0, 0.0]),
        leftover_dof=3.0, time_constants=LAGS, sensor_u=np.full(5, 0.015),
        temperature_range=ranges(5), position_range=(0.0, 300.0),
    )  # fmt: skip
    gradients = tuple(
        Gradients(p, {name: float(GRADIENTS[s, i] * f) for s, name in enumerate(SENSORS)})
        for i, p in enumerate(POSITIONS)
    )
    return ComponentDrift(
        name="pos_y", unit=unit, model="lagged", estimate=estimate, positions=POSITIONS, n=960,
        cycles=CYCLES,
        groups=(("T_01_degC",), ("T_02_degC", "T_03_degC", "T_04_degC"), ("T_spindle_degC",)),
        r2_fit=0.9989, rms_before=31.2 * f, rms_after=0.251 * f,
        held_out=HeldOut(
            before=30.9 * f, after=0.31 * f, ordinary=0.54 * f, r2=1 - (0.31 / 30.9) ** 2,
            cycles=tuple(
                (c, (30.0 + i) * f, (0.3 + 0.01 * i) * f) for i, c in enumerate(CYCLES)
            ),
            blocks=len(CYCLES),
        ),
        position_test=PositionTest(F=812.4, p=1e-40), condition=184.2,
        vif={"T_01_degC": 41.0, "T_02_degC": 812.3, "T_spindle_degC": 77.5, "T_05_degC": 12.1,
             "T_room_degC": None},
        residuals=Residuals(normality_p=0.31, lag1=0.12, effective=754.0),
        shares={"T_01_degC": 9.1 * f, "T_02_degC": 44.0 * f, "T_spindle_degC": 38.2 * f,
                "T_05_degC": 13.0 * f, "T_room_degC": 0.81 * f},
        at_positions=gradients,
        curves=curves(estimate, POSITIONS, 0.25 * f),
    )  # fmt: skip


def constant(name: str = "yaw_y", *, held_out: bool = True) -> ComponentDrift:
    """An angle of two sensors, the same everywhere, in arcsec; the warm-ups alone if not held."""
    unit = UNITS["arcsec"]
    f = unit.to_internal
    estimate = ThermalEstimate(
        component=name, of=None, unit=unit, sensors=SENSORS[:2], reference=REFERENCE,
        coefficients=np.array([[2.81, -1.1]]) * f, covariance=np.diag([0.02, 0.03]) ** 2 * f**2,
        coefficient_dof=np.inf, leftover=np.array([[(0.2 * f) ** 2]]), leftover_dof=np.inf,
        time_constants=np.zeros(2), sensor_u=np.zeros(2),
        temperature_range=ranges(2) if held_out else None,
    )  # fmt: skip
    cycles = CYCLES if held_out else CYCLES[:1]
    return ComponentDrift(
        name=name, unit=unit, model="stepwise", estimate=estimate, positions=(), n=60 * len(cycles),
        cycles=cycles, groups=(), r2_fit=0.97, rms_before=8.1 * f, rms_after=0.22 * f,
        held_out=HeldOut(before=8.0 * f, after=0.24 * f, ordinary=0.23 * f, r2=0.9991, cycles=(),
            blocks=4)
        if held_out
        else None,
        position_test=None, condition=8.3, vif={"T_01_degC": 4.1, "T_02_degC": 4.1},
        residuals=Residuals(normality_p=None, lag1=0.61, effective=14.6),
        shares={"T_01_degC": 11.9 * f, "T_02_degC": 4.6 * f},
        at_positions=(Gradients(None, {"T_01_degC": 2.81 * f, "T_02_degC": -1.1 * f}),),
        curves=tuple(x for x in curves(estimate, (None,), 0.2 * f) if x.cycle in cycles),
    )  # fmt: skip


def without_sensors() -> ComponentDrift:
    """A component whose drift no sensor explains."""
    found = constant()
    estimate = replace(
        found.estimate, sensors=(), coefficients=np.zeros((1, 0)), covariance=np.zeros((0, 0)),
        time_constants=np.zeros(0), sensor_u=np.zeros(0), temperature_range=np.zeros((0, 2)),
    )  # fmt: skip
    return replace(
        found, name="still", estimate=estimate, shares={}, vif={}, curves=(), condition=np.nan,
        at_positions=(Gradients(None, {}),),
    )  # fmt: skip


def many_positions() -> ComponentDrift:
    """Nine positions, sensors with long names, more cycles than names fit."""
    found = cubic()
    long = {name: f"T_upper_left_column_behind_cover_{name}" for name in SENSORS}
    curves = [
        curve._replace(position=place, cycle=f"2024-03-{number:02d} warm-up")
        for curve, place, number in product(found.curves[:1], np.linspace(0, 300, 9), range(1, 25))
    ]
    first = found.at_positions[0].gradients
    gradients = {long[name]: value for name, value in first.items()}
    return replace(
        found, name="a_very_long_component_name", groups=(),
        estimate=replace(found.estimate, sensors=tuple(long.values())), curves=tuple(curves),
        shares={long[name]: value for name, value in found.shares.items()}, vif={},
        at_positions=tuple(Gradients(float(p), gradients) for p in np.linspace(0, 300, 9)),
    )  # fmt: skip


def example(*components: ComponentDrift) -> ThermalFit:
    """A fit of these, by default of a cubic, a constant and one without held-out figure."""
    items = components or (cubic(), constant(), constant("roll_x", held_out=False))
    return ThermalFit(
        components={item.name: item for item in items},
        sensors=(*SENSORS, "T_03_degC", "T_04_degC"),
        reference=REFERENCE,
        method="auto",
        warnings=(finding("not-used", what="T_02_degC", reason="its twins"),),
    )
