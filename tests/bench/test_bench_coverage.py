"""The full count of the coverage study: 2000 machines, with and without pass drift."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from machine_trials import Drift, coverage, machine

MACHINES = 2000


@pytest.mark.parametrize(
    "drift", [Drift(1.0), Drift(0.0), Drift(1.0, common=True)], ids=["drift", "none", "common"]
)
def test_intervals_cover_94_to_96_percent(drift: Drift, tmp_path: Path) -> None:
    found = coverage(machine(tmp_path), drift, MACHINES, seed=2)
    print(f"\ncoverage of 95 % intervals, {drift}:")
    for name, share in found.items():
        print(f"  {name:12s} {100 * share:5.1f} %")
    tolerance = 2 * np.sqrt(0.95 * 0.05 / MACHINES)
    for name, share in found.items():
        assert 0.94 - tolerance < share < 0.96 + tolerance, name
