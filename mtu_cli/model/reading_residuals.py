"""Residuals of the readings of components, as tables of passes and targets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding, finding
from mtu_cli.model.covariates import gap_rows, table_covariates, text_warnings
from mtu_cli.model.estimates import ComponentEstimate, Estimates, covariance_in_run
from mtu_cli.model.estimation import MOST_AUTO, reading_rounding
from mtu_cli.model.fit import ComponentReadings, component_readings, effects_on_readings
from mtu_cli.model.machine_model import AXES, TIME, component_alone
from mtu_cli.model.passes import Passes
from mtu_cli.model.prediction import temperature_warnings
from mtu_cli.model.residuals import ResidualTable, cell_model, table_of
from mtu_cli.model.variance import drawable_passes
from mtu_cli.model.visits import Cells, IntArray
from mtu_cli.stats.covariance import bounded
from mtu_cli.stats.least_squares import FloatArray, least_squares, polynomial
from mtu_cli.units import ANGLE, UNITS


def reading_tables(
    machine: LoadedMachine, estimates: Estimates, readings: Readings
) -> tuple[tuple[ResidualTable, ...], tuple[Finding, ...]]:
    """One table for each component that was read: its readings minus its prediction. `estimates`
    are those that these readings took no part in: of a components report, or of the machine file.
    Of a component without an estimate the readings are taken minus their least-squares polynomial,
    whose degree is `fitted_degree`: then neither factor has a column, and what the polynomial may
    hold cannot be seen. Effects of the machine that were found in readings of a component are
    subtracted, too.

    A pass takes the place of a part, a target and direction that of a feature. Forward and reverse
    of a pass share that part of D which the fit estimated for both; the rest each draws anew.
    """
    tables, warnings = [], text_warnings(readings)
    for code, name in enumerate(readings.components):
        rows = np.flatnonzero(readings.code == code)
        if len(rows):
            series = component_readings(machine, readings, name, rows)
            cells = reading_cells(readings, series, name)
            columns = {key: x for key, x in series.columns.items() if key != f"dir_{series.axis}"}
            groups = (cells.part, cells.column, readings.file_index[rows])
            mask, gaps = gap_rows(columns, groups, readings, rows, f" of {name}")
            warnings += gaps
            series = component_readings(machine, readings, name, rows[~mask]) if gaps else series
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
        warnings += temperature_warnings(model, cells.nominal, values)
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
        degree = 0 if of is None else int(entry.degree) if declared else MOST_AUTO
        position = np.zeros(len(errors)) if of is None else cells.nominal[:, AXES.index(of)]
        degree = min(degree, len(cells.features) - 1, len(np.unique(position)) - 1)
        # A residual does not depend on where the powers are counted from; its digits do.
        errors = least_squares(polynomial(position - position.mean(), degree), errors).residuals
    return table_of(
        cells,
        errors[:, None],
        axes=(of or name,),
        component=name,
        unit="arcsec" if unit.dimension == ANGLE else "um",
        covariates=covariates,
        common=common,
        of_part=of_part,
        fitted_degree=degree,
        pass_dof=np.inf if estimate is None else estimate.pass_dof or np.inf,
        resolution=(float(np.sqrt(12 * reading_rounding(readings, rows, unit))),),
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


# Passes and targets.

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
    """The passes of each run by their numbers; with their file or direction where these alone
    differ.
    """
    numbered = {key[:2] for key in passes.keys}
    twice = len({number for _, number in numbered}) < len(numbered)
    runs: list[dict[str, str]] = [{} for _ in range(int(passes.runs.max(initial=-1)) + 1)]
    for g in np.argsort(passes.order).tolist():
        file, number, way = passes.keys[g]
        label = f"{readings.sources[file].shown} " * twice + str(number)
        runs[passes.runs[g]][label] = SIGNS[way]
    names = ["/".join(labels) for labels in runs]
    if len(set(names)) < len(names):
        names = [name + [*labels.values()][-1] for name, labels in zip(names, runs, strict=True)]
    return tuple(names)


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
