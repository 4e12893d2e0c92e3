"""The size of a scatter that was found."""

from __future__ import annotations

from dataclasses import dataclass

UNLIKE = 1e-3
"""p of whole parts scattering by the same along both axes, below which one axis alone does."""
LEAST_RATIO = 2.0
"""Of the larger scatter of two axes to the smaller one, from which on they are unlike: a single
loose feature makes sizes differ surely, but by little.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScatterSize:
    """The standard deviation of a scatter as a `parameter` (name, unit, value, u) of `FoundEffect`;
    of an operation (`of`) also that of all `others`, mm. `by_axis` are those along each axis, where
    axes may differ, `u_by_axis` their u in this order; of turns and growths, that move two axes as
    one, `p_alike` is that of their differing by scatter alone.
    """

    parameter: tuple[str, str, float, float]
    of: str | None = None
    others: float | None = None
    by_axis: tuple[tuple[str, float], ...] = ()
    u_by_axis: tuple[float, ...] = ()
    others_by_axis: tuple[tuple[str, float], ...] = ()
    p_alike: float | None = None

    @property
    def axes_unlike(self) -> bool:
        """Whether what would turn or grow as a whole does so along one axis: what makes it is
        another thing, and the `parameter` of both is that of neither.
        """
        if self.p_alike is None or self.p_alike >= UNLIKE:
            return False
        small, large = sorted(s for _, s in self.by_axis)
        return large >= LEAST_RATIO * small
