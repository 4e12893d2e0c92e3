"""Evidence of thermal models: nested held-out errors, tests of position, lags that are found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from plain_thermal import Table, held_out_errors
from synthetic_drift import REFERENCE, ROUNDING, UM, Plan, Run, one, readings, rises

from mtu_cli.analyses.thermal_fit import models, thermal_fit
from mtu_cli.files.readings import Readings
from mtu_cli.stats.lag import first_order_lag

PLACES = (0.0, 120.0, 200.0)


def table(found: Readings) -> Table:
    places = np.unique(found.position_mm)
    middle, half = (places.max() + places.min()) / 2, np.ptp(places) / 2
    return Table(
        u=rises(found, 3),
        y=found.error / UM,
        place=np.searchsorted(places, found.position_mm),
        cycle=found.cycle,
        scaled=(places - middle) / half,
    )


PLANS = {
    "clear": Plan(
        gradients=np.array([[2.0, -1.0, 0.0], [1.0, -1.0, 0.3], [0.0, -1.0, 0.0]]),
        positions=PLACES, cycles=4, n=20, noise=0.5,
    ),
    "weak": Plan(
        gradients=np.array([[0.05, 0.0, 0.02], [0.06, 0.02, 0.0], [0.05, 0.0, 0.0]]),
        positions=PLACES, cycles=3, n=25, noise=0.6, slow=(0.4,),
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", ["ridge", "stepwise"])
@pytest.mark.parametrize("name", PLANS)
def test_held_out_errors_are_those_of_plain_nested_fits(name: str, kind: str) -> None:
    found = PLANS[name].read(np.random.default_rng(31))
    drift = one(found, kind)
    total, by_cycle = held_out_errors(table(found), kind)
    assert drift.held_out is not None
    assert drift.held_out.after / UM == pytest.approx(total, rel=ROUNDING)
    assert [after / UM for _, _, after in drift.held_out.cycles] == pytest.approx(
        by_cycle, rel=ROUNDING
    )


def test_many_cycles_are_held_out_in_blocks_of_those_that_follow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(models, "MOST_BLOCKS", 4)
    found = replace(PLANS["clear"], cycles=10, n=4).read(np.random.default_rng(34))
    sizes = [2, 3, 2, 3]
    blocks = replace(table(found), cycle=np.repeat(np.arange(4), sizes)[found.cycle])
    total, by_block = held_out_errors(blocks, "ridge")
    drift = one(found, "ridge")
    assert drift.held_out is not None
    assert drift.held_out.blocks == 4
    assert drift.held_out.after / UM == pytest.approx(total, rel=ROUNDING)
    squares = np.array([after / UM for _, _, after in drift.held_out.cycles]) ** 2
    means = [part.mean() for part in np.split(squares, np.cumsum(sizes)[:-1])]
    assert np.sqrt(means) == pytest.approx(np.array(by_block), rel=ROUNDING)


def test_errors_without_temperature_and_of_ordinary_least_squares() -> None:
    found = PLANS["weak"].read(np.random.default_rng(32))
    rows = table(found)
    before = least = 0.0
    for held in range(3):
        others, left = rows.of([c for c in range(3) if c != held]), rows.of([held])
        for k in range(3):
            a, b = others.place == k, left.place == k
            before += np.sum((left.y[b] - others.y[a].mean()) ** 2)
            X = np.column_stack([np.ones(a.sum()), others.u[a]])
            fit = np.linalg.lstsq(X, others.y[a], rcond=None)[0]
            least += np.sum((left.y[b] - fit[0] - left.u[b] @ fit[1:]) ** 2)
    held_out = one(found, "ridge").held_out
    assert held_out is not None
    assert held_out.before / UM == pytest.approx(np.sqrt(before / len(found)), rel=ROUNDING)
    assert held_out.ordinary / UM == pytest.approx(np.sqrt(least / len(found)), rel=ROUNDING)
    assert held_out.r2 == pytest.approx(1 - (held_out.after / held_out.before) ** 2, rel=ROUNDING)


@pytest.mark.parametrize("method", ["auto", "stepwise", "ridge", "lagged"])
def test_a_held_out_cycle_takes_no_part_in_its_own_model(method: str) -> None:
    """An error added to one cycle alone is what that cycle then shows, to the last digit.

    A constant on the readings of one cycle moves what is held out by exactly that constant;
    had the cycle's readings had any say in fit or choice, they would show less of it.
    """
    plan = PLANS["clear"]
    found = plan.read(np.random.default_rng(33))
    inside = found.cycle == 1
    shifts = (0.0, 1000.0, -1000.0)
    seen = []
    for shift in shifts:
        moved = replace(found, error=found.error + np.where(inside, shift * UM, 0.0))
        fit = thermal_fit(moved, {"p": ("y", "um")}, reference=20.0, method=method, zeroed="never")
        held_out = fit.components["p"].held_out
        assert held_out is not None
        seen.append(next(after / UM for cycle, _, after in held_out.cycles if cycle == "c1") ** 2)
    # Mean squares at 0, +a and -a: the second difference is 2 a^2 if the residuals move by a.
    assert seen[1] + seen[2] - 2 * seen[0] == pytest.approx(2 * 1000.0**2, rel=ROUNDING)


def test_noise_alone_is_no_better_held_out() -> None:
    plan = Plan(gradients=np.zeros((1, 4)), n=40, noise=1.0)
    found = [one(plan.read(np.random.default_rng(seed)), "ridge").held_out for seed in range(30)]
    r2 = np.array([item.r2 for item in found if item is not None])
    assert len(r2) == 30
    assert r2.mean() < 3 * r2.std() / np.sqrt(30)


def false_alarms(draws: int, **changes: object) -> float:
    """Share of data sets without any dependence on position whose test says p < 0.05."""
    plan = replace(
        Plan(gradients=np.tile([2.0, -1.0, 0.5], (3, 1)), positions=PLACES, cycles=1, n=150),
        **changes,  # type: ignore[arg-type]  # the fields of a plan by name
    )
    alarms = 0
    for seed in range(draws):
        test = one(plan.read(np.random.default_rng(seed)), "ridge").position_test
        assert test is not None
        alarms += test.p < 0.05
    return alarms / draws


def test_false_alarms_of_the_test_of_position() -> None:
    """Where readings follow each other their autocorrelation is estimated from the residuals, a
    little too low: near 5 %, not 50 %.
    """
    assert abs(false_alarms(200) - 0.05) < 4 * np.sqrt(0.05 * 0.95 / 200)
    rate = false_alarms(120, noise_memory=0.8, n=300)
    assert rate < 0.10 + 4 * np.sqrt(0.1 * 0.9 / 120)


def lagged_plan(constants: Sequence[float], seed: int, cycles: int = 4) -> Readings:
    """Drift of lagged temperatures, 96 readings two minutes apart in each of the cycles."""
    rng = np.random.default_rng(seed)
    count = len(constants)
    gradients = np.array([2.0, -1.5, 1.0])[:count]
    plan = Plan(gradients=gradients[None], n=96, cycles=cycles)
    runs = []
    for c, T in enumerate(plan.temperatures(rng)):
        time = plan.time(c)
        lagged = first_order_lag(T, time, np.array(constants))
        own = lagged[np.arange(count), :, np.arange(count)].T
        error = (own - REFERENCE) @ gradients + 0.1 * rng.normal(size=96)
        runs.append(Run(position=0.0, cycle=f"c{c}", time=time, temperature=T, error=error * UM))
    return readings(runs)


@pytest.mark.parametrize("method", ["lagged", "auto"])
@pytest.mark.parametrize(
    "constants", [(4.0,), (128.0,), (16.0, 16.0, 16.0), (32.0, 0.0, 0.0), (0.0, 64.0, 8.0)]
)
def test_time_constants_on_the_grid_are_found(method: str, constants: tuple[float, ...]) -> None:
    """The grid is 4, 8, ... 128 min: powers of two from twice the step."""
    drift = one(lagged_plan(constants, 34), method)
    assert drift.model == "lagged"
    assert drift.estimate.time_constants == pytest.approx(constants, rel=ROUNDING)
    u = np.sqrt(np.diag(drift.estimate.covariance))
    planted = np.array([2.0, -1.5, 1.0])[: len(constants)] * UM
    assert (np.abs(drift.estimate.coefficients[0] - planted) < 5 * u).all()
    # 0.1 um is the noise of the 384 readings, whose rms has the standard error 0.1/sqrt(2*384).
    assert drift.rms_after / UM == pytest.approx(0.1, rel=5 / np.sqrt(2 * 384))
    residual = np.concatenate([curve.measured - curve.modelled for curve in drift.curves])
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(drift.rms_after, rel=ROUNDING)


def test_no_lag_is_found_where_there_is_none() -> None:
    drift = one(lagged_plan((0.0, 0.0, 0.0), 35), "lagged")
    assert (drift.estimate.time_constants == 0).all()
    assert drift.model == "ridge"


def test_lags_need_times() -> None:
    found = lagged_plan((32.0,), 37)
    untimed = replace(found, time_min=np.full(len(found), np.nan))
    result = thermal_fit(untimed, {"p": ("x", "um")}, reference=REFERENCE, method="auto")
    assert "no-effect-of-temperature" in [warned.code for warned in result.warnings]
    assert (result.components["p"].estimate.time_constants == 0).all()
