"""Where effects that shift and effects that grow cancel: a ratio of sums with its interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.stats.least_squares import FloatArray

ROUNDING = 1e-9
"""Of the places along an axis, or the values of a covariate: what is nearer to 0 is 0."""


@dataclass(frozen=True, slots=True)
class Lever:
    """What a parameter of an effect (both by their places) does at the middle of an axis or of a
    covariate, and its change over half of its extent.
    """

    effect: int
    parameter: int
    shift: float
    growth: float


@dataclass(frozen=True, slots=True)
class Crossing:
    """-a/g with its u and 95 % interval (None: unbounded), in halves of the extent."""

    value: float
    u: float
    interval: tuple[float, float] | None

    def over(self, middle: float, half: float) -> Crossing:
        """The same in the unit of an extent about its middle, half of which is `half`."""
        ends = self.interval
        return Crossing(
            middle + half * self.value,
            half * self.u,
            None if ends is None else (middle + half * ends[0], middle + half * ends[1]),
        )


def counted_from(levers: Sequence[Lever], middle: float, half: float) -> float:
    """Where the only lever that grows is zero; nan where there are others."""
    growing = [lever for lever in levers if lever.growth]
    if len(growing) != 1:
        return np.nan
    start = middle - half * growing[0].shift / growing[0].growth
    return start if abs(start) > ROUNDING * (abs(middle) + half) else 0.0


def crossing(
    effects: Sequence[FoundEffect], covariance: FloatArray, levers: Sequence[Lever]
) -> Crossing:
    """Where a + g r is zero, a the sum of shifts and g of growths over the levers.

    `covariance` (k, k) is that of the k parameters of all effects in their order, internal units.
    The u is by the joint covariance (JCGM 100:2008, 5.2.2), the interval that of Fieller
    (J. R. Stat. Soc. B 16 (1954) 175) with the least degrees of freedom of the parameters.
    """
    first = np.cumsum([0, *(len(effect.parameters) for effect in effects)])
    rows = [int(first[lever.effect]) + lever.parameter for lever in levers]
    C = covariance[np.ix_(rows, rows)]
    J = np.array([[lever.shift for lever in levers], [lever.growth for lever in levers]])
    a, g = J @ [effects[x.effect].parameters[x.parameter][2] for x in levers]
    if g == 0:
        return Crossing(np.nan, np.nan, None)
    V = J @ C @ J.T
    value = -a / g
    own = np.array([1.0, value])
    dof = min(effects[x.effect].intervals[x.parameter][2] for x in levers)
    t2 = float(stdtrit(max(dof, 1.0), 0.975)) ** 2
    # The r with (a + g r)^2 <= t^2 Var(a + g r).
    A, B, C0 = g**2 - t2 * V[1, 1], a * g - t2 * V[0, 1], a**2 - t2 * V[0, 0]
    root = np.sqrt(max(B**2 - A * C0, 0.0))
    return Crossing(
        float(value),
        float(np.sqrt(max(own @ V @ own, 0.0)) / abs(g)),
        (float((-B - root) / A), float((-B + root) / A)) if A > 0 else None,
    )
