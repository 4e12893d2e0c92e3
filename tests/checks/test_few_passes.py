"""Outlying readings of two or three passes: seen where the positions allow it, else a note."""

from __future__ import annotations

import numpy as np
import pytest
from made_tables import made_readings

from mtu_cli import checks


def found(
    passes: int, positions: int, off_um: float, seed: int = 1
) -> list[tuple[str, int | None]]:
    """Codes and rows of what is said of passes that drift, one reading of which is off."""
    rng = np.random.default_rng(seed)
    x = np.tile(25.0 * np.arange(positions), (passes, 1))
    lines = 3 * rng.standard_normal((passes, 1)) + 0.01 * rng.standard_normal((passes, 1)) * x
    error = 5 * np.sin(x / 100) + lines + rng.standard_normal(x.shape)
    error[0, positions // 2] += off_um
    table = made_readings(
        1e-3 * error.round(2).ravel(),
        position=x.ravel(),
        passes=np.repeat(np.arange(passes), positions),
        direction=1,
    )
    return [(item.code, item.row) for item in checks.run("readings", checks.ReadingsData(table))]


@pytest.mark.parametrize(("passes", "positions", "off"), [(2, 21, 60.0), (3, 11, 25.0)])
def test_a_slip_in_few_passes_is_named_by_its_row(passes: int, positions: int, off: float) -> None:
    right = [("outlying-value", 2 + positions // 2)]
    assert sum(found(passes, positions, off, seed) == right for seed in range(20)) >= 19
    assert all(not found(passes, positions, 0.0, seed) for seed in range(20))


def test_what_cannot_be_tested_is_said() -> None:
    assert found(2, 6, 60.0) == [("not-estimable", 2)]
    assert found(1, 11, 60.0) == []
