"""Whether columns, parts, or the entries of operations scatter more than single entries do."""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc, ndtr, ndtri

from mtu_cli.close_loop_sealed.stats.loose_columns import scaled_log_variance
from mtu_cli.close_loop_sealed.stats.mean_squares import EntryNoise
from mtu_cli.close_loop_sealed.stats.strata import Strata
from mtu_cli.stats.least_squares import FloatArray

MANY = 1e6
"""Degrees of freedom of what is known exactly."""
LARGEST = 1.0
"""Effects of single columns or parts up to the scatter of one entry are what they may have."""


def scatter_p(
    strata: Strata,
    y: FloatArray,
    noise: EntryNoise,
    predicted: FloatArray,
    predicted_dof: float,
    least: FloatArray,
) -> tuple[float, float]:
    """p of `column-variance` and `part-variance` (1 where they are undefined) of y (N,).

    Tested is that single columns, or parts, have effects of their own that scatter more than
    `LARGEST` times what one entry does: less than that is ordinary (fixed errors of single
    holes, setting up). Where the machine's own scatter from pass to pass is known, `predicted`
    (A,) the variance of a part's coordinate by it with `predicted_dof` degrees of freedom,
    parts are held against that (inf: against nothing). F tests, Bonferroni over the axes.

    `least` (S,) is the variance by rounding alone: entries that do not scatter at all were
    rounded. Where nothing was, whatever differs between columns is more than they scatter.
    """
    P, H, _ = strata.shape
    p: list[float] = [1.0]
    part = _PartScatter()
    squares = noise.squares
    of_columns = {"column": squares.rest, "reversal": squares.turned}
    for s, stratum in enumerate(strata.all):
        axis, own = stratum.axis, y[stratum.slice][len(stratum.lead) :]
        n, level = float(noise.dof[axis]), max(float(noise.variance[axis]), float(least[s]))
        if not len(own) or n < 3:
            continue
        if stratum.kind in of_columns:
            ordinary = of_columns[stratum.kind][axis] + LARGEST**2 * P * level
            p.append(float(fdtrc(len(own), n, _ratio(own, ordinary))))
        elif stratum.kind == "part":
            of_noise = float(squares.part.diagonal()[axis * (1 + strata.lines)])
            known = predicted[axis] > 0
            ordinary = of_noise + (predicted[axis] if known else LARGEST**2 * H * level)
            part.add(_ratio(own, ordinary), len(own), predicted_dof if known else n)
    return min(1.0, max(len(p) - 1, 1) * min(p)), part.p()


def _ratio(own: FloatArray, ordinary: float) -> float:
    """Mean square of coordinates over the ordinary one; of nothing 0, of more than none inf."""
    square = float(np.mean(own**2))
    if square == 0:
        return 0.0
    return square / ordinary if ordinary > 0 else np.inf


class _PartScatter:
    """Ratios of the parts' mean squares to what they may be: each axis, and all together."""

    def __init__(self) -> None:
        self.ratios: list[tuple[float, int, float]] = []

    def add(self, ratio: float, n: int, expected_dof: float) -> None:
        self.ratios.append((ratio, n, min(expected_dof, MANY)))

    def p(self) -> float:
        if not self.ratios:
            return 1.0
        single = [float(fdtrc(n, m, ratio)) for ratio, n, m in self.ratios]
        total = sum(n for _, n, _ in self.ratios)
        mean = sum(n * ratio for ratio, n, _ in self.ratios) / total
        together = float(fdtrc(total, min(m for _, _, m in self.ratios), mean))
        tests = len(single) + (len(single) > 1)
        return min(1.0, tests * min(*single, together))


def two_scatters_p(a: FloatArray, b: FloatArray, share: float) -> tuple[float, float]:
    """p (two-sided) and log ratio of the variances of entries a and b, zero-mean residuals.

    `share` is the degrees of freedom an entry. The variance of log s^2 is (2 + excess
    kurtosis) / n (Box, Biometrika 40 (1953) 318): heavy tails make variances differ by chance.
    """
    va, vb = float(np.mean(a**2)), float(np.mean(b**2))
    if va <= 0 or vb <= 0:
        return 1.0, 0.0
    z = np.concatenate([a.ravel() / np.sqrt(va), b.ravel() / np.sqrt(vb)])
    se = np.sqrt(scaled_log_variance(z) / share * (1 / a.size + 1 / b.size))
    log_ratio = float(np.log(va / vb))
    return float(2 * ndtr(-abs(log_ratio) / se)), log_ratio


def score_of(p: float) -> float:
    """The squared normal deviate of a two-sided p: a likelihood ratio of one parameter."""
    return float(ndtri(max(p, 1e-300) / 2) ** 2)
