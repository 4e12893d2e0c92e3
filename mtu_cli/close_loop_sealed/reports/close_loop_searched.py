"""What was searched, such as a pitch or a time constant, with its interval."""

from __future__ import annotations

import math

from mtu_cli.reports.numbers import MISSING, interval, significant, with_u

SEARCHED_DIGITS = 3
IN_NAMES = ("min", "mm")
"""Units that the name of what was searched ends with."""
AT = "at"
"""What is searched between the parts: the first and the last of them are ends of the data."""


def searched_text(
    found: tuple[float, float, float], several: bool = False, *, ends: bool = True
) -> tuple[str, str]:
    """What was searched, and its 95 % interval, to two digits of a quarter of its width; of one
    of `several` values that fit alike to digits of its own. What fits best at an end of what was
    searched has that end for no reason of the data, but where the data themselves end (no `ends`);
    what has no upper end has a lower one alone, what is 0 at its lower end an upper one.
    """
    value, low, high = found
    if several:
        both = (significant(end, SEARCHED_DIGITS) for end in (low, high))
        return significant(value, SEARCHED_DIGITS), f"[{', '.join(both)}]"
    if not high > low:
        return significant(value, SEARCHED_DIGITS), MISSING
    no_upper = math.isinf(high) or (ends and value == high)
    if no_upper and low <= 0:
        return significant(value, SEARCHED_DIGITS), "(not told)"
    if no_upper:
        return f"at least {significant(low)}", ""
    if ends and (value == low or low == 0):
        return f"at most {significant(high)}", ""
    u = (high - low) / 4
    return with_u(value, u)[0], interval(low, high, u)


def size_interval(low: float, high: float, u: float) -> str:
    """The 95 % interval of a size, such as "> 3.4" where that has no upper end."""
    if math.isinf(high) and math.isinf(low):
        return "any"
    if math.isinf(high) and math.isfinite(low):
        return f"> {significant(low)}"
    if math.isinf(low) and math.isfinite(high):
        return f"< {significant(high)}"
    return interval(low, high, u)


def open_end(low: float, high: float) -> str:
    """That a size which has no end one way is so much at least, or may be any."""
    open_ = math.isinf(low) or math.isinf(high)
    return f" (95 %: {size_interval(low, high, 1.0)})" if open_ else ""


def searched_unit(name: str) -> str:
    """The unit that a name such as `tau_min` or `pitch_mm` says, a word and the unit."""
    _, _, unit = name.partition("_")
    return unit if unit in IN_NAMES else ""
