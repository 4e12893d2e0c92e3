"""Measured minus predicted, as parts x features x axes, with the model's uncertainty.

Errors by the coefficients' covariance C are common to all parts; those by the pass-to-pass
covariance D each part draws anew. Readings become such tables in `reading_residuals`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mtu_cli.files.readings import Points
from mtu_cli.files.study import Datum
from mtu_cli.findings import Finding, error, finding
from mtu_cli.model.covariates import (
    needed_covariates,
    point_columns,
    rows_of,
    table_covariates,
    text_warnings,
    without_gaps,
    without_repeated,
)
from mtu_cli.model.features import guess_warnings, outside_warnings
from mtu_cli.model.machine_model import AXES, Covariates, MachineModel, design, sensors_of
from mtu_cli.model.machine_model import places as fixed_places
from mtu_cli.model.measured import judged_axes, roundings
from mtu_cli.model.prediction import constant_effects, predict, temperature_gradients
from mtu_cli.model.variance import component_blocks, drawable_passes
from mtu_cli.model.visits import (
    BoolArray,
    Cells,
    IntArray,
    Motions,
    check_repeats,
    datum_errors,
    incomplete_datum,
    motions_of,
    only_rows,
    operations_of,
    without_motions,
)
from mtu_cli.stats.covariance import factor_of
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, kw_only=True)
class ResidualTable:
    """Measured minus predicted, as P parts x H features x A axes; errors in mm (or rad).

    `parts` in order of manufacture; of readings, passes in order of time. `features` name the
    columns: features, "operation feature" where there are several operations; of readings,
    positions with their direction where there are two. `axes` name the errors: axes, or, of a
    `component` that has none, the component. `unit` is "um" or "arcsec", to show them in. `errors`
    (P, H, A) are means over `repeats` (P, H), nan where there are none. `places` (P, H, 3) mm, nan
    where a coordinate is not known. `operation` (H,) are codes of `operations`. `covariates`
    broadcast to (P, H) in the smallest shape. `common` (P or 1, H, A, K) and `of_part` (P or 1, H,
    A, R) are factors F of the covariances F F' of the errors by what all parts share (C) and by
    what each part draws anew (D; of readings none where D is not known). `datum` has been projected
    out of errors and factors; `fitted_degree` is that of the polynomial that the readings
    themselves gave (-1: none). `pass_dof` are the degrees of freedom of D; `resolution` (A,) the
    step, mm or rad, of the last digit of what was measured (empty: not known).
    """

    axes: tuple[str, ...]
    component: str | None
    unit: str
    parts: tuple[str, ...]
    features: tuple[str, ...]
    errors: FloatArray
    repeats: IntArray
    places: FloatArray
    operations: tuple[str, ...]
    operation: IntArray
    covariates: dict[str, FloatArray]
    common: FloatArray
    of_part: FloatArray
    datum: Datum = "none"
    fitted_degree: int = -1
    pass_dof: float = np.inf
    resolution: tuple[float, ...] = ()

    @property
    def there(self) -> BoolArray:
        """Which cells (P, H) were measured."""
        return self.repeats > 0

    @property
    def nouns(self) -> tuple[str, str]:
        """What a row and a column are called."""
        return ("part", "feature") if self.component is None else ("pass", "position")

    @property
    def plurals(self) -> tuple[str, str]:
        """The same of several."""
        return ("parts", "features") if self.component is None else ("passes", "positions")

    def without_datum(self, values: FloatArray) -> FloatArray:
        """Columns (P or 1, H, A, K) less the best-fit motions of the datum in each part, as the
        errors and factors are; cells that were not measured keep theirs.
        """
        return without_motions(values, self.motions, len(self.parts))

    @cached_property
    def mean_places(self) -> FloatArray:
        """Places (H, 3) of the features, means over the parts where they are known; else nan."""
        finite = np.isfinite(self.places)
        count = finite.sum(axis=0)
        total = np.where(finite, self.places, 0.0).sum(axis=0)
        return np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)

    @cached_property
    def motions(self) -> tuple[Motions, ...]:
        """The motions of each part that the datum removes, by operation."""
        axes = tuple(AXES.index(axis) for axis in self.axes if axis in AXES)
        return motions_of(self.datum, self.places, self.operation, axes, self.there)

    def ranges(self, columns: Iterable[str]) -> dict[str, list[float]]:
        """Lowest and highest value over the measured cells of positions and those `columns` that
        the table has.
        """
        values = {axis: self.places[..., i] for i, axis in enumerate(AXES)} | self.covariates
        result = {}
        for name in dict.fromkeys(columns):
            column = np.broadcast_to(values.get(name, np.nan), self.there.shape)[self.there]
            if len(column) and np.isfinite(column).all():
                result[name] = [float(column.min()), float(column.max())]
        return result


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The parts (rows) and features (columns) of a table, its `cells`, in which n measurements
    stand, and the nominal place (n, 3) mm of each of these.
    """

    parts: tuple[str, ...]
    features: tuple[str, ...]
    cells: Cells
    nominal: FloatArray
    operations: tuple[str, ...] = ("",)
    operation: IntArray

    @cached_property
    def places(self) -> FloatArray:
        """The places (P, H, 3) mm of the cells."""
        means = self.cells.means(self.nominal)
        return filled(self.cells.table(means), self.cells.repeats > 0)

    def table(self, errors: FloatArray, **facts: Any) -> ResidualTable:
        """The table of errors (n, A), each the mean of its cell."""
        return ResidualTable(
            parts=self.parts,
            features=self.features,
            operations=self.operations,
            operation=self.operation,
            places=self.places,
            errors=self.cells.table(self.cells.means(errors)),
            repeats=self.cells.repeats,
            **facts,
        )


