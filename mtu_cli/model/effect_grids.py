"""Grids of the parameters that an effect is not linear in: time constants, pitches, places."""

from __future__ import annotations

import math

import numpy as np

from mtu_cli.files.effects import Search
from mtu_cli.language import evaluate, names, parse
from mtu_cli.stats.least_squares import FloatArray

DEFAULT_COUNT = 40
MARGIN = 2
"""Values on either side of a grid between values."""
MOST_FREQUENCIES = 2000
PER_SPAN = 4.0
"""Frequencies a span: halfway between two of them the phase is off by an eighth of a period at
each end of the data at most.
"""
LARGEST_COLUMNS = 2_000_000
"""Numbers that the columns of one parameter may take."""
FEWEST_VALUES = 24
FEWEST_FOR_WAVES = 6
"""Different values: more than a wave's size, phase and period and a line take."""
MANY_PLACES = 20
"""Different values from which on uneven ones show periods shorter than their steps."""
ALIKE = 0.9
"""Of all values' phases: from which on a frequency looks like a constant at them."""
FINEST = 0.25
"""1/mm: the highest frequency that is looked at for that, half of the shortest pitch's."""
ONE_VALUE = 1e-9
"""Share of the span up to which two values are one."""


def grid_of(search: Search, values: FloatArray | None, size: int) -> FloatArray:
    """The searched values (G,); empty where the data gives none.

    `values` are those of the position or column searched along, `size` the entries of one
    column. A frequency grid runs from the longest to the shortest value, so that of two that
    the data cannot separate the longer one comes first.
    """
    distinct = np.zeros(0) if values is None else np.unique(values)
    most = max(FEWEST_VALUES, LARGEST_COLUMNS // size)
    if search.grid == "between":
        middles = (distinct[1:] + distinct[:-1]) / 2.0
        inside = middles[MARGIN - 1 : len(middles) - MARGIN + 1]
        count = min(search.count or len(inside), most)
        every = math.ceil(len(inside) / count) if count else 1
        return inside[(every - 1) // 2 :: every]
    waves = search.grid == "frequency"
    if waves and len(distinct) < FEWEST_FOR_WAVES:
        return np.zeros(0)
    # The variables of the bounds of a search.
    variables = dict[str, float]()
    if len(distinct) > 1:
        low, high, steps = float(distinct[0]), float(distinct[-1]), np.diff(distinct)
        step = float(np.median(steps[steps > ONE_VALUE * (high - low)]))
        variables = {"low": low, "high": high, "span": high - low}
        variables |= {"spacing": _spacing(distinct, step)}
    trees = [[parse(text) for text in texts] for texts in (search.from_, search.to)]
    if not all(names(tree).keys() <= {*variables} for side in trees for tree in side):
        return np.zeros(0)
    low, high = (
        float(choice(evaluate(tree, variables) for tree in side))
        for choice, side in zip((max, min), trees, strict=True)
    )
    if not (-math.inf if search.grid == "linear" else 0.0) < low < high < math.inf:
        return np.zeros(0)
    count = min(search.count or (MOST_FREQUENCIES if waves else DEFAULT_COUNT), most)
    if not waves:
        return (np.linspace if search.grid == "linear" else np.geomspace)(low, high, count)
    ends = 1.0 / high, 1.0 / low
    needed = math.ceil((ends[1] - ends[0]) * PER_SPAN * variables["span"]) + 1
    return 1.0 / np.linspace(*ends, max(2, min(needed, count)))


def _spacing(distinct: FloatArray, step: float) -> float:
    """The period at which a wave is a constant on the values (D,): their step where it is even, or
    they are few; of many uneven ones a shorter one, as far as it is looked for.

    Frequencies are separable up to the first f at which |sum exp(2 pi i f x)|/D is near 1, the
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
