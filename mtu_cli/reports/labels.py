"""Names cut to the room that a figure or a table has for them, and words that both show."""

from __future__ import annotations


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
