"""Which columns of a table stand side by side, and how wide: those that have no room beside the
others stand below, behind the names of the rows again, as pandas prints a wide frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

GAPS = (2, 1)
"""Blanks between two columns, the second where there is no room for the first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """The width that a column wants and the least that it can do with, in letters.

    A column that `names` the row stands in front of every group; before one that `begins`
    something of its own a group rather ends than elsewhere.
    """

    wanted: int
    least: int
    names: bool = False
    begins: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Columns side by side by their places in the table, their widths and the gap between."""

    columns: tuple[int, ...]
    widths: tuple[int, ...]
    gap: int

    @property
    def width(self) -> int:
        """Of all of it, in letters."""
        return sum(self.widths) + self.gap * (len(self.widths) - 1)


def groups(extents: Sequence[Extent], width: int) -> list[Group]:
    """All columns in one group where they have room in `width`, else in as many as it takes.

    No column is ever narrower than its least: where the names and one column have no room the
    group is wider than `width`.
    """
    every = list(range(len(extents)))
    if _least(extents, every) <= width:
        return [_group(extents, every, width)]
    names = [i for i in every if extents[i].names]
    return [_group(extents, [*names, *own], width) for own in _split(extents, names, width)]


def _split(extents: Sequence[Extent], names: list[int], width: int) -> Iterator[list[int]]:
    """The columns of each group without the names."""
    own: list[int] = []
    for i in (i for i in range(len(extents)) if i not in names):
        while own and _least(extents, [*names, *own, i]) > width:
            end = max((n for n, j in enumerate([*own, i]) if extents[j].begins), default=0)
            end = end or len(own)
            yield own[:end]
            own = own[end:]
        own.append(i)
    yield own


def _least(extents: Sequence[Extent], columns: Sequence[int]) -> int:
    return sum(extents[i].least for i in columns) + GAPS[-1] * (len(columns) - 1)


def _group(extents: Sequence[Extent], columns: Sequence[int], width: int) -> Group:
    """Columns as wide as they want where that has room, else the widest narrower first."""
    own = [extents[i] for i in columns]
    wanted = [item.wanted for item in own]
    for gap in GAPS:
        if sum(wanted) + gap * (len(own) - 1) <= width:
            return Group(columns=tuple(columns), widths=tuple(wanted), gap=gap)
    room = width - GAPS[-1] * (len(own) - 1)
    widths = [item.least for item in own]
    # From the least up, letter by letter: the narrow have all they want before the wide.
    for cap in range(min(widths), width + 1):
        wider = [min(item.wanted, max(item.least, cap)) for item in own]
        if sum(wider) > room:
            break
        widths = wider
    return Group(columns=tuple(columns), widths=tuple(widths), gap=GAPS[-1])
