"""Circles in planes that lean: points of different heights cut a round bore askew.

A plane whose normal is at theta from a bore's axis cuts it in an ellipse, longer by the share
theta^2 / 2 along the slope. That is no error of the machine: it goes into the covariance that an
oval is held against (`roundness`), and what the diameter gains is told.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.correct.quantity import Size
from mtu_cli.analyses.correct.roundness import Shape
from mtu_cli.analyses.correct.strain import entries
from mtu_cli.model.geometry import GeometryError, fit_circle, fit_plane
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.resolution import last_digit
from mtu_cli.stats.least_squares import FloatArray

OWN_HEIGHTS = 0.05
"""Share of the squares of heights along an axis that a plane through them leaves, from which on
it leans by heights of the points' own: of any two heights of five or more points evenly around it
leaves a ninth at least (three high and three low of six), of points at other angles less."""
ROUNDER = 0.5
"""Share of what points are out of round seen along their plane's normal, below which they are
rounder seen along an axis: by half, as chance alone seldom has it."""
ROUNDING_MM = 1e-9
LEAST_MM = 1e-5
"""A bore that is larger by less is no larger to anybody."""
ALONG = np.radians(1.0)
"""A bore that is inclined by less is along an axis of the machine."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaning:
    """A circle in a plane that leans by `angle` (rad), in which a round bore is `larger` (mm);
    the bore is along `axis`, None: along none of the machine.
    """

    id: str
    operation: str
    axis: str | None
    angle: float
    larger: float

    @property
    def label(self) -> str:
        """Its name, with that of the operation."""
        return f"{self.operation} {self.id}".strip()


def askew(normal: FloatArray, drawn: FloatArray) -> FloatArray:
    """Strain (6,) of a round bore along `drawn` in a plane across `normal`, unit vectors (3,): it
    is longer by theta^2 / 2 along the slope of the plane. 0 where nothing is `drawn` (0).
    """
    slope = drawn - (drawn @ normal) * normal
    return entries(0.5 * np.outer(slope, slope))


def bore(drawn: FloatArray) -> FloatArray:
    """Unit vector (3,) along the bore of a circle's `drawn` points (n, 3), mm; 0 where these are
    not known, or make no plane; along z of a part that is drawn without heights.

    Across their plane. Points that are drawn at heights of their own make a plane lean that is
    none of the bore's: its axis is then that of the machine's. Of a bore that leans itself the
    points lie about their plane by far less than it is inclined (`OWN_HEIGHTS`), and are no rounder
    as the machine's axis sees them.
    """
    if np.isnan(drawn[:, 2]).all() and np.isfinite(drawn[:, :2]).all():
        return np.array([0.0, 0.0, 1.0])
    if np.isnan(drawn).any():
        return np.zeros(3)
    try:
        plane = fit_plane(drawn)
    except GeometryError:
        return np.zeros(3)
    axis = np.eye(3)[np.argmax(np.abs(plane.normal))]
    heights = (drawn - plane.centroid) @ axis
    left = plane.heights / (plane.normal @ axis)
    own = left @ left >= OWN_HEIGHTS * (heights @ heights)
    return axis if own or _rounder(drawn, axis) else plane.normal


def _rounder(drawn: FloatArray, axis: FloatArray) -> bool:
    """Whether points are less than half as far out of round seen along an axis, and out of round
    else by more than the drawing's digits make them.
    """
    try:
        seen = fit_circle(drawn[:, axis == 0])
        own = fit_circle(drawn)
    except GeometryError:
        return False
    off = float(np.std(own.residuals))
    rounder = np.std(seen.residuals) < ROUNDER * off - ROUNDING_MM
    return bool(rounder and off > last_digit(drawn.ravel()))


def leaning(shapes: Iterable[Shape], sizes: Sequence[Size]) -> tuple[Leaning, ...]:
    """Circles whose points lie at heights through which a plane leans, in which a round bore would
    be larger by more than the u of its diameter, one of `sizes`.
    """
    found = []
    for shape in shapes:
        key, mean = (shape.kind, shape.id, shape.operation), shape.mean()
        u = [size.u for size in sizes if (size.kind, size.id, size.operation) == key]
        trace = float(mean.oblique[:3].sum())
        larger = mean.radius * trace
        if u and larger > max(min(u), LEAST_MM):
            own = Leaning(
                id=shape.id, operation=shape.operation, axis=_axis(mean.bore),
                angle=float(np.sqrt(2 * trace)), larger=larger,
            )  # fmt: skip
            found.append(own)
    return tuple(found)


def _axis(along: FloatArray) -> str | None:
    k = int(np.argmax(np.abs(along)))
    return AXES[k] if abs(along[k]) > np.cos(ALONG) else None
