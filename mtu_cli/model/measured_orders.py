"""Parts whose axes are swapped or run the other way, or whose features are in another order."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.points import Points
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.measured_units import EXPLAINS
from mtu_cli.stats.least_squares import FloatArray

IntArray = NDArray[np.int64]

NAMED = 3
NEARLY_ALL = 0.9
"""Share of a part's points that a mistake explains: there may be a bad one among them."""
FEWEST = 3
"""Points of a part from which on its order can be told from another one."""
MOST = 5000
"""Points of a part up to which another order of its features is looked for."""


def parts_in_other_order(
    points: Points, far: NDArray[np.bool_], axes: tuple[int, ...], limit: float
) -> str:
    """What order of axes or features explains the few parts of the points `far` (n,), in words; ""
    where one of these parts has none. `limit` is that of `far`, mm.
    """
    own = np.unique(points.part[far])
    if len(own) > NAMED:
        return ""
    found: dict[str, list[str]] = {}
    for code in own.tolist():
        rows = points.part == code
        measured, nominal = points.measured[rows][:, axes], points.nominal[rows][:, axes]
        order = other_order(measured, nominal, axes, limit)
        found.setdefault(order, []).append(repr(points.parts[code]))
    if "" in found:
        return ""
    return "; ".join(
        f"of part{'s' if len(names) > 1 else ''} {' and '.join(names)} this looks like {order}"
        for order, names in found.items()
    )


def other_order(
    measured: FloatArray, nominal: FloatArray, axes: tuple[int, ...], limit: float
) -> str:
    """What order of axes or features explains a part's points (k, axes) in mm, "" where none does.

    A way round comes with an origin of its own: what is measured from the other side has another
    zero. `limit` is how near, mm, what is undone comes to the nominal.
    """
    if len(measured) < FEWEST:
        return ""
    near = min(EXPLAINS * typical(measured - nominal), limit)
    away = measured - nominal
    if typical(away - np.median(away, axis=0)) < near:
        # It lies elsewhere, whatever else its places may be taken for.
        return ""
    flat = np.ptp(nominal, axis=0) <= limit
    for order, turned in _orders(len(axes)):
        # What has one place along an axis has no way round.
        if flat[np.array(turned)].any():
            continue
        own = measured[:, order] * np.where(turned, -1.0, 1.0)
        left = own - nominal
        left = left - np.where(turned, np.median(left, axis=0), 0.0)
        if np.quantile(np.abs(left).max(axis=1), NEARLY_ALL) < near:
            return _words(order, turned, [AXES[axis] for axis in axes])
    return "features in another order" if _shuffled(measured, nominal, near) else ""


def _orders(count: int) -> Iterator[tuple[list[int], tuple[bool, ...]]]:
    """Orders of axes and which of them run the other way, the fewest changes first."""
    every = [
        (list(order), turned)
        for order in permutations(range(count))
        for turned in product((False, True), repeat=count)
    ]
    changes = [
        sum(i != axis for i, axis in enumerate(order)) + sum(turned) for order, turned in every
    ]
    for i in np.argsort(changes, kind="stable")[1:].tolist():
        yield every[i]


def _words(order: list[int], turned: tuple[bool, ...], letters: list[str]) -> str:
    moved = [letter for i, letter in enumerate(letters) if order[i] != i]
    other = [letters[i] for i, way in enumerate(turned) if way]
    said = [f"{', '.join(moved[:-1])} and {moved[-1]} swapped"] if moved else []
    said += [f"{' and '.join(other)} counted the other way"] if other else []
    return ", and ".join(said)


def _shuffled(measured: FloatArray, nominal: FloatArray, near: float) -> bool:
    """Whether most points are where another feature of the part is, each at one of its own."""
    if len(measured) > MOST:
        return False
    from scipy.spatial import KDTree

    away, which = KDTree(nominal).query(measured)
    at = away < near * np.sqrt(nominal.shape[1])
    index: IntArray = np.asarray(which)
    moved = (nominal[index] != nominal).any(axis=1)
    most = bool(np.mean(at) >= NEARLY_ALL and 2 * np.count_nonzero(moved & at) > len(moved))
    return most and _spread(index[at], nominal)


def _spread(which: IntArray, nominal: FloatArray) -> bool:
    """Whether the places taken are as many as there are: repeats of a feature share one."""
    taken, there = (len(np.unique(nominal[rows], axis=0)) for rows in (which, slice(None)))
    return taken >= NEARLY_ALL * there


def typical(errors: FloatArray) -> float:
    """The median over points (n, axes) of the largest error along an axis."""
    return float(np.median(np.abs(errors).max(axis=1)))
