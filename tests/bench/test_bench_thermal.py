"""`mtu thermal-fit`: rates on simulated drift tests, and speed on ten million rows of 16 sensors.

`MTU_THERMAL_SETS` drift tests of each kind (see thermal_sets).
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from thermal_sets import KINDS, row
from watched_process import against_pandas

ROWS = 10_000_000
RUNS = 2
SENSORS = [f"T_{s:02d}_degC" for s in range(1, 17)]

SETS = int(os.environ.get("MTU_THERMAL_SETS", "12"))
SIGMAS = 3.0
"""Of the binomial scatter of a rate of so many sets."""


def least(rate: float, count: float) -> float:
    """A rate that so many tries fall below by chance only rarely."""
    return rate - SIGMAS * float(np.sqrt(rate * (1 - rate) / max(count, 1)))


@pytest.mark.parametrize("kind", KINDS)
def test_rates(kind: str) -> None:
    found = row(KINDS[kind], SETS, seed=7)
    print(f"\n{kind}: {found}")
    if found["gradients"]:
        assert found["coverage"] >= least(0.92, found["gradients"])
    if KINDS[kind].r <= 0.95:
        assert 1 - found["inseparable"] >= least(0.80, SETS)
    assert found["to_single"] <= 1.1
    assert (found["offsets"] == 1.0) if KINDS[kind].zeroed else (found["offsets"] <= 0.05)
    if KINDS[kind].zeroed:
        assert found["to_unzeroed"] <= 1.1


def write(path: Path, rows: int) -> None:
    """Four positions, ten cycles; sensors that follow the room with lags of their own."""
    rng = np.random.default_rng(1)
    gradients = rng.normal(0, 3, (4, 16))
    lags = rng.uniform(20, 90, 16)
    each = rows // 40
    with path.open("w") as file:
        file.write("component,position_mm,cycle,time_min,error,unit," + ",".join(SENSORS) + "\n")
        for p, position in enumerate((0, 100, 200, 300)):
            for cycle in range(10):
                minutes = np.arange(each) * (200 / each)
                rise = (
                    6 * (1 + 0.1 * rng.standard_normal(16)) * (1 - np.exp(-minutes[:, None] / lags))
                )
                rise += np.sin(minutes[:, None] / rng.uniform(5, 30, 16))
                read = 20 + rise + 0.015 * rng.standard_normal((each, 16))
                error = rise @ gradients[p] + 0.25 * rng.standard_normal(each)
                start = 1000.0 * (10 * p + cycle)
                for first in range(0, each, 10_000):
                    own = slice(first, first + 10_000)
                    lines = np.column_stack([minutes[own] + start, error[own], read[own]]).tolist()
                    file.writelines(
                        f"pos,{position},{cycle},{t:.5f},{e:.3f},um,"
                        + ",".join(f"{value:.3f}" for value in values)
                        + "\n"
                        for t, e, *values in lines
                    )


@pytest.mark.parametrize("model", ["ridge", "stepwise"])
def test_ten_million_rows(model: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.getbasetemp()
    path, out = folder / "drift.csv", folder / "out.json"
    if not path.exists():
        write(path, ROWS)
    words = ("thermal-fit", "--drift", path, "--model", model)
    time, memory = against_pandas(path, out, *words, runs=RUNS)
    held = json.loads(out.read_text())["results"]["components"]["pos"]["held_out"]
    print(f"{model}: held-out rms {held['rms_before_um']:.3g} -> {held['rms_after_um']:.3g} um")
    assert time <= 4
    assert memory <= 3
