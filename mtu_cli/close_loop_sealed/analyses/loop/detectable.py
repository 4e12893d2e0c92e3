"""The smallest effects that a table would show."""

from __future__ import annotations

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.estimate import entries_of, estimate, raw_design
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.model.effect_library import Member
from mtu_cli.close_loop_sealed.stats.column_groups import Packed
from mtu_cli.close_loop_sealed.stats.family_gate import Gate
from mtu_cli.stats.least_squares import FloatArray, beside

POWER_DEVIATE = 0.8416212335729143
"""Normal deviate of a power of 80 %."""


def minimum_detectable(
    prepared: Prepared, gate: Gate, found: Search, alpha: float
) -> dict[str, float]:
    """Root mean square (mm, rad) over the cells of the smallest effect of each candidate that
    passes the gate four times in five, whichever of its forms it has; the median over values that
    are searched. What was found is no noise, nor is what a candidate itself takes up.

    The likelihood ratio of one column among n coordinates is n log(1 + t^2 / v), v = n - k, t of
    noncentral Student distribution: it passes a limit T where t > c = sqrt(v (exp(T / n) - 1)).
    By (t (1 - 1/4v) - z) / sqrt(1 + t^2/2v) ~ N(0, 1) (Abramowitz & Stegun 1972, 26.7.10) that has
    a probability of 80 % at a signal-to-noise z = c (1 - 1/4v) + 0.84 sqrt(1 + c^2/2v).
    """
    scan = prepared.scan
    limit = float(np.quantile(gate.largest, 1 - alpha))
    pack = scan.pack()
    y = _left(prepared, pack, found)
    freedom = np.repeat(pack.dof, [stratum.size for stratum in scan.frame.strata.all])
    amplitudes: dict[int, dict[object, list[float]]] = {}
    for f, m, member in scan.walk():
        X = pack.without_found(raw_design(scan, [member]).T).T
        weights = _weights(scan, pack, y, X)
        information = np.einsum("ni,n,nj->ij", X, weights, X)
        squares = _mean_squares(prepared, m)
        k = len(squares)
        unit = np.full(k, 1 / np.sqrt(k)) / np.sqrt(np.maximum(squares, 1e-300))
        z2 = float(unit @ information @ unit)
        if z2 > 0 and pack.usable[m]:
            n = float(np.einsum("ni,n,n->", X**2, weights, freedom))
            n /= float(np.trace(information))
            own = amplitudes.setdefault(f, {}).setdefault(_form(prepared.members[m]), [])
            own.append(_needed(gate.statistic_of(limit, f), n, k) / np.sqrt(z2))
    return {
        scan.names[f]: max(float(np.median(own)) for own in forms.values())
        for f, forms in amplitudes.items()
    }


def _form(member: Member) -> object:
    """What members have in common that differ in what was searched or chosen alone."""
    axes = frozenset(axis for column in member.columns for axis in column)
    searched = member.searched or member.chosen is not None
    return (axes, len(member.columns)) if searched else (axes, *sorted(member.equations.items()))


def _needed(T: float, n: float, k: int) -> float:
    """Signal to noise that passes the limit T four times in five."""
    v = max(n - k, 1.0)
    c2 = v * np.expm1(min(T / n, 50.0))
    return float(np.sqrt(c2) * (1 - 0.25 / v) + POWER_DEVIATE * np.sqrt(1 + c2 / (2 * v)))


def _left(prepared: Prepared, pack: Packed, found: Search) -> FloatArray:
    """The whitened coordinates (N,) less the effects that were found, beside the polynomial of
    the readings.
    """
    scan, left = prepared.scan, prepared.y
    if found.members:
        columns = prepared.whole(found.members)
        left = left - raw_design(scan, columns) @ estimate(scan, left, columns).beta
    return pack.without_found(left)


def _weights(scan: Scan, pack: Packed, y: FloatArray, X: FloatArray) -> FloatArray:
    """Inverse variances (N,) of the coordinates, by stratum, of what X (N, k) leaves of y: few of
    them may say less than single entries scatter, which is in all of them.
    """
    weights, entries = np.zeros(len(y)), entries_of(scan.frame.strata)
    variances = np.zeros(len(entries))
    # The interaction first: it is what the others are held against.
    for s in sorted(range(len(entries)), key=lambda i: i != entries[i]):
        place, n = scan.frame.strata.all[s].slice, float(pack.dof[s])
        own = X[place][:, (X[place] != 0.0).any(axis=0)]
        k, square = own.shape[1], float(y[place] @ y[place])
        if 0 < k < min(n, len(own)):
            square = float(beside(np.column_stack([own, y[place]]), k)[0, 0]) ** 2
            n = n - k
        variances[s] = max(square / n, variances[entries[s]])
        weights[place] = 1.0 / variances[s] if variances[s] > 0 else 0.0
    return weights


def _mean_squares(prepared: Prepared, index: int) -> FloatArray:
    """Mean square of each column over the cells of the axes that it affects."""
    P, H = prepared.table.there.shape
    found = []
    for column in prepared.members[index].columns:
        means = [
            float(np.mean((np.broadcast_to(v, (P, H)) - np.mean(v)) ** 2)) for v in column.values()
        ]
        found.append(float(np.mean(means)))
    return np.array(found)
