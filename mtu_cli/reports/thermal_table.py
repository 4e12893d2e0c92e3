"""The tables of thermal-fit: what each model gains, what was tried, what each sensor does."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text

from mtu_cli.analyses.thermal_fit.result import ComponentDrift, ThermalFit
from mtu_cli.findings import listed
from mtu_cli.reports.labels import cut, spread
from mtu_cli.reports.numbers import MISSING, p_value, percent, plus_minus, significant
from mtu_cli.reports.tables import Column, Sheet
from mtu_cli.reports.thermal_shown import (
    DETAILED,
    by_share,
    change,
    nothing_held_out,
    shown_in,
)

IMPORTANT = 3
"""Sensors named in the summary."""
NAME_LENGTH = 14
"""Characters of a sensor's name there."""
SENSORS = 12
"""Sensors listed a component."""
POSITIONS = 6
WITH_U = 4
"""Positions beside which the gradients' uncertainties find room."""
DEGREES = 6
NO_LAG = "lagged, no lag found"
"""The model of who asked for lags, where none is worth it."""
SENSOR_LEGEND = (
    "± is one standard uncertainty; its part: root mean square of what the sensor adds to the "
    "modelled drift (parts of sensors that move together may cancel). Lag: time constant. VIF: how "
    "many times the other sensors inflate the variance of its gradient"
)


def tables(fit: ThermalFit) -> list[object]:
    """What a terminal shows; everything is in the report and, of gradients, in the CSV."""
    items = list(fit.components.values())
    detailed = items[:DETAILED]
    sheets: list[object] = [_summary(fit, items)]
    if any(item.candidates for item in detailed):
        sheets.append(_candidates(detailed))
    gradients = [_sensors(item) for item in detailed if item.estimate.sensors]
    sheets += [*gradients, Text(SENSOR_LEGEND, style="dim")] if gradients else []
    if len(items) > len(detailed):
        left_out = listed((item.name for item in items[DETAILED:]), 12)
        sheets.append(Text(f"not listed sensor by sensor: {left_out} (--csv FILE, -o FILE)"))
    return sheets


def _summary(fit: ThermalFit, items: Sequence[ComponentDrift]) -> Sheet:
    columns = [
        Column(title="component\n", text=True, folds=True),
        Column(title="unit\n", text=True),
        Column(title="model\n", text=True, folds=True),
        Column(title="degree\n"),
        Column(title="sensors\n", text=True, folds=True),
        Column(title="fitted rms\nwithout → with"),
        Column(title="held-out rms\nwithout → with"),
        Column(title="falls by\n%"),
        Column(title="all sensors\nheld out"),
    ]
    notes = [
        f"root mean square of the drift without and with temperatures (above {fit.reference:g} "
        "degC); degree: of the polynomial in position; sensors: how many, those of the largest "
        "part first",
        "held-out: cycles that took no part in fit or choice; all sensors: the same cycles by "
        "ordinary least squares on all sensors",
    ]
    grouped: dict[str, list[str]] = {}
    for item in items:
        if item.held_out is None:
            grouped.setdefault(nothing_held_out(item), []).append(item.name)
    notes += [f"{listed(names, 12)}: no held-out figure: {why}" for why, names in grouped.items()]
    notes += _in_blocks(items)
    lagless = [item.name for item in items if item.without_lag]
    if lagless:
        notes.append(
            f"{listed(lagless, 12)}: {NO_LAG}: none lowers the held-out error enough, so that the "
            "model is ridge (its name in the report)"
        )
    without = [item.name for item in items if not item.estimate.sensors]
    if without:
        notes.append(f"{listed(without, 12)}: no sensor explains the drift")
    if fit.not_used:
        own = listed(fit.not_used, 12)
        notes.append(f"columns that are no sensors (T_<sensor>_degC), not used: {own}")
    rows = [_summary_row(item) for item in items]
    return Sheet(title="Thermal models", columns=columns, rows=rows, notes=notes)


def _in_blocks(items: Sequence[ComponentDrift]) -> list[str]:
    """Which components have so many cycles that several are held out at a time."""
    grouped: dict[tuple[int, int], list[str]] = {}
    for item in items:
        found = item.held_out
        if found is not None and found.blocks < len(found.cycles):
            grouped.setdefault((len(found.cycles), found.blocks), []).append(item.name)
    return [
        f"{listed(names, 12)}: {cycles} cycles, held out in {blocks} blocks of those that follow "
        "each other"
        for (cycles, blocks), names in grouped.items()
    ]


def _summary_row(item: ComponentDrift) -> list[str]:
    unit, size = shown_in(item.unit)
    names = by_share(item)
    sensors = str(len(names))
    if names:
        more = ", ..." if len(names) > IMPORTANT else ""
        sensors += f": {', '.join(_short(name) for name in names[:IMPORTANT])}{more}"
    row = [
        item.name,
        unit,
        NO_LAG if item.without_lag else item.model,
        str(item.estimate.degree),
        sensors,
    ]
    row.append(change(item.rms_before, item.rms_after, size))
    found = item.held_out
    if found is None:
        return [*row, MISSING, MISSING, MISSING]
    fall = 1.0 - found.after / found.before if found.before > 0 else None
    return [
        *row,
        change(found.before, found.after, size),
        percent(fall) if fall is not None and fall >= 0 else significant(_hundred(fall), 3),
        significant(found.ordinary / size, 3),
    ]


