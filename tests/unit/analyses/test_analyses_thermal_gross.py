"""Gross drift readings do not hide each other, and a model that explains nothing is told."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from synthetic_drift import REFERENCE, UM, Plan

from mtu_cli.analyses.thermal_fit import thermal_fit
from mtu_cli.analyses.thermal_fit.result import HeldOut
from mtu_cli.analyses.thermal_fit.warnings import _consistent, _of_gain
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding

PLACES = (0.0, 120.0, 240.0)
PLAN = Plan(
    gradients=np.array([[2.0, -1.0], [1.5, -0.5], [1.0, 0.0]]), positions=PLACES, cycles=4, n=20
)


def outliers(given: Readings) -> list[Finding]:
    found = thermal_fit([given], {"p": ("x", "um")}, reference=REFERENCE, method="ridge")
    return [item for item in found.warnings if item.code == "outlier-readings"]


def in_time(given: Readings) -> np.ndarray:
    return np.lexsort((given.position_mm, given.time_min))


@pytest.mark.parametrize("share", [0.004, 0.02, 0.1, 0.2])
@pytest.mark.parametrize("kind", ["first", "row", "spread", "as mm"])
def test_gross_readings_are_counted_all_of_them_and_no_other(share: float, kind: str) -> None:
    """From one to a fifth of 240, equal or a thousandfold, in a row, also where cycles begin."""
    rng = np.random.default_rng(1)
    given = PLAN.read(rng)
    count = max(1, int(share * len(given)))
    order = in_time(given)
    rows = {"first": order[:count], "row": order[100 : 100 + count],
            "spread": rng.choice(len(given), count, replace=False),
            "as mm": order[60 : 60 + count]}[kind]  # fmt: skip
    error = given.error.copy()
    error[rows] = 1000 * error[rows] if kind == "as mm" else 250 * UM
    (warning,) = outliers(replace(given, error=error))
    assert warning.message.startswith(f"p: {count} of 240 readings are more than 8 robust ")
    assert warning.message.count(" um in cycle ") == min(count, 5)
    assert (f"; and {count - 5} more." in warning.message) == (count > 5)


def test_of_many_readings_all_are_judged() -> None:
    """Of 36 000 every second is fitted; three slips are told wherever they stand."""
    given = replace(PLAN, n=3000).read(np.random.default_rng(5))
    error = given.error.copy()
    error[[1, 11_112, 30_003]] += 60 * UM
    (warning,) = outliers(replace(given, error=error))
    assert warning.message.startswith("p: 3 of 36000 readings are more than 8 robust ")
    assert outliers(given) == []
    # One in 120, and each no farther than told apart from noise one by one.
    error = given.error.copy()
    error[::120] += 4 * UM
    (warning,) = outliers(replace(given, error=error))
    assert warning.message.startswith("p: 300 of 36000 readings ")


@pytest.mark.parametrize("count", [1, 2])
def test_a_place_with_few_of_many_readings_is_not_doubted(count: int) -> None:
    """What one alone tells is where its place begins."""
    given = replace(PLAN, n=1700).read(np.random.default_rng(6))
    position = given.position_mm.copy()
    position[np.flatnonzero(position == 0.0)[-count:]] = 60.0
    moved = replace(given, position_mm=position, error=given.error + 100 * UM)
    assert len(moved) == 20_400
    assert outliers(moved) == []
    # Of a place with enough readings each is judged.
    error = moved.error.copy()
    error[np.flatnonzero(position == 120.0)[777]] += 60 * UM
    (warning,) = outliers(replace(moved, error=error))
    assert warning.message.startswith("p: 1 of 20400 readings ")


def test_the_worst_are_told_first_with_cycle_time_and_position() -> None:
    given = PLAN.read(np.random.default_rng(2))
    error = given.error.copy()
    rows = in_time(given)[[7, 100, 200]]
    error[rows] += np.array([300.0, 900.0, 600.0]) * UM
    (warning,) = outliers(replace(given, error=error))
    told = re.findall(r"by (\S+) um in cycle '(\w+)' at (\d+) min and (\d+) mm", warning.message)
    expected = [
        (size, given.cycles[given.cycle[i]], f"{given.time_min[i]:g}", f"{given.position_mm[i]:g}")
        for size, i in zip(("900", "600", "300"), rows[[1, 2, 0]], strict=True)
    ]
    assert told == expected


def test_readings_without_times_and_places() -> None:
    plan = replace(PLAN, gradients=PLAN.gradients[:1], positions=(None,))
    given = plan.read(np.random.default_rng(3))
    given = replace(given, time_min=np.full(len(given), np.nan))
    error = given.error.copy()
    error[30:40] += 400 * UM
    (warning,) = outliers(replace(given, error=error))
    assert warning.message.startswith("p: 10 of 80 readings")
    assert " mm" not in warning.message
    assert " min" not in warning.message


def test_clean_readings_of_models_that_fall_short_are_not_doubted() -> None:
    """Drift that the model does not follow is no slip."""
    for seed in range(8):
        rng = np.random.default_rng(seed)
        for plan in (PLAN, replace(PLAN, slow=(0.5,)), replace(PLAN, noise=0.5, noise_memory=0.9)):
            assert outliers(plan.read(rng)) == []


def held(*cycles: tuple[float, float]) -> HeldOut:
    named = tuple((str(c), *pair) for c, pair in enumerate(cycles))
    before, after = np.sqrt(np.mean(np.square(cycles), axis=0))
    return HeldOut(before=before, after=after, ordinary=after, r2=1 - (after / before) ** 2,
                   cycles=named, blocks=len(named))  # fmt: skip


def test_a_gain_within_the_scatter_of_the_cycles_is_none() -> None:
    """Small and within it: the one alone is no reason, and whoever gains by half has a use."""
    nothing = held((10.0, 9.0), (10.0, 10.9), (12.0, 11.9), (9.0, 9.1))
    assert 0 < 1 - nothing.after / nothing.before < 0.05
    ((code, text),) = _of_gain(nothing)
    assert code == "no-better"
    assert f"falls by {100 * (1 - nothing.after / nothing.before):.2g} % only" in text
    small = held((10.0, 9.7), (20.0, 19.5), (12.0, 11.6), (9.0, 8.8))
    uneven = held((10.0, 2.0), (10.0, 11.0), (12.0, 12.1))
    assert list(_of_gain(small)) == []
    assert not _consistent(uneven)
    assert list(_of_gain(uneven)) == []


def test_temperatures_that_have_no_part_in_the_drift_are_told() -> None:
    """Nearly always: where no sensor is chosen, that is told."""
    plan = replace(PLAN, gradients=np.zeros((3, 2)), noise=0.6)
    told = 0
    for seed in range(10):
        found = thermal_fit([plan.read(np.random.default_rng(seed))], {"p": ("x", "um")},
                            reference=REFERENCE, method="ridge")  # fmt: skip
        told += bool({"no-better", "no-sensor"} & {item.code for item in found.warnings})
    # One in twenty cycles' gains is beyond their scatter by chance, some are large.
    assert told >= 8
    clear = thermal_fit([PLAN.read(np.random.default_rng(1))], {"p": ("x", "um")},
                        reference=REFERENCE, method="ridge")  # fmt: skip
    assert "no-better" not in {item.code for item in clear.warnings}
