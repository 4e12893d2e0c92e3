"""What is left of measured points, diameters and lengths once the modelled error is taken off?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mtu_cli.analyses.correct.leaning import leaning
from mtu_cli.analyses.correct.quantity import Size, mean_size, with_scatter
from mtu_cli.analyses.correct.result import CorrectResult
from mtu_cli.analyses.correct.roundness import ovals
from mtu_cli.analyses.correct.rows import RowErrors
from mtu_cli.analyses.correct.scatter import FEWEST, PointScatter, point_scatter
from mtu_cli.analyses.correct.sizes import Rings, sizes_of
from mtu_cli.analyses.correct.wanted import tasks_of, wanted_of
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.effect_columns import guess_warnings
from mtu_cli.model.features import dof_warnings, outside_warnings
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measured import no_shared_axis
from mtu_cli.model.residual_covariates import needed_covariates, point_columns
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray

__all__ = ["CorrectResult", "Size", "correct", "mean_size"]


def correct(
    model: MachineModel,
    part: LoadedPart | None,
    points: Points,
    settings: Settings,
    covariates: Mapping[str, float] | None = None,
) -> CorrectResult:
    """corrected = measured - modelled error, at the measured place and the rows' covariates.

    Valdes et al.: measured points minus synthesised error, a circle through the rest. The
    uncertainty of a corrected point is that of the error of one visit of one future part and
    the points' scatter beyond it; that of a diameter or length comes from its gradient in all
    its points and their full covariance.

    Raises InputError for a missing covariate or coordinate, points that cannot be what they
    claim or that no equation is for, or a circle that its points do not determine.
    """
    _check(model, points)
    rows, noted = _rows(model, points, covariates or {}, independent=settings.independent)
    error, u, dof, sensors = rows.errors()
    corrected = points.measured - np.nan_to_num(error)
    by_machine, rings, warned = _sizes(part, rows, corrected, covariates or {})
    scatter = point_scatter(points, corrected, sensors, rings.squares)
    k = settings.coverage_factor
    sizes = [replace(with_scatter(size, scatter), k=k) for size in by_machine]
    notes = [*noted, *outside_warnings(rows.all_outside()), *warned]
    return CorrectResult(
        points=points,
        axes=tuple(a for i, a in enumerate(AXES) if np.isfinite(error[:, i]).any()),
        error=error,
        u=u,
        dof=dof,
        corrected=corrected,
        scatter=scatter,
        sizes=tuple(sizes),
        ovals=ovals(rings.shapes.values(), scatter),
        leaning=leaning(rings.shapes.values(), by_machine),
        independent=settings.independent,
        notes=(*notes, *_size_warnings(sizes, scatter)),
    )


def _rows(
    model: MachineModel, points: Points, at: Mapping[str, float], *, independent: bool
) -> tuple[RowErrors, list[Finding]]:
    """The machine at the measured places under the rows' covariates, and what these lack."""
    columns = point_columns(points)
    found = needed_covariates(model, points, columns, at)
    rows = RowErrors(
        model=model,
        points=points,
        places=np.where(np.isnan(points.measured), points.nominal, points.measured),
        covariates=found.values,
        independent=independent,
    )
    guesses = guess_warnings(model, rows.places, found.values, columns, at)
    return rows, [*found.warnings, *guesses, *_axis_warnings(model, points)]


def _sizes(
    part: LoadedPart | None, rows: RowErrors, corrected: FloatArray, at: Mapping[str, float]
) -> tuple[list[Size], Rings, list[Finding]]:
    """Diameters and lengths of the part file by the machine's u alone, the form of its rings, and
    what is to be said of them.
    """
    if part is None:
        consequence = "points are corrected, no circle or length is known"
        facts = {"what": "the part file", "names": ["-p"], "consequence": consequence}
        return [], Rings(), [finding("missing-values", **facts)]
    wanted, warned = wanted_of(part, rows.points, at)
    tasks, partial = tasks_of(wanted, rows.points)
    sizes, rings = sizes_of(tasks, rows, corrected)
    warned += partial
    for item in wanted:
        own = [size for size in sizes if (size.kind, size.id) == (item.kind, item.id)]
        if item.calibration is not None and own:
            warned += item.calibration.warnings([one for size in own for one in size.repeats])
    return sizes, rings, warned


def _size_warnings(sizes: list[Size], scatter: PointScatter | None) -> list[Finding]:
    """Of few degrees of freedom, and of a scatter that nothing tells."""
    names = [f"{size.id} of {size.part}" for size in sizes]
    found = dof_warnings(names, np.array([size.dof for size in sizes]))
    if scatter is None:
        consequence = "u holds the machine model only; that takes repeats of "
        consequence += f"{FEWEST} degrees of freedom, or a circle of 4 points"
        facts = {"what": "probing", "names": ["the points"], "consequence": consequence}
        found = [*found, finding("no-scatter-known", **facts)]
    return found


def _check(model: MachineModel, points: Points) -> None:
    """Refuses points that nothing can be corrected of."""
    columns = [AXES.index(axis) for axis in model.axes]
    measured = [i for i in range(3) if np.isfinite(points.measured[:, i]).any()]
    if set(measured).isdisjoint(columns):
        raise no_shared_axis(model, points, measured)


def _axis_warnings(model: MachineModel, points: Points) -> list[Finding]:
    found = []
    for i, axis in enumerate(AXES):
        measured = np.isfinite(points.measured[:, i])
        if axis not in model.axes and measured.any():
            consequence = f"{axis} stays as it was measured"
            found.append(finding("axis-without-equation", axis=axis, consequence=consequence))
        elif axis in model.axes and not measured.all():
            what = f"{int((~measured).sum())} points"
            consequence = "not corrected there"
            found.append(
                finding("axis-not-measured", what=what, axis=axis, consequence=consequence)
            )
    return found
