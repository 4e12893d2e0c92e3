"""Numbers and names for people: rounded to the uncertainty (JCGM 100, 7.2.6), cut to the room."""

from __future__ import annotations

import math
from typing import TypeGuard

MISSING = "-"
PLAIN_DIGITS = 6
"""Significant digits of a value that is known exactly."""


def known(value: float | None) -> TypeGuard[float]:
    """Whether there is a number to show."""
    return value is not None and math.isfinite(value)


def with_u(value: float | None, u: float | None, digits: int = 2) -> tuple[str, str]:
    """A value and its uncertainty, u to `digits` significant digits, the value to u's last place.

    (-0.34, 8.06) gives ("-0.3", "8.1"). Without an uncertainty the value has six significant
    digits; what is None or not finite is shown as "-".
    """
    if not known(value):
        return MISSING, significant(u, digits)
    if not known(u) or u <= 0:
        return significant(value, PLAIN_DIGITS), "0" if u == 0 else MISSING
    exponent = decimal_exponent(u, digits)
    last, largest = exponent - digits + 1, max(exponent, decimal_exponent(value, digits))
    return _round(value, last, largest), _round(u, last, largest)


def plus_minus(value: float | None, u: float | None, digits: int = 2) -> str:
    """ "-0.3 ± 8.1", or the value alone without u."""
    first, second = with_u(value, u, digits)
    return first if MISSING in (first, second) else f"{first} ± {second}"


def interval(low: float | None, high: float | None, u: float | None, digits: int = 2) -> str:
    """ "[-16.5, 15.8]", the ends rounded to the last place of `u`."""
    if not (known(low) and known(high)):
        return MISSING
    return f"[{with_u(low, u, digits)[0]}, {with_u(high, u, digits)[0]}]"


def span(low: str, high: str) -> str:
    """ "2.0 to 2.6", or one number where both ends read the same."""
    return low if low == high else f"{low} to {high}"


def significant(value: float | None, digits: int = 2) -> str:
    """`value` to so many significant digits, without a power of ten where it is readable."""
    if not known(value) or value == 0:
        return "0" if value == 0 else MISSING
    exponent = decimal_exponent(value, digits)
    text = _round(value, exponent - digits + 1, exponent)
    plain = digits >= PLAIN_DIGITS and "." in text and "e" not in text
    return text.rstrip("0").rstrip(".") if plain else text


def fixed(value: float | None, decimals: int) -> str:
    """`value` to so many decimals; what rounds to zero has no sign."""
    return f"{value:z.{decimals}f}" if known(value) else MISSING


def p_value(p: float | None) -> str:
    """A p value: three decimals below 0.1, two above, "<0.001" below that."""
    if not known(p):
        return MISSING
    if p < 0.001:
        return "<0.001"
    return f"{p:.3f}" if p < 0.0995 else f"{p:.2f}"


def percent(probability: float | None) -> str:
    """A probability in percent with the digits that tell it from 0 and 100."""
    if not known(probability):
        return MISSING
    value = 100 * probability
    if value < 0.01:
        return "<0.01"
    if value > 99.99:
        return ">99.99"
    return f"{value:.2f}" if value < 1 or value > 99 else f"{value:.1f}"


def chance(probability: float, se: float) -> str:
    """A probability and its standard error in percent, such as "97.2 ± 0.3"; the far end of three
    standard errors, such as ">99.99", where one of them reaches 0 or 100.
    """
    if se == 0:
        return percent(probability)
    if probability + se >= 1:
        return ">" + percent(probability - 3 * se).removeprefix(">")
    if probability - se <= 0:
        return "<" + percent(probability + 3 * se).removeprefix("<")
    return plus_minus(100 * probability, 100 * se, 1)


def degrees_of_freedom(dof: float) -> str:
    """Degrees of freedom, one decimal where they are few; "inf" where they are infinite."""
    if math.isinf(dof):
        return "inf"
    if dof >= 1000:
        return ">999"
    return f"{dof:.1f}" if dof < 100 and dof != int(dof) else f"{dof:.0f}"


def decimal_exponent(value: float, digits: int) -> int:
    """l of c 10^l with 1 <= |c| < 10 after rounding to `digits`: 0.0996 to two has -1."""
    if value == 0:
        return -400
    return int(f"{value:.{digits - 1}e}".partition("e")[2])


def _round(value: float, last: int, exponent: int) -> str:
    """`value` to the place 10^last, as a multiple of 10^exponent where digits would be many."""
    if exponent >= -4 and last <= 5:
        return f"{value:z.{-last}f}" if last < 0 else f"{round(value, -last):z.0f}"
    mantissa = value / 10.0**exponent if exponent > -300 else value * 10.0 ** (-exponent)
    text = f"{mantissa:z.{max(exponent - last, 0)}f}"
    return f"{text}e{exponent}" if text.strip("0.") else "0"


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
