"""Slips of the fingers: the known names that a misspelt one was probably meant to be."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Iterable

MOST_COMPARED = 12
"""The most alike names, of which a misspelt one is compared with each letter by letter."""
LONGEST = 200
"""Letters of a name that are looked at: none is so long."""


def nearest(name: str, names: Iterable[str]) -> list[str]:
    """The known names that `name` was probably meant to be, several where they are equally near.

    Near is a name that is at most one slip for each three letters away, a slip being a letter left
    out, put in, mistaken or swapped with its neighbour, or that begins as the other does. The
    fewest slips count; of as many, letters in another order (`azx` is `axz` sooner than `ayz`) and
    letters put in (`umm` is `um` or `mm` sooner than `um/m`) are likelier than others.
    """
    folded = {str(candidate).casefold(): str(candidate) for candidate in names}
    own = name.casefold()
    if own in folded:
        return [folded[own]]
    ranked = {}
    for other in difflib.get_close_matches(own, folded, n=MOST_COMPARED, cutoff=0.6):
        slips = _slips(own[:LONGEST], other[:LONGEST])
        if 3 * slips <= max(len(own), len(other)) or _begins(own, other):
            more = bool(Counter(other) - Counter(own))
            ranked[other] = (slips, sorted(own) != sorted(other), more)
    least = min(ranked.values(), default=None)
    return [folded[other] for other in folded if ranked and ranked.get(other) == least]


def _begins(name: str, other: str) -> bool:
    """Whether the shorter of two names is the beginning of the longer, and more than a letter."""
    short, long = (name, other) if len(name) < len(other) else (other, name)
    return len(short) > 1 and long.startswith(short)


def _slips(name: str, other: str) -> int:
    """How many slips make one name of the other (optimal string alignment)."""
    before, above = [0] * (len(other) + 1), list(range(len(other) + 1))
    for i, letter in enumerate(name, 1):
        row = [i]
        for j, its in enumerate(other, 1):
            least = min(above[j] + 1, row[j - 1] + 1, above[j - 1] + (letter != its))
            if i > 1 and j > 1 and letter == other[j - 2] and name[i - 2] == its:
                least = min(least, before[j - 2] + 1)
            row.append(least)
        before, above = above, row
    return above[-1]