def _hundred(value: float | None) -> float | None:
    return None if value is None else 100.0 * value


def _short(sensor: str) -> str:
    """A sensor's own name in its column's: T_spindle_degC is spindle."""
    return cut(sensor.removeprefix("T_").removesuffix("_degC") or sensor, NAME_LENGTH)


def _candidates(items: Sequence[ComponentDrift]) -> Sheet:
    degrees = sorted({found.degree for item in items for found in item.candidates})
    columns = [
        Column(title="component\n", text=True, folds=True),
        Column(title="unit\n", text=True),
        Column(title="model\n", text=True),
        *(Column(title=f"degree {degree}\nheld out") for degree in degrees[:DEGREES]),
    ]
    rows = []
    for item in items:
        for model in dict.fromkeys(found.model for found in item.candidates):
            cells = [_candidate(item, model, degree) for degree in degrees[:DEGREES]]
            rows.append([item.name, shown_in(item.unit)[0], model, *cells])
    notes = [
        "root mean square over cycles held out of fit and choice; * chosen, on the scores within "
        "the other cycles: it need not be the smallest here; -: not tried in every fold"
    ]
    if any("" in row[3:] for row in rows):
        notes[0] += (
            "; empty: not tried (lags are sought only at the degrees that suit them best; the "
            "highest degree is the number of positions less one)"
        )
    if len(degrees) > DEGREES:
        notes.append(f"degrees above {degrees[DEGREES - 1]}: -o FILE")
    return Sheet(title="Models tried", columns=columns, rows=rows, notes=notes)


def _candidate(item: ComponentDrift, model: str, degree: int) -> str:
    tried = [x for x in item.candidates if (x.model, x.degree) == (model, degree)]
    kind = "lagged" if item.without_lag else item.model
    chosen = (kind, item.estimate.degree) == (model, degree)
    size = shown_in(item.unit)[1]
    shown = [MISSING if x.held_out is None else significant(x.held_out / size, 3) for x in tried]
    return ", ".join(shown) + ("*" if chosen and shown else "")


def _sensors(item: ComponentDrift) -> Sheet:
    unit = shown_in(item.unit)[0]
    chosen = spread(len(item.at_positions), POSITIONS)
    lagged = bool(item.estimate.time_constants.any())
    places = [item.at_positions[i][0] for i in chosen]
    columns = [
        Column(title="sensor\n", text=True, folds=True),
        Column(title=f"its part\n{unit}"),
        *(Column(title=f"{_place(place)}\n{unit}/degC") for place in places),
        *([Column(title="lag\nmin")] if lagged else []),
        Column(title="VIF\n"),
    ]
    names = by_share(item)
    title = f"{item.name}: gradients of its sensors"
    if len(names) > SENSORS:
        title += f": the {SENSORS} with the largest part, of {len(names)}"
    return Sheet(
        title=title,
        columns=columns,
        rows=[_sensor(item, name, chosen, lagged) for name in names[:SENSORS]],
        notes=_sensor_notes(item, len(chosen)),
    )


def _place(position: float | None) -> str:
    return "gradient" if position is None else f"at {position:g} mm"


def _sensor(item: ComponentDrift, sensor: str, chosen: Sequence[int], lagged: bool) -> list[str]:
    estimate, size = item.estimate, shown_in(item.unit)[1]
    s = estimate.sensors.index(sensor)
    cells = []
    for i in chosen:
        position, gradients = item.at_positions[i]
        value = gradients[sensor] / size
        if value == 0:
            cells.append(MISSING)
        elif len(chosen) <= WITH_U:
            u = estimate.gradient_u(s, position or 0.0) / size
            cells.append(plus_minus(value, u))
        else:
            cells.append(significant(value, 3))
    tau = float(estimate.time_constants[s])
    vif = item.vif.get(sensor)
    infinite = sensor in item.vif and vif is None
    share = item.shares.get(sensor)
    return [
        sensor,
        MISSING if share is None else significant(share / size, 3),
        *cells,
        *([significant(tau) if tau > 0 else MISSING] if lagged else []),
        "infinite" if infinite else significant(vif, 3),
    ]


def _sensor_notes(item: ComponentDrift, places: int) -> list[str]:
    notes = [
        f"{listed(group, 12)} move alike (|r| >= 0.999) and cannot be told apart: they share their "
        "drift, each with the gradient shown, and all are needed"
        for group in item.groups
        if len(group) > 1
    ]
    total = len(item.at_positions)
    if places < total:
        notes.append(f"{places} of {total} positions; all of them: --csv FILE")
    if item.position_test is not None:
        p = p_value(item.position_test.p)
        shown = f"p {p}" if p.startswith("<") else f"p = {p}"
        notes.append(
            "test of the drift being the same at all positions: "
            f"F = {significant(item.position_test.F, 3)}, {shown}"
        )
    found = item.residuals
    text = f"residuals: autocorrelation {significant(found.lag1)} from reading to reading"
    text += f" ({item.n} readings tell as much as {significant(found.effective, 3)})"
    if found.normality_p is not None:
        text += f", normal: p {p_value(found.normality_p)}"
    notes.append(f"{text}; condition number {significant(item.condition, 3)}")
    return notes
