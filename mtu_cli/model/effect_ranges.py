"""Where declared effects were found, and whether they are used elsewhere."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.files.covariates import is_temperature
from mtu_cli.findings import Finding, finding
from mtu_cli.model.effect_parameters import EFFECT_MARK, DeclaredEffect
from mtu_cli.model.machine_model import AXES, MachineModel, design, places, theta
from mtu_cli.stats.least_squares import FloatArray

NEAR_K = 0.5
"""Temperatures this near to one another are one to a shop: a meter of steel grows by 6 um."""
SLACK = 0.1
"""Share of the range seen that may be exceeded without a word."""
SAME = 1e-9
"""Relative; a column that did not change is told from another value by more."""
LARGE_MM = 1.0
"""No effect of a machine that makes parts is larger: a parameter or a constant is in another
unit than is meant ..."""
STEEP = 1e-3
"""... but on a long axis: no machine grows by more in proportion, as steel would by 90 K."""


@dataclass(frozen=True, slots=True)
class _Left:
    """A range that was left: the column, its ends, and the value farthest from them."""

    column: str
    low: float
    high: float
    value: float


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
        *_not_given(model.effects, known),
        *_too_large(model, points, covariates),
    ]


def _not_given(
    effects: Sequence[DeclaredEffect], values: Mapping[str, FloatArray | float]
) -> list[Finding]:
    """One warning for all effects that hold within a range of a column of which nothing is known,
    or not at all points: no equation asks for it.
    """
    found: dict[tuple[str, float, float], list[DeclaredEffect]] = {}
    for effect in effects:
        for column in effect.within:
            if not np.isfinite(np.asarray(values.get(column, np.nan), float)).all():
                found.setdefault((column, *effect.seen[column]), []).append(effect)
    return [
        finding(
            "outside-effect-range",
            effects=_listed(own),
            file=own[0].file,
            covariate=column,
            range=_between(low, high, high - low),
            consequence=_lacks(values.get(column), column),
        )
        for (column, low, high), own in found.items()
    ]


def _lacks(given: FloatArray | float | None, column: str) -> str:
    """How many points have no value of a column."""
    known = np.isfinite(np.atleast_1d(np.asarray(np.nan if given is None else given, float)))
    if known.any():
        return f"{known.size - int(known.sum())} of {known.size} points have no value"
    return f"no value is given (--at {column})"


def outside_seen(
    effects: Sequence[DeclaredEffect], values: Mapping[str, FloatArray | float]
) -> list[Finding]:
    """One warning for all effects that left the same range by more than a tenth of it."""
    found: dict[_Left, list[DeclaredEffect]] = {}
    for effect in effects:
        for column, (low, high) in effect.seen.items():
            given = np.atleast_1d(np.asarray(values.get(column, np.nan), float))
            given = given[np.isfinite(given)]
            beyond = np.maximum(low - given, given - high)
            slack = max(
                SLACK * (high - low),
                SAME * max(abs(low), abs(high)),
                NEAR_K if column in effect.within and is_temperature(column) else 0.0,
            )
            if len(given) and beyond.max() > slack:
                worst = float(given[int(np.argmax(beyond))])
                found.setdefault(_Left(column, low, high, worst), []).append(effect)
    return [_left(*item) for item in found.items()]


def _left(left: _Left, effects: Sequence[DeclaredEffect]) -> Finding:
    unit = " mm" if left.column in AXES else ""
    beyond = max(left.low - left.value, left.value - left.high)
    return finding(
        "outside-effect-range",
        effects=_listed(effects),
        file=effects[0].file,
        covariate=left.column,
        range=_between(left.low, left.high, left.high - left.low or beyond) + unit,
        consequence=f"extrapolated to {_shown(left.value, beyond)}{unit}",
    )


def _between(low: float, high: float, size: float) -> str:
    """Ends to digits that tell `size`."""
    ends = dict.fromkeys(_shown(end, size or 1.0) for end in (low, high))
    return f"from {' to '.join(ends)}" if len(ends) == 2 else f"at {next(iter(ends))}"


def _shown(value: float, size: float) -> str:
    """A value with six digits, or more where a thousandth of `size` could not be told by them."""
    digits = math.ceil(math.log10(max(abs(value) / size, 1.0))) + 3
    if digits <= 6:
        return f"{value:.6g}"
    # All digits before the point: with an exponent they could not be told apart at a glance.
    return f"{value:.{max(digits, len(str(int(abs(value)))))}g}"


def _listed(effects: Sequence[DeclaredEffect]) -> str:
    return ", ".join(f"effects[{effect.index}] ({effect.name})" for effect in effects)


def _too_large(
    model: MachineModel, points: FloatArray, covariates: Mapping[str, FloatArray | float]
) -> list[Finding]:
    warnings = []
    known = np.nan_to_num(points)
    moved = float(max(np.abs(known).max(), np.ptp(known, axis=0).max()))
    for effect in model.effects:
        terms = tuple(term for term in model.terms if _owner(term.estimate.name) == effect.name)
        if not terms:
            continue
        alone = replace(model, terms=terms, remainders=dict.fromkeys(model.axes, ()))
        said = design(alone, points, covariates).J @ theta(alone)
        largest = float(said[int(np.argmax(np.abs(said)))])
        if abs(largest) > max(LARGE_MM, STEEP * moved):
            warnings.append(
                finding(
                    "effect-too-large",
                    effect=_listed([effect]),
                    file=effect.file,
                    value_mm=largest,
                    where="",
                    expected="parameters and constants in the units of their columns",
                )
            )
    return warnings


def _owner(name: str) -> str:
    """The effect whose parameter a term is; nothing for a component of the machine."""
    return name.rpartition(EFFECT_MARK)[0]
