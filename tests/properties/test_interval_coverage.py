"""95 % intervals cover 95 %: coefficients, future points and lengths of simulated machines.

The full count of 2000 machines, with limits of 94 to 96 %, runs in `make bench`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from machine_trials import Drift, coverage, machine

MACHINES = 400


@pytest.mark.parametrize(
    "drift", [Drift(1.0), Drift(0.0), Drift(1.0, common=True)], ids=["drift", "none", "common"]
)
def test_intervals_cover(drift: Drift, tmp_path: Path) -> None:
    found = coverage(machine(tmp_path), drift, MACHINES, seed=11)
    futures = {name: share for name, share in found.items() if "[" not in name}
    coefficients = [share for name, share in found.items() if "[" in name]
    standard_error = np.sqrt(0.95 * 0.05 / MACHINES)
    for name, share in futures.items():
        assert abs(share - 0.95) < 3.5 * standard_error, name
    # The coefficients of one machine are nearly independent of each other.
    total = standard_error / np.sqrt(len(coefficients) / 2)
    assert abs(np.mean(coefficients) - 0.95) < 3.5 * total
