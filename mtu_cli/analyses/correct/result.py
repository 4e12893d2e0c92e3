"""What correct found: corrected points, and diameters and lengths before and after."""

from __future__ import annotations

from dataclasses import dataclass

from mtu_cli.analyses.correct.leaning import Leaning
from mtu_cli.analyses.correct.quantity import Kind, Size
from mtu_cli.analyses.correct.roundness import Oval
from mtu_cli.analyses.correct.scatter import PointScatter
from mtu_cli.analyses.correct.summary import (
    AxisCorrections,
    FeatureErrors,
    SizeErrors,
    axis_corrections,
    feature_errors,
    size_errors,
)
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class CorrectResult:
    """Corrected points and the sizes among them.

    `error` (n, 3) is the modelled error of each point with standard uncertainty `u` and
    effective degrees of freedom `dof` (n, 3), mm; nan along axes that have no equation or were
    not measured. `corrected` (n, 3) = measured - error, along such axes measured as it is.
    `axes` are those that were corrected; `ovals` the calibrated rings that stay oval, `leaning`
    the circles whose points lie at different heights.
    """

    points: Points
    axes: tuple[str, ...]
    error: FloatArray
    u: FloatArray
    dof: FloatArray
    corrected: FloatArray
    scatter: PointScatter | None
    sizes: tuple[Size, ...]
    ovals: tuple[Oval, ...]
    leaning: tuple[Leaning, ...]
    coverage_factor: float
    independent: bool
    warnings: tuple[Finding, ...]

    def of_corrected(self, rows: int | slice = slice(None)) -> tuple[FloatArray, FloatArray]:
        """u and effective degrees of freedom (n, 3) of corrected coordinates, mm; they hold the
        `scatter` of the measured points, too, where it is known.
        """
        u, dof = self.u[rows], self.dof[rows]
        return (u, dof) if self.scatter is None else self.scatter.added(u, dof)

    def of_kind(self, kind: Kind) -> tuple[Size, ...]:
        """The circles, spheres or lengths."""
        return tuple(item for item in self.sizes if item.kind == kind)

    def by_size(self) -> tuple[SizeErrors, ...]:
        """The errors of every circle, sphere and length over the parts before and after."""
        return size_errors(self.sizes)

    def by_feature(self) -> FeatureErrors:
        """Mean errors of the features before and after."""
        return feature_errors(self.points, self.corrected)

    def along(self, axis: str) -> AxisCorrections:
        """The corrections along one of `axes`, summed up."""
        k = AXES.index(axis)
        return axis_corrections(self.error[:, k], self.u[:, k])
