"""Whether every part has the same turn (or growth) along two axes: an F test between nested models.

Beside a mean of every column, each part has a line of its own along each axis. What turns or grows
as a whole has one coefficient for both axes along a direction of these lines; what one axis alone
has needs two. Both models by least squares, their residual sums of squares compared (Scheffe, The
Analysis of Variance (1959), 2.9), whatever cells are missing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from mtu_cli.close_loop_sealed.stats.loose_columns import beside_lines_and_columns
from mtu_cli.stats.least_squares import FloatArray, least_squares

ROUNDING = 1e-20
"""Of the values' squares."""
LEAST_SD = 1e-4
"""Of the other axis' standard deviation: one that scatters less has no scatter to be held against.
"""
LEAST_APART = 1e-9
"""Of a contrast, below which what it has beside movements of the whole is rounding."""
MOST_COLUMNS = 300
"""Of one axis: the means of both are solved for at once, by eigenvectors, the time of which goes
with the cube of their number: a tenth of a second of as many. More columns are not tested.
"""


def apart_from_whole(direction: FloatArray, whole: Sequence[FloatArray]) -> FloatArray | None:
    """(2, k): the contrast of lines' coefficients between a `direction` (2, k) along the one axis
    and along the other, free of whatever moves a part as a whole. None where nothing is left of
    it, as where all features lie on one oblique line.

    `whole` are all such directions, the one itself among them: where features lie obliquely a
    growth moves the axes apart along a turn. All about the middle of the places: without a part
    of the constant.
    """
    apart = np.concatenate([direction[0] / np.sum(direction[0] ** 2),
                            -direction[1] / np.sum(direction[1] ** 2)])  # fmt: skip
    known = np.stack([own.ravel() for own in whole], axis=1)
    left = apart - known @ least_squares(known, apart).coefficients
    if np.linalg.norm(left) < LEAST_APART * np.linalg.norm(apart):
        return None
    found: FloatArray = left.reshape(direction.shape)
    return found


def p_alike(
    values: FloatArray,
    there: NDArray[np.bool_],
    smooth: FloatArray,
    apart: FloatArray,
    sd: FloatArray,
    further: float = 1.0,
) -> float | None:
    """p of lines without the contrast `apart` (2, k) of their coefficients in the columns `smooth`
    (H, k), for `values` (P, H, 2) that are `there` (P, H), of standard deviations `sd` (2,).

    None where too few are there to tell, where one axis hardly scatters (`LEAST_SD`), and of more
    than `MOST_COLUMNS` columns.

    `further` (1 or more) is by how much the variance of the contrast is larger than that of the
    values makes it, by what is known to move the axes apart.
    """
    H = len(smooth)
    if H > MOST_COLUMNS or sd.min() <= LEAST_SD * sd.max():
        return None
    columns = np.concatenate(
        [np.kron(np.eye(2)[axis], smooth / sd[axis]) for axis in range(2)], axis=0
    )
    both = (values / sd).transpose(0, 2, 1).reshape(len(values), 2 * H, 1)
    twice = np.concatenate([there, there], axis=1)
    designs = (columns, columns @ _without(apart))
    left, one = (beside_lines_and_columns(both, twice, own) for own in designs)
    dof, more = left[2], one[2] - left[2]
    if dof < 1 or more < 1:
        return None
    within, between = float(np.sum(left[0] ** 2)), float(np.sum(one[0] ** 2))
    # Where nothing scatters, what differs by rounding does not differ.
    floor = ROUNDING * float(np.sum(both[twice] ** 2))
    if between <= floor:
        return 1.0
    ratio = (between - within) / more / (further * max(within, floor) / dof)
    return float(fdtrc(more, dof, max(ratio, 0.0)))


def _without(apart: FloatArray) -> FloatArray:
    """(2 k, 2 k - 1): all coefficients that have nothing of a contrast."""
    square, turn = np.linalg.eigh(np.outer(apart, apart))
    found: FloatArray = turn[:, np.argsort(square)[:-1]]
    return found
