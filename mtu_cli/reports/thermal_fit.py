"""The report of thermal-fit: a thermal model a component, and the evidence for it.

Coefficients are in the component's `unit`, other figures in um or arcsec, as their names say.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mtu_cli.analyses.thermal_fit import ComponentDrift, ThermalFit
from mtu_cli.findings import listed
from mtu_cli.reports import figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Fields, RowOf, declare
from mtu_cli.reports.numbers import cut, fixed, significant, spread

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
    covariance | estimate.covariance | of the coefficients, powers first | -, size=size2()
    coefficient_dof | estimate.coefficient_dof | its degrees of freedom
    leftover_covariance | estimate.leftover | of the drift that the model leaves | -, size=size2()
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
    unit = "um" if item is None else item.rms_unit.name
    definitions = {"cycle": lambda _: "cycle", "size2": lambda x: x.unit.to_internal**2}
    return declare(COMPONENT, UNIT=unit, gradient=GRADIENT, **definitions)


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
    component | drift.name | name of the component | component, text
    of | drift.estimate.of | its axis
    unit | drift.unit.name | of the figures | unit, text
    model | drift.model | stepwise, ridge or lagged
    degree | drift.estimate.degree | of the polynomial in position
    -. | with_sensor()
        position_mm | at.position | observed position | position, exact
        sensor | sensor.sensors | of the model; empty: it has none | sensor, text
        stands_for | twins() | sensors that move as it does
        gradient_per_degC | at.value | drift per degC \
            | gradient / per degC, plus-minus, u=at.u, size=drift.unit.to_internal
        u_gradient_per_degC | at.u | its standard uncertainty | -, size=drift.unit.to_internal
        interval95_gradient | at.interval | its 95 % interval \
            | 95 % interval / per degC, interval, u=at.u, size=drift.unit.to_internal
        separable | separable() | false: its gradient is known together with other sensors' only \
            | sepa- / rable, yes_no
        u_by | at.by | u from the scatter of cycles, or the model of the errors | u by, text
        share_rms | share() | rms of its part of the modelled drift \
            | rms / part, sig3, size=drift.unit.to_internal
        time_constant_min | sensor.time_constants | time constant; 0: none | lag, unit=min
        vif | vif() | variance inflation factor; empty: infinite | VIF, sig3
        temperature_low_degC | sensor.temperature_range.0 | lowest temperature read
        temperature_high_degC | sensor.temperature_range.1 | highest temperature read
    """,
    with_sensor=lambda row: row if row["at"] else None,
    twins=lambda row: next(
        (x[1:] for x in row["drift"].groups if x[0] == row["sensor"].sensors), ()
    ),
    separable=lambda row: (
        not any(
            x.position == row["at"].position and row["sensor"].sensors in x.sensors
            for x in row["drift"].inseparable
        )
    ),
    share=lambda row: row["drift"].shares.get(row["sensor"].sensors),
    vif=lambda row: row["drift"].vif.get(row["sensor"].sensors),
)


def rows(item: ComponentDrift) -> list[dict[str, Any]]:
    """Gradients with what the model has of their sensors; one row without where it has none."""
    model = item.estimate
    places = [(at, model.sensors.index(at.sensors[0])) for at in item.gradients]
    entries = [{"drift": item, "at": at, "sensor": RowOf(model, i)} for at, i in places]
    return entries or [{"drift": item, "at": None, "sensor": None}]


MODEL = declare(
    """
    - | name | | component, text
    - | rms_unit.name | | unit, text
    - | model | | model, text
    - | estimate.degree | | degree, count
    - | len(estimate.sensors) | | sensors, count
    - | leading() | | largest parts, text
    - | rms_before | | fitted rms / without, sig3, size=rms_unit.to_internal
    - | rms_after | | / with, sig3, size=rms_unit.to_internal
    - | held_out.before | | held-out / without, sig3, size=rms_unit.to_internal
    - | held_out.after | | / with, sig3, size=rms_unit.to_internal
    - | held_out.reduction | | reduction / %, reduction()
    - | condition | | condition / number, sig3, detail
    - | lag1 | | autocorr., detail
    - | normality_p | | normal / p, p, detail
    """,
    # T_spindle_degC is spindle.
    leading=lambda x: ", ".join(
        name.removeprefix("T_").removesuffix("_degC")
        for name in sorted(x.estimate.sensors, key=lambda name: -x.shares.get(name, 0.0))[:3]
    ),
    reduction=lambda value, u, digits: fixed(100 * value, 0),
)


