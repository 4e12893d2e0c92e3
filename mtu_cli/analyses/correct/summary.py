"""Corrected points summed up: by feature over parts and repeats, and along an axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.stats.least_squares import FloatArray


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

    points: int
    least: float
    mean: float
    largest: float
    u_mean: float
    u_largest: float


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


def axis_corrections(error: FloatArray, u: FloatArray) -> AxisCorrections:
    """Of modelled errors (n,) mm with their u (n,); nan where the axis was not measured."""
    known = np.isfinite(error)
    correction, own = -error[known], u[known]
    return AxisCorrections(
        points=len(own),
        least=float(correction.min()),
        mean=float(correction.mean()),
        largest=float(correction.max()),
        u_mean=float(own.mean()),
        u_largest=float(own.max()),
    )
