"""Measured minus predicted, as parts x columns x axes, with what the model's own uncertainty
adds to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.model.columns import (
    resolution,
    text_warnings,
    without_written_errors,
)
from mtu_cli.close_loop_sealed.model.covariate_tables import table_covariates, without_gaps
from mtu_cli.close_loop_sealed.model.residual_factors import (
    Values,
    cell_model,
    compressed,
    first_of,
    pass_dof,
    read_ranges,
)
from mtu_cli.close_loop_sealed.model.residual_layout import (
    Layout,
    Motions,
    Visited,
    filled,
    freed,
    layout_of,
    motions_of,
    visited_of,
)
from mtu_cli.close_loop_sealed.model_slice import Cells, VisitScatter, visit_scatter
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, error, finding
from mtu_cli.model.covariates import needed_covariates, point_columns, rows_of
from mtu_cli.model.effect_columns import guess_warnings
from mtu_cli.model.features import outside_warnings
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.machine_model import places as fixed_places
from mtu_cli.model.measured import check_repeats, left_out, no_shared_axis, not_measured
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.visits import Datum, IntArray, axes_of, only_rows
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, kw_only=True)
class ResidualTable:
    """Measured minus predicted, as P parts x H columns x A axes; errors in mm (or rad).

    `parts` in order of manufacture; of readings, passes in order of time. `features` name the
    columns: features, "operation feature" where there are several operations; of readings,
    positions with their direction where there are two. `axes` name the errors: axes, or, of a
    `component` that has none, the component. `unit` is "um" or "arcsec", to show them in.

    `errors` (P, H, A) are means over `repeats` (P, H), nan where there are none;
    `repeat_variance` (A,) is that of one measurement within its cell with `repeat_dof` degrees
    of freedom, nan without. `places` (P, H, 3) mm, nan where a coordinate is not known.
    `operation` (H,) are codes of `operations`. `covariates` broadcast to (P, H) in the smallest
    shape. `common` (P or 1, H, A, K) and `of_part` (P or 1, H, A, R) are factors F of the
    covariances F F' of the errors by what all parts share (the coefficients, C) and by what
    each part draws anew (the pass-to-pass covariance, D). `datum` has been projected out of
    errors and factors; `fitted_degree` is that of the polynomial that the readings themselves
    gave (-1: none). `pass_dof` are the degrees of freedom that D was estimated with; `travel`
    the ends of the machine's axes, mm, where they are known, `read` those of the readings that the
    model was fitted to; `resolution` (A,) the step, mm, that measured coordinates were rounded to,
    0 where there is none (empty: none is known).
    `scatter_known`: false where the model has scatter of parts (passes) of a size that nothing
    told before. `visit`: what the machine's repeatability makes of one entry, where it is known.
    """

    axes: tuple[str, ...]
    component: str | None
    unit: str
    parts: tuple[str, ...]
    features: tuple[str, ...]
    errors: FloatArray
    repeats: IntArray
    repeat_variance: FloatArray
    repeat_dof: int
    places: FloatArray
    operations: tuple[str, ...]
    operation: IntArray
    covariates: dict[str, FloatArray]
    common: FloatArray
    of_part: FloatArray
    datum: Datum = "none"
    fitted_degree: int = -1
    pass_dof: float = np.inf
    travel: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    read: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    resolution: tuple[float, ...] = ()
    scatter_known: bool = True
    visit: VisitScatter | None = None

    @property
    def there(self) -> NDArray[np.bool_]:
        """Which cells (P, H) were measured."""
        return self.repeats > 0

    def freed(self, values: FloatArray) -> FloatArray:
        """Columns (P or 1, H, A, K) less the freedoms of the datum in each part, as the errors
        and factors are; cells that were not measured keep theirs. The first dimension stays 1
        where all parts are alike.
        """
        return freed(values, self.motions, len(self.parts))

    @cached_property
    def motions(self) -> tuple[Motions, ...]:
        """What the datum lets each part move by, each operation on its own."""
        parts = np.arange(len(self.parts))
        axes = tuple(AXES.index(axis) for axis in self.axes if axis in AXES)
        return motions_of(self.datum, self.places, self.operation, axes, self.there, parts)


def residual_table(
    model: MachineModel,
    points: Points,
    covariates: Mapping[str, float] | None = None,
    datum: Datum = "none",
) -> tuple[ResidualTable, tuple[Finding, ...]]:
    """The table of measured points: E = measured - nominal - (J theta + remainder), the model at
    the points' nominal places and own covariates, `covariates` where they have no such column.

    A `datum` that frees is projected out of every measurement of a part, operation by
    operation, and of the factors. An axis without an equation, or that not every point has, is
    left out with a warning; so are the rows of `without_gaps`, and covariates that are texts.

    Raises InputError for a missing covariate or coordinate, points that cannot be what they
    claim, or points of no axis that an equation is for.
    """
    check_repeats(points)
    warned = left_out(points)
    points, written = without_written_errors(points, model.covariates())
    points, gaps = without_gaps(points, model.covariates())
    warned += [*written, *gaps, *text_warnings(points)]
    axes = _axes(model, points, warned)
    layout = layout_of(points)
    table, errors = _measured(model, points, covariates or {}, axes, layout, warned)
    table = replace(table, resolution=tuple(resolution(points.measured[:, a]) for a in axes))
    if datum == "none":
        return table, tuple(warned)
    table = replace(table, datum=datum)
    visited = visited_of(points, layout, axes, datum, table.places)
    lost = visited.lost(layout.cells.column)
    if lost.any():
        told: list[Finding] = []
        rest = _without_lost(points, lost, datum, told)
        table, more = residual_table(model, rest, covariates, datum)
        return table, (*written, *gaps, *told, *more)
    warned += visited.warnings(table.there, table.operation)
    return _without_motions(table, visited, layout.cells, errors), tuple(warned)


def _measured(
    model: MachineModel,
    points: Points,
    at: Mapping[str, float],
    axes: tuple[int, ...],
    layout: Layout,
    warned: list[Finding],
) -> tuple[ResidualTable, FloatArray]:
    """The table with nothing set free, and the errors (n, A) of the points."""
    cells, columns = layout.cells, point_columns(points)
    needed = needed_covariates(model, points, columns, at, at_nominal=True)
    shown, gaps = table_covariates(columns, cells, (points.file_index, points.sources))
    found = cell_model(model, points.nominal, needed.values, cells, _shapes(shown))
    at_once = _at_once(model, points, needed.values, layout)
    warned += [*needed.warnings, *gaps, *outside_warnings(at_once)]
    warned += guess_warnings(model, points.nominal, needed.values, columns, at)
    own = [model.axes.index(AXES[axis]) for axis in axes]
    errors = points.measured[:, axes] - points.nominal[:, axes] - found.predicted[:, own]
    variance, dof = within(cells, errors)
    place = np.column_stack(list(fixed_places(model, points.nominal).values()))
    return ResidualTable(
        axes=tuple(AXES[axis] for axis in axes),
        component=None,
        unit="um",
        parts=layout.parts,
        features=layout.features,
        errors=cells.table(cells.means(errors)),
        repeats=cells.repeats,
        repeat_variance=variance,
        repeat_dof=dof,
        places=filled(cells.table(cells.means(place)), cells.repeats > 0),
        operations=layout.operations,
        operation=layout.operation,
        covariates=shown,
        common=found.common[:, :, own],
        of_part=found.of_part[:, :, own],
        pass_dof=pass_dof(model),
        read=read_ranges(model),
        visit=visit_scatter(model, at_once, own),
    ), errors


def within(
    cells: Cells, errors: FloatArray, fitted: FloatArray | float = 0.0
) -> tuple[FloatArray, int]:
    """The pooled variance (A,) of one of the errors (n, A) within its cell, and its degrees of
    freedom; motions fitted `fitted` (A,) of the values.
    """
    n = len(errors)
    dof = np.broadcast_to((n - len(cells.there)) * (1 - fitted / n), errors.shape[1])
    # A count that rounding put just below a whole number is that number.
    least = int(dof.min() + 1e-9)
    if least <= 0:
        return np.full(errors.shape[1], np.nan), 0
    return cells.squares(errors) / dof, least


def _axes(model: MachineModel, points: Points, warned: list[Finding]) -> tuple[int, ...]:
    measured = axes_of(points)
    for axis in measured:
        if AXES[axis] not in model.axes:
            name, consequence = AXES[axis], f"errors along {AXES[axis]} are left out"
            warned.append(finding("axis-without-equation", axis=name, consequence=consequence))
    warned += not_measured(model.axes, points)
    axes = tuple(axis for axis in measured if AXES[axis] in model.axes)
    if not axes:
        raise no_shared_axis(model, points, measured)
    return axes


def _shapes(shown: Mapping[str, FloatArray]) -> dict[str, tuple[int, ...]]:
    return {name: value.shape for name, value in shown.items()}


def _at_once(model: MachineModel, points: Points, values: Values, layout: Layout) -> Prediction:
    """The model at the first measurement of every column."""
    rows = first_of(layout.cells.column, len(layout.features))
    return predict(model, layout.features, points.nominal[rows], rows_of(values, rows))


def _without_motions(
    table: ResidualTable, visited: Visited, cells: Cells, errors: FloatArray
) -> ResidualTable:
    """The table with every measurement of a part set free, and then the mean of them.

    Where all measurements of a part have the same features, the second changes nothing.
    """
    free, fitted = visited.free(errors, cells.column)
    variance, dof = within(cells, free, fitted)
    return replace(
        table,
        repeat_variance=variance,
        repeat_dof=dof,
        errors=table.freed(cells.table(cells.means(free))[..., None])[..., 0],
        common=compressed(table.freed(table.common)),
        of_part=compressed(table.freed(table.of_part)),
    )


def _without_lost(
    points: Points, lost: NDArray[np.bool_], datum: Datum, warned: list[Finding]
) -> Points:
    """The points but those of whose errors the motions take all."""
    if lost.all():
        raise error(
            "too-little-data",
            what=f"the datum {datum!r} takes all errors, no measurement has enough features",
            file=points.sources[0].shown,
            expected="more features measured of each part, or --datum none",
        )
    count = int(lost.sum())
    reason = f"in measurements of so few features the datum {datum!r} takes all errors"
    names = [f"{count} of {len(lost)} points"]
    warned.append(finding("not-measured", names=names, count=count, reason=reason))
    return only_rows(points, ~lost)
