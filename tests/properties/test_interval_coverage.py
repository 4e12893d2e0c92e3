"""95 % intervals cover 95 %: coefficients, future points and lengths of simulated machines.

The full count of 2000 machines, with limits of 94 to 96 %, runs in `make bench`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from machine_trials import Drift, coverage_by_machine, machine

MACHINES, PARTS = 100, 25


@pytest.mark.parametrize(
    "drift", [Drift(1.0), Drift(0.0), Drift(1.0, common=True)], ids=["drift", "none", "common"]
)
def test_intervals_cover(drift: Drift, tmp_path: Path) -> None:
    found = coverage_by_machine(machine(tmp_path), drift, MACHINES, 11, PARTS)
    coefficients = [shares for name, shares in found.items() if "[" in name]
    for name in (name for name in found if "[" not in name):
        # Many parts of few machines: 0.8 %.
        standard_error = found[name].std(ddof=1) / np.sqrt(MACHINES)
        assert standard_error < 0.01, name
        assert abs(found[name].mean() - 0.95) < 3.5 * standard_error, name
    # The coefficients of one machine are nearly independent of each other.
    total = np.sqrt(0.95 * 0.05 / MACHINES) / np.sqrt(len(coefficients) / 2)
    assert abs(np.mean(coefficients) - 0.95) < 3.5 * total
