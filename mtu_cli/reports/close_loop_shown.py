"""What the report, the tables and the picture of close-loop share: sizes in the unit shown."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.close_loop.result import (
    DRIFT,
    FIELD,
    CloseLoopResult,
    FoundEffect,
    Judged,
    TableResult,
)
from mtu_cli.reports.document import finite
from mtu_cli.units import PARAMETER_UNITS, UNITS, Unit

LEVEL = "level"


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """A parameter in the unit it is shown in, with its 95 % interval."""

    name: str
    unit: str
    value: float
    u: float
    interval: tuple[float, float]
    dof: float


def first_table(result: CloseLoopResult) -> TableResult:
    """The table that the scores at the top are of: the first that gave the verdict."""
    return next(
        (item for item in result.tables if item.verdict == result.verdict), result.tables[0]
    )


def unit_of(item: TableResult) -> Unit:
    """The unit that the errors of a table are shown in."""
    return UNITS[item.table.unit]


def size_of(item: TableResult, value: float | None) -> float | None:
    """An error in internal units (mm, rad) in the table's own; None where it is not finite."""
    return None if value is None else finite(value / unit_of(item).to_internal)


def parameters_of(effect: FoundEffect) -> tuple[Shown, ...]:
    """The parameters of an effect in the units they are shown in."""
    found = []
    for (name, unit, value, u), (low, high, dof) in zip(
        effect.parameters, effect.intervals, strict=True
    ):
        scale = PARAMETER_UNITS[unit].to_internal
        found.append(
            Shown(
                name=name,
                unit=unit,
                value=value / scale,
                u=u / scale,
                interval=(low / scale, high / scale),
                dof=dof,
            )
        )
    return tuple(found)


def is_level(name: str) -> bool:
    """Whether a parameter is only the level that an equation needs beside what it says."""
    return name == LEVEL or name.startswith(f"{LEVEL}_")


def amplitude(effect: FoundEffect) -> tuple[float, float]:
    """Length sqrt(sum p_i^2) of the parameters as a vector, levels left out, and its
    u = sqrt(g' C g) with g = p/length (JCGM 100:2008, 5.2.2); internal units.
    """
    p = np.array([0.0 if is_level(name) else value for name, _, value, _ in effect.parameters])
    length = float(np.linalg.norm(p))
    if length == 0:
        return 0.0, math.nan
    g = p / length
    return length, math.sqrt(max(float(g @ effect.covariance @ g), 0.0))


def effect_rms(effect: FoundEffect, item: TableResult) -> float:
    """Root mean square of an effect over all coordinates of a table, mm (rad)."""
    return math.sqrt(effect.explained_share) * item.in_sample_before.rms


def class_of(effect: FoundEffect) -> tuple[str, ...]:
    """What the data cannot tell apart: the effect, its rivals, what is the same on these points."""
    return tuple(dict.fromkeys([effect.name, *effect.class_names, *effect.aliases]))


def improvement_percent(item: TableResult) -> float | None:
    """By how much the root mean square of held-out errors fell; None where there was none."""
    if item.before.rms == 0:
        return None
    return 100 * (1 - item.after.rms / item.before.rms)


def something_left(item: TableResult) -> bool:
    """Whether there is more than scatter beside what was named."""
    return bool(item.fired) or item.without_name


def ranked(item: TableResult) -> list[Judged]:
    """The candidates that could be tested, the likeliest first."""
    seen = [judged for judged in item.candidates if judged.log_bayes_factor is not None]
    return sorted(seen, key=lambda judged: -(judged.log_bayes_factor or 0.0))


def in_words(name: str) -> str:
    """A rival's name as people read it: drifts and fields without a name have none."""
    for prefix, text in ((DRIFT, "a smooth drift in"), (FIELD, "a smooth field in")):
        if name.startswith(f"{prefix}-"):
            return f"{text} {name.removeprefix(f'{prefix}-')} without a name"
    return name


def things(item: TableResult) -> tuple[str, str]:
    """What the rows and the columns of a table are: parts and features, passes and positions."""
    return ("part", "feature") if item.table.component is None else ("pass", "position")


def plural(word: str) -> str:
    return f"{word}es" if word.endswith("s") else f"{word}s"
