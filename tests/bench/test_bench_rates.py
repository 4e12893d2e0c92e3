"""Rates of alarms and of coverage on many simulated studies; five million rows of parts."""

from pathlib import Path

import numpy as np
import pytest
from checks import damage, damage_points, test_damage, test_damage_points
from machine_trials import Drift, coverage, machine
from measured_examples import part_file, planted_and_clean
from table_trials import axis_machine, table_coverage
from watched_process import against_pandas

AXES = 500


@pytest.mark.parametrize("amplitude", [0.0, 4.0, 8.0, 16.0])
def test_intervals_of_future_readings(amplitude: float, tmp_path: Path) -> None:
    found = table_coverage(axis_machine(tmp_path), AXES, amplitude, seed=3)
    print(f"\n{amplitude:g} u: {found}")
    assert found.inside >= 0.93
    assert found.width <= 1.25


@pytest.mark.parametrize("own", [0.5, 1.0])
def test_runs_that_bend_on_their_own(own: float, tmp_path: Path) -> None:
    found = table_coverage(axis_machine(tmp_path), AXES, 8.0, seed=4, own=own)
    print(f"\nown bends of {own:g} sigma: {found}")
    assert found.inside >= 0.93


# The full count of the coverage study: 2000 machines, with and without pass drift.


MACHINES = 2000


@pytest.mark.parametrize(
    "drift", [Drift(1.0), Drift(0.0), Drift(1.0, common=True)], ids=["drift", "none", "common"]
)
def test_intervals_cover_95_percent(drift: Drift, tmp_path: Path) -> None:
    found = coverage(machine(tmp_path), drift, MACHINES, seed=2)
    print(f"\ncoverage of 95 % intervals, {drift}:")
    for name, share in found.items():
        print(f"  {name:12s} {100 * share:5.1f} %")
    print(f"  from {100 * min(found.values()):.1f} to {100 * max(found.values()):.1f} %")
    # 26 shares: the largest of so many deviations from 95 % reaches about three standard errors
    # (0.5 %) by chance; their mean is held to the promised 94 to 96 %, each to 93 to 97 %.
    assert 0.94 < np.mean(list(found.values())) < 0.96
    for name, share in found.items():
        assert abs(share - 0.95) < 0.01 + 2 * np.sqrt(0.95 * 0.05 / MACHINES), name


# How often the checks say something about sound readings, temperatures and points.


SOUND_STUDIES = 500
MOST = 0.01
"""Share of sound studies with any alarm."""


def alarmed(number: int, folder: Path) -> bool:
    """Whether a study drawn by its number has any finding: readings, points or drift."""
    seed = damage.SEED + 1000 + number
    if number % 2:
        study = damage_points.STUDIES[number // 2 % len(damage_points.STUDIES)]
        sound = damage_points.simulate(folder, study, seed)
        return bool(test_damage_points.judged(sound, folder))
    of, name = ("drift", "valdes-ring") if number % 8 == 0 else ("lbb", damage.STUDIES[number % 3])
    return bool(test_damage.judged(name, of, damage.simulate(folder, of, name, seed), folder))


def test_sound_studies_seldom_raise_an_alarm(tmp_path: Path) -> None:
    alarms = sum(alarmed(number, tmp_path) for number in range(SOUND_STUDIES))
    print(f"\nalarms in {alarms} of {SOUND_STUDIES} sound studies")
    assert alarms <= MOST * SOUND_STUDIES


# `mtu anova` on five million rows, against pandas reading the same file.


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
