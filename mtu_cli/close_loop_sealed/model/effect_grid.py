"""Grids of searched parameters: pitches, time constants, the part at which something jumped."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mtu_cli.close_loop_sealed.model.effect_candidate import FloatArray
from mtu_cli.files.effects import Search
from mtu_cli.language import evaluate, parse

DEFAULT_COUNT = 40
MOST_FREQUENCIES = 2000
"""Frequencies where no number is asked for: as many as the places demand, up to here."""
PER_SPAN = 4.0
"""Frequencies a span: halfway between two of them the phase is off by an eighth of a period at
each end of the data at most."""
COARSE = 0.5
"""Periods from one frequency to the next above which waves between them are not sure to be seen."""
LARGEST = 2_000_000
"""Numbers that the columns of one parameter may take."""
FEWEST = 24
MANY_PLACES = 30
"""Different values from which on waves are told apart well, and those that lie unevenly show
periods shorter than their steps."""
ALIKE = 0.9
"""Of all values' phases together: from which on a frequency looks like a constant at them."""
FINEST = 0.25
"""1/mm: the highest frequency that is looked at for that, half of the shortest pitch's."""
ONE_VALUE = 1e-9
"""Share of the span up to which two values are one."""


def grid_of(search: Search, values: FloatArray | None, size: int) -> FloatArray:
    """The searched values (G,); empty where the data gives none.

    `values` are those of the position or column searched along, `size` the entries of one
    column. A frequency grid runs from the longest to the shortest value, so that of two that
    the data cannot tell apart the longer one stands first.
    """
    distinct = np.zeros(0) if values is None else np.unique(values)
    if search.grid == "between":
        middles = (distinct[1:] + distinct[:-1]) / 2.0
        inside = middles[search.margin - 1 : len(middles) - search.margin + 1]
        count = min(search.count or len(inside), _most(size))
        every = math.ceil(len(inside) / count) if count else 1
        return inside[(every - 1) // 2 :: every]
    known = _known(distinct)
    low = max(_bounds(search.from_, known), default=math.nan)
    high = min(_bounds(search.to, known), default=math.nan)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        return np.zeros(0)
    usual = MOST_FREQUENCIES if search.grid == "frequency" else DEFAULT_COUNT
    count = min(search.count or usual, _most(size))
    if search.grid == "linear":
        return np.linspace(low, high, count)
    if low <= 0.0:
        return np.zeros(0)
    if search.grid == "log":
        return np.geomspace(low, high, count)
    ends = 1.0 / high, 1.0 / low
    needed = math.ceil((ends[1] - ends[0]) * PER_SPAN * known["span"]) + 1
    return 1.0 / np.linspace(*ends, max(2, min(needed, count)))


def _most(size: int) -> int:
    """Values that a grid may have whose columns have `size` entries."""
    return max(FEWEST, LARGEST // size)


def periods_apart(search: Search, values: FloatArray, grid: FloatArray) -> float:
    """Periods from one frequency of a grid (G,) to the next over the span of the values; 0 of
    other grids. One over `PER_SPAN` is wanted.
    """
    if search.grid != "frequency" or len(grid) < 2:
        return 0.0
    return float(abs(1.0 / grid[1] - 1.0 / grid[0]) * np.ptp(values))


def coarseness(search: Search, values: FloatArray, grid: FloatArray) -> str | None:
    """What lies between the values (G,) of a grid, where the data (`values`) would tell it."""
    apart = periods_apart(search, values, grid)
    if apart > COARSE:
        return (
            f"{apart:.2g} periods apart over the span of the data: one between two of them may be "
            "missed, or be told as two effects"
        )
    if search.grid == "between" and len(grid) > 1:
        every = int(np.diff(np.searchsorted(np.unique(values), grid[:2]))[0])
        if every > 1:
            return (
                f"one in {every} of those of the data: of the others the nearest is told, and what "
                "is left of it may be told as another effect"
            )
    return None


def shortest_of(search: Search, values: FloatArray) -> float:
    """The least of the lower bounds of a search: one of them may be that of the data's spacing,
    below which values look like others. nan where none is above 0.
    """
    known = [low for low in _bounds(search.from_, _known(np.unique(values))) if low > 0.0]
    return min(known, default=math.nan)


def has_many_places(values: FloatArray) -> bool:
    """Whether values are so many that waves over them are told apart well."""
    return len(np.unique(values)) >= MANY_PLACES


def is_continuous(search: Search) -> bool:
    """Whether the columns have a derivative with respect to what is searched."""
    return search.grid != "between"


def _known(distinct: FloatArray) -> dict[str, float]:
    if len(distinct) < 2:
        return {}
    span, steps = float(distinct[-1] - distinct[0]), np.diff(distinct)
    return {
        "low": float(distinct[0]),
        "high": float(distinct[-1]),
        "span": span,
        "spacing": _spacing(distinct, float(np.median(steps[steps > ONE_VALUE * span]))),
    }


def _spacing(distinct: FloatArray, step: float) -> float:
    """The period that the values (D,) cannot tell from a constant: their step where it is even, or
    they are few; of many uneven ones a shorter one, as far as it is looked for.

    They tell frequencies apart up to the first f at which |sum exp(2 pi i f x)|/D is near 1, the
    height of an alias in the spectral window (Lomb, Astrophys. Space Sci. 39 (1976) 447).
    """
    first = 0.5 / step
    if len(distinct) < MANY_PLACES or first >= FINEST:
        return step
    count = math.ceil((FINEST - first) * 2 * PER_SPAN * float(np.ptp(distinct))) + 1
    frequencies = np.linspace(first, FINEST, min(count, 2 * MOST_FREQUENCIES))
    window = np.abs(np.exp(2j * np.pi * np.outer(frequencies, distinct)).mean(axis=1))
    alike = frequencies[window >= ALIKE]
    return min(step, 1.0 / float(alike[0]) if len(alike) else 1.0 / FINEST)


def _bounds(texts: Sequence[str], known: dict[str, float]) -> list[float]:
    found = []
    for text in texts:
        tree = parse(text)
        if known or not any(name in text for name in ("span", "spacing", "low", "high")):
            found.append(float(evaluate(tree, known)))
        else:
            found.append(math.nan)
    return found
