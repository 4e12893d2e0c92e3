"""The smallest effects that a table would show."""

from __future__ import annotations

import numpy as np

from mtu_cli.analyses.close_loop.estimate import estimate, raw_design
from mtu_cli.analyses.close_loop.prepare import Prepared
from mtu_cli.analyses.close_loop.search import Search
from mtu_cli.stats.column_groups import whitened
from mtu_cli.stats.family_gate import Gate
from mtu_cli.stats.least_squares import beside

POWER_DEVIATE = 0.8416212335729143
"""Normal deviate of a power of 80 %."""


def minimum_detectable(
    prepared: Prepared, gate: Gate, found: Search, alpha: float
) -> dict[str, float]:
    """Root mean square (mm, rad) over the cells of the smallest effect of each candidate that
    passes the gate four times in five; the median over its members. What was found is no noise, nor
    is what a candidate itself takes up: the scatter is that of the data without them.

    The likelihood ratio of one column among n coordinates is n log(1 + t^2 / v), v = n - k, t of
    noncentral Student distribution: it passes a limit T where t > c = sqrt(v (exp(T / n) - 1)).
    By (t (1 - 1/4v) - z) / sqrt(1 + t^2/2v) ~ N(0, 1) (Abramowitz & Stegun 1972, 26.7.10) that has
    a probability of 80 % at a signal-to-noise z = c (1 - 1/4v) + 0.84 sqrt(1 + c^2/2v).
    """
    scan = prepared.scan
    strata = scan.frame.strata
    limit = float(np.quantile(gate.largest, 1 - alpha))
    y = _left(prepared, found)
    freedom = np.repeat(scan.dof, [stratum.size for stratum in strata.all])
    smallest = {}
    first = 0
    for f, members in enumerate(scan.columns):
        T = gate.statistic_of(limit, f)
        amplitudes = []
        for i, member in enumerate(members):
            X = whitened(strata, scan.whitening, raw_design(scan, [member]))
            weights = _weights(prepared, y, X)
            information = np.einsum("ni,n,nj->ij", X, weights, X)
            squares = _mean_squares(prepared, first + i)
            k = len(squares)
            unit = np.full(k, 1 / np.sqrt(k)) / np.sqrt(np.maximum(squares, 1e-300))
            z2 = float(unit @ information @ unit)
            if z2 > 0:
                n = float(np.einsum("ni,n,n->", X**2, weights, freedom))
                n /= float(np.trace(information))
                amplitudes.append(_needed(T, n, k) / np.sqrt(z2))
        first += len(members)
        if amplitudes:
            smallest[scan.names[f]] = float(np.median(amplitudes))
    return smallest


def _needed(T: float, n: float, k: int) -> float:
    """Signal to noise that passes the limit T four times in five."""
    v = max(n - k, 1.0)
    c2 = v * np.expm1(min(T / n, 50.0))
    return float(np.sqrt(c2) * (1 - 0.25 / v) + POWER_DEVIATE * np.sqrt(1 + c2 / (2 * v)))


def _left(prepared: Prepared, found: Search) -> np.ndarray:
    """The whitened coordinates (N,) less the effects that were found."""
    scan, left = prepared.scan, prepared.y
    if found.members:
        columns = prepared.whole(found.members)
        left = left - raw_design(scan, columns) @ estimate(scan, left, columns).beta
    return whitened(scan.frame.strata, scan.whitening, left)


def _weights(prepared: Prepared, y: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Inverse variances (N,) of the coordinates, by stratum, of what X (N, k) leaves of y."""
    scan = prepared.scan
    weights = np.zeros(len(y))
    for s, n in zip(scan.frame.strata.all, scan.dof, strict=True):
        own = X[s.slice][:, (X[s.slice] != 0.0).any(axis=0)]
        k = own.shape[1]
        square = float(y[s.slice] @ y[s.slice])
        if 0 < k < min(n, s.size):
            rest = beside(np.column_stack([own, y[s.slice]]), k)
            square = float(rest[0, 0]) ** 2
            n = n - k
        weights[s.slice] = n / square if square > 0 else 0.0
    return weights


def _mean_squares(prepared: Prepared, index: int) -> np.ndarray:
    """Mean square of each column over the cells of the axes that it affects."""
    P, H = prepared.table.there.shape
    found = []
    for column in prepared.members[index].columns:
        means = [
            float(np.mean((np.broadcast_to(v, (P, H)) - np.mean(v)) ** 2)) for v in column.values()
        ]
        found.append(float(np.mean(means)))
    return np.array(found)
