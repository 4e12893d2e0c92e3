"""Measured points with all that may be odd about them, and their residuals one by one."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from made_tables import made_points
from numpy.typing import NDArray

from mtu_cli.files.readings import Points
from mtu_cli.findings import Finding
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.prediction import predict
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.covariance import drawable_passes
from mtu_cli.stats.least_squares import FloatArray

Cell = tuple[str, str]

MACHINE = """
components:
  px: {of: x, unit: um, coefficients: [2, -0.06], covariance: [[0.04, 0.001], [0.001, 1e-3]],
       pass_covariance: [[0.2, 0.001], [0.001, 4e-4]], s_repeat: 0.4, dof: 8}
  py: {of: y, unit: um, coefficients: [1, -0.05], covariance: [[0.04, 0], [0, 1e-4]],
       pass_covariance: [[0.3, 0], [0, 4e-5]], s_repeat: 0.5, dof: 8}
  sq: {unit: urad, coefficients: [50], covariance: [[4]], pass_covariance: [[9]]}
equations:
  Ex: px + y*sq + 0.002*dir_x
  Ey: py
"""
UNCERTAIN = MACHINE.replace("\ncomponents", "\nconstants: {Z: {value: 40.0, u: 2.0}}\ncomponents")
UNCERTAIN = UNCERTAIN.replace("Ey: py", "Ey: py + Z*sq + 1e-6*Z**2")
GROWING = MACHINE.replace("Ey: py", "Ey: py + (T_bed_degC - 20)*sq*x")


def measured(
    parts: int,
    features: int,
    repeats: int,
    *,
    sigma: float = 0.01,
    z: bool = False,
    keep: float = 1.0,
) -> Points:
    """Points in a random order; `keep` of them, but one of every part and feature.

    The first parts run forward, the others in reverse; a machining time each.
    """
    rng = np.random.default_rng(1)
    n = parts * features * repeats
    part = np.repeat(np.arange(parts), features * repeats)
    feature = np.tile(np.repeat(np.arange(features), repeats), parts)
    place = np.column_stack([rng.uniform(0, 300, (features, 2)), rng.uniform(5, 50, features)])
    place[:, 2] = place[:, 2] if z else np.nan
    nominal = place[feature]
    way = np.where(part < (parts + 1) // 2, 1.0, -1.0)
    cell = part * features + feature
    found = made_points(
        [f"P{i}" for i in part],
        feature,
        [f"h{i}" for i in range(features)],
        nominal + sigma * rng.standard_normal((n, 3)),
        nominal,
        repeat=np.tile(np.arange(repeats) + 1, parts * features),
        time=1.5 * cell,
        direction=np.column_stack([way, -way, np.full(n, np.nan)]),
    )
    kept = rng.random(n) < keep
    kept[np.flatnonzero(part == feature % parts)] = True
    kept[np.flatnonzero(feature == part % features)] = True
    return rows(found, rng.permutation(np.flatnonzero(kept)))


def rows(points: Points, chosen: NDArray[Any]) -> Points:
    arrays: dict[str, Any] = {
        field.name: getattr(points, field.name)[chosen]
        for field in fields(points)
        if isinstance(getattr(points, field.name), np.ndarray)
    }
    covariates = {name: column[chosen] for name, column in points.covariates.items()}
    return replace(points, covariates=covariates, **arrays)


def with_operations(points: Points, names: Sequence[str]) -> Points:
    """Every other feature in the second operation, and so on."""
    return replace(points, operations=tuple(names), operation=points.feature % len(names))


def column_of(points: Points, i: int) -> str:
    name = str(points.features[points.feature[i]])
    code = int(points.operation[i])
    told = len(np.unique(points.operation)) > 1 and code >= 0
    return f"{points.operations[code]} {name}" if told else name


def values_at(points: Points, i: int, at: Mapping[str, float]) -> dict[str, float]:
    own = {f"dir_{a}": points.direction[i, k] for k, a in enumerate(AXES)}
    own |= {"time_min": points.time_min[i], "sequence": float(points.sequence[i])}
    own |= {name: column[i] for name, column in points.covariates.items()}
    return dict(at) | own


def residuals(
    model: MachineModel, points: Points, axes: Sequence[int], at: Mapping[str, float]
) -> FloatArray:
    """Measured less nominal less predicted of each point, one prediction a point."""
    found = []
    for i in range(len(points)):
        one = predict(model, ["p"], points.nominal[i : i + 1], values_at(points, i, at))
        mean = [one.mean[one.row("p", AXES[a])] for a in axes]
        found.append((points.measured[i] - points.nominal[i])[list(axes)] - mean)
    return np.array(found)


def by_cell(points: Points, errors: FloatArray) -> dict[Cell, list[FloatArray]]:
    found: dict[Cell, list[FloatArray]] = defaultdict(list)
    for i, error in enumerate(errors):
        found[points.parts[points.part[i]], column_of(points, i)].append(error)
    return found


def moved(points: Points, errors: FloatArray, axes: Sequence[int], *, turning: bool) -> FloatArray:
    """Errors less the rigid motion of each part, operation and repeat, by least squares."""
    left = errors.copy()
    groups: dict[tuple[int, int, int], list[int]] = defaultdict(list)
    for i in range(len(points)):
        groups[int(points.part[i]), int(points.operation[i]), int(points.repeat[i])].append(i)
    for inside in groups.values():
        columns = [np.tile(np.eye(len(axes))[k], len(inside)) for k in range(len(axes))]
        if turning:
            x, y = points.nominal[inside, 0], points.nominal[inside, 1]
            turn = np.zeros((len(inside), len(axes)))
            turn[:, 0], turn[:, 1] = -(y - y.mean()), x - x.mean()
            columns.append(turn.ravel() / 100)
        X = np.column_stack(columns)
        own = errors[inside].ravel()
        left[inside] = (own - X @ np.linalg.lstsq(X, own, rcond=None)[0]).reshape(len(inside), -1)
    return left


def codes(warned: tuple[Finding, ...]) -> list[str]:
    return [item.code for item in warned]


def warm(points: Points, seed: int = 3) -> Points:
    """The points with a temperature of their own each."""
    T = 20 + np.random.default_rng(seed).uniform(0, 5, len(points))
    return replace(points, covariates={"T_bed_degC": T})


def check_against_loop(model: MachineModel, points: Points, table: ResidualTable) -> None:
    """Means, counts and places, cell by cell."""
    axes = ["xyz".index(axis) for axis in table.axes]
    errors = residuals(model, points, axes, {})
    cells = by_cell(points, errors)
    places = by_cell(points, points.nominal)
    for p, part in enumerate(table.parts):
        for h, feature in enumerate(table.features):
            own = cells.get((part, feature), [])
            assert table.repeats[p, h] == len(own)
            if not own:
                assert np.isnan(table.errors[p, h]).all()
                continue
            mean = sum(own) / len(own)
            np.testing.assert_allclose(table.errors[p, h], mean, rtol=0, atol=1e-13)
            place = sum(places[part, feature]) / len(own)
            np.testing.assert_allclose(table.places[p, h], place, rtol=1e-14)
    assert len(cells) == (table.repeats > 0).sum()


def check_factors(model: MachineModel, points: Points, table: ResidualTable) -> None:
    """J C J' of all parts together and J D J' of each, from predictions of the points."""
    named = [values_at(points, i, {}) for i in range(len(points))]
    values = {name: np.array([own[name] for own in named]) for name in model.covariates()}
    ids = [str(i) for i in range(len(points))]
    whole, eye = predict(model, ids, points.nominal, values), np.eye(len(model.axes))
    P, H, A = table.errors.shape
    M = np.zeros((P, H, A, len(points), A))
    for i in range(len(points)):
        p = table.parts.index(points.parts[points.part[i]])
        h = table.features.index(column_of(points, i))
        M[p, h, :, i] = eye / table.repeats[p, h]
    there = (table.repeats > 0).ravel()
    mean = M.reshape(P * H, A, -1)[there].reshape(-1, len(points) * A)

    def flat(factor: FloatArray) -> FloatArray:
        wide = np.broadcast_to(factor, (P, *factor.shape[1:]))
        return wide.reshape(P * H, A, -1)[there].reshape(-1, factor.shape[-1])

    C = flat(table.common)
    known = sum(b.G @ b.C @ b.G.T for b in whole.blocks)
    expected = mean @ np.asarray(known) @ mean.T
    size = np.abs(expected).max()
    np.testing.assert_allclose(C @ C.T, expected, rtol=0, atol=1e-9 * size)
    D = sum(b.G @ drawable_passes(b.D, b.C) @ b.G.T for b in whole.blocks)
    expected = mean @ np.asarray(D) @ mean.T
    F = flat(table.of_part)
    of = np.repeat(np.repeat(np.arange(P), H)[there], A)
    same = of[:, None] == of
    size = np.abs(expected).max()
    np.testing.assert_allclose((F @ F.T)[same], expected[same], rtol=0, atol=1e-9 * size)
