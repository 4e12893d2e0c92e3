"""Where declared effects were found, and whether they are used elsewhere."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.files.covariates import is_temperature
from mtu_cli.findings import Finding, finding
from mtu_cli.model.covariates import Columns, Values, number, used_columns
from mtu_cli.model.effect_parameters import EFFECT_MARK, DeclaredEffect
from mtu_cli.model.machine_model import AXES, MachineModel, design, places, theta
from mtu_cli.model.temperatures import temperature_warnings
from mtu_cli.stats.least_squares import FloatArray

NEAR_K = 0.5
"""Temperatures this near to one another are one to a shop: a meter of steel grows by 6 um."""
SLACK = 0.1
"""Share of the range seen that may be exceeded without a warning."""
SAME = 1e-9
"""Relative; a value that differs by more is not that of a column that did not change."""
LARGE_MM = 1.0
"""No effect of a machine that makes parts is larger: a parameter or a constant is in another
unit than is meant ..."""
STEEP = 1e-3
"""... but on a long axis: no machine grows by more in proportion, as steel would by 90 K."""
Groups = dict[tuple[str, str, str], list[DeclaredEffect]]
"""Effects by column, its range and what is the matter with it."""


def effect_warnings_at(
    model: MachineModel, points: FloatArray, covariates: Mapping[str, FloatArray | float]
) -> list[Finding]:
    """Of effects used beyond what they were found on, and of those that are too large to be true,
    at `points` (n, 3) in mm under `covariates`, one value for all or one a point.
    """
    if not model.effects:
        return []
    values = {**covariates, **places(model, points)}
    known = {name: value for name, value in values.items() if name not in model.constants}
    return [
        *outside_seen(model.effects, known),
        *not_given(model.effects, known),
        *_too_large(model, points, covariates),
    ]


def guess_warnings(
    model: MachineModel,
    points: FloatArray,
    values: Values,
    columns: Columns,
    at: Mapping[str, float],
) -> list[Finding]:
    """Temperatures of points at `points` (n, 3) mm, and what declared effects were found in, beyond
    what is known.
    """
    return [
        *temperature_warnings(model, points, values),
        *effect_warnings_at(model, points, with_effect_columns(model, values, columns, at)),
    ]


def with_effect_columns(
    model: MachineModel, values: Values, columns: Columns, at: Mapping[str, float]
) -> Values:
    """The `values` that equations need (`needed_covariates`), and others by name of which declared
    effects have a range that they were found in; nan in cells that are no number.
    """
    more: Values = {}
    for name in used_columns(model):
        if name in columns:
            column = columns[name]
            cells = map(number, column.tolist()) if column.dtype == object else column
            more[name] = np.array(list(cells), np.float64)
        elif name in at:
            more[name] = at[name]
    return {**more, **values}


def not_given(
    effects: Sequence[DeclaredEffect], values: Mapping[str, FloatArray | float]
) -> list[Finding]:
    """Of effects that hold within a range of a column of which nothing is known, or not at all
    points: no equation needs it.
    """
    result: Groups = {}
    for effect in effects:
        for column in effect.within:
            low, high = effect.seen[column]
            known = np.isfinite(np.atleast_1d(np.asarray(values.get(column, np.nan), float)))
            if not known.all():
                lack = f"{known.size - int(known.sum())} of {known.size} points have no value"
                lack = lack if known.any() else f"no value is given (--at {column})"
                key = (column, _between(low, high, high - low), lack)
                result.setdefault(key, []).append(effect)
    return _findings(result)


def outside_seen(
    effects: Sequence[DeclaredEffect], values: Mapping[str, FloatArray | float]
) -> list[Finding]:
    """Of effects that left a range that they were found on by more than a tenth of it."""
    result: Groups = {}
    for effect in effects:
        for column, (low, high) in effect.seen.items():
            given = np.atleast_1d(np.asarray(values.get(column, np.nan), float))
            given = given[np.isfinite(given)]
            excess = np.maximum(low - given, given - high)
            slack = max(
                SLACK * (high - low),
                SAME * max(abs(low), abs(high)),
                NEAR_K if column in effect.within and is_temperature(column) else 0.0,
            )
            if len(given) and (beyond := float(excess.max())) > slack:
                unit = " mm" if column in AXES else ""
                worst = _shown(float(given[int(np.argmax(excess))]), beyond)
                seen = _between(low, high, high - low or beyond) + unit
                key = (column, seen, f"extrapolated to {worst}{unit}")
                result.setdefault(key, []).append(effect)
    return _findings(result)


def _findings(found: Groups) -> list[Finding]:
    """One warning for all effects of which the same is true."""
    return [
        finding(
            "outside-effect-range", effects=_listed(effects), file=effects[0].file,
            covariate=column, range=seen, consequence=consequence,
        )
        for (column, seen, consequence), effects in found.items()
    ]  # fmt: skip


def _between(low: float, high: float, size: float) -> str:
    """Ends to digits that show `size`."""
    ends = dict.fromkeys(_shown(end, size or 1.0) for end in (low, high))
    return f"from {' to '.join(ends)}" if len(ends) == 2 else f"at {next(iter(ends))}"


def _shown(value: float, size: float) -> str:
    """A value with six digits, or more where these do not show a thousandth of `size`."""
    digits = math.ceil(math.log10(max(abs(value) / size, 1.0))) + 3
    if digits <= 6:
        return f"{value:.6g}"
    # All digits before the point: with an exponent they look alike.
    return f"{value:.{max(digits, len(str(int(abs(value)))))}g}"


def _listed(effects: Sequence[DeclaredEffect]) -> str:
    return ", ".join(f"effects[{effect.index}] ({effect.name})" for effect in effects)


def _too_large(
    model: MachineModel, points: FloatArray, covariates: Mapping[str, FloatArray | float]
) -> list[Finding]:
    warnings = []
    known = np.nan_to_num(points)
    size = float(max(np.abs(known).max(), np.ptp(known, axis=0).max()))
    for effect in model.effects:
        terms = tuple(
            t for t in model.terms if t.estimate.name.rpartition(EFFECT_MARK)[0] == effect.name
        )
        if not terms:
            continue
        alone = replace(model, terms=terms, remainders=dict.fromkeys(model.axes, ()))
        errors = design(alone, points, covariates).J @ theta(alone)
        largest = float(errors[int(np.argmax(np.abs(errors)))])
        if abs(largest) > max(LARGE_MM, STEEP * size):
            expected = "parameters and constants in the units of their columns"
            facts = {"effect": _listed([effect]), "file": effect.file, "expected": expected}
            warnings.append(finding("effect-too-large", value_mm=largest, where="", **facts))
    return warnings
