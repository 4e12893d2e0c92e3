"""Where effects cancel: of sizes that are known to the last digit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_tables import table
from loop_examples import SMOOTH, effect, parameter

from mtu_cli.analyses.close_loop.crossings import crossings
from mtu_cli.analyses.close_loop.result import FoundEffect
from mtu_cli.stats.coverage import coverage_factor, fieller

LEVEL = parameter("level_x", "um", 4.0, 0.4, "level")
DRIFT = effect(
    "thermal-drift-x",
    parameter("drift", "um/K", -2.0, 0.1),
    LEVEL,
    equations={"Ex": "drift*(T_a_degC - 20) + level_x"},
)
GROWTH = effect(
    "thermal-growth-x",
    parameter("growth", "um/m/K", 10.0, 0.5),
    parameter("scale", "um/m", -30.0, 2.0, "margin"),
    parameter("drift", "um/K", 1.0, 0.05, "margin"),
    parameter("level_x", "um", 4.0, 0.4, "level"),
    equations={
        "Ex": "growth*(x - 200)*(T_a_degC - 20) + scale*(x - 200) + drift*(T_a_degC - 20) + level_x"
    },
)
T = np.linspace(18, 26, 12)[:, None]
TABLE = replace(table(12, 9), covariates={"T_a_degC": T, "dir_x": np.tile([[-1.0], [1.0]], (6, 1))})


def test_a_ratio_has_fiellers_interval() -> None:
    a, b, V = 4.0, 2.0, np.array([[0.16, 0.02], [0.02, 0.01]])
    value, u, ends = fieller(a, b, V, 12.0)
    assert value == 2.0
    assert u == pytest.approx(np.sqrt((0.16 - 4 * 0.02 + 4 * 0.01) / 4))
    assert ends is not None
    for x in ends:
        s = np.sqrt(V[0, 0] - 2 * x * V[0, 1] + x**2 * V[1, 1])
        assert abs(a - x * b) / s == pytest.approx(coverage_factor(0.95, 12.0))
    assert fieller(a, 0.1, V)[2] is None


def test_an_axis_is_right_where_its_drift_and_level_cancel() -> None:
    (found,) = crossings([DRIFT], DRIFT.covariance, TABLE)
    assert (found.axis, found.covariate, found.whole) == ("x", "T_a_degC", True)
    assert found.value == pytest.approx(22.0)
    assert found.u == pytest.approx(np.sqrt(0.4**2 + 2**2 * 0.1**2) / 2)


def test_a_growth_has_a_temperature_and_a_place_without_error() -> None:
    found = {each.covariate: each for each in crossings([GROWTH], GROWTH.covariance, TABLE)}
    assert found["T_a_degC"].value == pytest.approx(23.0)
    assert found["x"].value == pytest.approx(100.0)
    assert not any(each.whole for each in found.values())


@pytest.mark.parametrize(
    "effects",
    [
        # Another effect along the axis depends on something else, or its name is not certain.
        (DRIFT, effect("scale-x", parameter("b", "um/m", 9, 1), equations={"Ex": "b*(x - 200)"})),
        (DRIFT, SMOOTH),
        (replace(DRIFT, classes=(("thermal-drift-x", 0.6), ("warm-up-x", 0.4))),),
        # No size is estimated but one; a direction; the level's sign is all that is known.
        (effect("d-x", parameter("d", "um/K", -2, 0.1), equations={"Ex": "d*(T_a_degC - 20)"}),),
        (replace(DRIFT, equations={"Ex": "drift*dir_x + level_x"}),),
        (replace(DRIFT, equations={"Ex": "drift*1e-3*(T_a_degC - 20) + level_x"}),),
    ],
)
def test_no_zero_is_told_where_there_is_none(effects: tuple[FoundEffect, ...]) -> None:
    rows = iter(range(9))
    own = [replace(e, rows=tuple(next(rows) for _ in e.parameters)) for e in effects]
    covariance = np.diag([p.u**2 for e in own for p in e.parameters])
    assert crossings(own, covariance, TABLE) == ()
