"""Points at which effects that were found together cancel: they are one cause."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedPoint:
    """Where along `axis` effects (by their place in the table's list) cancel: those of `growth`,
    and those of `drift` that move the whole axis, all with the same `covariate` (None: constant).

    `at`, its standard uncertainty `u` and 95 % `interval` (None: unbounded) in mm. It is `told`
    where the interval is no longer than the axis' travel, or, where that is not known, than the
    longest of the other travels and of the parts. `given` is an effect (its place, and the name it
    is taken for) which the data cannot tell from others: if it is that, all of these are one cause.
    `counted_from`, mm, is where a growth that is one effect is zero by itself; nan where it is
    several, or that place is none of its equation's but of its values.
    """

    axis: str
    covariate: str | None
    growth: tuple[int, ...]
    drift: tuple[int, ...]
    at: float
    u: float
    interval: tuple[float, float] | None
    told: bool
    counted_from: float = math.nan
    given: tuple[int, str] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class NeutralPoint:
    """The value of a `covariate` (a temperature, say, or `y`, the place along another axis) at
    which effects (by their place in the table's list) cancel along `axis`: those of `drift`, which
    change with it, and those of `offset`, which are constant; where they go with a temperature or
    another column `beside` it, all are proportional to that, and `offset` to nothing else.

    `at`, its standard uncertainty `u` and 95 % `interval` in the covariate's unit; `seen` are the
    least and the largest value of the data. None is told whose interval is longer than these span,
    or farther from them than half of that. `counted_from` is where a drift that is one effect is
    zero by itself; nan where it is several. `given` is as of a `FixedPoint`: an effect that the
    data cannot tell from others; if it is that, all of these are one cause.
    """

    axis: str
    covariate: str
    drift: tuple[int, ...]
    offset: tuple[int, ...]
    at: float
    u: float
    interval: tuple[float, float]
    seen: tuple[float, float]
    counted_from: float = math.nan
    given: tuple[int, str] | None = None
    beside: str | None = None
