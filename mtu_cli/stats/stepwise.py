"""Forward-backward selection of columns on compressed rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import fdtrc

from mtu_cli.stats.compressed import Compressed, autocorrelation, effective_number
from mtu_cli.stats.least_squares import FloatArray, least_squares, shortened, triangle

ENTER = 0.05
REMOVE = 0.10
_NOTHING_LEFT = 1e-12
"""Share of a column, or of the sum of squares, below which only rounding is left."""


def stepwise(rows: Compressed, enter: float = ENTER, remove: float = REMOVE) -> tuple[int, ...]:
    """The chosen of the columns 1 ... k-2; column 0 is the constant, the last one the target.

    Forward-backward selection by the partial F of each column (Draper & Smith, Applied
    Regression Analysis, 1998, ch. 15): the best one enters at p < `enter`, any whose p rises
    above `remove` leaves again. Residuals of one warm-up follow each other, so that n counts
    with the effective number of independent ones (`effective_number`), by the autocorrelation of
    the residuals on all columns: those on few columns hold the drift itself and would let nothing
    enter.
    """
    # Steps cost less by a factor of no more rows than columns.
    Z = shortened(rows.factor)
    everything = least_squares(Z[:, :-1], Z[:, -1]).coefficients
    residuals = replace(rows, factor=Z), np.append(-everything, 1.0)
    number = effective_number(rows.n, autocorrelation([residuals]))
    least = _NOTHING_LEFT * float(Z[:, -1] @ Z[:, -1])

    def p(count: int, gain: float, before: float) -> float:
        """Of the F by which one of `count` columns lowers the sum of squares `before`."""
        dof, left = number - count - 1, before - gain
        if dof <= 0 or before <= least:
            return 1.0
        return float(fdtrc(1, dof, gain / left * dof)) if left > _NOTHING_LEFT * before else 0.0

    chosen: list[int] = []
    seen = set[frozenset[int]]()
    # A set of columns that was there before would come back for ever.
    while frozenset(chosen) not in seen:
        seen.add(frozenset(chosen))
        others = [j for j in range(1, Z.shape[1] - 1) if j not in chosen]
        gains, before = _gains(Z, chosen, others)
        if not others or p(len(chosen) + 1, float(gains.max()), before) >= enter:
            break
        chosen.append(others[int(np.argmax(gains))])
        while len(chosen) > 1:
            fit = least_squares(Z[:, [0, *chosen]], Z[:, -1])
            loss = fit.coefficients[1:] ** 2 / np.diag(fit.unscaled_covariance)[1:]
            weakest = float(loss.min())
            if p(len(chosen), weakest, fit.rss + weakest) <= remove:
                break
            del chosen[int(np.argmin(loss))]
    return tuple(sorted(chosen))


def _gains(Z: FloatArray, chosen: list[int], others: list[int]) -> tuple[FloatArray, float]:
    """What each of the others takes off the sum of squares that the chosen leave, and that sum."""
    p = len(chosen) + 1
    # R of constant, chosen, others, target: what the chosen leave of the rest is below them.
    R = triangle(Z[:, [0, *chosen, *others, -1]])
    left, residual = R[p:, p:-1], R[p:, -1]
    squares = np.sum(left**2, axis=0)
    usable = squares > _NOTHING_LEFT * np.sum(R[:, p:-1] ** 2, axis=0)
    gains = np.where(usable, (left.T @ residual) ** 2 / np.where(usable, squares, 1.0), 0.0)
    return gains, float(residual @ residual)
