"""A known distribution mapped, rank for rank, to Student's t: a control variate of known ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.copula import bounded_rank
from mtu_cli.stats.distributions import Distribution
from mtu_cli.stats.linear_distribution import LinearDistribution, Term, linear_distribution

FloatArray = NDArray[np.float64]

NEARLY_NORMAL = 12.0
"""Degrees of freedom whose tails a map to the normal distribution bends little."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RankMap:
    """A rising map of draws of one distribution to draws of `scale` times Student's t.

    It keeps the ranks. `at` (n,): in equal steps, `to` (n,): where they are mapped to. `dof` is
    infinite where it leads to the normal distribution. With `single`, the one term that is drawn,
    `at` are its probabilities.
    """

    at: FloatArray
    to: FloatArray
    scale: float
    dof: float
    single: Term | None = None

    def __call__(self, deviations: FloatArray) -> FloatArray:
        if self.single is not None:
            c, item = self.single
            deviations = bounded_rank(item, deviations / c)
        # Equal steps need no search, which would take a fifth of a budget's Monte Carlo.
        last = len(self.at) - 1
        place = (deviations - self.at[0]) * (last / (self.at[-1] - self.at[0]))
        np.clip(place, 0.0, last, out=place)
        below = np.minimum(place.astype(np.intp), last - 1)
        place -= below
        low = self.to[below]
        mapped: FloatArray = low + place * (self.to[below + 1] - low)
        return mapped


def rank_map(known: LinearDistribution, dof: float) -> RankMap:
    """The map of `known` to a t of `dof` degrees of freedom (3 or more) with its 95 % interval.

    From `NEARLY_NORMAL` on to a normal distribution. The nearer the tails of both, the less
    the map bends.
    """
    if dof >= NEARLY_NORMAL:
        dof, unit = math.inf, known.score
        scale = known.quantile(0.975) / NormalDist().inv_cdf(0.975)
    else:
        t = linear_distribution([(1.0, Distribution(kind="t", u=1.0, dof=dof))])
        if t is None:
            raise ValueError(f"no map to a t of {dof} degrees of freedom")
        scale = known.quantile(0.975) / t.quantile(0.975)
        unit = np.interp(known.score, t.score, t.at)
    to = scale * unit
    if known.single is not None:
        at = np.linspace(0.0, 1.0, len(to))
        return RankMap(at=at, to=to, scale=scale, dof=dof, single=known.single)
    return RankMap(at=known.at, to=to, scale=scale, dof=dof)
