"""The size of a scatter that was found."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ScatterSize:
    """The standard deviation of a scatter as a `parameter` (name, unit, value, u) of `FoundEffect`;
    of an operation (`of`) also that of all `others`, mm. `by_axis` are those along each axis, where
    axes may differ; of turns and growths, that move two axes as one, `p_alike` is that of their
    differing by scatter alone.
    """

    parameter: tuple[str, str, float, float]
    of: str | None = None
    others: float | None = None
    by_axis: tuple[tuple[str, float], ...] = ()
    others_by_axis: tuple[tuple[str, float], ...] = ()
    p_alike: float | None = None
