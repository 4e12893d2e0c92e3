"""Where effects cancel: the temperature at which an axis is right, the place about which it turns.

The sizes of an effect and of its margins are counted from somewhere; where their sum is 0 is not.
Along one axis errors are a sum of sizes times levers. Where all levers are linear in a covariate or
coordinate t, the sum is v(t) = a + b t of one number, or of several: of growth and drift one that
goes with the place and one that is alike at all places. It is 0 where all of them are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import fdtri

from mtu_cli.analyses.close_loop.describe import effects_of
from mtu_cli.analyses.close_loop.diagnosis import Diagnosis
from mtu_cli.analyses.close_loop.estimate import COVERED, estimates_of
from mtu_cli.analyses.close_loop.result import Crossing, FoundEffect, Parameter
from mtu_cli.files.covariates import is_temperature
from mtu_cli.language import Node, evaluate, linear_form, parse
from mtu_cli.model.effect_library import TableData
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

CELLS = 40
"""Measured cells at which levers are compared."""
SAME = 1e-9
"""Relative; less is rounding."""
REFERENCE_DEGC = 20.0
"""Temperature from which on lengths are counted (ISO 1)."""


class Term(NamedTuple):
    """A size along one axis: its effect, row in the covariance and lever."""

    effect: FoundEffect
    size: Parameter
    row: int
    lever: Node


def without_references(diagnosis: Diagnosis) -> Diagnosis:
    """A diagnosis without the offsets that say no more than where effects are counted from: with
    the level these are zero at a value of a covariate within its range, or at the temperature of
    reference (the 95 % interval reaches there), which is reported instead.
    """
    table = diagnosis.design.table
    values = TableData.of(table).values
    for offset in diagnosis.offsets if diagnosis.entries else ():
        rest = replace(diagnosis, offsets=tuple(x for x in diagnosis.offsets if x is not offset))
        sizes = estimates_of(rest.models, rest.model)
        for zero in crossings(effects_of(rest, sizes), sizes.covariance, table):
            column, (low, high) = values[zero.covariate], zero.interval95
            inside = low <= column.max() and high >= column.min()
            inside |= is_temperature(zero.covariate) and low <= REFERENCE_DEGC <= high
            if inside and zero.covariate not in AXES and offset.name == f"offset-{zero.axis}":
                diagnosis = rest
    return diagnosis


def crossings(
    effects: Sequence[FoundEffect], covariance: FloatArray, table: ResidualTable
) -> tuple[Crossing, ...]:
    """Of all effects along an axis at once, and of each that has its level; of effects that are
    alone in their class. `covariance` is over the `rows` of the effects.
    """
    result = list[Crossing]()
    # Coordinates and covariates at some of the measured cells, and their ends.
    cells = np.linspace(0, int(table.there.sum()) - 1, CELLS).astype(int)
    columns = {
        name: np.broadcast_to(v, table.there.shape)[table.there][cells]
        for name, v in TableData.of(table).values.items()
    }
    for axis in table.axes:
        groups = [
            _terms(effect, f"E{axis}") for effect in effects if f"E{axis}" in effect.equations
        ]
        if len(groups) > 1:
            groups.insert(0, [x for terms in groups for x in terms] if all(groups) else [])
        for name in (name for name in columns if not name.startswith("dir_")):
            for i, group in enumerate(groups):
                levels = [
                    x.size.role == "level" or x.effect.candidate.kind == "offset" for x in group
                ]
                no_level = table.fitted_degree >= 0 or table.datum != "none"
                classes = [x for term in group for x in term.effect.class_names[1:]]
                if not group or classes or not (no_level or any(levels)):
                    continue
                rows = [x.row for x in group]
                zero = _zero(group, covariance[np.ix_(rows, rows)], columns, name)
                if zero is not None:
                    value, u, ends = zero
                    result.append(
                        Crossing(
                            axis=axis,
                            covariate=name,
                            effect=group[0].effect.name,
                            whole=i == 0,
                            value=value,
                            u=u,
                            interval95=ends,
                        )
                    )
                    break
    return tuple(result)


def _terms(effect: FoundEffect, key: str) -> list[Term]:
    """Of an effect that is a sum of sizes times levers, but for sizes that are not estimable."""
    if effect.candidate.over is not None or effect.table is not None:
        return []
    pairs = zip(effect.parameters, effect.rows, strict=True)
    sizes = {p.name: (p, row) for p, row in pairs if p.u > 0}
    form = linear_form(parse(effect.equations[key]), [p.name for p in effect.parameters])
    return [Term(effect, *sizes[x], k) for x, k in form.coefficients.items() if x in sizes]


def _zero(
    group: Sequence[Term], C: FloatArray, columns: dict[str, FloatArray], name: str
) -> tuple[float, float, tuple[float, float]] | None:
    """Where the sum of sizes with covariance C is zero, with u and the 95 % interval: the values t
    at which v(t) = 0 is not rejected (of one number that of Fieller, 1954). None where there is no
    such value, or none that is known to within the range of the data, at most that from its middle.
    """
    low, high = columns[name].min(), columns[name].max()
    centre, half = (low + high) / 2, (high - low) / 2
    if not half > SAME * max(abs(low), abs(high)):
        return None
    u = np.array([x.size.u for x in group])
    ends = [
        np.array(
            [
                evaluate(x.lever, columns | {name: centre + t * half}) + np.zeros(CELLS)
                for x in group
            ]
        )
        for t in (-1, 0, 1)
    ]
    M, R = ends[1].T * u, (ends[2] - ends[0]).T / 2 * u
    largest = np.abs(M) + np.abs(R)
    if np.abs((ends[2] - 2 * ends[1] + ends[0]).T * u).max() > 1e-6 * largest.max():
        return None
    U, s, _ = np.linalg.svd(np.hstack([M, R]), full_matrices=False)
    M, R = (U[:, s > 1e-6 * s[0]].T @ X for X in (M, R))
    # A sum that is zero there whatever the sizes has no zero to estimate.
    if np.linalg.matrix_rank(np.array([M.ravel(), R.ravel()]), tol=1e-6 * s[0]) < 2:
        return None
    b, C = np.array([x.size.value for x in group]) / u, C / u / u[:, None]

    def tests(t: FloatArray) -> FloatArray:
        """v' V^-1 v, and the inverse of the variance of t."""
        J = M + t[:, None, None] * R
        V = J @ C @ np.swapaxes(J, 1, 2)
        V = V + 1e-14 * s[0] ** 2 * np.eye(len(M))
        stack = np.stack([J @ b, np.broadcast_to(R @ b, (len(t), len(M)))], axis=-1)
        return np.einsum("tki,tki->it", stack, np.linalg.solve(V, stack))

    t, step = np.zeros(1), 3.0
    while step > 1e-9:
        t = t[np.argmin(tests(t)[0])] + np.linspace(-step, step, 201)
        step /= 50
    t = t[[np.argmin(tests(t)[0])]]
    dof = min(min(x.size.dof for x in group), 1e9)
    limit = len(M) * fdtri(len(M), max(dof, 1.0), COVERED)
    (least,), (information,) = tests(t)
    bracket = np.array([-1e3, t[0] - 2, t[0] + 2, 1e3])
    if least > limit or abs(t[0]) > 2 or (tests(bracket)[0] <= limit).any():
        return None
    inner, outer = np.repeat(t, 2), t[0] + np.array([-2.0, 2.0])
    for _ in range(50):
        middle = (inner + outer) / 2
        accept = tests(middle)[0] <= limit
        inner, outer = np.where(accept, middle, inner), np.where(accept, outer, middle)
    if np.ptp(inner) > 2:
        return None
    first, last = (centre + half * inner).tolist()
    return centre + half * float(t[0]), half * float(information**-0.5), (first, last)
