"""What the checks find of the damages, and that they say nothing of sound readings."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from made_tables import made_readings

from checks.damage import CONFIGS, DAMAGES, DRAWS, counted, draws
from mtu_cli import checks
from mtu_cli.files.machine import load_machine
from mtu_cli.files.readings import Readings
from mtu_cli.units import UNITS

FEWER = {"a pass in another unit": 3, "a mirrored pass": 1, "drift in mm marked um": 0}
"""Found of DRAWS, where these are fewer than all: a drift of 0.1 um is not impossible."""


def as_table(frame: pd.DataFrame, components: dict) -> Readings:
    """A frame as sound cells are read."""
    names, code = np.unique(frame.component, return_inverse=True)
    units = [UNITS[unit] for unit in frame.unit]
    axisless = np.array([components[name].of is None for name in names])[code]
    ways = frame["direction"].map({"forward": 1, "reverse": -1}) if "direction" in frame else 0
    return made_readings(
        frame.error.to_numpy(float) * [unit.to_internal for unit in units],
        names,
        code=code,
        position=np.where(axisless, np.nan, frame.position_mm.to_numpy(float)),
        dimension=[unit.dimension for unit in units],
        passes=frame.get("pass"),
        direction=np.nan_to_num(ways),
        cycle=frame["cycle"].astype(str) if "cycle" in frame else None,
        time=frame.get("time_min", np.nan),
        covariates={name: frame[name].to_numpy(float) for name in frame if name[:2] == "T_"},
    )


known = cache(load_machine)


def judged(study: str, of: str, frame: pd.DataFrame) -> list[tuple[str, str]]:
    """(code, message) of what the checks say about a frame."""
    machine = known(CONFIGS / study / "machine.yaml").machine
    table = as_table(frame.reset_index(drop=True), machine.components)
    data = checks.ReadingsData(table, machine.components, machine.travels)
    found = checks.run("drift" if of == "drift" else "readings", data)
    return [(each.code, each.message) for each in found]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> list[tuple]:
    return list(draws(tmp_path_factory.mktemp("damage")))


def test_damages_are_found_and_named(drawn: list[tuple]) -> None:
    kinds = {kind: damage.words for kind, damage in DAMAGES.items()}
    found_of = ((kind, judged(study, DAMAGES[kind].of, frame)) for kind, study, _, frame in drawn)
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


def test_sound_readings_raise_no_alarm(drawn: list[tuple]) -> None:
    seen = {id(sound): (study, DAMAGES[kind].of, sound) for kind, study, sound, _ in drawn}
    assert [found for args in seen.values() for found in judged(*args)] == []
