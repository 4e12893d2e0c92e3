"""How often a byte stands in a text, quickly also where it is frequent."""

from __future__ import annotations

_CHUNK = 1 << 18


def count_byte(content: bytes, byte: int, start: int = 0) -> int:
    """The count of `byte` from `start` on; bytes.count stops at every one that it finds."""
    import numpy as np

    view = np.frombuffer(content, np.uint8)[start:]
    return sum(
        int(np.count_nonzero(view[at : at + _CHUNK] == byte)) for at in range(0, len(view), _CHUNK)
    )