def filled(table: FloatArray, there: BoolArray) -> FloatArray:
    """A table (P, H, ...) whose missing cells hold the mean of their column, or of their part
    where the column has none. Means of equal values keep their digits.
    """
    if there.all():
        return table
    mask = there.reshape(*there.shape, *(1,) * (table.ndim - 2))
    means = []
    for k in (0, 1):
        origin = np.take_along_axis(table, np.expand_dims(mask.argmax(axis=k), k), axis=k)
        away = np.where(mask, table - origin, 0.0).sum(axis=k, keepdims=True)
        means.append(origin + away / np.maximum(mask.sum(axis=k, keepdims=True), 1))
    return np.where(mask, table, np.where(mask.any(axis=0, keepdims=True), *means))


# The table of measured points.


def residual_table(
    model: MachineModel,
    points: Points,
    covariates: Mapping[str, float] | None = None,
    datum: Datum = "none",
) -> tuple[ResidualTable, tuple[Finding, ...]]:
    """The table of measured points: E = measured - nominal - (J theta + remainder), the model at
    the points' nominal places and covariates, `covariates` where they have no such column. A
    `datum` but none is projected out of every measurement of a part and of the factors. An axis
    without an equation, or that not every point has, is left out with a warning; so are covariates
    that repeat the errors or are texts, and rows with one of few gaps in a covariate.

    Raises InputError for a missing covariate or coordinate, points that cannot be what they claim,
    or points of no axis that an equation is for.
    """
    check_repeats(points)
    axes, warnings = judged_axes(model, points, "errors along {} are left out")
    points, repeated = without_repeated(points, model.covariates())
    points, gaps = without_gaps(points, model.covariates())
    warnings += [*repeated, *gaps, *text_warnings(points)]
    points, removals = _estimable(points, axes, datum)
    warnings += removals
    layout = _layout(model, points)
    at, cells, columns = covariates or {}, layout.cells, point_columns(points)
    values, idle = needed_covariates(model, points, columns, at, at_nominal=True)
    tables, more = table_covariates(columns, cells, points, np.arange(len(points)))
    predicted, common, of_part = cell_model(model, points.nominal, values, cells, tables)
    first = np.unique(cells.column, return_index=True)[1]
    once = predict(model, layout.features, points.nominal[first], rows_of(values, first))
    warnings += [*idle, *more, *outside_warnings(once)]
    warnings += guess_warnings(model, points.nominal, values)
    of_axes = [model.axes.index(AXES[axis]) for axis in axes]
    errors = points.measured[:, axes] - points.nominal[:, axes] - predicted[:, of_axes]
    errors = datum_errors(points, errors, axes, datum)[0]
    of_operation = (layout.operation == code for code in np.unique(layout.operation))
    reps = [cells.repeats[:, mask] for mask in of_operation]
    if datum != "none" and any(((n > 0) & (n < n.max(axis=1, keepdims=True))).any() for n in reps):
        warnings.append(incomplete_datum())
    estimates = [x.estimate for x in model.terms if np.any(x.estimate.pass_covariance)]
    dofs = [each.pass_dof for each in estimates] + [group.pass_dof for group in model.joint]
    table = layout.table(
        errors,
        axes=tuple(AXES[axis] for axis in axes),
        component=None,
        unit="um",
        covariates=tables,
        common=common[:, :, of_axes],
        of_part=of_part[:, :, of_axes],
        datum=datum,
        # The fewest that a pass-to-pass covariance of the model was estimated with.
        pass_dof=float(min((dof for dof in dofs if dof > 0), default=np.inf)),
        resolution=tuple(np.sqrt(12 * roundings(points)[list(axes)]).tolist()),
    )
    if datum != "none":
        # Where all measurements of a part have the same features, errors are aligned already.
        table = replace(
            table,
            errors=table.without_datum(table.errors[..., None])[..., 0],
            common=compressed(table.without_datum(table.common)),
            of_part=compressed(table.without_datum(table.of_part)),
        )
    return table, tuple(warnings)


