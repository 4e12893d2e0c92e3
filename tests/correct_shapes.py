"""Rings and balls with a form of their own, and a machine whose model lacks a strain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from correct_examples import DIAMETER, error_at, machine, ring_part, ring_places, ring_points, seen
from numpy.typing import NDArray

from mtu_cli.analyses.correct import CorrectResult, correct
from mtu_cli.analyses.correct.leaning import askew
from mtu_cli.analyses.correct.quantity import Kind
from mtu_cli.analyses.correct.roundness import Shape
from mtu_cli.analyses.correct.scatter import Origin, PointScatter
from mtu_cli.analyses.correct.strain import levers_of
from mtu_cli.model.geometry import fit_circle, fit_plane, fit_sphere
from mtu_cli.model.settings import Settings

Floats = NDArray[np.float64]
NOISE, RADIUS = 1e-3, 40.0
UPRIGHT = np.array([0.0, 0.0, 1.0])


def shape(
    points: Floats, kind: Kind = "circle", K: Floats | None = None, dof: float = np.inf
) -> Shape:
    """Of one visit of points (n, 2) or (n, 3)."""
    fit = (fit_sphere if kind == "sphere" else fit_circle)(points)
    n, d = points.shape
    away = np.zeros((n, 3))
    away[:, :d] = fit.away
    askance = d == 3 and kind == "circle"
    levers = levers_of(kind, fit.radius, away)
    return Shape(
        kind=kind, id="a", operation="", radius=fit.radius, residuals=fit.residuals, away=away,
        K=np.zeros((n, n)) if K is None else K, dof=dof,
        bore=UPRIGHT if askance else np.zeros(3), judged=levers is not None,
        oblique=askew(fit_plane(points).normal, UPRIGHT) if askance else np.zeros(6),
    )  # fmt: skip


def together(visits: list[Shape]) -> Shape:
    found = visits[0]
    for own in visits[1:]:
        found = found.and_another(own)
    return found


def known(origin: Origin = "repeats", s: float = NOISE) -> PointScatter:
    return PointScatter(variance=s**2, spread=0.0, dof=np.inf, origin=origin)


def ring(n: int) -> Floats:
    angle = 2 * np.pi * np.arange(n) / n
    return RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])


def ball(n: int, rng: np.random.Generator, above: float = -1.0) -> Floats:
    """Points on a sphere, no lower than `above` radii."""
    z, angle = rng.uniform(above, 1.0, n), rng.uniform(0, 2 * np.pi, n)
    flat = np.sqrt(1 - z**2)
    return RADIUS * np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z])


def noisy(points: Floats, rng: np.random.Generator) -> Floats:
    return points + NOISE * rng.standard_normal(points.shape)


def sheared(points: Floats, angle: float) -> Floats:
    """With a right angle of x and y that is off."""
    return points + angle * np.column_stack(
        [points[:, 1], *np.zeros((points.shape[1] - 1, len(points)))]
    )


def lacking(folder: Path, strain_at: Floats) -> CorrectResult:
    """Two parts on a machine with an error that its model lacks, read twice each."""
    rng = np.random.default_rng(1)
    true = np.tile(ring_places(diameter=DIAMETER), (4, 1))
    T = np.full(44, 21.0)
    measured = seen(true, lambda p, t: error_at(p, t) + p @ strain_at, T)
    measured[:, :2] += 5e-4 * rng.standard_normal((44, 2))
    points = ring_points(
        measured, ["p", "p", "q", "q"], [1, 2, 1, 2], covariates={"T_scale_degC": T}
    )
    return correct(machine(folder), ring_part(folder), points, Settings())
