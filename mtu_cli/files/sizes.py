"""Numbers of a file that are too large to calculate with: variances are squares of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Set
from typing import Any

from mtu_cli.files.yaml_file import YamlPath

LARGEST = 1e30
"""Of a number, as of a lever arm: products of some of them stay far from what overflows."""
LARGEST_SQUARED = LARGEST**2
"""Of an entry of a covariance matrix."""
Place = tuple[str | None, ...]
"""A path in a document; None is any one key or index."""
COMPONENT: Place = ("components", None)
FITTED: Place = ("results", "components", None)
JOINT: Place = ("results", "joint_pass_covariance", None)
MATRICES: dict[str, tuple[Place, ...]] = {
    "covariance": (COMPONENT, ("effects", None), FITTED, ("results", "effects")),
    "covariance_independent": (FITTED,),
    "coefficient_covariance": (JOINT,),
    "pass_covariance": (COMPONENT, FITTED, JOINT),
    "pass_covariance_moment": (FITTED,),
    "half_difference_mean_square": (FITTED, JOINT),
    "run_covariance": (FITTED,),
}
"""Where covariance matrices stand, by their key."""
FREE: dict[str, tuple[Place, ...]] = {
    "found": (("effects", None),),
    "seed": (("settings",),),
    "dof": (COMPONENT,),
    "pass_dof": (COMPONENT, FITTED, JOINT),
    "repeat_dof": (COMPONENT, FITTED),
    "coefficient_dof": (FITTED,),
    "leftover_dof": (FITTED,),
}
"""Where values stand that nothing is calculated with, and degrees of freedom, by their key."""
WHAT = "the number is too large to calculate with"


def expected_size(limit: float) -> str:
    """What was expected where a number is beyond `limit`."""
    return f"at most {limit:g} in size"


def too_large(data: Any) -> Iterator[tuple[YamlPath, float, float]]:
    """Path, value and limit of every number of a document that is beyond what it may be, in the
    document's order.

    Degrees of freedom may be as many as they like: 1e99 is infinite to many. What is not finite
    is told elsewhere.
    """
    waiting: list[tuple[YamlPath, Any, float]] = [((), data, LARGEST)]
    while waiting:
        path, value, limit = waiting.pop()
        if isinstance(value, dict):
            own = [
                ((*path, key), item, LARGEST_SQUARED if _among(MATRICES, path, key) else LARGEST)
                for key, item in value.items()
                if not _among(FREE, path, key)
            ]
            waiting.extend(reversed(own))
        elif isinstance(value, (list, tuple)):
            items = [((*path, i), item, limit) for i, item in enumerate(value)]
            waiting.extend(reversed(items))
        elif isinstance(value, (int, float)) and limit < abs(value) < math.inf:
            yield path, value, limit


def _among(places: Mapping[str, tuple[Place, ...]], path: YamlPath, key: Any) -> bool:
    """Whether `key` stands in one of its places."""
    return any(
        len(place) == len(path)
        and all(step is None or step == own for step, own in zip(place, path, strict=True))
        for place in places.get(key, ())
    )


def without(data: Any, paths: Set[YamlPath], path: YamlPath = ()) -> Any:
    """The document with None for the values at `paths`."""
    if path in paths:
        return None
    if isinstance(data, dict):
        return {key: without(item, paths, (*path, key)) for key, item in data.items()}
    if isinstance(data, list):
        return [without(item, paths, (*path, i)) for i, item in enumerate(data)]
    return data
