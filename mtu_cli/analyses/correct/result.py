"""Corrected points, and diameters and lengths before and after."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

from mtu_cli.analyses.correct.leaning import Leaning
from mtu_cli.analyses.correct.quantity import Kind, Sides, Size
from mtu_cli.analyses.correct.roundness import Oval
from mtu_cli.analyses.correct.scatter import PointScatter
from mtu_cli.analyses.correct.summary import (
    AxisCorrections,
    FeatureErrors,
    SizeErrors,
    axis_corrections,
    feature_errors,
    rms_errors,
    size_errors,
)
from mtu_cli.analyses.correct.warnings import size_warnings
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, kw_only=True)
class CorrectResult:
    """Corrected points and the sizes among them.

    `error` (n, 3) is the modelled error of each point with standard uncertainty `u` and
    effective degrees of freedom `dof` (n, 3), mm; nan along axes that have no equation or were
    not measured. `corrected` (n, 3) = measured - error, along such axes measured as it is.
    `axes` are those that were corrected; `ovals` the calibrated rings that stay oval, `leaning`
    the circles whose points lie at different heights; `notes` are warnings of the input.
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
    independent: bool
    notes: tuple[Finding, ...]

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Of the input, and of the sizes after the correction."""
        return (*self.notes, *size_warnings(self.sizes, self.ovals, self.leaning))

    @cached_property
    def part(self) -> list[str]:
        """The part (n,) of every point."""
        return [self.points.parts[i] for i in self.points.part]

    @cached_property
    def feature(self) -> list[str]:
        """The feature (n,) of every point."""
        return [self.points.features[i] for i in self.points.feature]

    @cached_property
    def repeat(self) -> list[int | None]:
        """The repeat (n,) of every point; None where it is not given."""
        return [i if i >= 0 else None for i in self.points.repeat.tolist()]

    @cached_property
    def operation(self) -> list[str | None]:
        """The operation (n,) of every point; None where it is not given."""
        return [self.points.operations[i] if i >= 0 else None for i in self.points.operation]

    @cached_property
    def correction(self) -> FloatArray:
        """What is added to the measured coordinates (n, 3), mm: minus the modelled error (JCGM
        200, 2.53).
        """
        return 0.0 - self.error

    @cached_property
    def _of_corrected(self) -> tuple[FloatArray, FloatArray]:
        return (self.u, self.dof) if self.scatter is None else self.scatter.added(self.u, self.dof)

    @property
    def u_corrected(self) -> FloatArray:
        """Standard uncertainty (n, 3) of corrected coordinates, mm, with the `scatter` of the
        measured points where it is known.
        """
        return self._of_corrected[0]

    @property
    def dof_corrected(self) -> FloatArray:
        """Its effective degrees of freedom (n, 3)."""
        return self._of_corrected[1]

    def of_kind(self, kind: Kind) -> tuple[Size, ...]:
        """The circles, spheres or lengths."""
        return tuple(item for item in self.sizes if item.kind == kind)

    def by_size(self) -> tuple[SizeErrors, ...]:
        """The errors of every circle, sphere and length over the parts before and after."""
        return size_errors(self.sizes)

    def rms(self, kinds: Collection[Kind]) -> Sides | None:
        """Root mean square of the errors of all sizes of some kinds before and after."""
        return rms_errors(self.sizes, kinds)

    def by_feature(self) -> FeatureErrors:
        """Mean errors of the features before and after."""
        return feature_errors(self.points, self.corrected)

    def by_axis(self) -> tuple[AxisCorrections, ...]:
        """The corrections along each of `axes`, summed up."""
        return tuple(
            axis_corrections(axis, self.error[:, k], self.u[:, k])
            for k, axis in enumerate(AXES)
            if axis in self.axes
        )
