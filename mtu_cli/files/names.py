"""Names of parts, features, columns and the like: texts that stand on one line of a table."""

from __future__ import annotations

import re

_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")
NO_NAME = "no name for a table"
EXPECTED = "a text on one line that is not empty, without control characters"


def is_name(text: str) -> bool:
    """Whether a table can show the text: not empty, and nothing in it that a terminal obeys."""
    return bool(text) and _CONTROL.search(text) is None
