"""Where effects cancel: the temperature at which an axis is right, the place about which it turns.

The sizes of an effect and of its margins are counted from somewhere; where their sum is 0 is not.
Along one axis errors are a sum of sizes b_i times levers. Where the levers of some of them are
K (s_i + r_i t), K the same for all and t a covariate or coordinate, these cancel at
t = -(sum s_i b_i)/(sum r_i b_i): the ratio of two estimated sizes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.close_loop.estimate import Parameter
from mtu_cli.analyses.close_loop.result import Crossing, FoundEffect
from mtu_cli.language import Node, evaluate, linear_form, names, parse
from mtu_cli.model.effect_library import TableData
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.coverage import fieller
from mtu_cli.stats.least_squares import FloatArray

CELLS = 40
"""Measured cells at which levers are compared."""
SAME = 1e-9
"""Relative; less is rounding."""


class Term(NamedTuple):
    """A size along one axis: its effect, row in the covariance and lever."""

    effect: FoundEffect
    size: Parameter
    row: int
    lever: Node


def crossings(
    effects: Sequence[FoundEffect], covariance: FloatArray, table: ResidualTable
) -> tuple[Crossing, ...]:
    """All that are known to within the range of the data, and not farther than it from its middle;
    of effects that are alone in their class. `covariance` is over the `rows` of the effects.
    """
    result: dict[tuple[str, str, frozenset[int]], Crossing] = {}
    for axis in table.axes:
        own = [effect for effect in effects if f"E{axis}" in effect.equations]
        terms = list[Term]()
        for effect in own:
            if effect.candidate.over is None and effect.table is None and effect.rows:
                pairs = zip(effect.parameters, effect.rows, strict=True)
                sizes = {p.name: (p, row) for p, row in pairs}
                form = linear_form(parse(effect.equations[f"E{axis}"]), sizes)
                terms += [Term(effect, *sizes[x], lever) for x, lever in form.coefficients.items()]
        smooth = any(effect.table is not None for effect in own)
        for name in dict.fromkeys(name for term in terms for name in names(term.lever)):
            for group, centre, half, s, r in _groups(terms, name, table, smooth):
                if any(len(term.effect.classes) > 1 for term in group):
                    continue
                J, rows = np.array([-s, r]), [term.row for term in group]
                above, below = J @ [term.size.value for term in group]
                C = J @ covariance[np.ix_(rows, rows)] @ J.T
                dof = min(term.size.dof for term in group)
                value, u, ends = fieller(above, below, C, dof)
                if ends is None or ends[1] - ends[0] > 2 or abs(value) > 2:
                    continue
                low, high = (centre + half * end for end in ends)
                result[axis, name, frozenset(rows)] = Crossing(
                    axis=axis,
                    covariate=name,
                    effect=max(group, key=lambda term: bool(names(term.lever))).effect.name,
                    whole=len(group) == len(terms) and not smooth,
                    value=centre + half * value,
                    u=half * u,
                    interval95=(low, high),
                )
    return tuple(result.values())


def _groups(
    terms: Sequence[Term], name: str, table: ResidualTable, smooth: bool
) -> Iterator[tuple[list[Term], float, float, FloatArray, FloatArray]]:
    """Terms that are K (s + r t) with one K, t = (name - centre)/half of its range: the first of
    them rises with t, another does not in proportion to it. What is the same at all other places
    and times (K = 1) is so by itself alone where all terms are of the group.
    """
    # Coordinates and covariates at some of the measured cells, and their ends.
    cells = np.linspace(0, int(table.there.sum()) - 1, CELLS).astype(int)
    columns = {
        name: np.broadcast_to(v, table.there.shape)[table.there][cells]
        for name, v in TableData.of(table).values.items()
    }
    if name.startswith("dir_") or name not in columns:
        return
    low, high = columns[name].min(), columns[name].max()
    centre, half = (low + high) / 2, (high - low) / 2
    if not half > SAME * max(abs(low), abs(high)):
        return
    there = [columns | {name: centre + t * half} for t in (-1.0, 0.0, 1.0)]
    ends = [np.array([evaluate(x.lever, own) * np.ones(CELLS) for x in terms]) for own in there]
    middle, rise, bend = ends[1], (ends[2] - ends[0]) / 2, ends[2] - 2 * ends[1] + ends[0]
    for first in range(len(terms)):
        K = rise[first]
        there = np.abs(K) > SAME * np.abs(K).max(initial=0.0)
        if not there.any():
            continue
        K = K[there]
        s, r = middle[:, there] / K, rise[:, there] / K
        size = np.abs(s).max(axis=1) + np.abs(r).max(axis=1)
        alike = np.ptp(s, axis=1) + np.ptp(r, axis=1) + np.abs(bend[:, there] / K).max(axis=1)
        chosen = np.flatnonzero(alike <= SAME * size).tolist()
        alone = np.ptp(K) <= SAME * np.abs(K).max()
        if first not in chosen or (alone and (smooth or len(chosen) < len(terms))):
            continue
        s, r = s[chosen].mean(axis=1), r[chosen].mean(axis=1)
        if np.linalg.matrix_rank(np.array([s, r]), tol=SAME) == 2:
            yield [terms[i] for i in chosen], centre, half, s, r
