"""The 95 % interval of a corrected diameter and length holds the true one in 95 % of machines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from correct_examples import ring_part
from correct_trials import diameter_coverage
from machine_trials import Drift, machine

MACHINES = 300


@pytest.mark.parametrize("drift", [Drift(1.0), Drift(0.0)], ids=["drift", "none"])
def test_intervals_of_a_ring_cover(drift: Drift, tmp_path: Path) -> None:
    part = ring_part(tmp_path, "lengths: [{from: r0, to: r5}]\n")
    shares = diameter_coverage(machine(tmp_path), part, drift, MACHINES, seed=5)
    standard_error = np.sqrt(0.95 * 0.05 / MACHINES)
    for share in shares:
        assert abs(share - 0.95) < 3.5 * standard_error
