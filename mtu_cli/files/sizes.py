"""Numbers of a file that are too large to calculate with: variances are squares of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Set
from typing import Any

from mtu_cli.files.yaml_file import YamlPath

LARGEST = 1e30
"""Of a number, as of a lever arm: products of some of them stay far from what overflows."""
LARGEST_SQUARED = LARGEST**2
"""Of an entry of a covariance matrix."""
MATRICES = ("covariance", "covariance_independent", "coefficient_covariance", "pass_covariance",
            "pass_covariance_moment")  # fmt: skip
FREE = ("found", "seed")
"""Keys whose values nothing is calculated with."""
WHAT = "the number is too large to calculate with"


def expected_size(limit: float) -> str:
    """What was expected where a number is beyond `limit`."""
    return f"at most {limit:g} in size"


def too_large(data: Any) -> Iterator[tuple[YamlPath, float, float]]:
    """Path, value and limit of every number of a document that is beyond what it may be.

    Degrees of freedom may be as many as they like: 1e99 is infinite to many. What is not finite
    is told elsewhere.
    """
    waiting: list[tuple[YamlPath, Any, float]] = [((), data, LARGEST)]
    while waiting:
        path, value, limit = waiting.pop()
        if isinstance(value, dict):
            for key, item in value.items():
                if key not in FREE and not str(key).endswith("dof"):
                    own = LARGEST_SQUARED if key in MATRICES else LARGEST
                    waiting.append(((*path, key), item, own))
        elif isinstance(value, (list, tuple)):
            waiting.extend(((*path, i), item, limit) for i, item in enumerate(value))
        elif isinstance(value, (int, float)) and limit < abs(value) < math.inf:
            yield path, value, limit


def without(data: Any, paths: Set[YamlPath], path: YamlPath = ()) -> Any:
    """The document with None for the values at `paths`."""
    if path in paths:
        return None
    if isinstance(data, dict):
        return {key: without(item, paths, (*path, key)) for key, item in data.items()}
    if isinstance(data, list):
        return [without(item, paths, (*path, i)) for i, item in enumerate(data)]
    return data
