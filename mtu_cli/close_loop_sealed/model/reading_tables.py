"""Readings of components less what was known of them, as tables of passes and targets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.close_loop_sealed.bridge import loop_warning
from mtu_cli.close_loop_sealed.model.columns import text_warnings
from mtu_cli.close_loop_sealed.model.covariate_tables import rows_without_gaps, table_covariates
from mtu_cli.close_loop_sealed.model.residual_factors import CellModel, Values, cell_model
from mtu_cli.close_loop_sealed.model.residual_layout import filled
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable, within
from mtu_cli.close_loop_sealed.model_slice import ReadingLayout, reading_layout
from mtu_cli.files.machine_contract import Component
from mtu_cli.findings import Finding
from mtu_cli.language import parse
from mtu_cli.model.estimates import (
    ComponentEstimate,
    Estimates,
    ThermalEstimate,
    covariance_in_run,
)
from mtu_cli.model.fit import (
    effects_on_readings,
    from_machine_file,
    reading_columns,
    reading_places,
    thermal_from_machine_file,
)
from mtu_cli.model.machine_model import (
    AXES,
    TIME,
    MachineModel,
    Term,
    drift_terms,
)
from mtu_cli.model.shapes import MOST_AUTO
from mtu_cli.model.temperatures import temperature_warnings
from mtu_cli.model.variance import drawable_passes
from mtu_cli.model.visits import IntArray
from mtu_cli.stats.covariance import bounded
from mtu_cli.stats.least_squares import FloatArray, least_squares, polynomial
from mtu_cli.units import ANGLE, UNITS

if TYPE_CHECKING:
    from mtu_cli.files.machine import LoadedMachine
    from mtu_cli.files.readings import Readings

Found = tuple[ResidualTable, list[Finding]]
SHOWN = 3
"""Pairs of passes that are told one by one."""


def reading_tables(
    machine: LoadedMachine, known: Estimates | MachineModel | None, readings: Readings
) -> tuple[tuple[ResidualTable, ...], tuple[Finding, ...]]:
    """One table a component that was read: readings minus what was known of it before them.

    `known` are estimates that these readings took no part in, a components report's; None:
    the machine file's coefficients and drifts. A component of which nothing was known is taken
    less its own least-squares polynomial of these readings, whose degree is `fitted_degree`:
    then neither factor has a column, and what the polynomial may hold cannot be seen.

    Effects of the machine that were found in readings of a component are taken off, too.

    A pass takes the place of a part, a target and direction that of a feature. Forward and
    reverse of a pass share what the fit found them to share of D, the rest each draws anew.
    """
    estimates = _estimates(machine, known)
    tables, warned = [], text_warnings(readings)
    for code, name in enumerate(readings.components):
        rows = np.flatnonzero(readings.code == code)
        if not len(rows):
            continue
        entry = machine.machine.components[name]
        reader = _Reader(
            machine=machine,
            name=name,
            of=entry.of,
            degree=_degree(entry),
            readings=readings,
            rows=rows,
            layout=reading_layout(readings, rows, entry.of, name),
        )
        reader, gaps = reader.without_gaps()
        table, told = reader.table(estimates)
        angular = UNITS[entry.unit].dimension == ANGLE
        tables.append(replace(table, unit="arcsec" if angular else "um"))
        warned += [*gaps, *told]
    return tuple(tables), tuple(warned)


def _degree(entry: Component) -> int:
    """Of what is declared already: of a table or `degree: auto` the bends of the highest degree."""
    if entry.of is None:
        return 0
    declared = isinstance(entry.degree, int) and not entry.is_table
    return int(entry.degree) if declared else MOST_AUTO


def _estimates(machine: LoadedMachine, known: Estimates | MachineModel | None) -> Estimates:
    if isinstance(known, Estimates):
        return known
    if known is None:
        return Estimates(
            components=from_machine_file(machine), thermal=thermal_from_machine_file(machine)
        )
    own = [term for term in known.terms if term.estimate.name in machine.machine.components]
    return Estimates(
        components={term.estimate.name: term.estimate for term in own},
        joint=known.joint,
        thermal={drift.component: drift for drift in known.drifts()},
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reader:
    """The readings `rows` (n,) of one component."""

    machine: LoadedMachine
    name: str
    of: str | None
    degree: int
    readings: Readings
    rows: IntArray
    layout: ReadingLayout

    def without_gaps(self) -> tuple[_Reader, list[Finding]]:
        """The readings less those that lack a covariate which nearly all others have; all passes
        stay, and so does their count.
        """
        cells = self.layout.cells
        columns = self._columns()
        columns.pop(f"dir_{self.of}", None)
        groups = (cells.part, cells.column)
        rows, told = rows_without_gaps(self.readings, self.rows, columns, groups)
        if not told:
            return self, []
        layout = reading_layout(self.readings, rows, self.of, self.name)
        return replace(self, rows=rows, layout=layout), told

    def table(self, estimates: Estimates) -> Found:
        """The table less what `estimates` know of the component."""
        columns = self._columns()
        files = (self.readings.file_index[self.rows], self.readings.sources)
        shown, gaps = table_covariates(columns, self.layout.cells, files)
        shapes = {name: value.shape for name, value in shown.items()}
        estimate = estimates.components.get(self.name)
        drift, told = self._drift(estimates.thermal.get(self.name), columns)
        said, left_out = effects_on_readings(self.machine, self.name, self._places(), columns)
        warned = [*self._instruments(), *self._paired(), *gaps, *told, *left_out]
        if estimate is None and drift is None:
            return self._fitted(shown, self.readings.error[self.rows] - said), warned
        axis = self.of or AXES[0]
        own, both = (None, None) if estimate is None else _shared_by_directions(estimate)
        model = _alone(self.name, axis, own, drift)
        values: Values = {
            name: columns[name]
            for name in (*model.covariates(), *((TIME,) if drift is not None else ()))
            if name in columns
        }
        warned += temperature_warnings(model, self._places(), values)
        found = cell_model(model, self._places(), values, self.layout.cells, shapes)
        errors = (self.readings.error[self.rows] - said)[:, None] - found.predicted
        if estimate is None:
            return self._fitted(shown, errors[:, 0], found), warned
        of_part = self._by_direction(found.of_part)
        if both is not None:
            shared = _alone(self.name, axis, both, None)
            of_runs = cell_model(shared, self._places(), {}, self.layout.cells, {}).of_part
            of_part = np.concatenate([of_part, of_runs], axis=3)
        made = self._made(errors, shown, found.common, of_part)
        scatters = bool(np.any(estimate.pass_covariance))
        made = replace(made, pass_dof=estimate.pass_dof or np.inf, scatter_known=scatters)
        return made, warned

    def _fitted(
        self,
        shown: dict[str, FloatArray],
        errors: FloatArray | None = None,
        found: CellModel | None = None,
    ) -> ResidualTable:
        """The table less the polynomial that the readings themselves give."""
        y = self.readings.error[self.rows] if errors is None else errors
        position = np.zeros(len(y)) if self.of is None else self._places()[:, AXES.index(self.of)]
        degree = min(self.degree, len(self.layout.columns) - 1, len(np.unique(position)) - 1)
        # A residual does not depend on where the powers are counted from; its digits do.
        fit = least_squares(polynomial(position - position.mean(), degree), y)
        nothing = np.zeros((1, len(self.layout.columns), 1, 0))
        common = nothing if found is None else found.common
        of_part = nothing if found is None else self._by_direction(found.of_part)
        made = self._made(fit.residuals[:, None], shown, common, of_part)
        return replace(made, fitted_degree=degree, scatter_known=False)

    def _made(
        self,
        errors: FloatArray,
        shown: dict[str, FloatArray],
        common: FloatArray,
        of_part: FloatArray,
    ) -> ResidualTable:
        cells = self.layout.cells
        variance, dof = within(cells, errors)
        return ResidualTable(
            axes=(self.name if self.of is None else self.of,),
            component=self.name,
            unit="um",
            parts=self.layout.passes,
            features=self.layout.columns,
            errors=cells.table(cells.means(errors)),
            repeats=cells.repeats,
            repeat_variance=variance,
            repeat_dof=dof,
            places=filled(cells.table(cells.means(self._places())), cells.repeats > 0),
            operations=("",),
            operation=np.zeros(len(self.layout.columns), np.int64),
            covariates=shown,
            common=common,
            of_part=of_part,
        )

    def _by_direction(self, of_part: FloatArray) -> FloatArray:
        """The factor with columns of its own for each direction."""
        signs = self.layout.direction
        apart = [
            np.where((signs == sign)[None, :, None, None], of_part, 0.0)
            for sign in np.unique(signs)
        ]
        return np.concatenate(apart, axis=3)

    def _places(self) -> FloatArray:
        return reading_places(self.readings, self.rows, self.of)

    def _columns(self) -> dict[str, np.ndarray]:
        return reading_columns(self.readings, self.rows, self.layout.cells.part, self.of)

    def _drift(
        self, drift: ThermalEstimate | None, columns: dict[str, np.ndarray]
    ) -> tuple[ThermalEstimate | None, list[Finding]]:
        """The known drift if the readings have its temperatures, and its times where it lags."""
        if drift is None:
            return None, []
        needed = [*drift.sensors, *((TIME,) if drift.time_constants.any() else ())]
        lost = [
            name
            for name in needed
            if name not in columns
            or columns[name].dtype == object
            or not np.isfinite(columns[name]).all()
        ]
        if not lost:
            return drift, []
        text = (
            f"the readings of {self.name} do not have {', '.join(lost)} in every row: its known "
            "drift with temperature stays in them"
        )
        return None, [loop_warning(code="drift-not-removed", message=text)]

    def _paired(self) -> list[Finding]:
        if not self.layout.pairs:
            return []
        pairs = self.layout.pairs
        text = (
            f"passes of {self.name} run one way: one there and one back are judged as one pass "
            f"({', '.join(pairs[:SHOWN])}{' and so on' if len(pairs) > SHOWN else ''})"
        )
        return [loop_warning(code="passes-paired", message=text)]

    def _instruments(self) -> list[Finding]:
        roles = dict.fromkeys(self.readings.roles[i] for i in self.readings.file_index[self.rows])
        if len(roles) < 2:
            return []
        text = f"{self.name} was read by {' and '.join(roles)}: their passes stand in one table"
        return [loop_warning(code="instruments-together", message=text)]


def _shared_by_directions(
    estimate: ComponentEstimate,
) -> tuple[ComponentEstimate, ComponentEstimate | None]:
    """The estimate with what forward and reverse of a run do not share of D, and an error of zero
    with what they do, K = S_m - S_h (`stats.pass_pairs`).
    """
    known = covariance_in_run(estimate)
    if known is None:
        return estimate, None
    C = estimate.covariance
    # Of several instruments D is of all, K of those that ran both ways: together they are D.
    D = drawable_passes(estimate.pass_covariance, C)
    K = bounded(drawable_passes(known, C), D)
    own = replace(estimate, pass_covariance=drawable_passes(D - K, C))
    zero = np.zeros_like(estimate.coefficients)
    return own, replace(estimate, coefficients=zero, covariance=np.zeros_like(C), pass_covariance=K)


def _alone(
    name: str, axis: str, estimate: ComponentEstimate | None, drift: ThermalEstimate | None
) -> MachineModel:
    """A machine whose only error, along `axis`, is that of one component."""
    lever = {axis: parse("1")}
    terms = [] if estimate is None else [Term(estimate=estimate, levers=lever)]
    if drift is not None:
        terms += drift_terms(drift, lever)
    return MachineModel(
        name=name,
        axes=(axis,),
        terms=tuple(terms),
        remainders={axis: ()},
        constants={},
        joint=(),
    )
