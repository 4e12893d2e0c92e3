"""A table of residuals posed as a problem of strata, candidates and a likelihood."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.analyses.close_loop.design import Design, design_of, smooth_covariance
from mtu_cli.analyses.close_loop.likelihood import Likelihood
from mtu_cli.analyses.close_loop.missing import interaction, missing
from mtu_cli.analyses.close_loop.strata import INTERACTION, LINE, PART, Strata, strata_of
from mtu_cli.model.effect_library import Candidate
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

NOTABLE = 0.05
"""Share of the level's predicted variance from which a line's scatter is a stratum of its own."""
FEWEST_FOR_BENDS = 3
SAME = 1e-6
"""Of a direction; less is left of none but rounding."""
VOID = 1e-6
"""Share of a stratum's coordinates below which nothing of it is left."""


def posed(
    table: ResidualTable,
    candidates: Sequence[Candidate],
    scatter: Sequence[str] = (),
    of_features: FloatArray | None = None,
    step: Callable[[], None] = lambda: None,
) -> Likelihood:
    """The likelihood of a table's errors in its strata with the columns of its candidates, beside
    motions of whole parts that `scatter`, which are lines of their own, the last of each axis;
    `of_features` (A,) mm^2 is then the variance of what is alike in all parts.
    """
    there = np.isfinite(table.errors).all(axis=2) & table.there
    gaps = missing(there, free_lines(table))
    errors = gaps.of_axes(table.errors)
    scale = _scale(errors, steps_of(table), gaps.lines)
    errors, steps = errors / scale, steps_of(table) / scale
    strata = _strata(table, errors, scatter)
    if of_features is not None:
        strata = _with_moved_means(strata, errors, len(scatter), of_features / scale**2)
    design = design_of(table, strata, candidates, scale, gaps, step)
    n = _dof(design)
    design.kernels = tuple(k for k in design.kernels if all(n[s] > 0 for s in k.strata))
    y = np.where(n[strata.labels()] > 0, strata.coordinates(errors), 0.0)
    variance, axis = np.zeros(len(steps)), np.array(strata.axis)
    for s in strata.of(INTERACTION):
        part = y[strata.slices[s]]
        variance[axis[s]] = part @ part / max(n[s], 1.0)
    least = steps[axis] ** 2 / 12
    # Repeats that scatter less than half a step share their rounding: so do means of features.
    first = strata.at[:, 0]
    means = np.isin(np.arange(len(axis)), strata.labels()[first[first >= 0]])
    shared = means & (variance[axis] < steps[axis] ** 2 / 4)
    least = np.where(shared, strata.shape[0] * least, least)
    known = _known(design, len(scatter), variance, n)
    return Likelihood(design, y, errors.mean(axis=(0, 1)), n, known, least)


def _dof(design: Design) -> FloatArray:
    """Degrees of freedom (S,): less the missing cells and what a datum freed."""
    strata = design.strata
    P, H, A = strata.shape
    n = strata.sizes.copy()
    for s in strata.of(INTERACTION):
        n[s] -= design.gaps.count
    axis, _, j = np.unravel_index(strata.place, (A, P, H))
    taken = np.zeros(len(n))
    for motion in design.table.motions:
        for k in range(motion.Q.shape[1]):
            one = np.zeros((H, A))
            one[motion.columns] = motion.Q[:, k].reshape(len(motion.columns), A)
            share = np.einsum("ha,ahj->aj", one, strata.of_features) ** 2
            of_strata = np.bincount(strata.labels(), share[axis, j], minlength=len(n))
            taken += of_strata * len(motion.rows) / P
    left = n - taken
    # A datum that takes a stratum leaves nothing of it but rounding.
    return np.where(left > VOID * n, np.maximum(left, 1.0), 0.0)


