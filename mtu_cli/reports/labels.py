"""Names beside marks in a figure, where they hide the least."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import FloatArray

DIRECTIONS = 16
WIDTH = 34
"""Characters of a line of a name beside a panel."""
CHARACTER = 0.066
"""Width of a character of a name, inches."""
LINE = 0.24
"""Between names one above the other, inches."""
LONG, SHORT = 40, 5
"""Characters that a name keeps where there is no room for all of it, at most and at least."""


def cut(name: str, length: int) -> str:
    """A name without its middle where it is long: numbered names differ at the end."""
    if len(name) <= length:
        return name
    end = (length - 3) // 2
    return f"{name[: length - 3 - end]}...{name[-end:]}"


def clipped(name: str, length: int) -> str:
    """The same with one sign for what is left out, where there is little room."""
    if len(name) <= length:
        return name
    end = (length - 1) // 2
    return f"{name[: length - 1 - end]}\N{HORIZONTAL ELLIPSIS}{name[len(name) - end :]}"


def room(names: Collection[str], places: Sequence[FloatArray], spacing: float) -> int:
    """Characters of a name that there is room for beside features at `places` (n, 2), inches.

    All of the longest, or of long names as many as the others leave room for and as tell all names
    apart; 0 where that is none. `spacing` of neighbouring features, inches.
    """
    longest: int = max(len(name) for name in names)
    lengths: list[int] = [longest, *range(min(LONG, longest - 1), SHORT - 1, -1)]
    for letters in lengths:
        if len({clipped(name, letters) for name in names}) < len(names):
            return 0
        width = CHARACTER * letters
        if width <= 0.6 * spacing or all(_rows_fit(item, width) for item in places):
            return letters
    return 0


def _rows_fit(places: FloatArray, width: float) -> bool:
    """Whether names of a `width`, inches, have room where features stand in rows or columns."""
    dx, dy = np.abs(places[:, None] - places[None])[np.triu_indices(len(places), 1)].T
    return bool(((width <= 0.6 * dx) | (dy >= LINE)).all())


def spread(count: int, most: int) -> list[int]:
    """At most `most` of `count` places, ends included, evenly apart."""
    if count <= most:
        return list(range(count))
    return [round(i * (count - 1) / (most - 1)) for i in range(most)]


def folded(name: str, width: int = WIDTH) -> str:
    """A long name in two lines of at most `width` characters, without its middle if need be."""
    if len(name) <= width:
        return name
    lines = textwrap.wrap(name, width)
    if len(lines) > 2:
        lines = [lines[0], cut(name[len(lines[0]) :].lstrip(), width)]
    return "\n".join(lines)


def around(
    places: FloatArray,
    tips: FloatArray,
    radii: FloatArray,
    reach: float,
    also: Sequence[tuple[FloatArray, FloatArray]] = (),
    boxes: tuple[FloatArray, float] | None = None,
) -> FloatArray:
    """Where to write each name, (n, 2): `reach` from its place, clear of arrows and ellipses.

    `tips` (n, 2) end the arrows that start at `places`, `radii` (n,) are those of the
    ellipses about the tips, `also` starts and tips (m, 2) of further arrows, `boxes` widths (n,)
    and the height of the names, which must not run into one another. Each name takes
    the direction of least cover, in order; all in the unit of the figure.
    """
    starts = np.vstack([places, *(start for start, _ in also)])
    ends = np.vstack([tips, *(end for _, end in also)])
    angles = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    offsets = reach * np.column_stack([np.cos(angles), np.sin(angles)])
    placed = np.zeros((0, 2))
    for i, (place, tip) in enumerate(zip(places, tips, strict=True)):
        spots = place + offsets
        cost = 3.0 * _near(_to_segments(spots, starts, ends), 0.8 * reach).sum(axis=1)
        cost += 4.0 * _near(_apart(spots, places), 0.9 * reach).sum(axis=1)
        cost += _near(_apart(spots, tips) - radii, 0.5 * reach).sum(axis=1)
        if len(placed):
            cost += 6.0 * _near(_apart(spots, placed), 1.6 * reach).sum(axis=1)
            if boxes is not None:
                cost += 12.0 * _meet(spots, placed, boxes, i).sum(axis=1)
        # Opposite to the arrow where nothing else decides.
        direction = tip - place
        norm = float(np.linalg.norm(direction))
        if norm > 0:
            cost += 0.2 * (offsets @ direction) / (reach * norm)
        placed = np.vstack([placed, spots[int(np.argmin(cost))]])
    return placed


def _meet(
    spots: FloatArray, placed: FloatArray, boxes: tuple[FloatArray, float], own: int
) -> NDArray[np.bool_]:
    """Whether the name `own` at `spots` runs into those that are `placed` (the first ones)."""
    widths, height = boxes
    dx, dy = np.abs(spots[:, None] - placed[None]).transpose(2, 0, 1)
    result: NDArray[np.bool_] = (dx < 0.5 * (widths[own] + widths[: len(placed)])) & (dy < height)
    return result


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
