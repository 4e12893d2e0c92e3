"""Forward-backward selection of columns on compressed rows."""

from __future__ import annotations

from collections.abc import Sequence
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
    rows = replace(rows, factor=shortened(rows.factor))
    chosen: list[int] = []
    everything = range(1, rows.factor.shape[1] - 1)
    memory = autocorrelation([(rows, fitted_weights(rows, everything))])
    number, seen = effective_number(rows.n, memory), set[frozenset[int]]()
    # A set of columns that was there before would come back for ever.
    while frozenset(chosen) not in seen:
        seen.add(frozenset(chosen))
        entering = _best_entry(rows, chosen, number, enter)
        if entering is None:
            break
        chosen.append(entering)
        while (leaving := _worst(rows, chosen, number, remove)) is not None:
            chosen.remove(leaving)
    return tuple(sorted(chosen))


def fitted_weights(rows: Compressed, chosen: Sequence[int]) -> FloatArray:
    """w (k,) such that Z w are the residuals of the target on constant and chosen columns."""
    used = [0, *chosen]
    fit = least_squares(rows.factor[:, used], rows.factor[:, -1])
    weights = np.zeros(rows.factor.shape[1])
    weights[-1] = 1.0
    weights[used] = -fit.coefficients
    return weights


def _best_entry(rows: Compressed, chosen: Sequence[int], number: float, limit: float) -> int | None:
    others = [j for j in range(1, rows.factor.shape[1] - 1) if j not in chosen]
    if not others:
        return None
    p = len(chosen) + 1
    # R of constant, chosen, others, target: what the chosen leave of the rest is below them.
    R = triangle(rows.factor[:, [0, *chosen, *others, -1]])
    left, residual = R[p:, p:-1], R[p:, -1]
    squares = np.sum(left**2, axis=0)
    usable = squares > _NOTHING_LEFT * np.sum(R[:, p:-1] ** 2, axis=0)
    gain = np.where(usable, (left.T @ residual) ** 2 / np.where(usable, squares, 1.0), 0.0)
    best = int(np.argmax(gain))
    chance = _partial_p(rows, number - p - 1, float(gain[best]), float(residual @ residual))
    return others[best] if chance < limit else None


def _worst(rows: Compressed, chosen: Sequence[int], number: float, limit: float) -> int | None:
    """That of the chosen whose loss b_j^2/C_jj is least, where it is not significant."""
    if len(chosen) < 2:
        return None
    fit = least_squares(rows.factor[:, [0, *chosen]], rows.factor[:, -1])
    loss = fit.coefficients[1:] ** 2 / np.diag(fit.unscaled_covariance)[1:]
    least = int(np.argmin(loss))
    gain = float(loss[least])
    p = _partial_p(rows, number - len(chosen) - 1, gain, fit.rss + gain)
    return chosen[least] if p > limit else None


def _partial_p(rows: Compressed, dof: float, gain: float, before: float) -> float:
    """p of F = gain / (what is left / its effective degrees of freedom)."""
    if dof <= 0:
        return 1.0
    rss = before - gain
    total = float(np.sum(rows.factor[:, -1] ** 2))
    if before <= _NOTHING_LEFT * total:
        return 1.0
    if rss <= _NOTHING_LEFT * before:
        return 0.0
    return float(fdtrc(1, dof, gain / rss * dof))
