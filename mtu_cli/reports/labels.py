"""Names beside marks in a figure, where they hide the least."""

from __future__ import annotations

from typing import Any

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

DIRECTIONS = 16


def around(places: FloatArray, tips: FloatArray, radii: FloatArray, reach: float) -> FloatArray:
    """Where to write each name, (n, 2): `reach` from its place, clear of arrows and ellipses.

    `tips` (n, 2) end the arrows that start at `places`, `radii` (n,) are those of the
    ellipses about the tips. Each name takes the direction of least cover, in order; all in
    the unit of the figure.
    """
    angles = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    offsets = reach * np.column_stack([np.cos(angles), np.sin(angles)])
    placed = np.zeros((0, 2))
    for place, tip in zip(places, tips, strict=True):
        spots = place + offsets
        cost = 3.0 * _near(_to_segments(spots, places, tips), 0.8 * reach).sum(axis=1)
        cost += 4.0 * _near(_apart(spots, places), 0.9 * reach).sum(axis=1)
        cost += _near(_apart(spots, tips) - radii, 0.5 * reach).sum(axis=1)
        if len(placed):
            cost += 6.0 * _near(_apart(spots, placed), 1.6 * reach).sum(axis=1)
        # Opposite to the arrow where nothing else decides.
        direction = tip - place
        norm = float(np.linalg.norm(direction))
        if norm > 0:
            cost += 0.2 * (offsets @ direction) / (reach * norm)
        placed = np.vstack([placed, spots[int(np.argmin(cost))]])
    return placed


def _near(distance: FloatArray, limit: float) -> FloatArray:
    """0 beyond `limit`, rising to 1 at no distance."""
    result: FloatArray = np.clip(1.0 - distance / limit, 0.0, 1.5)
    return result


def _apart(spots: FloatArray, others: FloatArray) -> FloatArray:
    result: FloatArray = np.linalg.norm(spots[:, None] - others[None], axis=2)
    return result


def _to_segments(spots: FloatArray, starts: FloatArray, ends: FloatArray) -> FloatArray:
    """Distance (spots, segments) of points to line segments."""
    along = ends - starts
    square = np.maximum((along**2).sum(axis=1), 1e-30)
    t = ((spots[:, None] - starts[None]) * along[None]).sum(axis=2) / square
    foot = starts[None] + np.clip(t, 0.0, 1.0)[:, :, None] * along[None]
    result: FloatArray = np.linalg.norm(spots[:, None] - foot, axis=2)
    return result


def halo() -> list[Any]:
    """A white rim that keeps a name legible on whatever it covers."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.2, foreground="white")]