def _known(
    design: Design, moving: int, variance: FloatArray, n: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Sums of squares and degrees of freedom (S,) of the parts' scatter by the model's D, but for
    the last lines of each axis, which are `moving`.
    """
    strata, table = design.strata, design.table
    squares, dof = np.zeros((2, len(n)))
    if not table.of_part.shape[3]:
        return squares, dof
    own = min(float(table.pass_dof), 1e4)
    F = table.of_part / design.scale
    for s in (*strata.of(PART), *strata.of(LINE)):
        a, first = strata.axis[s], strata.place[strata.slices[s].start]
        line = int(first) % strata.shape[1]
        lines = sum(strata.axis[other] == a for other in strata.of(LINE))
        if n[s] == 0 or line > lines - moving:
            continue
        direction = strata.of_features[a][:, line]
        size = float(np.mean(np.sum(np.einsum("h,phr->pr", direction, F[:, :, a]) ** 2, 1)))
        if size > 0:
            dof[s], squares[s] = own, own * (variance[a] + size)
    return squares, dof


def steps_of(table: ResidualTable) -> FloatArray:
    """The resolution (A,) of errors, mm."""
    steps = np.zeros(table.errors.shape[2])
    steps[: len(table.resolution)] = table.resolution
    return steps


def free_lines(table: ResidualTable) -> FloatArray:
    """Orthonormal directions (H, k) in which each part is free: its level, and of readings the
    lines that passes move along.
    """
    H = len(table.features)
    level = np.full((H, 1), 1 / np.sqrt(H))
    return np.column_stack([level, _reading_lines(table)]) if table.component else level


def _scale(errors: FloatArray, steps: FloatArray, lines: FloatArray) -> float:
    """A size of the errors: their interaction's standard deviation, else their own."""
    inner = [float(np.std(interaction(own, lines))) for own in np.moveaxis(errors, 2, 0)]
    largest = float(np.abs(errors).max())
    sizes = (max(inner), float(np.std(errors)), float(steps.max()), largest)
    return next((size for size in sizes if size > 1e-12 * max(largest, 1e-300)), 1.0)


def _strata(table: ResidualTable, errors: FloatArray, moving: Sequence[str]) -> Strata:
    P, readings = len(errors), table.component is not None
    lines = _lines(table)
    for lever in (lever_of(name, table.axes, table.mean_places) for name in moving):
        if lever is not None:
            lines = [_with_line(own, lever[:, a]) for a, own in enumerate(lines)]
    along = _along(table) if readings and P >= FEWEST_FOR_BENDS else None
    rough = None if along is None else smooth_covariance(along)
    result = strata_of(P, lines, features_scatter=not readings, roughness=rough)
    bends = 0.0 if rough is None else own_bends(result, errors)
    if not bends:
        return result
    return strata_of(P, lines, features_scatter=not readings, roughness=rough, bends=bends)


def _with_moved_means(
    strata: Strata, errors: FloatArray, moving: int, of_features: FloatArray
) -> Strata:
    """Strata in which the mean of the parts along their last lines, which are `moving`, scatters as
    it must: by v_features + v_line - v_inner.
    """
    y, spread = strata.coordinates(errors), strata.spread.copy()
    P, H, A = strata.shape
    _, _, j = np.unravel_index(strata.place, (A, P, H))
    variance = [float(np.mean(y[part] ** 2)) for part in strata.slices]
    for s in strata.of(INTERACTION):
        a = strata.axis[s]
        for line in [own for own in strata.of(LINE) if strata.axis[own] == a][-moving:]:
            more = max(variance[line] - variance[s], 0.0) / of_features[a]
            spread[strata.at[a, 0, j[strata.slices[line].start]]] *= np.sqrt(1 + more)
    return replace(strata, spread=spread)


def _along(table: ResidualTable) -> FloatArray | None:
    """Places (H,) along the axis that the readings of a component were taken along."""
    places = table.mean_places
    spans = np.nan_to_num(np.ptp(places, axis=0))
    i = int(np.argmax(spans))
    return places[:, i] if spans[i] > 0 and len(np.unique(places[:, i])) > 3 else None


def _lines(table: ResidualTable) -> list[FloatArray]:
    """Orthonormal directions (H, k) by axis along which whole parts move beside their level."""
    _, H, A = table.errors.shape
    if table.component is not None:
        return [_reading_lines(table)] * A
    result = []
    for F in np.moveaxis(table.of_part.mean(axis=0), 1, 0):
        whole = max(float(np.sum(F.mean(axis=0) ** 2)) * H, 1e-300)
        U, s, _ = np.linalg.svd(F - F.mean(axis=0), full_matrices=False)
        result.append(U[:, s**2 > NOTABLE * whole][:, :2])
    return result


def _with_line(lines: FloatArray, direction: FloatArray) -> FloatArray:
    """Orthonormal lines (H, k) with one more of features, beside their level."""
    rest = direction - direction.mean()
    rest = rest - lines @ (lines.T @ rest)
    size = float(np.linalg.norm(rest))
    return np.column_stack([lines, rest / size]) if size > SAME else lines


def lever_of(name: str, axes: tuple[str, ...], places: FloatArray) -> FloatArray | None:
    """The unit pattern (H, A) of a small turn or growth of a whole part."""
    if not {*axes} <= {*AXES} or ("rotation" in name and not {"x", "y"} <= {*axes}):
        return None
    q = places[:, [AXES.index(axis) for axis in axes]]
    q = q - q.mean(axis=0)
    if "rotation" in name:
        turned, (i, j) = np.zeros_like(q), map(axes.index, "xy")
        turned[:, i], turned[:, j] = -q[:, j], q[:, i]
        q = turned
    size = np.linalg.norm(q)
    return q / size if size > 0 else None


def _reading_lines(table: ResidualTable) -> FloatArray:
    """Orthonormal directions (H, k) of passes beside their level: slope, direction, and both."""
    columns, along = [np.ones(len(table.features))], _along(table)
    columns += [] if along is None else [along]
    sign = next((v for k, v in table.covariates.items() if k.startswith("dir_")), None)
    if sign is not None and sign.shape == (1, len(table.features)):
        columns.append(np.asarray(sign[0], float))
        columns += [] if along is None else [sign[0] * (along - along.mean())]
    X = np.column_stack(columns)
    left = np.abs(np.diag(np.linalg.qr(X, mode="r")))
    Q, R = np.linalg.qr(X[:, left > 1e-8 * np.linalg.norm(X, axis=0)])
    return np.asarray((Q * np.sign(np.diag(R)))[:, 1:])


def own_bends(strata: Strata, errors: FloatArray) -> float:
    """The REML estimate of the variance of the parts' own bends over the interaction's, from
    differences between parts.
    """
    P, H, A = strata.shape
    y = strata.coordinates(errors)
    _axis, i, j = np.unravel_index(strata.place, (A, P, H))
    inner = np.isin(strata.labels(), strata.of(INTERACTION)) & (i > 0)
    squares, count = (np.bincount(j[inner], w, H) for w in (y[inner] ** 2, np.ones(inner.sum())))
    grid = np.concatenate([[0.0], np.geomspace(0.01, 1000, 40)])
    spread = 1 + grid[:, None] * strata.bends
    left = np.maximum((squares / spread).sum(axis=1), 1e-300)
    deviance = (count * np.log(spread)).sum(axis=1) + count.sum() * np.log(left)
    return float(grid[int(np.argmin(deviance))])
