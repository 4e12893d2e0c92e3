"""Measured minus predicted, as parts x features x axes, with the model's uncertainty.

Errors by the coefficients' covariance C are common to all parts; those by the pass-to-pass
covariance D each part draws anew. Of readings of a component a pass takes the place of a part, a
target and direction that of a feature.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import Points, Readings
from mtu_cli.files.study import Datum
from mtu_cli.findings import Finding, error, finding
from mtu_cli.model.covariates import (
    needed_covariates,
    point_columns,
    table_covariates,
    text_warnings,
    without_repeated,
)
from mtu_cli.model.estimates import ComponentEstimate, Estimates, covariance_in_run
from mtu_cli.model.estimation import reading_rounding
from mtu_cli.model.features import guess_warnings, outside_warnings, temperature_warnings
from mtu_cli.model.fit import ComponentReadings, component_readings, effects_on_readings
from mtu_cli.model.machine_model import (
    AXES,
    TIME,
    Covariates,
    MachineModel,
    component_alone,
    design,
    places_of,
    sensors_of,
)
from mtu_cli.model.measured import judged_axes, roundings
from mtu_cli.model.prediction import (
    component_blocks,
    constant_effects,
    noise_by_sensor,
    outside_ranges,
)
from mtu_cli.model.visits import (
    Cells,
    Passes,
    check_repeats,
    datum_errors,
    operations_of,
)
from mtu_cli.stats.alignment import Motions, motions_of, without_motions
from mtu_cli.stats.covariance import bounded, drawable_passes, factor_of, reduced_factor
from mtu_cli.stats.groups import distinct, filled_table, group_least, known_mean
from mtu_cli.stats.kernels import MOST_AUTO
from mtu_cli.stats.least_squares import (
    BoolArray,
    FloatArray,
    IntArray,
    least_squares,
    polynomial,
)
from mtu_cli.units import SMALL, UNITS


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
        return known_mean(self.places, axis=0)

    @cached_property
    def motions(self) -> tuple[Motions, ...]:
        """The motions of each part that the datum removes, by operation."""
        axes = tuple(AXES.index(axis) for axis in self.axes if axis in AXES)
        return motions_of(self.datum, self.places, self.operation, axes, self.there)

    @property
    def steps(self) -> FloatArray:
        """The resolution (A,) of the errors, mm or rad; 0 of those that it is not known of."""
        steps = np.zeros(self.errors.shape[2])
        steps[: len(self.resolution)] = self.resolution
        return steps

    @property
    def fitted_powers(self) -> FloatArray:
        """Orthonormal polynomials (H, k) in position that were removed from the readings."""
        if self.fitted_degree < 0:
            return np.zeros((len(self.features), 0))
        places = np.nan_to_num(self.mean_places)
        along = places[:, int(np.argmax(np.ptp(places, axis=0)))]
        degree = min(self.fitted_degree, len(np.unique(along)) - 1)
        u = (along - along.mean()) / max(float(np.ptp(along)), 1e-300)
        return np.asarray(np.linalg.qr(np.vander(u, degree + 1, increasing=True))[0])

    @property
    def along(self) -> FloatArray | None:
        """Places (H,) along the axis that a component was read along; None of fewer than four, and
        of no axis.
        """
        spans = np.nan_to_num(np.ptp(self.mean_places, axis=0))
        along = self.mean_places[:, int(np.argmax(spans))]
        return along if spans.max() > 0 and len(np.unique(along)) > 3 else None

    @property
    def direction(self) -> FloatArray:
        """The direction (H,) in which each place is approached; 0 where it is not one for each."""
        unknown = np.zeros((1, len(self.features)))
        named = (v for name, v in self.covariates.items() if name.startswith("dir_"))
        values = next(named, unknown)
        return (values if values.shape == unknown.shape else unknown)[0]

    @property
    def free_lines(self) -> FloatArray:
        """Orthonormal directions (H, k) in which each part is free: its level, and of readings the
        slope, direction, and both, along which passes move.
        """
        columns = [np.ones(len(self.features))]
        if self.component is not None:
            along, way = self.along, self.direction
            columns += [way] if along is None else [along, way, way * (along - along.mean())]
        X = np.column_stack(columns)
        rest = np.abs(np.diag(np.linalg.qr(X, mode="r")))
        Q, R = np.linalg.qr(X[:, rest > 1e-8 * np.linalg.norm(X, axis=0)])
        return np.asarray(Q * np.sign(np.diag(R)))

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

    def taken(self, index: IntArray, axis: int) -> ResidualTable:
        """The table of some of its parts (axis 0), or of its columns (1)."""
        names = ("parts", "features")[axis]
        count = len(getattr(self, names))

        def take(values: FloatArray) -> FloatArray:
            # What is alike in all parts, or columns, may have one row.
            return values.take(index, axis) if values.shape[axis] == count else values

        of_cells = ("errors", "repeats", "places", "common", "of_part")
        fields: dict[str, Any] = {name: take(getattr(self, name)) for name in of_cells}
        fields[names] = tuple(getattr(self, names)[i] for i in index)
        fields["covariates"] = {name: take(values) for name, values in self.covariates.items()}
        if axis == 1:
            fields["operation"] = self.operation[index]
        return replace(self, **fields)


def table_of(cells: Cells, errors: FloatArray, **facts: Any) -> ResidualTable:
    """The table of errors (n, A), each the mean of its cell."""
    return ResidualTable(
        parts=cells.parts,
        features=cells.features,
        operations=cells.operations,
        operation=cells.operation,
        places=filled_table(cells.means(cells.nominal), cells.repeats > 0),
        errors=cells.means(errors),
        repeats=cells.repeats,
        **facts,
    )


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
    that repeat the errors or are texts.

    Raises InputError for a missing covariate or coordinate, points that cannot be what they claim,
    or points of no axis that an equation is for.
    """
    check_repeats(points)
    axes, warnings = judged_axes(model, points, "errors along {} are left out")
    points, repeated = without_repeated(points, model.covariates())
    warnings += [*repeated, *text_warnings(points)]
    points, removals = _estimable(points, axes, datum)
    warnings += removals
    at, cells, columns = covariates or {}, _cells(model, points), point_columns(points)
    values, idle = needed_covariates(model, points, columns, at, points.nominal)
    tables, more = table_covariates(columns, cells, points, np.arange(len(points)))
    predicted, common, of_part = cell_model(model, cells, values, tables)
    once = points.nominal[np.unique(cells.column, return_index=True)[1]]
    warnings += [*idle, *more, *outside_warnings(outside_ranges(model, cells.features, once))]
    warnings += guess_warnings(model, points.nominal, values)
    of_axes = [model.axes.index(AXES[axis]) for axis in axes]
    errors = points.measured[:, axes] - points.nominal[:, axes] - predicted[:, of_axes]
    errors = datum_errors(points, errors, axes, datum)[0]
    estimates = [x.estimate for x in model.terms if np.any(x.estimate.pass_covariance)]
    dofs = [each.pass_dof for each in estimates] + [group.pass_dof for group in model.joint]
    table = table_of(
        cells,
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
            common=reduced_factor(table.without_datum(table.common)),
            of_part=reduced_factor(table.without_datum(table.of_part)),
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
        return points.where(~mask), warnings
    return points, []


def _cells(model: MachineModel, points: Points) -> Cells:
    """Parts by `sequence`, then as they first appear; features as the part file has them, by
    operation first.
    """
    operations, operation = operations_of(points)
    count = len(points.features)
    columns, column = distinct(operation.astype(np.int64) * count + points.feature)
    of_column = columns // count
    used = [points.features[code % count] for code in columns.tolist()]
    if len(np.unique(of_column)) > 1:
        pairs = zip(of_column.tolist(), used, strict=True)
        used = [f"{operations[code]} {name}".lstrip() for code, name in pairs]
    parts, first, part = np.unique(points.part, return_index=True, return_inverse=True)
    order = np.lexsort([first, group_least(points.sequence, part, len(parts))])
    row = np.argsort(order)[part]
    return Cells(
        parts=tuple(points.parts[i] for i in parts[order].tolist()),
        features=tuple(used),
        operations=operations,
        operation=of_column,
        part=row,
        column=column,
        nominal=np.column_stack(list(places_of(model, points.nominal).values())),
    )


# The model at the cells.


def cell_model(
    model: MachineModel, cells: Cells, values: Covariates, by_name: Mapping[str, FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Predictions (n, a) mm of the measurements under the covariates `values`, as `predict` makes
    them, and of the cells the factors F (P or 1, H, a, K) of the covariances F F', mm^2, that all
    parts share and that every part draws anew. `by_name` are the covariates' tables: the noise of a
    temperature that all points share is common to all parts, that of one reading a part is of the
    part; that of a reading a point adds to the scatter of single cells and is in neither factor. A
    drift with a lag has the history of all measurements.
    """
    places = cells.nominal
    centre = design(model, places, values)
    of_constants, shift = constant_effects(model, places, values, centre)
    mean = centre.mean + shift
    shared, drawn = [np.zeros((len(mean), 0))], [np.zeros((len(mean), 0))]
    blocks = component_blocks(model, centre.J, centre.levers)
    for block in (*blocks, *of_constants):
        shared.append(block.G @ factor_of(block.C))
        drawn.append(block.G @ factor_of(drawable_passes(block.D, block.C)))
    read = {name: by_name[name].shape if name in by_name else (1, 1) for name in sensors_of(model)}
    for sensor, by_lag in noise_by_sensor(model, places, centre.levers).items():
        # The noise of one reading a cell is in neither.
        if read[sensor][1] == 1:
            column = np.sum([*by_lag.values()], axis=0)
            (shared if read[sensor] == (1, 1) else drawn).append(column[:, None])
    size = (len(places), len(model.axes))
    factors = (np.concatenate(columns, axis=1).reshape(*size, -1) for columns in (shared, drawn))
    there = cells.repeats > 0
    common, of_part = (reduced_factor(filled_table(cells.means(F), there)) for F in factors)
    return mean.reshape(size), common, of_part


# The tables of readings.


def reading_tables(
    machine: LoadedMachine, estimates: Estimates, readings: Readings
) -> tuple[tuple[ResidualTable, ...], tuple[Finding, ...]]:
    """One table for each component that was read: its readings minus its prediction. `estimates`
    are those that these readings took no part in: of a components report, or of the machine file.
    Of a component without an estimate the readings are taken minus their least-squares polynomial,
    whose degree is `fitted_degree`: then neither factor has a column, and what the polynomial may
    hold cannot be seen. Effects of the machine that were found in readings of a component are
    subtracted, too.

    Forward and reverse of a pass share that part of D which the fit estimated for both; the rest
    each draws anew.
    """
    tables, warnings = [], text_warnings(readings)
    for code, name in enumerate(readings.components):
        rows = np.flatnonzero(readings.code == code)
        if len(rows):
            series = component_readings(machine, readings, name, rows)
            tables.append(_table(machine, name, estimates, readings, series, warnings))
    return tuple(tables), tuple(warnings)


def _table(
    machine: LoadedMachine,
    name: str,
    estimates: Estimates,
    readings: Readings,
    series: ComponentReadings,
    warnings: list[Finding],
) -> ResidualTable:
    """The table of the readings of one component."""
    entry, estimate = machine.machine.components[name], estimates.components.get(name)
    of, unit, rows, columns = series.of, UNITS[entry.unit], series.rows, series.columns
    cells = reading_cells(readings, series, name)
    covariates, gaps = table_covariates(columns, cells, readings, rows)
    warnings += gaps
    if (drift := estimates.thermal.get(name)) is not None:
        # It needs its temperatures, and the times where it lags.
        needed = [*drift.sensors, *((TIME,) if drift.time_constants.any() else ())]
        whole = {k for k, x in columns.items() if x.dtype != object and np.isfinite(x).all()}
        if lacks := [key for key in needed if key not in whole]:
            warnings.append(finding("drift-not-removed", component=name, columns=", ".join(lacks)))
            drift = None
    effects, left_out = effects_on_readings(machine, name, cells.nominal, columns)
    warnings += left_out
    errors, degree = readings.error[rows] - effects, -1
    common = of_part = np.zeros((1, len(cells.features), 1, 0))
    if estimate is not None or drift is not None:
        of_pass, of_run = (None, None) if estimate is None else _by_run(estimate)
        model = component_alone(name, of or AXES[0], of_pass, drift)
        names = [*model.covariates(), *((TIME,) if drift is not None else ())]
        values = {key: columns[key] for key in names if key in columns}
        warnings += temperature_warnings(model, values)
        mean, common, drawn = cell_model(model, cells, values, covariates)
        errors = errors - mean[:, 0]
        if estimate is not None and np.any(estimate.pass_covariance):
            # Forward and reverse draw with separate columns.
            direction = np.zeros(len(cells.features))
            direction[cells.column] = readings.direction[rows]
            signs = direction[None, :, None, None]
            parts = [np.where(signs == sign, drawn, 0.0) for sign in np.unique(signs)]
            if of_run is not None:
                model = component_alone(name, of or AXES[0], of_run)
                parts.append(cell_model(model, cells, {}, {})[2])
            of_part = np.concatenate(parts, axis=3)
    if estimate is None:
        # Of a table or `degree: auto` the bends of the highest degree are declared already.
        declared = isinstance(entry.degree, int) and not entry.is_table
        degree = int(entry.degree) if declared else MOST_AUTO
        position = np.zeros(len(errors)) if of is None else cells.nominal[:, AXES.index(of)]
        degree = min(degree, len(cells.features) - 1, len(np.unique(position)) - 1)
        # A residual does not depend on where the powers are counted from; its digits do.
        errors = least_squares(polynomial(position - position.mean(), degree), errors).residuals
    return table_of(
        cells,
        errors[:, None],
        axes=(of or name,),
        component=name,
        unit=SMALL[unit.dimension].name,
        covariates=covariates,
        common=common,
        of_part=of_part,
        fitted_degree=degree,
        pass_dof=np.inf if estimate is None else estimate.pass_dof or np.inf,
        resolution=(float(np.sqrt(12 * reading_rounding(readings, rows))),),
    )


def _by_run(estimate: ComponentEstimate) -> tuple[ComponentEstimate, ComponentEstimate | None]:
    """The component with what each pass draws anew of D, and what forward and reverse of a run
    share of it, K = S_m - S_h (`stats.mixed_model`), None where passes are independent. Of several
    instruments D is of all, K of those that ran both ways.
    """
    in_run, C = covariance_in_run(estimate), estimate.covariance
    if in_run is None:
        return estimate, None
    D, zero = drawable_passes(estimate.pass_covariance, C), np.zeros_like(estimate.coefficients)
    K = bounded(drawable_passes(in_run, C), D)
    of_pass = replace(estimate, pass_covariance=drawable_passes(D - K, C))
    of_run = replace(of_pass, coefficients=zero, covariance=np.zeros_like(C), pass_covariance=K)
    return of_pass, of_run


SAME = 1e-4
"""Positions within this share of the travel are one target, recorded as it was reached."""
SIGNS = {1: " +", -1: " -", 0: ""}


def reading_cells(readings: Readings, series: ComponentReadings, name: str) -> Cells:
    """The cells of the readings `series` of the component `name`.

    A pass is one number of one file, in one direction where it is not a run there and back.
    """
    target, labels = np.zeros(len(series.rows), np.int64), [name]
    if series.of is not None:
        target, labels = _targets(series.places[:, AXES.index(series.of)])
    sign = readings.direction[series.rows].astype(np.int64)
    # Forward first, as the passes of a fit are.
    columns, column = np.unique(target * 3 + (1 - sign), return_inverse=True)
    signs = 1 - columns % 3
    several = len(np.unique(signs)) > 1
    return Cells(
        parts=_row_names(readings, series.passes),
        features=tuple(
            labels[code // 3] + SIGNS[int(way)] * several
            for code, way in zip(columns.tolist(), signs, strict=True)
        ),
        operation=np.zeros(len(columns), np.int64),
        part=series.passes.runs[series.group],
        column=column.reshape(-1),
        nominal=series.places,
    )


def _row_names(readings: Readings, passes: Passes) -> tuple[str, ...]:
    """The passes of each run by their numbers; with their file where two have the same."""
    numbered = {key[:2] for key in passes.keys}
    twice = len({number for _, number in numbered}) < len(numbered)
    runs: list[dict[str, None]] = [{} for _ in range(int(passes.runs.max(initial=-1)) + 1)]
    for g in np.argsort(passes.order).tolist():
        file, number, _ = passes.keys[g]
        runs[passes.runs[g]][f"{readings.sources[file].shown} " * twice + str(number)] = None
    return tuple(map("/".join, runs))


def _targets(position: FloatArray) -> tuple[IntArray, list[str]]:
    """The target of each reading (n,), ascending, and their names, with as many digits as make them
    differ. Each position is a target of its own where neighbours would merge.
    """
    distinct, code = np.unique(position, return_inverse=True)
    near = SAME * float(np.ptp(distinct))
    group = np.cumsum(np.r_[0, np.diff(distinct) > near])
    first = np.unique(group, return_index=True)[1]
    last = np.r_[first[1:], len(distinct)] - 1
    if (distinct[last] - distinct[first] > 3 * near).any():
        group = np.arange(len(distinct))
    target = group[code.reshape(-1)]
    means = np.bincount(target, position) / np.bincount(target)
    named = ([f"{value:.{digits}g}" for value in means] for digits in (6, 9, 12, 17))
    return target, next(labels for labels in named if len(set(labels)) == len(labels))
