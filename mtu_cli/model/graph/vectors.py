"""Vectors of many trials at once: arrays (3, m), one row a coordinate.

Rows of a coordinate are contiguous, so that every operation runs at the speed of the cache.
"""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """a.b, (m,)."""
    total: FloatArray = a[0] * b[0]
    part = a[1] * b[1]
    total += part
    np.multiply(a[2], b[2], out=part)
    total += part
    return total


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """a x b, (3, m)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    part = np.empty(out.shape[1:])
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        np.multiply(a[j], b[k], out=out[i])
        np.multiply(a[k], b[j], out=part)
        out[i] -= part
    return out


def norm(a: FloatArray) -> FloatArray:
    """|a|, (m,)."""
    square = dot(a, a)
    return np.sqrt(square, out=square)


def unit(a: FloatArray) -> FloatArray:
    """a/|a|, (3, m)."""
    found: FloatArray = a / norm(a)
    return found


def across(a: FloatArray, direction: FloatArray) -> FloatArray:
    """The part of a across a unit vector: a - (a.d) d, (3, m)."""
    out = dot(a, direction) * direction
    return np.subtract(a, out, out=out)


def tangents(n: FloatArray) -> list[FloatArray]:
    """Unit vectors (d, m) across unit vectors n (d, m) and each other; d is 2 or 3."""
    if len(n) == 2:
        return [np.stack([-n[1], n[0]])]
    # The axis that stands most across.
    axis = (np.argmin(np.abs(n), axis=0) == np.arange(3)[:, None]).astype(np.float64)
    first = unit(cross(n, axis))
    return [first, cross(n, first)]


def vector_dot(a: FloatArray, b: FloatArray, out: FloatArray | None = None) -> FloatArray:
    """a.b over the first axis, of any length: of points (d, n, m) with vectors (d, m), (n, m)."""
    total: FloatArray = np.multiply(a[0], b[0], out=out)
    part = np.empty_like(total)
    for left, right in zip(a[1:], b[1:], strict=True):
        np.multiply(left, right, out=part)
        total += part
    return total
