"""Lines of all passes at once against least squares of one pass after the other."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.pass_lines import lines_by_pass

EPS = np.finfo(float).eps


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
    # A line at the far end of its places loses their distance over their spread in digits.
    tolerance = 1e3 * EPS * (1 + abs(centre)) ** 2 * np.abs(columns).max(axis=0)
    for g in range(5):
        own = codes == g
        wanted = np.linalg.lstsq(Z[own], columns[own], rcond=None)[0]
        assert (np.abs(left[own] - (columns[own] - Z[own] @ wanted)) <= tolerance).all()
        assert (np.abs(columns[own] - Z[own] @ lines[g] - left[own]) <= tolerance).all()
        if g != 3 or q == 1:
            assert (np.abs(lines[g] - wanted) <= tolerance).all()
        else:
            np.testing.assert_array_equal(lines[g, 1], 0.0)
