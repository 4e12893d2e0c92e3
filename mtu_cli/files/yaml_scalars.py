"""Scalars of the YAML 1.2 core schema: ``1e-6`` is a number, ``no`` and ``12:30`` are text."""

from __future__ import annotations

import math
import re

Scalar = str | int | float | bool | None


class NotFinite(float):
    """A number beyond all numbers, or none: its `text` is what stands in the file."""

    text: str

    @classmethod
    def of(cls, value: float | str, text: str) -> NotFinite:
        """A value that is not finite, written as `text`."""
        found = cls(value)
        found.text = text
        return found


_NULL = frozenset(("", "~", "null", "Null", "NULL"))
_TRUE = frozenset(("true", "True", "TRUE"))
_FALSE = frozenset(("false", "False", "FALSE"))
_INTEGER = re.compile(r"[-+]?[0-9]+")
_BASED = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"[-+]?\.(?:inf|Inf|INF)")
_NAN = frozenset((".nan", ".NaN", ".NAN"))

MAX_INTEGER_DIGITS = 300
"""Longer integers are read as floats: no quantity needs them, and they take quadratic time."""

CORE_TAG = "tag:yaml.org,2002:"


def plain_scalar(text: str) -> Scalar:
    """The value of a scalar without quotes (YAML 1.2.2, 10.3.2)."""
    if text in _NULL:
        return None
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if text[0] in "+-.0123456789":
        return _number(text)
    return text


def _number(text: str) -> Scalar:
    value = _value(text)
    if isinstance(value, float) and not math.isfinite(value):
        return NotFinite.of(value, text)
    return value


def _value(text: str) -> Scalar:
    if _INTEGER.fullmatch(text):
        return int(text) if len(text) <= MAX_INTEGER_DIGITS else float(text)
    if _BASED.fullmatch(text):
        return int(text, 0) if len(text) <= MAX_INTEGER_DIGITS else float("inf")
    if _FLOAT.fullmatch(text):
        return float(text)
    if _INFINITE.fullmatch(text):
        return float("-inf") if text[0] == "-" else float("inf")
    return float("nan") if text in _NAN else text


def tagged_scalar(tag: str, text: str) -> tuple[bool, Scalar]:
    """Whether `text` may carry an explicit core tag such as ``!!float``, and its value."""
    kind = tag.removeprefix(CORE_TAG)
    if kind == "str" or tag == "!":
        return True, text
    value = plain_scalar(text)
    match kind:
        case "null":
            return value is None, value
        case "bool":
            return isinstance(value, bool), value
        case "int":
            return isinstance(value, int) and not isinstance(value, bool), value
        case "float":
            if isinstance(value, int) and not isinstance(value, bool):
                value = float(value)
            return isinstance(value, float), value
    return False, None
