"""Holm's adjustment, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.family import holm


def test_holm_by_hand() -> None:
    p = np.array([0.04, 0.001, 0.03, 0.5])
    assert holm(p) == pytest.approx([0.09, 0.004, 0.09, 0.5])


def test_a_test_that_was_not_made_does_not_count() -> None:
    found = holm(np.array([np.nan, 0.04, 0.03, np.nan]))
    assert found == pytest.approx([np.nan, 0.06, 0.06, np.nan], nan_ok=True)
    assert np.isnan(holm(np.full(3, np.nan))).all()


def test_never_beyond_one_and_in_the_order_of_p() -> None:
    rng = np.random.default_rng(1)
    p = rng.random(200) ** 3
    found = holm(p)
    assert found.max() <= 1
    assert (found >= p).all()
    assert (np.diff(found[np.argsort(p)]) >= 0).all()
    # The slow rule: reject at level q the smallest as long as p < q/(those left).
    for level in (0.01, 0.05, 0.3):
        left, rejected = sorted(p), set()
        while left and left[0] <= level / len(left):
            rejected.add(left.pop(0))
        assert {x for x, a in zip(p, found, strict=True) if a <= level} == rejected
