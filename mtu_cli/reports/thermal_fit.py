"""The report of thermal-fit: a thermal model a component, and the evidence for it.

Coefficients are in the component's `unit`, other figures in um or arcsec, as their names say.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

from mtu_cli.analyses.thermal_fit.result import ComponentDrift, ThermalFit
from mtu_cli.findings import listed
from mtu_cli.reports import machine_figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Fields, declare
from mtu_cli.reports.numbers import fixed

LEADING = 3
"""Sensors named in the table of models."""
COMPONENT = """
    of | estimate.of | its axis; null: a constant
    unit | unit.name | of its coefficients
    model | | stepwise, ridge or lagged
    degree | estimate.degree | of the polynomial in position
    positions_mm | positions | of the readings
    sensors | estimate.sensors | of the model
    groups | | sensors that move alike, |r| >= 0.999
    reference_temperature_degC | estimate.reference | at which the drift is zero
    time_constants_min | estimate.time_constants | lag of each sensor; 0: none
    coefficients | estimate.coefficients | by powers of mm and by sensor, per degC \
        | -, size=unit.to_internal
    covariance | estimate.covariance | of the coefficients, powers first | -, size=size2
    coefficient_dof | estimate.coefficient_dof | its degrees of freedom
    leftover_covariance | estimate.leftover | of the drift that the model leaves | -, size=size2
    leftover_dof | estimate.leftover_dof | its degrees of freedom
    sensor_u_degC | estimate.sensor_u | standard uncertainty of each sensor
    temperature_range_degC | estimate.temperature_range | of each sensor in the readings
    position_range_mm | estimate.position_range | of the readings
    n | | number of readings
    cycles | | names of the cycles
    r2_fit | | share of the variance that the model explains
    zeroed.offsets | offsets | whether every cycle has an offset of its own
    zeroed.by | by | setting, first readings (all 0) or test of the offsets
    rms_before_UNIT | rms_before | rms of the drift
    rms_after_UNIT | rms_after | rms of the residuals
    held_out.
        by | cycle() | what was held out
        rms_before_UNIT | before | rms of the drift
        rms_after_UNIT | after | rms of the residuals
        ordinary_UNIT | ordinary | the same of ordinary least squares on all sensors
        r2 | | share of the variance that the model predicts
    collinearity.condition_number | condition | of the standardised sensors
    collinearity.vif | vif | variance inflation factor by sensor; null: infinite
    residuals.normality_p | normality_p | p that they are normal (D'Agostino & Pearson)
    residuals.lag1_autocorrelation | lag1 | from reading to reading
    gradients[] | | *gradient
    inseparable[] | | *gradient
"""


GRADIENT = """
    position_mm | position | observed position; null: the same at all
    sensors | | of `inseparable` those that have a gradient together only
    gradient_UNIT_per_degC | value | drift per degC of the first, the others moving with it as \
        they did | -, unit=UNIT
    u_UNIT_per_degC | u | its standard uncertainty | -, unit=UNIT
    interval95_UNIT_per_degC | interval | that holds it at 95 % | -, unit=UNIT
    by | | u from the scatter of cycles, or the model of the errors
"""


def component(item: ComponentDrift | None) -> Fields:
    """The figures of a component; the unit in their names is um or arcsec."""
    unit = "um" if item is None else item.rms_unit
    gradient = declare(GRADIENT.replace("UNIT", unit))
    text = COMPONENT.replace("UNIT", unit)
    return declare(text, cycle=lambda held: "cycle", gradient=gradient)


RESULTS = declare(
    """
    method | | model that was asked for
    sensors | | sensors of the readings
    reference_temperature_degC | reference | of the machine
    components[] | | *component
    """,
    component=component,
)
ROW = declare(
    """
    - | drift.name | name of the component | component, text, csv=component
    - | drift.estimate.of | its axis | -, csv=of
    - | drift.unit.name | of the figures | unit, text, csv=unit
    - | drift.model | stepwise, ridge or lagged | -, csv=model
    - | drift.estimate.degree | of the polynomial in position | -, csv=degree
    - | at.position | observed position | position, exact, unit=mm, csv=position_mm
    - | sensor | of the model; empty: it has none | sensor, text, csv=sensor
    - | stands_for | sensors that move as it does | -, csv=stands_for
    - | at.value | drift per degC | -, size=drift.unit.to_internal, csv=gradient_per_degC
    - | gradient() | | gradient / per degC, plus-minus, u=at.u, size=drift.unit.to_internal
    - | at.u | its standard uncertainty | -, size=drift.unit.to_internal, csv=u_gradient_per_degC
    - | at.interval | its 95 % interval \
        | 95 % interval / per degC, interval, u=at.u, size=drift.unit.to_internal, \
        csv=interval95_gradient
    - | separable | false: its gradient is known together with other sensors' only \
        | -, csv=separable
    - | inseparable() | | sepa- / rable, text
    - | at.by | u from the scatter of cycles, or the model of the errors | u by, text, csv=u_by
    - | share | rms of its part of the modelled drift \
        | rms / part, sig3, size=drift.unit.to_internal, csv=share_rms
    - | lag | time constant; 0: none | lag, unit=min, csv=time_constant_min
    - | vif | variance inflation factor; empty: infinite | VIF, sig3, csv=vif
    - | temperatures.0 | lowest temperature read | -, csv=temperature_low_degC
    - | temperatures.1 | highest temperature read | -, csv=temperature_high_degC
    """,
    gradient=lambda x: x["at"].value if "at" in x and (x["at"].value or x["at"].u) else None,
    inseparable=lambda x: None if x.get("separable", True) else "no",
)


def rows(item: ComponentDrift) -> Iterator[dict[str, Any]]:
    """Every sensor at every position; one row without a sensor where the model has none."""
    model, twins = item.estimate, {group[0]: group[1:] for group in item.groups}
    together = {(x.position, sensor) for x in item.inseparable for sensor in x.sensors}
    if not item.gradients:
        yield {"drift": item}
    for at in item.gradients:
        (sensor,) = at.sensors
        i, span = model.sensors.index(sensor), model.temperature_range
        yield {
            "drift": item,
            "at": at,
            "sensor": sensor,
            "stands_for": twins.get(sensor, ()),
            "separable": (at.position, sensor) not in together,
            "share": item.shares.get(sensor),
            "lag": float(model.time_constants[i]),
            "vif": item.vif.get(sensor),
            "temperatures": None if span is None else span[i],
        }


def _leading(item: ComponentDrift) -> str:
    """The sensors with the largest parts; T_spindle_degC is spindle."""
    by_share = sorted(item.estimate.sensors, key=lambda name: -item.shares.get(name, 0.0))
    names = [name.removeprefix("T_").removesuffix("_degC") for name in by_share]
    return ", ".join([*names[:LEADING], *(["..."] if len(names) > LEADING else [])])


MODEL = declare(
    """
    - | name | | component, text
    - | rms_unit | | unit, text
    - | model | | model, text
    - | estimate.degree | | degree, count
    - | len(estimate.sensors) | | sensors, count
    - | leading() | | largest parts, text
    - | rms_before | | fitted rms / without, sig3, size=rms_size
    - | rms_after | | / with, sig3, size=rms_size
    - | held_out.before | | held-out / without, sig3, size=rms_size
    - | held_out.after | | / with, sig3, size=rms_size
    - | held_out.reduction | | reduction / %, percent1
    - | held_out.ordinary | | all sensors / held out, sig3, size=rms_size, detail
    - | condition | | condition / number, sig3, detail
    - | lag1 | | autocorr., detail
    - | normality_p | | normal / p, p, detail
    """,
    leading=_leading,
)


def document(fit: ThermalFit, digits: int = 2) -> Document:
    """One row a component; in the CSV one a component, observed position and sensor."""
    items = list(fit.components.values())
    gradients = [row for item in items for row in rows(item)]
    footer = (
        f"rms of the drift without and with temperatures above {fit.reference:g} degC; held out: "
        "cycles not in the fit"
    )
    if any(item.offsets for item in items):
        footer += "; zeroed in every cycle: from its mean"
    models = Table("Thermal models", ROW, gradients, footer, shown=items, shown_fields=MODEL)
    footer = (
        "± standard uncertainty; rms part: of the modelled drift; VIF: variance inflation; not "
        "separable: known together only (warnings)"
    )
    known = [row for row in gradients if "sensor" in row]
    sensors = Table("Gradients of the sensors", ROW, known, footer, detail=True)
    tables, figure = [models, sensors], partial(machine_figures.drift, fit)
    return Document("Thermal models", (RESULTS, fit), tables, figure, _verdict(items), digits)


def _verdict(items: list[ComponentDrift]) -> str:
    held = {item.name: item.held_out.reduction for item in items if item.held_out is not None}
    held = {name: reduction for name, reduction in held.items() if math.isfinite(reduction)}
    if not held:
        return "No cycle is held out: the fit alone does not validate the models."
    least = min(held, key=held.__getitem__)
    others = [item.name for item in items if item.name not in held]
    more = f"; not validated: {listed(others)}" if others else ""
    reduction = f"{fixed(100 * held[least], 1)} %{' or more' * (len(held) > 1)}"
    return (
        f"On held-out cycles the thermal models reduce the rms drift by {reduction} (least: "
        f"{least}){more}."
    )