def _estimable(points: Points, axes: tuple[int, ...], datum: Datum) -> tuple[Points, list[Finding]]:
    """The points without the measurements whose errors the datum removes entirely, with a warning.

    Raises InputError where it removes those of all.
    """
    mask = datum_errors(points, points.measured[:, axes], axes, datum)[1]
    if mask.all() and len(mask):
        raise error(
            "too-little-data",
            what=f"the datum {datum!r} takes all errors, no measurement has enough features",
            file=points.sources[0].shown,
            expected="more features measured of each part, or --datum none",
        )
    if count := int(mask.sum()):
        reason = f"in measurements of so few features the datum {datum!r} takes all errors"
        names = [f"{count} of {len(mask)} points"]
        warnings = [finding("not-measured", names=names, count=count, reason=reason)]
        return only_rows(points, ~mask), warnings
    return points, []


def _layout(model: MachineModel, points: Points) -> Layout:
    """Parts by `sequence`, then as they first appear; features as the part file has them, by
    operation first.
    """
    operations, operation = operations_of(points)
    count = len(points.features)
    columns, column = np.unique(
        operation.astype(np.int64) * count + points.feature, return_inverse=True
    )
    of_column = columns // count
    used = [points.features[code % count] for code in columns.tolist()]
    if len(np.unique(of_column)) > 1:
        pairs = zip(of_column.tolist(), used, strict=True)
        used = [f"{operations[code]} {name}".lstrip() for code, name in pairs]
    parts, first, part = np.unique(points.part, return_index=True, return_inverse=True)
    earliest = np.full(len(parts), np.iinfo(np.int64).max)
    np.minimum.at(earliest, part.reshape(-1), points.sequence)
    order = np.lexsort([first, earliest])
    row = np.argsort(order)[part.reshape(-1)]
    return Layout(
        parts=tuple(points.parts[i] for i in parts[order].tolist()),
        features=tuple(used),
        operations=operations,
        operation=of_column,
        cells=Cells(parts=len(parts), columns=len(columns), part=row, column=column.reshape(-1)),
        nominal=np.column_stack(list(fixed_places(model, points.nominal).values())),
    )


# The model at the cells.

NEGLIGIBLE = 1e-13
"""Share of the largest variance, or value, below which something is rounding."""


def cell_model(
    model: MachineModel,
    places: FloatArray,
    values: Covariates,
    cells: Cells,
    by_name: Mapping[str, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Predictions (n, a) mm at `places` (n, 3) mm under the covariates `values`, as `predict` makes
    them, and of the cells the factors F (P or 1, H, a, K) of the covariances F F', mm^2, that all
    parts share and that every part draws anew. `by_name` are the covariates' tables: the noise of a
    temperature that all points share is common to all parts, that of one reading a part is of the
    part; that of a reading a point adds to the scatter of single cells and is in neither factor. A
    drift with a lag has the history of all measurements.
    """
    centre = design(model, places, values)
    of_constants, shift = constant_effects(model, places, values, centre)
    mean = centre.mean + shift
    shared, drawn = [np.zeros((len(mean), 0))], [np.zeros((len(mean), 0))]
    blocks = component_blocks(model, centre.J, centre.levers)
    for block in (*blocks, *of_constants):
        shared.append(block.G @ factor_of(block.C))
        drawn.append(block.G @ factor_of(drawable_passes(block.D, block.C)))
    read = {name: by_name[name].shape if name in by_name else (1, 1) for name in sensors_of(model)}
    if any(shape[1] == 1 for shape in read.values()):
        gradients = temperature_gradients(model, places, centre.levers, noise=True)
        for sensor, column in gradients.items():
            # The noise of one reading a cell is in neither.
            if read[sensor][1] == 1:
                (shared if read[sensor] == (1, 1) else drawn).append(column[:, None])
    size = (len(places), len(model.axes))
    factors = (np.concatenate(columns, axis=1).reshape(*size, -1) for columns in (shared, drawn))
    tables = (cells.table(cells.means(F), 0.0) for F in factors)
    common, of_part = (compressed(filled(F, cells.repeats > 0)) for F in tables)
    return mean.reshape(size), common, of_part


def compressed(factor: FloatArray) -> FloatArray:
    """The same covariances F F' with as few columns as they have directions, F (P, H, A, R); P is 1
    where all parts have the same but for rounding.
    """
    if not factor.size:
        return factor[:1, ..., :0]
    tolerance = NEGLIGIBLE * np.abs(factor).max()
    factor = factor[:1] if (np.abs(factor - factor[:1]) <= tolerance).all() else factor
    flat = factor.reshape(-1, factor.shape[-1])
    size, vectors = np.linalg.eigh(flat.T @ flat)
    nonzero = size > NEGLIGIBLE * max(float(size[-1]), 0.0)
    return (flat @ vectors[:, nonzero]).reshape(*factor.shape[:-1], int(nonzero.sum()))
