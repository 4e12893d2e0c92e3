"""Names cut to the room that a figure or a table has for them, and words that both show."""

from __future__ import annotations

import textwrap

WIDTH = 34
"""Characters of a line of a name beside a panel."""


def words(*parts: str | None) -> str:
    """Those that there are, with blanks between."""
    return " ".join(filter(None, parts))


def cut(name: str, length: int) -> str:
    """A name without its middle where it is long: numbered names differ at the end."""
    if len(name) <= length:
        return name
    end = (length - 1) // 2
    return f"{name[: length - 1 - end]}\N{HORIZONTAL ELLIPSIS}{name[len(name) - end :]}"


def spread(count: int, most: int) -> list[int]:
    """At most `most` of `count` places, ends included, evenly apart."""
    if count <= most:
        return list(range(count))
    return [round(i * (count - 1) / (most - 1)) for i in range(most)]


def folded(name: str, width: int = WIDTH) -> str:
    """A long name in two lines of at most `width` characters, without its middle if need be."""
    if len(name) <= width:
        return name
    lines = textwrap.wrap(name, width)
    if len(lines) > 2:
        lines = [lines[0], cut(name[len(lines[0]) :].lstrip(), width)]
    return "\n".join(lines)
