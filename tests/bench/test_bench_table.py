"""The full count of tables of smooth profiles: 500 axes, future readings between the targets."""

from pathlib import Path

import pytest
from table_trials import axis_machine, table_coverage

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
