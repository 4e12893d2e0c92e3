"""What of a column is the same in all parts, on strata that are named by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from mtu_cli.close_loop_sealed.analyses.loop.same_strata import NEARLY, hides, is_same, same_of
from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan

KINDS = ("part", "column", "reversal", "interaction", "line")


def scan(size: int = 3) -> Scan:
    """Strata of one axis with nothing to whiten."""
    strata = [
        SimpleNamespace(kind=kind, axis=0, size=size, lead=range(0), slice=slice(0, size))
        for kind in KINDS
    ]
    frame = SimpleNamespace(strata=SimpleNamespace(all=strata))
    return cast("Scan", SimpleNamespace(frame=frame, whitening=np.zeros((1, 0, 0))))


def test_columns_and_reversals_are_the_same_in_all_parts() -> None:
    whole = {index: np.ones(3) for index in range(len(KINDS))}
    assert set(same_of(scan(), whole)) == {1, 2}
    assert is_same(scan(), {1: np.ones(3), 2: np.ones(3)})
    assert not is_same(scan(), {0: np.ones(3), 1: np.ones(3)})
    assert not is_same(scan(), {})


@pytest.mark.parametrize(("apart", "hidden"), [(0.9, True), (1.1, False)])
def test_what_is_told_twice_hides_what_is_nearly_its_same_part(apart: float, hidden: bool) -> None:
    """To the share of the square that `NEARLY` allows."""
    share = apart * NEARLY
    other = {1: np.array([1.0, 0.0, 0.0])}
    same = np.array([np.sqrt(1 - share), np.sqrt(share), 0.0])
    assert hides(scan(), {0: np.ones(3), 1: 5 * same}, other) == hidden
    # What is the same in all parts alone, or in none, tells its size once.
    assert not hides(scan(), {1: same}, other)
    assert not hides(scan(), {0: same}, other)
