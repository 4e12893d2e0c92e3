"""Every number of a report, and every null."""

from __future__ import annotations

from typing import Any


def numbers(value: Any, path: str = "") -> list[tuple[str, float | None]]:
    """Every number and null of a report, with the names that lead to it."""
    if isinstance(value, dict):
        return [pair for key, item in value.items() for pair in numbers(item, f"{path}.{key}")]
    if isinstance(value, list):
        return [pair for item in value for pair in numbers(item, path)]
    if value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
        return [(path, value)]
    return []
