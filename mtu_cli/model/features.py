"""The places where a machine is judged: features of a part, or a grid over its volume."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from itertools import product

import numpy as np

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import Finding, InputError, error, finding, listed
from mtu_cli.model.effect_parameters import range_warnings
from mtu_cli.model.machine_model import (
    AXES,
    Covariates,
    MachineModel,
    coordinates_of,
    places_of,
    row_times,
    without_coordinate,
)
from mtu_cli.model.prediction import Outside, Prediction
from mtu_cli.stats.least_squares import FloatArray

FEW_DOF = 3.0
BELOW_THREE = "fewer than 3 effective ones"
NO_U = "a source with two or fewer, so that no standard uncertainty exists"
MOST_PLACES = 3000
"""The covariance of all places is calculated: its side is this times the axes."""
SLACK = 0.05
"""Share of the fitted range of temperatures that may be exceeded without a warning."""


def feature_points(
    part: LoadedPart, model: MachineModel, chosen: Iterable[str] | None = None
) -> tuple[tuple[str, ...], FloatArray, list[Finding]]:
    """Ids, nominal coordinates (n, 3) in mm (nan: not given) and warnings.

    A coordinate that a constant of the machine fixes (its effective z) is the machine's.

    Raises InputError for features without a coordinate that an equation needs.
    """
    places = part.part.places()
    ids = tuple(places) if chosen is None else tuple(dict.fromkeys(chosen))
    # None becomes nan.
    points = np.array([places[i] for i in ids], np.float64).reshape(len(ids), 3)
    problem = without_coordinate(model, points, lambda i: (ids[i], part.place("features", ids[i])))
    if problem is not None:
        raise InputError(problem)
    warnings = []
    for axis, value in model.position_constants().items():
        column = points[:, AXES.index(axis)]
        if (np.isfinite(column) & (np.abs(column - value) > 1e-9)).any():
            reason = f"the machine fixes {axis} at {value:g} mm; nominal lengths have it"
            facts = {"what": f"the part's {axis}", "names": [f"{axis}_mm"], "reason": reason}
            warnings.append(finding("not-used", **facts))
    return ids, points, warnings


def outside_warnings(outside: Outside) -> list[Finding]:
    """One warning for all components whose measured range the features leave alike."""
    # Of other axes the same features are at other positions.
    alike: dict[tuple[float, float, tuple[tuple[str, float], ...]], list[str]] = {}
    for (component, low, high), positions in outside.items():
        alike.setdefault((low, high, tuple(positions.items())), []).append(component)
    warnings = []
    for (low, high, points), names in alike.items():
        rest = f" (and {len(points) - 1} more)" if len(points) > 1 else ""
        point, at = points[0]
        what = f"feature {point!r} at {at:g} mm{rest}"
        facts = {"low": low, "high": high, "unit": "mm"}
        warnings.append(finding("outside-measured-range", what=what, names=names, **facts))
    return warnings


def temperature_warnings(model: MachineModel, covariates: Covariates) -> list[Finding]:
    """Temperatures beyond those of the fit, one warning a sensor and range for all drifts that were
    read in it, and lags without a history; `covariates` are one value for all or one a point.
    """
    beyond: dict[tuple[str, float, float], tuple[float, list[str]]] = {}
    for drift in model.drifts():
        ranges = [] if drift.temperature_range is None else drift.temperature_range.tolist()
        for sensor, (low, high) in zip(drift.sensors, ranges, strict=False):
            values = np.atleast_1d(np.asarray(covariates[sensor], float))
            away = np.maximum(low - values, values - high)
            i = int(np.argmax(away))
            if away[i] > max(SLACK * (high - low), 1e-9):
                entry = beyond.setdefault((sensor, low, high), (values[i], []))
                entry[1].append(drift.component)
    warnings = []
    for (sensor, low, high), (value, components) in beyond.items():
        what, names = f"{sensor} at {value:.4g} degC", [f"the drift of {listed(components)}"]
        facts = {"sensor": sensor, "low": low, "high": high, "unit": "degC"}
        warnings.append(finding("outside-measured-range", what=what, names=names, **facts))
    times = row_times(covariates)
    lagged = [drift for drift in model.drifts() if drift.time_constants.any()]
    if lagged and (times is None or np.ptp(times) == 0):
        slowest = max(float(drift.time_constants.max()) for drift in lagged)
        names = [drift.component for drift in lagged]
        warnings.append(finding("settled-temperatures", components=names, minutes=slowest))
    return warnings


def guess_warnings(model: MachineModel, points: FloatArray, values: Covariates) -> list[Finding]:
    """Of temperatures, and of effects beyond what they were found on, at `points` (n, 3) in mm
    under covariates `values`, one for all or one a point.
    """
    whole = {**values, **places_of(model, points)}
    inputs = {name: value for name, value in whole.items() if name not in model.constants}
    outside = range_warnings(model.effects, inputs, model.file)
    return [*temperature_warnings(model, values), *outside]


def prediction_warnings(
    model: MachineModel, prediction: Prediction, covariates: Covariates | None
) -> list[Finding]:
    """Of places, temperatures and effects beyond what is known of them."""
    guessed = guess_warnings(model, prediction.points, covariates or {})
    return [*outside_warnings(prediction.outside), *guessed]


def one_direction(model: MachineModel, at: Collection[str]) -> list[Finding]:
    """The warning of one approach direction for all features: between them a reversal cancels."""
    names = [name for name in at if name.startswith("dir_") and name in model.covariates()]
    return [finding("one-direction", names=names)] if names else []


def dof_warnings(what: Sequence[str], dof: FloatArray) -> list[Finding]:
    """Fewer than three effective degrees of freedom: Student's t has no variance there."""
    few = [name for name, value in zip(what, dof, strict=True) if value < FEW_DOF]
    return [finding("few-degrees-of-freedom", names=few, how=BELOW_THREE)] if few else []


