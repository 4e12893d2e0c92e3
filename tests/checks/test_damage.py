"""What the checks find of the damages, and that they say nothing of sound readings."""

from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from made_tables import made_readings

from checks.damage import CONFIGS, DAMAGES, DRAWS, counted, draws
from mtu_cli import checks
from mtu_cli.checks.readings import _off_the_line
from mtu_cli.files.machine import load_machine
from mtu_cli.files.readings import read_readings

FEWER = {"a pass in another unit": 3, "a mirrored pass": 1, "drift in mm marked um": 0}
"""Found of DRAWS, where these are fewer than all: a drift of 0.1 um is not impossible."""


known = cache(load_machine)


def judged(study: str, of: str, frame: pd.DataFrame, folder: Path) -> list[tuple[str, str]]:
    """(code, message) of what the checks say about a frame."""
    machine = known(CONFIGS / study / "machine.yaml").machine
    frame.to_csv(folder / "damaged.csv", index=False)
    table = read_readings([(folder / "damaged.csv", of)], machine.components, for_fit=False)
    data = checks.ReadingsData(table, machine.components, machine.travels)
    found = checks.run("drift" if of == "drift" else "readings", data)
    return [(each.code, each.message) for each in found]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> list[tuple]:
    return list(draws(tmp_path_factory.mktemp("damage")))


def test_damages_are_found_and_named(drawn: list[tuple], tmp_path: Path) -> None:
    kinds = {kind: damage.words for kind, damage in DAMAGES.items()}
    found_of = (
        (kind, judged(study, DAMAGES[kind].of, frame, tmp_path)) for kind, study, _, frame in drawn
    )
    counts = counted(kinds, found_of)
    fewer = {kind for kind in DAMAGES if counts[kind]["found"] < FEWER.get(kind, DRAWS)}
    assert not fewer, counts


def narrow(low: float, high: float, travel: float) -> list[str]:
    """What is said of a pass over these positions."""
    component = SimpleNamespace(of="x", unit="um")
    at = np.linspace(low, high, 9)
    table = made_readings(np.sin(at) * 1e-3, position=at, passes=np.repeat([1, 2, 3], 3))
    data = checks.ReadingsData(table, {"dx_x": component}, {"x": (0.0, travel)})
    return [x.message for x in checks.run("readings", data) if x.code == "unit-of-positions"]


def test_short_passes_are_suspicious_only_where_another_unit_explains_them() -> None:
    """It takes the positions to more than a twentieth of the travel, and not beyond it."""
    (metres,) = narrow(0.0, 0.5, 500.0)
    assert "within a twentieth of the travel of x (500 mm); in metres they would not be" in metres
    assert "in inches" in narrow(0.0, 19.0, 500.0)[0]
    # 19 mm away from zero, and 30 um, which are a thirtieth of the travel in metres.
    assert narrow(300.0, 319.0, 500.0) == narrow(0.0, 0.03, 1000.0) == []


def test_sound_readings_raise_no_alarm(drawn: list[tuple], tmp_path: Path) -> None:
    seen = {id(sound): (study, DAMAGES[kind].of, sound) for kind, study, sound, _ in drawn}
    assert [found for args in seen.values() for found in judged(*args, tmp_path)] == []


@pytest.mark.parametrize(("factor", "marked"), [(0.99, False), (1.01, True)])
def test_a_reading_is_judged_by_the_line_through_the_others_of_its_pass(
    factor: float, marked: bool
) -> None:
    """Beyond eight standard deviations of a reading predicted there by three others."""
    x, s, error = np.array([0.0, 30.0, 50.0, 90.0]), 0.7, np.zeros((5, 4))
    others = np.vander(x[:3], 2)
    at = np.array([x[3], 1.0])
    u = s * np.sqrt(1 + at @ np.linalg.inv(others.T @ others) @ at)
    error[2] = 2.0 + 0.1 * x
    error[2, 3] += factor * 8 * u
    mask = np.zeros(error.shape, bool)
    mask[2, 3] = True
    assert _off_the_line(error, x, mask, s)[2, 3] == marked
