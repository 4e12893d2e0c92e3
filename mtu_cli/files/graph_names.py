"""The ending of a message about an unknown place: the closest name, or the known ones."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import SequenceMatcher

from mtu_cli.errors import listing, nearest, question

SHOWN = 12
"""Names listed."""


def known_places(name: str, known: Iterable[str]) -> str:
    """``did you mean 'H1'?``; or what is known, the most alike first, and how many more."""
    listed = list(known)
    if near := question(nearest(name, listed)):
        return near
    if not listed:
        return listing(listed)
    order = sorted(listed, key=lambda item: (-_likeness(name, item), abs(len(item) - len(name))))
    more = f" and {len(order) - SHOWN} more" if len(order) > SHOWN else ""
    return f"one of: {', '.join(order[:SHOWN])}{more}"


def _likeness(name: str, other: str) -> float:
    return SequenceMatcher(None, name.lower(), other.lower()).ratio()
