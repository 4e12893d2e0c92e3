"""What a thermal model does not hold, and what its readings lacked, in plain words."""

from __future__ import annotations

import numpy as np

from mtu_cli.analyses.thermal_fit.evidence import FEWEST_NESTED
from mtu_cli.analyses.thermal_fit.library import Library
from mtu_cli.analyses.thermal_fit.result import ComponentDrift
from mtu_cli.analyses.thermal_fit.series import Series
from mtu_cli.analyses.thermal_fit.uncertainty import Rest
from mtu_cli.model.settings import Warned
from mtu_cli.stats.least_squares import FloatArray

OVER_FIT = 2.0
COLLINEAR = 30.0
"""Condition number from which on single coefficients are not to be trusted (Belsley, Kuh &
Welsch 1980, ch. 3)."""
STUCK_SHARE = 0.5
"""A sensor counts as stuck where one value fills this share of a cycle ..."""
OTHERS_MOVE = 0.5
"""... while the other sensors move by this many degC (their median)."""
FEWEST_ROWS = 10


def component_warnings(
    series: Series, lib: Library, drift: ComponentDrift, method: str
) -> list[Warned]:
    """Warnings of one component's model."""
    name = drift.name
    found: list[tuple[str, str]] = []
    if len(lib.cycles) < FEWEST_NESTED:
        many = "no cycles are told apart" if len(lib.cycles) < 2 else "there are two cycles only"
        found.append(
            (
                "not-held-out",
                f"{name}: {many}: no cycle can be held out of fit and choice, and the fit's own "
                "rms says little of the next warm-up (three cycles or more, column 'cycle')",
            )
        )
    held = drift.held_out
    if held is not None and drift.rms_after > 0 and held.after > OVER_FIT * drift.rms_after:
        found.append(
            (
                "over-fit",
                f"{name}: rms {_shown(drift, drift.rms_after)} on the cycles of the fit, "
                f"{_shown(drift, held.after)} on held-out ones: believe the latter",
            )
        )
    if held is not None and held.after > held.before:
        found.append(
            (
                "no-better",
                f"{name}: on held-out cycles the temperatures make it worse: the model is not "
                "to be used",
            )
        )
    if drift.condition > COLLINEAR:
        found.append(
            (
                "collinear",
                f"{name}: the sensors move together (condition number {drift.condition:.0f}): "
                "single coefficients are not to be read on their own",
            )
        )
    if method in ("auto", "lagged") and len(lib.time_constants) < 2:
        why = "no times are given" if series.complete else "there are too many readings"
        found.append(("no-lags", f"{name}: models with lags are not tried: {why}"))
    if len(drift.positions) == 1 and drift.estimate.of is not None:
        found.append(
            (
                "one-position",
                f"{name}: the drift was read at {drift.positions[0]:g} mm only: that it is the "
                f"same all along {drift.estimate.of} is assumed, not tested",
            )
        )
    if not drift.estimate.sensors:
        found.append(("no-sensor", f"{name}: no sensor explains the drift"))
    return [Warned(code=code, message=message) for code, message in found]


def sensor_warnings(
    series: Series, sensors: tuple[str, ...], rest: Rest, drift: ComponentDrift
) -> list[Warned]:
    """Sensors that do not move, at all or for a time in which the others do."""
    span = series.range()
    still = [sensors[s] for s in range(len(sensors)) if span[s, 0] == span[s, 1]]
    found = [
        Warned(
            code="sensor-still",
            message=f"{name} reads {span[sensors.index(name), 0]:g} degC throughout: left out",
        )
        for name in still
    ]
    for c, cycle in enumerate(series.cycles):
        rows = rest.kept.at(series.positions[0], c)
        for s in _stuck(rest.kept.temperature[rows]):
            if sensors[s] in still:
                continue
            found.append(
                Warned(
                    code="sensor-stuck",
                    message=f"{sensors[s]} stands still in cycle {cycle!r} while the others "
                    f"move{_consequence(drift, sensors[s], span[s])}",
                )
            )
    return found


def _stuck(temperature: FloatArray) -> list[int]:
    """Columns (n, s) of which one value fills half the rows while the others move."""
    if len(temperature) < FEWEST_ROWS:
        return []
    found = []
    for s in range(temperature.shape[1]):
        values, counts = np.unique(temperature[:, s], return_counts=True)
        if counts.max() < STUCK_SHARE * len(temperature):
            continue
        still = temperature[:, s] == values[np.argmax(counts)]
        others = np.delete(np.ptp(temperature[still], axis=0), s)
        if len(others) and np.median(others) > OTHERS_MOVE:
            found.append(s)
    return found


def _consequence(drift: ComponentDrift, sensor: str, span: FloatArray) -> str:
    if sensor not in drift.estimate.sensors:
        return f": the model of {drift.name} does not use it"
    largest = max(abs(gradients[sensor]) for _, gradients in drift.at_positions)
    wrong = _shown(drift, largest * float(span[1] - span[0]))
    return f": it makes the model of {drift.name} wrong by up to {wrong}"


def _shown(drift: ComponentDrift, value: float) -> str:
    return f"{value / drift.unit.to_internal:.2g} {drift.unit.name}"
