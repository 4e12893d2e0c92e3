"""The machine as a design matrix at points: E = J theta + remainder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.language import evaluate, names
from mtu_cli.model.effect_parameters import EFFECT_MARK
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.stats.least_squares import FloatArray

LARGEST = 1e30
"""Of a lever arm or error in mm: squares of larger ones are no numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """The machine at n points: rows are (point, axis), points first.

    `J` (n*a, K) in theta, `columns` of each term in it, `levers` (n*a, c) of each term,
    `remainder` (n*a,) in mm.
    """

    J: FloatArray
    levers: FloatArray
    remainder: FloatArray
    columns: tuple[slice, ...]


def places(model: MachineModel, points: FloatArray) -> dict[str, FloatArray]:
    """Coordinates (n,) by axis, those that a constant fixes at its value."""
    fixed = model.position_constants()
    return {
        axis: np.full(len(points), fixed[axis]) if axis in fixed else points[:, i]
        for i, axis in enumerate(AXES)
    }


def design(
    model: MachineModel, points: FloatArray, covariates: Mapping[str, FloatArray | float]
) -> Design:
    """J, lever arms and remainder at `points` (n, 3) in mm (nan where a coordinate is unknown).

    Row (i, axis) holds dE_axis/dtheta at point i: lever arm times powers of the component's
    position. Gilsinn & Ling 2004, eq. (1), or any other set of linear equations.

    Raises InputError where a needed coordinate is unknown or a value is not finite.
    """
    values: dict[str, FloatArray | float] = {
        name: pair[0] for name, pair in model.constants.items()
    }
    place = places(model, points)
    values |= place
    values |= {name: covariates[name] for name in model.covariates()}
    n, a = len(points), len(model.axes)
    widths = [len(term.estimate.coefficients) for term in model.terms]
    starts = np.concatenate([[0], np.cumsum(widths)]).astype(int)
    J = np.zeros((n, a, starts[-1]))
    levers = np.zeros((n, a, len(model.terms)))
    for t, term in enumerate(model.terms):
        rows = term.basis.rows(place, covariates, n)
        for i, axis in enumerate(model.axes):
            if axis in term.levers:
                levers[:, i, t] = evaluate(term.levers[axis], values)
                # An infinite lever arm is reported by _check_finite, in words.
                with np.errstate(invalid="ignore"):
                    J[:, i, starts[t] : starts[t + 1]] = levers[:, i, t, None] * rows
    remainder = np.zeros((n, a))
    for i, axis in enumerate(model.axes):
        for node in model.remainders[axis]:
            remainder[:, i] += evaluate(node, values)
    _check_finite(model, J, remainder, points)
    return Design(
        J=J.reshape(n * a, -1),
        levers=levers.reshape(n * a, -1),
        remainder=remainder.reshape(n * a),
        columns=tuple(slice(starts[t], starts[t + 1]) for t in range(len(widths))),
    )


def _check_finite(
    model: MachineModel, J: FloatArray, remainder: FloatArray, points: FloatArray
) -> None:
    with np.errstate(invalid="ignore"):
        bad = ~((np.abs(J) < LARGEST).all(axis=2) & (np.abs(remainder) < LARGEST))
    if not bad.any():
        return
    i, a = np.argwhere(bad)[0]
    problem = not_finite(model, model.axes[a], points[i])
    owners = [
        term.estimate.name.rpartition(EFFECT_MARK)[0]
        for term in model.terms
        for _ in term.estimate.coefficients
    ]
    with np.errstate(invalid="ignore"):
        first = np.flatnonzero(~(np.abs(J[i, a]) < LARGEST))
    owner = owners[first[0]] if len(first) else ""
    if (place := model.places.get((owner, model.axes[a]))) is not None:
        problem = replace(problem, file=place[0], line=place[1], path=place[2])
    raise InputError(problem)


def coordinates_of(model: MachineModel, axis: str) -> tuple[str, ...]:
    """The coordinates that the equation of an axis is of, without those that a constant fixes."""
    used: set[str] = set()
    for term in model.terms:
        if axis in term.levers:
            used |= {*names(term.levers[axis]), term.estimate.of or ""}
    for node in model.remainders[axis]:
        used |= set(names(node))
    return tuple(name for name in AXES if name in used and name not in model.constants)


def not_finite(model: MachineModel, axis: str, point: FloatArray) -> Finding:
    """The finding of the equation of an axis that has no value at `point` (3,), mm."""
    used = coordinates_of(model, axis)
    unknown = [name for k, name in enumerate(AXES) if np.isnan(point[k]) and name in used]
    known = [f"{name}={point[AXES.index(name)]:g}" for name in used if name not in unknown]
    where = f" at {', '.join(known)}" if known else ""
    if unknown:
        where += f" without a {unknown[0]}"
        expected = f"{unknown[0]}_mm in the part or nominal_{unknown[0]}_mm of the points, or a "
        expected += "constant of the machine"
    else:
        expected = "an equation that is defined at every feature (no division by 0, no root or "
        expected += "logarithm of a negative number, no exponential of millimetres)"
    what = f"the equation E{axis} of {model.name!r}"
    return finding("no-finite-value", what=what, where=where, expected=expected)


def of_feature(problem: Finding, name: str, more: int, **place: Any) -> Finding:
    """The same finding of a feature, and of so many more, at its place in a file."""
    others = f" (and {more} more)" if more else ""
    where = f"{problem.facts['where']}, of feature {name!r}{others}"
    return replace(problem, facts={**problem.facts, "where": where}, **place)


def without_coordinate(
    model: MachineModel, points: FloatArray
) -> tuple[np.ndarray, Finding] | None:
    """Which of `points` (n, 3) lack a coordinate that an equation needs, and the Problem of the
    first of them; None where none does.
    """
    for axis in model.axes:
        columns = [AXES.index(name) for name in coordinates_of(model, axis)]
        lacking = np.flatnonzero(np.isnan(points[:, columns]).any(axis=1))
        if len(lacking):
            return lacking, not_finite(model, axis, points[lacking[0]])
    return None


def theta(model: MachineModel) -> FloatArray:
    """The coefficients of all terms, one after the other, (K,)."""
    return np.concatenate([term.estimate.coefficients for term in model.terms])
