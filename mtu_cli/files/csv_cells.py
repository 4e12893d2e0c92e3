"""Single cells: what is a number or a time, and what to write instead of what stands there."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mtu_cli.files.contract import number_expectation
from mtu_cli.files.csv_table import Decimal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# No digit may belong to two of the parts: a long cell would be tried in all ways of cutting it.
_NUMBER = {
    ".": re.compile(r"[+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d++)?", re.ASCII),
    ",": re.compile(r"[+-]?(?:\d++(?:,\d*+)?|,\d++)(?:[eE][+-]?\d++)?", re.ASCII),
}
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)|[+-]?1\.#(?:inf|ind|qnan)", re.IGNORECASE)
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:([,.' \u00a0\u202f])\d{3})(?:\1\d{3})*(?:[.,]\d+)?")
_DATE = re.compile(r"\d{4}-?\d{2}-?\d{2}(?:[T ].*)?", re.ASCII)

NO_TIME = -(2**63)
TIME_EXPECTED = "an ISO 8601 time such as 2024-05-03T14:30:00"


def number(cell: str, decimal: Decimal = ".") -> float | None:
    """The value of a cell, or None where it is no number; infinite where it overflows."""
    cell = cell.strip()
    if decimal == "," and "." in cell:
        return None
    text = cell.replace(",", ".") if decimal == "," else cell
    try:
        value = float(text)
    except ValueError:
        return None
    if math.isfinite(value) and "_" not in text and text.isascii():
        return value
    # Python also reads nan, 1_000 and digits of other scripts.
    return value if _NUMBER[decimal].fullmatch(cell) else None


def is_not_finite(cell: str, decimal: Decimal = ".") -> bool:
    """Whether a cell says nan or infinity, or is a number too large for one."""
    value = number(cell, decimal)
    if value is not None:
        return not math.isfinite(value)
    return _NOT_FINITE.fullmatch(cell.strip()) is not None


def is_text(cell: str, decimal: Decimal = ".") -> bool:
    """Whether a cell is neither empty nor a number nor one of the ways to write nan."""
    cell = cell.strip()
    return bool(cell) and number(cell, decimal) is None and not is_not_finite(cell, decimal)


def expectation(cell: str, decimal: Decimal = ".") -> str:
    """What was expected of a cell that is no finite number."""
    cell = cell.strip()
    if is_not_finite(cell, decimal):
        return "a finite number"
    if "\u2212" in cell or "\u2013" in cell:
        return "a number with a plain minus sign (-)"
    if number(cell, "." if decimal == "," else ",") is not None:
        if decimal == ",":
            return "a number with a decimal comma, as in the rest of the file"
        return "a number with a decimal point (a decimal comma needs semicolons between columns)"
    if _THOUSANDS.fullmatch(cell):
        return "a number without thousands separators"
    return number_expectation(cell)


def microseconds(cells: Sequence[str]) -> tuple[NDArray[np.int64], frozenset[bool]]:
    """ISO 8601 times as microseconds, and whether they state an offset from UTC.

    A cell that is no time gives the smallest integer (`NO_TIME`).
    """
    import numpy as np
    import pandas as pd

    shaped = [cell if _DATE.fullmatch(cell) else None for cell in map(str.strip, cells)]
    parsed = pd.to_datetime(
        pd.Series(shaped, dtype="object"), format="ISO8601", errors="coerce", utc=True
    )
    values = parsed.dt.tz_localize(None).to_numpy(dtype="datetime64[us]").astype(np.int64)
    pairs = zip(shaped, values.tolist(), strict=True)
    aware = {_states_offset(cell) for cell, value in pairs if cell and value != NO_TIME}
    return values, frozenset(aware)


def _states_offset(cell: str) -> bool:
    clock = cell[10:] if cell[4] == "-" else cell[8:]
    return clock.endswith(("Z", "z")) or "+" in clock or "-" in clock
