"""Corrected points summed up: by feature over parts and repeats, and along an axis."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.correct.quantity import Size
from mtu_cli.files.points import Points
from mtu_cli.model.settings import PROBABILITY
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray

ROUNDING_MM = 1e-7
"""What of a form is rounding: a tenth of a nanometre."""
ROUNDER = 0.7
"""Share of the form before that is left where a correction makes a circle rounder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureErrors:
    """Measured features with the means (m, 3) mm over all their points: nominal places, and
    measured minus nominal before and after the correction; nan where a point lacks a coordinate.
    """

    features: tuple[str, ...]
    places: FloatArray
    before: FloatArray
    after: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisCorrections:
    """The corrections of `points` coordinates along an axis, mm: what is added to the measured."""

    axis: str
    points: int
    least: float
    mean: float
    largest: float
    u_mean: float
    u_largest: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeErrors:
    """The errors of one circle, sphere or length over all `parts` (of operations: each counts),
    before and after the correction, mm, with the root mean square `form`; `half` is the median
    half-width of intervals that the errors after of all circles and spheres are in together, in
    95 % of all cases (Bonferroni).
    """

    kind: str
    id: str
    parts: int
    mean: tuple[float, float]
    rms: tuple[float, float]
    form: tuple[float, float]
    half: float

    @property
    def grown(self) -> bool:
        """Whether the correction has made the errors larger, by more than its uncertainty: the
        mean error after is one that no part is predicted to have. Not of a length: what a part
        was made to be off its nominal length is no error of the machine.
        """
        return self.off and self.rms[1] > self.rms[0]

    @property
    def off(self) -> bool:
        """Whether the mean error after is beyond its uncertainty."""
        return abs(self.mean[1]) > self.half and self.kind != "length"

    @property
    def rounder(self) -> bool:
        """Whether the correction has made it rounder all the same (`ROUNDER`): the model then
        describes the points, and what the diameter is held against is in doubt. A circle through
        three points has no form.
        """
        return self.form[0] > ROUNDING_MM and self.form[1] < ROUNDER * self.form[0]


def size_errors(sizes: Sequence[Size]) -> tuple[SizeErrors, ...]:
    """One entry for each size that has a reference, in the order in which they come."""
    groups: dict[tuple[str, str], list[Size]] = {}
    for item in sizes:
        if math.isfinite(item.reference):
            groups.setdefault((item.kind, item.id), []).append(item)
    judged = sum(kind != "length" for kind, _ in groups)
    probability = 1 - (1 - PROBABILITY) / max(judged, 1)
    found = []
    for (kind, name), own in groups.items():
        errors = np.array([item.error for item in own])
        mean, rms = errors.mean(axis=0), np.sqrt((errors**2).mean(axis=0))
        form = np.sqrt(np.mean(np.square([item.form for item in own]), axis=0))
        half = [coverage_factor(probability, item.dof_error) * item.u_error for item in own]
        found.append(
            SizeErrors(
                kind=kind,
                id=name,
                parts=len(own),
                mean=(float(mean[0]), float(mean[1])),
                rms=(float(rms[0]), float(rms[1])),
                form=(float(form[0]), float(form[1])),
                half=float(np.median(half)),
            )
        )
    return tuple(found)


def feature_errors(points: Points, corrected: FloatArray) -> FeatureErrors:
    """Means over the points of every feature; `corrected` (n, 3) mm."""
    measured, code = np.unique(points.feature, return_inverse=True)
    count = np.bincount(code)[:, None]

    def mean(values: FloatArray) -> FloatArray:
        found: FloatArray = (
            np.column_stack([np.bincount(code, values[:, k]) for k in range(3)]) / count
        )
        return found

    return FeatureErrors(
        features=tuple(points.features[m] for m in measured),
        places=mean(points.nominal),
        before=mean(points.measured - points.nominal),
        after=mean(corrected - points.nominal),
    )


def rms_errors(sizes: Sequence[Size], kinds: Collection[str]) -> tuple[float, float] | None:
    """Root mean square of the errors of all sizes of some kinds before and after; None where none
    has a reference.
    """
    errors = [item.error for item in sizes if item.kind in kinds and math.isfinite(item.reference)]
    if not errors:
        return None
    before, after = np.sqrt(np.mean(np.square(errors), axis=0))
    return float(before), float(after)


def axis_corrections(axis: str, error: FloatArray, u: FloatArray) -> AxisCorrections:
    """Of modelled errors (n,) mm with their u (n,); nan where the axis was not measured."""
    known = np.isfinite(error)
    correction, own = -error[known], u[known]
    return AxisCorrections(
        axis=axis,
        points=len(own),
        least=float(correction.min()),
        mean=float(correction.mean()),
        largest=float(correction.max()),
        u_mean=float(own.mean()),
        u_largest=float(own.max()),
    )