def grid_of(
    machine: LoadedMachine, model: MachineModel, text: str
) -> tuple[tuple[str, ...], FloatArray]:
    """Ids and coordinates (n, 3) in mm of a grid over the travels that the machine file states.

    `text` is a count an axis, such as 5 or 7,5,3 (z of two counts has one place, in the middle); an
    axis that a constant fixes, or that no equation and component needs, has one place (nan where
    nothing fixes it).

    Raises InputError for a count that is none, or an axis without travel.
    """
    try:
        numbers = [int(count) for count in text.split(",")]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 3 or min(numbers) < 1:
        form, expected = "a count an axis", "5 or 7,5,3, say"
        raise error("wrong-type", path="--grid", kind=form, value=text, expected=expected)
    fixed, travels = model.position_constants(), machine.machine.travels
    needed = {name for axis in model.axes for name in coordinates_of(model, axis)} - {*fixed}
    counts = [*(numbers * 3 if len(numbers) == 1 else numbers), 1][:3]
    counts = [count if axis in needed else 1 for axis, count in zip(AXES, counts, strict=True)]
    if (count := math.prod(counts)) > MOST_PLACES:
        expected = f"at most {MOST_PLACES} places, not {count}"
        raise error("out-of-range", path="--grid", value=text, expected=expected)
    if lacking := [axis for axis in AXES if axis in needed and axis not in travels]:
        raise InputError(
            finding(
                "missing-key",
                key=f"{axis}.travel_mm",
                expected=f"axes: {{{axis}: {{travel_mm: [LOW, HIGH]}}}}",
                **machine.place("axes"),
            )
            for axis in lacking
        )
    levels = []
    for axis, count in zip(AXES, counts, strict=True):
        ends = travels[axis] if axis in needed else (fixed.get(axis, np.nan),) * 2
        levels.append(np.linspace(*ends, count) if count > 1 else np.full(1, np.mean(ends)))
    points = np.array(list(product(*levels)))
    names = tuple(",".join(f"{value:g}" for value in row if np.isfinite(value)) for row in points)
    return names, points
