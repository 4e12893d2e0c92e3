"""Lines of all passes at once against least squares of one pass after the other, in fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed_model import lines_by_pass

EPS = np.finfo(float).eps


def exact_line(z: FloatArray, y: FloatArray, q: int) -> tuple[list[Fraction], list[Fraction]]:
    """Coefficients (q,) and residuals (n,) of [1] or [1, z], level alone where z is one place.

    Without rounding: least squares in floating point lose as many digits far from zero as what
    they are to judge, and how many of them differs from one processor to the next.
    """
    places, values = [Fraction(v) for v in z.tolist()], [Fraction(v) for v in y.tolist()]
    n = len(places)
    middle, level = sum(places, Fraction()) / n, sum(values, Fraction()) / n
    square = sum(((p - middle) ** 2 for p in places), Fraction())
    slope = Fraction()
    if q == 2 and square:
        slope = sum(((p - middle) * v for p, v in zip(places, values, strict=True)), slope) / square
    start = level - slope * middle
    left = [v - start - slope * p for p, v in zip(places, values, strict=True)]
    return [start, slope][:q], left


@pytest.mark.parametrize("q", [1, 2])
@pytest.mark.parametrize("centre", [0.0, 0.5, 1e3])
def test_they_are_the_least_squares_lines_of_each_pass(q: int, centre: float) -> None:
    """Uneven passes in mixed order; what is left also where a pass has a single place."""
    rng = np.random.default_rng(7)
    codes = rng.permutation(np.repeat(np.arange(5), [2, 9, 4, 3, 6])).astype(np.int64)
    z = centre + rng.uniform(-0.5, 0.5, len(codes))
    z[codes == 3] = centre + 0.25
    Z = np.column_stack([np.ones(len(z)), z])[:, :q]
    columns = rng.normal(size=(len(z), 3)) * [1.0, 1e-3, 1e4]
    lines, left = lines_by_pass(columns, Z, codes, 5)
    # Where z is 0 a line at the far end of its places is as uncertain as their distance tells.
    tolerance = 1e3 * EPS * (1 + abs(centre)) * np.abs(columns).max(axis=0)
    for g in range(5):
        own = codes == g
        exact = [exact_line(z[own], columns[own, m], q) for m in range(columns.shape[1])]
        wanted = np.array([line for line, _ in exact], dtype=float).T
        over = np.array([rest for _, rest in exact], dtype=float).T
        assert (np.abs(left[own] - over) <= tolerance).all()
        assert (np.abs(columns[own] - Z[own] @ lines[g] - left[own]) <= tolerance).all()
        assert (np.abs(lines[g] - wanted) <= tolerance).all()
        if g == 3 and q == 2:
            np.testing.assert_array_equal(lines[g, 1], 0.0)
