"""The signs of a direction, as readings and points may write them."""

from __future__ import annotations

from mtu_cli.errors import nearest, question

SIGN_WORDS = {"forward": 1, "+": 1, "1": 1, "+1": 1, "reverse": -1, "-": -1, "-1": -1}
_MINUS = str.maketrans({"\u2212": "-", "\u2013": "-"})
"""What a word processor makes of a minus: as a sign it can mean nothing else."""
EXPECTED = "forward or reverse, + or -, 1 or -1"


def direction_sign(label: str) -> int | None:
    """+1 for forward, -1 for reverse, None for anything else; a number as its value."""
    plain = label.strip().casefold().translate(_MINUS).replace(",", ".")
    if plain in SIGN_WORDS:
        return SIGN_WORDS[plain]
    try:
        value = float(plain)
    except ValueError:
        return None
    return int(value) if abs(value) == 1.0 and "_" not in plain else None


def direction_hint(label: str) -> str | None:
    """What to write instead of a label that is no direction; None for one that is."""
    if direction_sign(label) is not None:
        return None
    return question(nearest(label, ("forward", "reverse"))) or EXPECTED
