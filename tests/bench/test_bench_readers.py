"""Processor time of reading CSV files, as multiples of what `pandas.read_csv` takes."""

import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
import pandas as pd
import pytest

from mtu_cli.files.csv_file import read_table
from mtu_cli.files.headers import READINGS as SPEC
from mtu_cli.files.headers import CellFaults

ROWS = 1_000_000


def processor_time(work: Callable[[], object]) -> float:
    times = []
    for _ in range(5):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return median(times)


def written(path: Path, rows: int) -> Path:
    rng = np.random.default_rng(rows)
    frame = pd.DataFrame(
        {
            "component": rng.choice(["dx_x", "dy_x", "ez_x"], rows),
            "position_mm": rng.integers(0, 1000, rows),
            "pass": rng.integers(1, 9, rows),
            "error": np.round(rng.normal(size=rows), 4),
            "unit": "um",
        }
    )
    frame.to_csv(path, index=False)
    return path


def test_small_files_take_a_moment(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", 60_000)
    assert path.stat().st_size > 1e6
    assert processor_time(lambda: read_table(path, "lbb", SPEC, CellFaults())) <= 0.15


@pytest.mark.parametrize(("faults", "most"), [(0, 2.5), (1, 3.5)])
def test_a_million_readings(tmp_path: Path, faults: int, most: float) -> None:
    path = written(tmp_path / "a.csv", ROWS)
    alone = processor_time(lambda: pd.read_csv(path))
    if faults:
        lines = path.read_text().split("\n")
        lines[700_000] = "dx_x,500,1,1.2.3,um"
        path.write_text("\n".join(lines))

    def read() -> int:
        problems = CellFaults()
        read_table(path, "lbb", SPEC, problems)
        return len(problems.listed)

    assert read() == faults
    ratio = processor_time(read) / alone
    print(f"{ratio:.2f} times pandas.read_csv ({alone:.2f} s)")
    assert ratio <= most
