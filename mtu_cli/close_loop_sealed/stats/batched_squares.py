"""What columns leave of readings, of many small problems at once."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray, gram_schmidt


def batched_squares_left(X: FloatArray, y: FloatArray, least: float) -> FloatArray:
    """min over b of |y - X b|^2, (m,), of m small problems at once; X is (k, n, m), y (n, m) or
    (n, 1) for all of them.

    A column of which no more than the length `least` is left beside those before it explains
    nothing: what is rounding alone takes nothing from the others either.
    """
    given = np.broadcast_to(y, X.shape[1:])
    _, _, rest = gram_schmidt(X, given, np.full(1, least), np.inf)
    found: FloatArray = np.einsum("nm,nm->m", rest, rest)
    return found
