"""Where declared effects were found, and whether they are used elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mtu_cli.findings import Finding, finding
from mtu_cli.model.covariates import Values
from mtu_cli.model.effect_parameters import DeclaredEffect
from mtu_cli.model.machine_model import AXES, MachineModel, places
from mtu_cli.model.temperatures import temperature_warnings
from mtu_cli.stats.least_squares import FloatArray

SLACK = 0.1
"""Share of the range seen that may be exceeded without a warning."""
SAME = 1e-9
"""Relative; a value that differs by more is not that of a column that did not change."""


def effect_warnings_at(
    model: MachineModel, points: FloatArray, covariates: Mapping[str, FloatArray | float]
) -> list[Finding]:
    """Of effects used beyond what they were found on, at `points` (n, 3) in mm under `covariates`,
    one value for all or one a point.
    """
    values = {**covariates, **places(model, points)}
    known = {name: value for name, value in values.items() if name not in model.constants}
    return outside_seen(model.effects, known)


def guess_warnings(model: MachineModel, points: FloatArray, values: Values) -> list[Finding]:
    """Temperatures of points at `points` (n, 3) mm, and what declared effects were found in, beyond
    what is known.
    """
    return [
        *temperature_warnings(model, points, values),
        *effect_warnings_at(model, points, values),
    ]


def outside_seen(
    effects: Sequence[DeclaredEffect], values: Mapping[str, FloatArray | float]
) -> list[Finding]:
    """One warning for all effects that left the same range that they were found on, by more than a
    tenth of it.
    """
    groups: dict[tuple[str, str, str], list[DeclaredEffect]] = {}
    for effect in effects:
        for column, (low, high) in effect.seen.items():
            given = np.atleast_1d(np.asarray(values.get(column, np.nan), float))
            given = given[np.isfinite(given)]
            excess = np.maximum(low - given, given - high)
            slack = max(SLACK * (high - low), SAME * max(abs(low), abs(high)))
            if len(given) and excess.max() > slack:
                unit = " mm" if column in AXES else ""
                worst = f"extrapolated to {given[int(np.argmax(excess))]:.8g}{unit}"
                seen = f"from {low:.8g} to {high:.8g}" if low < high else f"at {low:.8g}"
                groups.setdefault((column, seen + unit, worst), []).append(effect)
    return [
        finding(
            "outside-effect-range",
            effects=", ".join(f"effects[{effect.index}] ({effect.name})" for effect in group),
            file=group[0].file, covariate=column, range=seen, consequence=consequence,
        )
        for (column, seen, consequence), group in groups.items()
    ]  # fmt: skip
