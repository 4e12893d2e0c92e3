"""The model at measured cells: what it predicts, and factors of what its uncertainty adds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.model.residual_layout import filled
from mtu_cli.close_loop_sealed.model_slice import Cells
from mtu_cli.language import names
from mtu_cli.model.covariates import rows_of
from mtu_cli.model.machine_model import AXES, TIME, MachineModel, design, sensors_of, theta
from mtu_cli.model.prediction import constant_effects
from mtu_cli.model.temperatures import temperature_gradients
from mtu_cli.model.variance import component_blocks, drawable_passes
from mtu_cli.model.visits import IntArray
from mtu_cli.stats.least_squares import FloatArray

PIECE = 8192
"""Measurements predicted at once, so that their design matrix stays in the cache."""
NEGLIGIBLE = 1e-13
"""Share of the largest variance below which a direction of a factor is rounding."""
ROUNDING = 1e-13

Values = Mapping[str, FloatArray | float]
Factors = dict[tuple[str, ...], FloatArray]
"""Factors (m, a, r) by the quantities that they are of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CellModel:
    """The model at n measurements and their cells.

    `predicted` (n, a) mm. `common` (P or 1, H, a, K) and `of_part` (P or 1, H, a, R): factors F
    of the covariances F F' that all parts share and that every part draws anew, mm; first
    dimension 1 where all parts have the same.
    """

    predicted: FloatArray
    common: FloatArray
    of_part: FloatArray


def pass_dof(model: MachineModel) -> float:
    """The fewest degrees of freedom that a pass-to-pass covariance of the model was estimated
    with; infinite where none was estimated.
    """
    own = [
        term.estimate.pass_dof
        for term in model.terms
        if np.any(term.estimate.pass_covariance) and term.estimate.pass_dof > 0
    ]
    together = [group.pass_dof for group in model.joint if group.pass_dof > 0]
    return float(min([*own, *together], default=np.inf))


def read_ranges(model: MachineModel) -> dict[str, tuple[float, float]]:
    """From where to where each axis was read, mm, by the readings of all components along it."""
    found: dict[str, tuple[float, float]] = {}
    for term in model.terms:
        axis, ends = term.estimate.of, term.estimate.position_range
        if axis is not None and ends is not None:
            low, high = found.get(axis, ends)
            found[axis] = (min(low, ends[0]), max(high, ends[1]))
    return found


def covariance_root(C: FloatArray) -> FloatArray:
    """F (k, r) with C = F F', r the rank; what is negative by rounding counts as 0.

    Level and slope differ in unit: the rank is judged with variances scaled to 1.
    """
    scale = np.sqrt(np.maximum(np.diag(C), 0.0))
    unit = np.where(scale > 0, scale, 1.0)
    size, vectors = np.linalg.eigh(C / np.outer(unit, unit))
    kept = size > NEGLIGIBLE * len(C) * max(float(size[-1]), 0.0)
    found: FloatArray = scale[:, None] * vectors[:, kept] * np.sqrt(size[kept])
    return found


def compressed(factor: FloatArray) -> FloatArray:
    """The same covariance F F' with as few columns as it has directions; F (..., R)."""
    if not factor.size:
        return factor[..., :0]
    flat = factor.reshape(-1, factor.shape[-1])
    size, vectors = np.linalg.eigh(flat.T @ flat)
    kept = size > NEGLIGIBLE * max(float(size[-1]), 0.0)
    found: FloatArray = (flat @ vectors[:, kept]).reshape(*factor.shape[:-1], int(kept.sum()))
    return found


def cell_model(
    model: MachineModel,
    places: FloatArray,
    values: Values,
    cells: Cells,
    shapes: Mapping[str, tuple[int, ...]],
) -> CellModel:
    """Predictions at `places` (n, 3) mm under the covariates `values`, as `predict` makes them.

    Measurements that differ in nothing the equations hold are predicted once. `shapes` are
    those of the covariates' tables: the noise of a temperature that all points share is common
    to all parts, that of one reading a part is of the part; that of a reading a point, as the
    components' repeatability, adds to the scatter of single cells and is in neither factor.
    A drift with a lag is given the history of all measurements.
    """
    every = _inputs(model, places, values)
    # What lags is the mean over the measurements of a moment: all of them count.
    lagged = _lagged(model)
    if not lagged and _determined(every, cells.column, cells.columns):
        rows = first_of(cells.column, cells.columns)
        at_once = _evaluated(model, places, values, rows, shapes)
        common, of_part = (
            compressed(_end_to_end([item]))[None] for item in (at_once.shared, at_once.drawn)
        )
        return CellModel(predicted=at_once.mean[cells.column], common=common, of_part=of_part)
    by_cell = not lagged and _determined(every, cells.index, len(cells.there))
    return _by_cell(model, places, values, cells, shapes, by_cell=by_cell)


def _by_cell(
    model: MachineModel,
    places: FloatArray,
    values: Values,
    cells: Cells,
    shapes: Mapping[str, tuple[int, ...]],
    *,
    by_cell: bool,
) -> CellModel:
    predicted = np.empty((len(places), len(model.axes)))
    pieces: list[_Evaluated] = []
    for start, end in _pieces(model, cells):
        last = cells.starts[end] if end < len(cells.starts) else len(places)
        rows = cells.order[cells.starts[start] : last]
        if by_cell:
            found = _evaluated(model, places, values, cells.first[start:end], shapes)
            predicted[rows] = np.repeat(found.mean, cells.count[start:end], axis=0)
        else:
            found = _evaluated(model, places, values, rows, shapes)
            predicted[rows] = found.mean
            found = found.averaged(cells.starts[start:end] - cells.starts[start])
        pieces.append(found)
    there = cells.repeats > 0
    common, of_part = (
        compressed(_alike(filled(cells.table(_end_to_end(items), 0.0), there)))
        for items in ([piece.shared for piece in pieces], [piece.drawn for piece in pieces])
    )
    return CellModel(predicted=predicted, common=common, of_part=of_part)


