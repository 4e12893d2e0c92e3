"""The errors of a design one by one, and what they do to the coordinates of its tables.

Inputs, the errors of entries, of columns and of parts, are uncorrelated: sums over them, each
alone in a table, are expectations over all at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.stats.crossed import Completion, Freeing
from mtu_cli.close_loop_sealed.stats.strata import Strata
from mtu_cli.stats.least_squares import FloatArray

MOST = 1200
"""Inputs up to which each is passed on its own."""
PROBES = 400
"""Sums of all inputs with random signs instead of more (Hutchinson, Commun. Stat. Simul. Comput.
19 (1990) 433): a sum of squares of n degrees of freedom is then known to sqrt(2 / (400 n)) of it.
"""
VALUES = 1 << 21
"""Numbers in the tables that are passed at once."""

Inputs = Callable[[FloatArray], FloatArray]
"""From signs (b, n) of inputs to what they do to each axis, (b, J / A, P, H)."""
Turned = Callable[[FloatArray], FloatArray]
"""From values (b, J / A, P, H) to the coordinates (b, J, N) of each along each axis."""


def entry_and_column_inputs(strata: Strata, there: NDArray[np.bool_]) -> list[tuple[Inputs, int]]:
    """The entries that are `there` (P, H), the columns and their reversals, and their numbers."""
    P, H, _ = strata.shape
    cells = np.flatnonzero(there)
    even = strata.columns[:, [0, *strata.even.tolist()]]
    odd = strata.columns[:, strata.odd]

    def entries(of: FloatArray) -> FloatArray:
        found = np.zeros((len(of), P * H))
        found[:, cells] = of
        return found.reshape(len(of), 1, P, H)

    def columns(of: FloatArray) -> FloatArray:
        return np.ones((P, 1)) * (of @ even.T)[:, None, None]

    def reversals(of: FloatArray) -> FloatArray:
        return np.ones((P, 1)) * (of @ odd.T)[:, None, None]

    return [(entries, len(cells)), (columns, even.shape[1]), (reversals, odd.shape[1])]


def part_inputs(strata: Strata) -> Inputs:
    """The parts, by their offsets and smooth directions."""
    own = strata.columns[:, : 1 + strata.lines].T

    def parts(of: FloatArray) -> FloatArray:
        found: FloatArray = of[:, None, :, None] * own[:, None]
        return found

    return parts


def signs(n: int) -> FloatArray:
    """(m, n) with a sum of products over m that is the identity, exactly or on average."""
    if n <= MOST:
        return np.eye(n)
    rng = np.random.default_rng(n)
    found: FloatArray = rng.choice([-1.0, 1.0], (PROBES, n)) / np.sqrt(PROBES)
    return found


def turning(strata: Strata, completion: Completion, freeing: Freeing | None) -> Turned:
    """What tables of a design have as coordinates: freed, filled in, rotated."""
    if freeing is None:
        return _apart(strata, completion)
    return _together(strata, completion, freeing)


def coordinates(
    strata: Strata, turned: Turned, inputs: Inputs, of: FloatArray
) -> Iterator[FloatArray]:
    """Coordinates (b, J, N) of the inputs with the signs `of` (m, n), some at a time."""
    P, H, A = strata.shape
    J = inputs(of[:0]).shape[1] * A
    step = max(VALUES // (J * P * H * A), 1)
    for first in range(0, len(of), step):
        yield turned(inputs(of[first : first + step]))


def _together(strata: Strata, completion: Completion, freeing: Freeing) -> Turned:
    """Coordinates of values along each axis in turn, where freeing mixes the axes."""
    P, H, A = strata.shape

    def turned(values: FloatArray) -> FloatArray:
        tables = np.zeros((len(values), A, values.shape[1], P, H, A))
        for axis in range(A):
            tables[:, axis, :, :, :, axis] = values
        freed = freeing(tables.reshape(len(values), -1, P, H, A))
        return strata.coordinates(completion.fill(freed))[0]

    return turned


def _apart(strata: Strata, completion: Completion) -> Turned:
    """As `_together`, where nothing is freed: each axis has the same of its own values."""
    P, H, A = strata.shape

    def turned(values: FloatArray) -> FloatArray:
        flat = strata.rotated(completion.fill(values[..., None])).reshape(*values.shape[:2], P * H)
        found = np.zeros((len(values), A, values.shape[1], strata.size))
        for stratum in strata.all:
            place = strata.order[stratum.slice] - stratum.axis * P * H
            found[:, stratum.axis, :, stratum.slice] = flat[..., place]
        return found.reshape(len(values), -1, strata.size)

    return turned
