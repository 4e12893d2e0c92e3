"""Declared effects: their parameters as components that a machine file states, where they were
found, and grids of those that an effect is not linear in: time constants, pitches, places.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from mtu_cli.files.covariates import POSITIONS
from mtu_cli.files.effects import Search
from mtu_cli.files.machine import Effect, LoadedMachine
from mtu_cli.findings import Finding, finding
from mtu_cli.language import evaluate, names, parse
from mtu_cli.model.estimates import ComponentEstimate, EffectEstimates, JointPasses, known_component
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS

EFFECT_MARK = "."
"""Stands between an effect and its parameter; no component's name holds it."""
SAME = 1e-9
"""Relative; less is the rounding of a value that went through a file's unit."""
SLACK = 0.1
"""Share of the range seen that may be exceeded without a warning."""


Known = dict[str, ComponentEstimate]


def renames(effect: Effect) -> dict[str, str]:
    """The names of an effect's parameters and components -> ``effect.parameter``."""
    own = (*effect.parameters, *effect.components)
    return {name: f"{effect.name}{EFFECT_MARK}{name}" for name in own}


def effects_of(
    machine: LoadedMachine, reported: EffectEstimates | None
) -> tuple[Known, Known, tuple[JointPasses, ...]]:
    """The parameters of a machine's effects: as the file states them, each effect by itself,
    or, of effects all of whose parameters are `reported`, with the report's joint covariance; the
    components within effects; and the covariances.
    """
    components, tables = Known(), Known()
    covariances, matches = dict[tuple[str, ...], FloatArray](), list[int]()
    for effect in machine.machine.effects:
        rename, stated = renames(effect), effect.parameters.values()
        names = [rename[name] for name in effect.parameters]
        units = [PARAMETER_UNITS[p.unit] for p in stated]
        if reported is not None and {*names} <= {*reported.names}:
            rows = [reported.names.index(name) for name in names]
            values, C = reported.values[rows], reported.covariance[np.ix_(rows, rows)]
            matches += rows
        else:
            f = np.array([unit.to_internal for unit in units])
            values = np.array([p.value for p in stated]) * f
            # Where the file states a covariance, it replaces the parameters' u.
            u2 = np.diag([p.u**2 for p in stated])
            C = u2 if effect.covariance is None else np.asarray(effect.covariance, float)
            C = C * np.outer(f, f)
            if effect.covariance is not None:
                covariances[tuple(names)] = C
        for i, (name, unit) in enumerate(zip(names, units, strict=True)):
            components[name] = ComponentEstimate(
                name=name,
                unit=unit,
                coefficients=values[i : i + 1],
                covariance=C[i : i + 1, i : i + 1],
                pass_covariance=np.zeros((1, 1)),
            )
        for name, entry in effect.components.items():
            tables[rename[name]] = known_component(rename[name], entry)
    if reported is not None and matches:
        known = tuple(reported.names[i] for i in matches)
        covariances[known] = reported.covariance[np.ix_(matches, matches)]
    joint = (
        JointPasses(
            components=names,
            widths=(1,) * len(names),
            covariance=C,
            pass_covariance=np.zeros_like(C),
        )
        for names, C in covariances.items()
    )
    return components, tables, tuple(joint)


def joint_effects(
    machine: LoadedMachine,
    reported: EffectEstimates | None,
    names: tuple[str, ...],
    covariance: FloatArray,
) -> EffectEstimates | None:
    """All parameters of a machine's effects with one covariance, None where it has no effect.

    That of effects estimated separately is zero between them; `covariance` (k, k), in internal
    units, is over the parameters `names`, estimated jointly now.
    """
    components, _, joint = effects_of(machine, reported)
    order, items = list(components), list(components.values())
    if not order:
        return None
    C = np.diag([item.covariance[0, 0] for item in items])
    for group in joint:
        rows = [order.index(name) for name in group.components]
        C[np.ix_(rows, rows)] = group.covariance
    rows = [order.index(name) for name in names]
    C[rows] = C[:, rows] = 0.0
    C[np.ix_(rows, rows)] = covariance
    return EffectEstimates(
        names=tuple(order),
        units=tuple(item.unit for item in items),
        values=np.array([item.coefficients[0] for item in items]),
        covariance=C,
    )


def range_warnings(
    effects: Sequence[Effect], values: Mapping[str, FloatArray | float], file: str | None
) -> list[Finding]:
    """Of effects of a machine `file` that are used, at `values` by name of column or position, more
    than a tenth of the range away from what they were found on.
    """
    warnings = []
    for effect in effects:
        for column, (low, high) in effect.seen.items():
            x = np.atleast_1d(np.asarray(values.get(column, np.nan), float))
            x = x[np.isfinite(x)]
            excess = np.maximum(low - x, x - high)
            slack = max(SLACK * (high - low), SAME * max(abs(low), abs(high)))
            if len(x) and excess.max() > slack:
                unit = " mm" if column in POSITIONS else ""
                span = f"from {low:.8g} to {high:.8g}" if low < high else f"at {low:.8g}"
                far = f"extrapolated to {x[int(np.argmax(excess))]:.8g}{unit}"
                facts = {"effects": effect.name, "covariate": column, "range": span + unit}
                code = "outside-effect-range"
                warnings.append(finding(code, **facts, consequence=far, file=file))
    return warnings


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
        low, high = float(distinct[0]), float(distinct[-1])
        variables = {"low": low, "high": high, "span": high - low, "spacing": _spacing(distinct)}
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


def _spacing(distinct: FloatArray) -> float:
    """The period at which a wave is a constant on the values (D,): their step where it is even, or
    they are few; of many uneven ones a shorter one, as far as it is looked for.

    Frequencies are separable up to the first f at which |sum exp(2 pi i f x)|/D is near 1, the
    height of an alias in the spectral window (Lomb, Astrophys. Space Sci. 39 (1976) 447).
    """
    span, steps = float(np.ptp(distinct)), np.diff(distinct)
    step = float(np.median(steps[steps > ONE_VALUE * span]))
    first = 0.5 / step
    if len(distinct) < MANY_PLACES or first >= FINEST:
        return step
    count = math.ceil((FINEST - first) * 2 * PER_SPAN * span) + 1
    frequencies = np.linspace(first, FINEST, min(count, 2 * MOST_FREQUENCIES))
    window = np.abs(np.exp(2j * np.pi * np.outer(frequencies, distinct)).mean(axis=1))
    alike = frequencies[window >= ALIKE]
    return min(step, 1.0 / float(alike[0]) if len(alike) else 1.0 / FINEST)
