"""`mtu anova` on five million rows, against pandas reading the same file."""

from pathlib import Path

import numpy as np
import pytest
from measured_examples import part_file, planted_and_clean
from watched_process import against_pandas

RUNS = 3
ROWS = 5_000_000
SHAPES = {"few parts": (21, 2500), "as in a series": (500, 500), "many parts": (2500, 200)}


def write(path: Path, parts: int, features: int) -> None:
    """Points of `parts` parts; texts in part, feature and operation, as CMMs export them."""
    rng = np.random.default_rng(1)
    repeats = round(ROWS / (parts * features))
    place = rng.uniform(0, 300, (features, 2)).round(3)
    with path.open("w") as file:
        file.write("part,feature,operation,repeat,x_mm,y_mm,nominal_x_mm,nominal_y_mm\n")
        for p in range(parts):
            made = place + rng.normal(0, 0.004, (features, 2))
            for r in range(1, repeats + 1):
                seen = made + rng.normal(0, 0.001, (features, 2))
                file.writelines(
                    f"P{p:04d},h{i:04d},drilled,{r},{x:.5f},{y:.5f},{X},{Y}\n"
                    for i, ((x, y), (X, Y)) in enumerate(
                        zip(seen.tolist(), place.tolist(), strict=True)
                    )
                )


@pytest.mark.parametrize("shape", SHAPES)
def test_five_million_rows(shape: str, tmp_path: Path) -> None:
    path = tmp_path / "cmm.csv"
    write(path, *SHAPES[shape])
    time, memory = against_pandas(path, tmp_path / "out.json", "anova", "--cmm", path, runs=RUNS)
    assert memory <= 3
    assert time <= 4


def test_planted_and_false_alarms(tmp_path: Path) -> None:
    """Features, lengths and right angles as one family: 4 sigma found, clean studies silent."""
    found, alarms = planted_and_clean(part_file(tmp_path), 300)
    print(f"\nparts 4 sigma off: {100 * found:.1f} % named; clean studies: {100 * alarms:.1f} %")
    assert found >= 0.95
    assert alarms <= 0.05 + 2 * np.sqrt(0.05 * 0.95 / 300)