def document(fit: ThermalFit, digits: int = 2) -> Document:
    """One row a component; in the CSV one a component, observed position and sensor."""
    items = list(fit.components.values())
    footer = (
        f"rms without and with temperatures above {fit.reference:g} degC; held out: cycles left out"
    )
    if any(item.offsets for item in items):
        footer += "; zeroed in every cycle: from its mean"
    entries = [row for item in items for row in rows(item)]
    of_sensors = "± u; rms part: of modelled drift; not separable: known together with others only"
    gradients = [row for row in entries if row["at"]]
    tables = [
        Table("", ROW, entries, selection=()),
        Table("Thermal models", MODEL, items, footer),
        Table("Gradients of the sensors", ROW, gradients, of_sensors, detail=True),
    ]
    gains = {item.name: item.held_out.reduction for item in items if item.held_out is not None}
    gains = {name: reduction for name, reduction in gains.items() if math.isfinite(reduction)}
    verdict = "No cycle is held out: the fit alone does not validate the models."
    if gains:
        least = min(gains, key=gains.__getitem__)
        rest = listed(item.name for item in items if item.name not in gains)
        by = f"{fixed(100 * abs(gains[least]), 0)} %"
        if gains[least] < 0:
            change = f"increase the rms drift by up to {by} (most: {least})"
        else:
            change = f"reduce the rms drift by {by}{' or more' * (len(gains) > 1)} (least: {least})"
        unknown = f"; not validated: {rest}" if rest else ""
        verdict = f"On held-out cycles the thermal models {change}{unknown}."
    return Document("Thermal models", (RESULTS, fit), tables, figure, verdict, digits)


def figure(fit: ThermalFit) -> figures.Figure:
    """Measured and modelled drift, a panel a component; along an axis a colour a position."""
    items = list(fit.components.values())[:6]
    page = figures.blank(9.0, 0.9 + 2.75 * max(1, len(items)))
    for panel, item in zip(figures.panels_of(page, len(items), 1), items, strict=True):
        _curves(panel, item)
    some = f" of {len(items)} of {len(fit.components)} components"
    some = some if len(items) < len(fit.components) else ""
    figures.title(page, f"Drift with temperature{some}: measured (dots), modelled (lines)")
    return page


def _curves(panel: figures.Axes, item: ComponentDrift) -> None:
    unit, size = item.rms_unit.name, item.rms_unit.to_internal
    places = list(dict.fromkeys(curve.position for curve in item.curves))
    positions = [places[i] for i in spread(len(places), 6)]
    along, start = item.estimate.degree > 0 and len(positions) > 1, 0.0
    shades = figures.shades(len(positions)) if along else [figures.BLUE] * len(positions)
    colours = dict(zip(positions, shades, strict=True))
    for cycle in dict.fromkeys(curve.cycle for curve in item.curves):
        curves = [curve for curve in item.curves if curve.cycle == cycle and len(curve.time)]
        panel.axvline(start, color=figures.GREY, linewidth=0.7, linestyle="--")
        for curve in (curve for curve in curves if curve.position in colours):
            time, colour = curve.time - curve.time.min() + start, colours[curve.position]
            measured, modelled = curve.measured / size, curve.modelled / size
            panel.plot(time, measured, "o", ms=3.0, color=colour, alpha=0.35, mew=0)
            at = "" if curve.position is None else f"{curve.position:g} mm"
            panel.plot(time, modelled, color=colour, linewidth=1.0, label=at)
        start += max((float(np.ptp(curve.time)) for curve in curves), default=0.0)
    panel.set_xlabel("min, and the cycles one after the other")
    panel.set_ylabel(f"drift, {unit}")
    held_out = item.held_out
    kind = "rms of held-out cycles" if held_out else "rms of the fit (nothing held out)"
    rms = (held_out.before, held_out.after) if held_out else (item.rms_before, item.rms_after)
    change = " → ".join(significant(x / size, 3) for x in rms)
    panel.set_title(f"{cut(item.name, 26)}: {kind} {change} {unit}")
    if along:
        figures.key(panel, [panel], loc="center left", bbox_to_anchor=(1.0, 0.5))