def _alike(factor: FloatArray) -> FloatArray:
    """(1, H, a, R) of a factor (P, H, a, R) that is the same for all parts but for rounding."""
    size = ROUNDING * np.abs(factor).max(initial=0.0)
    return factor[:1] if (np.abs(factor - factor[:1]) <= size).all() else factor


def _end_to_end(pieces: list[Factors]) -> FloatArray:
    """Factors of all pieces (m, a, R), one below the other; a term that vanishes at a piece's
    places is not among its own.
    """
    widths = {key: factor.shape[2] for piece in pieces for key, factor in piece.items()}
    rows = []
    for piece in pieces:
        m, a, _ = next(iter(piece.values())).shape
        own = [piece.get(key, np.zeros((m, a, width))) for key, width in widths.items()]
        rows.append(np.concatenate(own, axis=2))
    return np.concatenate(rows)


def _pieces(model: MachineModel, cells: Cells) -> Iterator[tuple[int, int]]:
    """Ranges of cells; all at once where a lag needs the history of all."""
    total = len(cells.there)
    step = total if _lagged(model) else max(1, PIECE // int(cells.count.max()))
    return ((start, min(start + step, total)) for start in range(0, total, step))


def _lagged(model: MachineModel) -> bool:
    return any(bool(drift.time_constants.any()) for drift in model.drifts())


def _inputs(model: MachineModel, places: FloatArray, values: Values) -> list[FloatArray]:
    """All columns (n,) that a prediction may depend on."""
    fixed = model.position_constants()
    found = [places[:, i] for i, axis in enumerate(AXES) if axis not in fixed]
    needed = {*model.covariates(), TIME}
    return [*found, *(np.asarray(v) for k, v in values.items() if k in needed and np.ndim(v))]


def first_of(code: IntArray, size: int) -> IntArray:
    """The first measurement of every code."""
    first = np.empty(size, np.int64)
    first[code[::-1]] = np.arange(len(code))[::-1]
    return first


def _determined(columns: list[FloatArray], code: IntArray, size: int) -> bool:
    """Whether all columns are functions of the code."""
    first = first_of(code, size)[code]
    return all(_same(column, column[first]).all() for column in columns)


def _same(a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
    return np.asarray((a == b) | (np.isnan(a) & np.isnan(b)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Evaluated:
    """The model at m rows: `mean` (m, a) mm, factors (m, a, r) that all parts share and that
    each draws anew.
    """

    mean: FloatArray
    shared: Factors
    drawn: Factors

    def averaged(self, starts: IntArray) -> _Evaluated:
        """The factors averaged over runs of rows; the mean stays as it is."""
        count = np.diff(np.r_[starts, len(self.mean)])[:, None, None]
        shared, drawn = (
            {key: np.add.reduceat(factor, starts, axis=0) / count for key, factor in own.items()}
            for own in (self.shared, self.drawn)
        )
        return _Evaluated(mean=self.mean, shared=shared, drawn=drawn)


def _evaluated(
    model: MachineModel,
    places: FloatArray,
    values: Values,
    rows: IntArray,
    shapes: Mapping[str, tuple[int, ...]],
) -> _Evaluated:
    """The model at the measurements `rows` (m,)."""
    given, place = rows_of(values, rows), places[rows]
    centre = design(model, place, given)
    size = (len(rows), len(model.axes))
    blocks = {
        block.names: block
        for block in component_blocks(model, centre.J, centre.levers, centre.columns)
    }
    mean = centre.J @ theta(model) + centre.remainder
    for name, alone in _uncertain(model):
        effects = constant_effects(alone, place, given, centre)
        mean += effects.shift
        blocks |= {(name, *block.names): block for block in effects.blocks}
    shared, drawn = {}, {}
    for key, block in blocks.items():
        D = drawable_passes(block.D, block.C)
        shared[key] = _by_row(block.G @ covariance_root(block.C), size)
        drawn[key] = _by_row(block.G @ covariance_root(D), size)
    read = {sensor: shapes.get(sensor, (1, 1)) for sensor in sensors_of(model)}
    # The noise of a reading of its own at every cell is none of the two.
    if any(shape[1] == 1 for shape in read.values()):
        for sensor, column in temperature_gradients(
            model, place, centre.levers, noise=True
        ).items():
            kind = shared if read[sensor] == (1, 1) else drawn if read[sensor][1] == 1 else {}
            kind[(sensor,)] = _by_row(column[:, None], size)
    return _Evaluated(mean=mean.reshape(size), shared=shared, drawn=drawn)


def _uncertain(model: MachineModel) -> list[tuple[str, MachineModel]]:
    """Each uncertain constant that an equation holds, and the model in which it alone is so."""
    used: set[str] = set(AXES)
    for node in (
        *(lever for term in model.terms for lever in term.levers.values()),
        *(node for nodes in model.remainders.values() for node in nodes),
    ):
        used |= set(names(node))
    exact = {name: (value, 0.0) for name, (value, _) in model.constants.items()}
    return [
        (name, replace(model, constants=exact | {name: pair}))
        for name, pair in model.constants.items()
        if pair[1] != 0 and name in used
    ]


def _by_row(factor: FloatArray, size: tuple[int, int]) -> FloatArray:
    """(m * a, r) as (m, a, r), r perhaps 0."""
    return factor.reshape(*size, factor.shape[1])
