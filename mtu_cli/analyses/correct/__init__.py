"""Measured points, diameters and lengths less the modelled error."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from mtu_cli.analyses.correct.sizes import (
    FEWEST,
    FormTest,
    Kind,
    PointScatter,
    RowErrors,
    Sides,
    Size,
    form_tests,
    mean_sizes,
    measurands_of,
    measured_sizes,
    point_scatter,
)
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.readings import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.covariates import needed_covariates, point_columns
from mtu_cli.model.features import dof_warnings, guess_warnings, outside_warnings
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measured import axis_warnings, no_shared_axis, roundings
from mtu_cli.model.settings import Settings
from mtu_cli.stats.coverage import significant
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM


@dataclass(frozen=True, kw_only=True)
class CorrectResult:
    """Corrected points and the sizes among them.

    Labels (n,) of every point, None where one is not given. `error` (n, 3) is the modelled error
    with standard uncertainty `u` (n, 3), mm; nan along axes that have no equation or were not
    measured. `corrected` (n, 3) = measured - error, along such
    axes measured as it is; its `u_corrected` has the `scatter` of the measured points, too.
    `axes` are those that were corrected, `forms` the rings whose form could be tested.
    """

    points: Points
    part: list[str]
    feature: list[str]
    repeat: list[int | None]
    operation: list[str | None]
    axes: tuple[str, ...]
    error: FloatArray
    u: FloatArray
    corrected: FloatArray
    u_corrected: FloatArray
    scatter: PointScatter | None
    sizes: tuple[Size, ...]
    forms: tuple[FormTest, ...]
    independent: bool
    warnings: tuple[Finding, ...]

    @property
    def correction(self) -> FloatArray:
        """What is added to the measured coordinates (n, 3), mm: minus the modelled error (JCGM
        200, 2.53).
        """
        return 0.0 - self.error

    def of_kind(self, kind: Kind) -> tuple[Size, ...]:
        """The circles, spheres or lengths."""
        return tuple(item for item in self.sizes if item.kind == kind)

    def rms(self, kind: Kind) -> Sides | None:
        """Root mean square of the errors of all sizes of a kind before and after; None where none
        has a reference.
        """
        errors = [item.error for item in self.of_kind(kind) if isfinite(item.reference)]
        if not errors:
            return None
        before, after = np.sqrt(np.mean(np.square(errors), axis=0)).tolist()
        return before, after


def correct(
    model: MachineModel,
    part: LoadedPart | None,
    points: Points,
    settings: Settings,
    covariates: Mapping[str, float] | None = None,
) -> CorrectResult:
    """corrected = measured - modelled error, at the measured place and the rows' covariates.

    Valdes et al.: measured points minus synthesised error, a circle through the rest. u of a
    corrected point is that of one visit of one future part and the points' scatter beyond it; that
    of a diameter or length comes from its gradient in all its points and their full covariance.

    Raises InputError for a missing covariate or coordinate, points that cannot be what they
    claim or that no equation is for, or a circle that its points do not determine.
    """
    at = covariates or {}
    measured = [k for k in range(3) if np.isfinite(points.measured[:, k]).any()]
    if {AXES[k] for k in measured}.isdisjoint(model.axes):
        raise no_shared_axis(model, points, measured)
    places = np.where(np.isnan(points.measured), points.nominal, points.measured)
    values, idle = needed_covariates(model, points, point_columns(points), at, places)
    rows = RowErrors(
        model=model,
        points=points,
        places=places,
        covariates=values,
        independent=settings.independent,
    )
    warnings = [*idle, *guess_warnings(model, rows.places, values)]
    left = "{} stays as it was measured", "not corrected there"
    warnings += axis_warnings(points, model.axes, *left, nominal=False)
    error, u = rows.errors()
    corrected = points.measured - np.nan_to_num(error)
    measurands, absent = ([], []) if part is None else measurands_of(part, points, at)
    visits, rings, partial = measured_sizes(measurands, rows, corrected)
    scatter = point_scatter(points, corrected, rings)
    sizes = tuple(mean_sizes(measurands, visits, scatter, settings.coverage_factor))
    u_corrected = u if scatter is None else np.hypot(u, scatter.s)
    forms = tuple(form_tests(rings, scatter, float(roundings(points).max())))
    warnings += [*outside_warnings(rows.outside), *absent, *partial]
    for order, item in enumerate(measurands):
        temperatures = [x.temperature for key, of in visits.items() if key[0] == order for x in of]
        warnings += item.warnings(temperatures) if temperatures and item.kind != "length" else []
    warnings += _size_warnings(sizes, scatter, forms)
    return CorrectResult(
        points=points,
        part=[points.parts[i] for i in points.part],
        feature=[points.features[i] for i in points.feature],
        repeat=[i if i >= 0 else None for i in points.repeat.tolist()],
        operation=[points.operations[i] if i >= 0 else None for i in points.operation],
        axes=tuple(a for i, a in enumerate(AXES) if np.isfinite(error[:, i]).any()),
        error=error,
        u=u,
        corrected=corrected,
        u_corrected=u_corrected,
        scatter=scatter,
        sizes=sizes,
        forms=forms,
        independent=settings.independent,
        warnings=tuple(warnings),
    )


def _size_warnings(
    sizes: Sequence[Size], scatter: PointScatter | None, forms: Collection[FormTest]
) -> Iterator[Finding]:
    """Of unknown figures of sizes, or of their common scatter; and of calibrated rings whose form
    is more than is explained, at 95 % of all together (Bonferroni): a ring of no calibration may
    have the form that it was made with.
    """
    names = [f"{size.id} of {size.part}" for size in sizes]
    yield from dof_warnings(names, np.array([size.dof for size in sizes]))
    if scatter is None:
        consequence = "u holds the machine model only; that takes repeats of "
        consequence += f"{FEWEST} degrees of freedom, or a circle of 4 points"
        facts = {"what": "probing", "names": ["the points"], "consequence": consequence}
        yield finding("no-scatter-known", **facts)
    if exact := [name for name, size in zip(names, sizes, strict=True) if size.error[0] == 0]:
        details = {"names": exact, "reason": "no error before the correction"}
        yield finding("not-estimable", quantity="reduction_percent", **details)
    calibrated = [form for form in forms if form.calibrated]
    if excess := significant({form: form.p for form in calibrated}):
        worst = max(excess, key=lambda form: form.F)
        labels = {form: f"{form.operation} {form.id}".strip() for form in excess}
        yield finding(
            "form-left",
            names=[*dict.fromkeys(labels.values())],
            worst=labels[worst],
            rms_um=worst.rms / UM,
            explained_um=worst.explained / UM,
        )
