"""Corrected points, and diameters and lengths before and after."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.correct.scatter import FormLeft, PointScatter, unexplained
from mtu_cli.analyses.correct.sizes import Sides, Size
from mtu_cli.analyses.correct.wanted import Kind
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM


class FeatureErrors(NamedTuple):
    """Measured features with the means (m, 3) mm over all their points: nominal places, and
    measured minus nominal before and after the correction; nan where a point lacks a coordinate.
    """

    features: tuple[str, ...]
    places: FloatArray
    before: FloatArray
    after: FloatArray


@dataclass(frozen=True, kw_only=True)
class CorrectResult:
    """Corrected points and the sizes among them.

    Labels (n,) of every point, None where one is not given. `error` (n, 3) is the modelled error
    with standard uncertainty `u` and effective degrees of freedom `dof` (n, 3), mm; nan along axes
    that have no equation or were not measured. `corrected` (n, 3) = measured - error, along such
    axes measured as it is; its `u_corrected` has the `scatter` of the measured points, too.
    `axes` are those that were corrected, `forms` the rings whose form could be tested; `notes` are
    warnings of the input.
    """

    points: Points
    part: list[str]
    feature: list[str]
    repeat: list[int | None]
    operation: list[str | None]
    axes: tuple[str, ...]
    error: FloatArray
    u: FloatArray
    dof: FloatArray
    corrected: FloatArray
    u_corrected: FloatArray
    dof_corrected: FloatArray
    scatter: PointScatter | None
    sizes: tuple[Size, ...]
    forms: tuple[FormLeft, ...]
    independent: bool
    notes: tuple[Finding, ...]

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Of the input, and of what the correction leaves."""
        return (*self.notes, *_left(self))

    @property
    def correction(self) -> FloatArray:
        """What is added to the measured coordinates (n, 3), mm: minus the modelled error (JCGM
        200, 2.53).
        """
        return 0.0 - self.error

    def of_kind(self, kind: Kind) -> tuple[Size, ...]:
        """The circles, spheres or lengths."""
        return tuple(item for item in self.sizes if item.kind == kind)

    def rms(self, kinds: Collection[Kind]) -> Sides | None:
        """Root mean square of the errors of all sizes of some kinds before and after; None where
        none has a reference.
        """
        sizes = (item for item in self.sizes if item.kind in kinds)
        errors = [item.error for item in sizes if isfinite(item.reference)]
        if not errors:
            return None
        before, after = np.sqrt(np.mean(np.square(errors), axis=0)).tolist()
        return before, after

    def by_feature(self) -> FeatureErrors:
        """Mean errors of the features before and after."""
        nominal = self.points.nominal
        seen, code = np.unique(self.points.feature, return_inverse=True)
        count = np.bincount(code)
        places, before, after = (
            np.column_stack([np.bincount(code, along) / count for along in values.T])
            for values in (nominal, self.points.measured - nominal, self.corrected - nominal)
        )
        return FeatureErrors(tuple(self.points.features[i] for i in seen), places, before, after)

    @property
    def largest(self) -> tuple[float, str]:
        """The largest correction, mm, and its axis."""
        along = np.nan_to_num(np.abs(self.error)).max(axis=0)
        i = int(along.argmax())
        return float(along[i]), AXES[i]


def _left(result: CorrectResult) -> Iterator[Finding]:
    """Figures that are not estimable, and forms that the correction leaves."""
    exact = [item for item in result.sizes if item.error[0] == 0]
    if names := [f"{item.id} of {item.part}" for item in exact]:
        reason = "no error before the correction"
        yield finding("not-estimable", quantity="reduction_percent", names=names, reason=reason)
    if forms := unexplained(result.forms):
        most = max(forms, key=lambda form: form.F)
        yield finding(
            "form-left",
            names=list(dict.fromkeys(f"{form.operation} {form.id}".strip() for form in forms)),
            worst=f"{most.operation} {most.id}".strip(),
            rms_um=most.rms / UM,
            explained_um=most.explained / UM,
        )
