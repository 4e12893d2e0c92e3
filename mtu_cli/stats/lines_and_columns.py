"""What is left of a table of parts and columns beside a line of every part and a mean of every
column, whatever cells are missing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import FloatArray

TINY = 1e-9
"""Of the largest square of directions: those with less do not differ from the others."""


def beside_lines_and_columns(
    values: FloatArray, there: NDArray[np.bool_], smooth: FloatArray
) -> tuple[FloatArray, FloatArray, int]:
    """Residuals (P, H, A) of `values` (P, H, A), zero where they are not `there` (P, H); the share
    (P, H) of a cell's variance that its part's line leaves; and the degrees of freedom of each of
    the A tables.

    Least squares on `smooth` (H, k), by every part for itself, and on a free mean of every column.
    With Q_p the projector on what the part's own cells have beside its line, the means c solve
    (sum Q_p) c = sum Q_p y_p, and the residuals Q_p (y_p - c) have sum rank(Q_p) - rank(sum Q_p)
    degrees of freedom. Cells of parts that hold no more than a line tell nothing, and have none.
    """
    basis = line_bases(there, smooth)
    y = np.where(there[:, :, None], values, 0.0)
    flat = basis.transpose(1, 0, 2).reshape(basis.shape[1], -1)
    total = np.diag(there.sum(axis=0).astype(float)) - flat @ flat.T
    square, turn = np.linalg.eigh(total)
    kept = square > TINY * max(float(square[-1]), 1.0)
    wanted = _projected(y, basis).sum(axis=0)
    means = (turn[:, kept] / square[kept]) @ (turn[:, kept].T @ wanted)
    left = _projected(np.where(there[:, :, None], y - means, 0.0), basis)
    dof = int(there.sum()) - int((basis**2).sum().round()) - int(kept.sum())
    share = np.where(there, np.maximum(1.0 - (basis**2).sum(axis=2), 0.0), 0.0)
    return np.where(there[:, :, None], left, 0.0), share, dof


def line_bases(there: NDArray[np.bool_], smooth: FloatArray) -> FloatArray:
    """(P, H, k): orthonormal columns over each part's cells, zero where these have fewer."""
    own = smooth * there[:, :, None]
    square, turn = np.linalg.eigh(np.einsum("phi,phj->pij", own, own))
    # Cells in a row have fewer directions than the part.
    kept = square > TINY * np.maximum(square[:, -1:], 1e-300)
    scale = np.where(kept, 1.0 / np.sqrt(np.where(kept, square, 1.0)), 0.0)
    found: FloatArray = own @ turn * scale[:, None, :]
    return found


def _projected(y: FloatArray, basis: FloatArray) -> FloatArray:
    """Q_p y_p (P, H, A) of every part."""
    return y - basis @ (basis.transpose(0, 2, 1) @ y)
