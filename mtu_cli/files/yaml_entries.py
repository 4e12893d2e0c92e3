"""Lines that were meant to be ``key: value`` and lack the colon, or the blank behind it."""

from __future__ import annotations

import re

_KEY = r"(?P<key>[^\s:=#'\"{}\[\],&*!|<>%@`-][^\s:=#'\"{}\[\],!<>]*)"
_EQUALS = re.compile(_KEY + r"[ \t]*:?=(?!=)[ \t]*(?P<value>\S[^\n]*?(?=\s+\w+\s*=|\n|$))?")
_NO_BLANK = re.compile(_KEY + r":(?![\s\\/])(?P<value>\S[^\n]*)")
_NO_COLON = re.compile(_KEY + r"[ \t]+(?P<value>[{\[][^\n]*)")
COLON = "with a colon and a blank behind the key"
LONGEST = 60
"""Characters of an entry that a message shows."""
LOOKED_AT = 400


def as_entry(text: str) -> str | None:
    """``Ex: dx_x`` of a text such as ``Ex = dx_x`` or ``Ex:dx_x``; None where it is neither.

    A path (``C:\\data``, ``http://``) is not taken for an entry without its blank.
    """
    # More is not shown; and blanks without end would be looked at again from each of them.
    begun = text.strip()[:LOOKED_AT]
    for form in (_EQUALS, _NO_BLANK, _NO_COLON):
        if found := form.match(begun):
            entry = f"{found['key']}: {(found['value'] or '...').strip()}"
            return entry if len(entry) <= LONGEST else f"{entry[: LONGEST - 3]}..."
    return None


def key_of(text: str) -> str:
    """The key of what was meant to be an entry, else the text itself."""
    entry = as_entry(text)
    return text if entry is None else entry.partition(": ")[0]
