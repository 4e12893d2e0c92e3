"""Positioning: both uncertainties by simulated axes and closed forms, odd tests, plans, limits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from positioning_examples import positioning, published

from mtu_cli.analyses.iso230 import (
    ISO,
    Axis,
    corrected,
    evaluate,
    figures_of,
    instrument_u,
    plan,
    sampling_u,
    statistics,
    warnings_of,
)
from mtu_cli.files.study import InstrumentBudget
from mtu_cli.stats.blocks import stream
from mtu_cli.stats.least_squares import FloatArray

UM = 1e-3
JUDGED = ("A", "R", "E", "M", "B")
TARGETS = np.arange(0.0, 1001.0, 100.0)


def simulated(seed: int, axes: int, shape: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    """True means (axes, 2, m) and s (axes, 1, 1), um: a smooth profile with backlash."""
    rng = stream(seed)
    m = shape[0]
    waves = rng.normal(0, 3, (axes, 3, 1)) * np.cos(
        np.outer(np.arange(1, 4), np.linspace(0, 3, m)) + rng.uniform(0, 6, (axes, 3, 1))
    )
    backlash = rng.normal(0, 4, (axes, 1, 1)) + rng.normal(0, 0.5, (axes, 1, m))
    mean = waves.sum(axis=1)[:, None, :] + np.array([[0.5], [-0.5]]) * backlash
    return mean, rng.uniform(0.3, 2.0, (axes, 1, 1))


def test_a_repeated_test_lies_within_the_stated_bound() -> None:
    """1000 axes, each tested twice: within 2 sqrt(2) u_sampling in 92 % or more."""
    shape = (11, 5)
    truth, s = simulated(1, 1000, shape)
    rng = stream(2)
    tests = [
        statistics(truth[..., None] + s[..., None] * rng.standard_normal((1000, 2, *shape)))
        for _ in range(2)
    ]
    first, second = (figures_of(mean, own) for _, mean, own in tests)
    u = sampling_u(*tests[0], stream(3), 150)
    for name in JUDGED:
        inside = np.abs(first[name] - second[name]) <= 2 * math.sqrt(2) * u[name]
        assert inside.mean() >= 0.92, name
        # Nor is it so wide that it says nothing.
        assert inside.mean() <= 0.99, name


def test_figures_of_an_instrument_without_error_lie_within_two_u() -> None:
    """1000 axes read by instruments with an error of the budget's: A, E and M in 93 % or more."""
    budget = InstrumentBudget(
        device_U_um_per_m=3.0, T_half_width_K=0.5, alpha_um_per_m_K=11.0, alignment_mm=0.5,
        T_mean_degC=21.5, alpha_half_width=1.0, already_at_20=True,
    )  # fmt: skip
    truth, s = simulated(4, 1000, (11, 5))
    rng, inside = stream(5), dict.fromkeys(("A", "E", "M"), 0)
    for i in range(1000):
        right = (truth[i, :, :, None] + s[i] * rng.standard_normal((2, 11, 5))) * UM
        scale = rng.standard_normal() * 1.5 + rng.uniform(-1, 1) * 5.5 + rng.uniform(-1, 1) * 1.5
        scale += rng.uniform() * 0.5**2 / 2  # a rectangle up to d^2/(2 L), um a metre
        test = positioning(TARGETS, (right + scale * 1e-6 * TARGETS[:, None]) / UM)
        u = instrument_u(test, budget, stream(6, i), 200)
        read, known = (figures_of(*statistics(x)[1:]) for x in (test.readings, right))
        for name in inside:
            inside[name] += bool(abs(read[name] - known[name]) <= 2 * u[name])
    assert min(inside.values()) >= 930, inside


BUDGETS: dict[str, tuple[dict[str, Any], float]] = {
    # U of k = 2 for L = 1 m, um: ISO/TR 230-9 as derived in formats.
    "device": ({"device_U_um_per_m": 2.0}, 2.0),
    "alignment": ({"alignment_mm": 2.0}, 2.0**2 / (2 * 1000) * 1e3 / math.sqrt(3)),
    "temperature": ({"T_half_width_K": 0.5, "alpha_um_per_m_K": 11.5}, 11.5 / math.sqrt(3)),
    "expansion": (
        {"T_mean_degC": 24.0, "alpha_um_per_m_K": 11.5, "alpha_half_width": 1.0},
        8.0 / math.sqrt(3),
    ),
}


@pytest.mark.parametrize("name", BUDGETS)
def test_closed_forms_of_one_contributor(name: str) -> None:
    """On a straight steep line E and M change with the scale alone, so U(E) is the closed form;
    R and B do not change.
    """
    given, U = BUDGETS[name]
    line = np.broadcast_to((0.1 * TARGETS)[:, None], (2, 11, 5))
    budget = InstrumentBudget(already_at_20=True, **given)
    found = instrument_u(positioning(TARGETS, line), budget, stream(7))
    for figure in ("E", "M"):
        assert 2 * found[figure] / UM == pytest.approx(U, rel=0.03)
    assert found["B"] == found["R"] == 0


def test_readings_are_taken_to_20_degc_where_the_budget_says_so() -> None:
    given: dict[str, Any] = {"T_mean_degC": 23.0, "alpha_um_per_m_K": 10.0}
    readings = np.broadcast_to((0.03 * TARGETS)[:, None], (2, 11, 5))
    test = positioning(TARGETS, readings)
    own, noted = corrected(test, InstrumentBudget(already_at_20=False, **given))
    assert own.readings == pytest.approx(np.zeros((2, 11, 5)), abs=1e-12)
    assert [x.code for x in noted] == ["corrected-to-20"]
    assert corrected(test, InstrumentBudget(already_at_20=True, **given)) == (test, [])


def there(axis: Axis) -> str:
    """Figures of ISO 230-2 that exist."""
    return " ".join(name for name in ISO if not math.isnan(axis.figures[name].value))


def test_one_direction_has_one_way_figures_alone() -> None:
    targets, readings = published(3)
    readings[1] = np.nan
    axis = evaluate(positioning(targets, readings), None, 2.0, 1, 0)
    assert there(axis) == "A_forward E_forward R_forward"
    assert axis.figures["A_forward"].value / UM == pytest.approx(19.0975, abs=1e-4)
    assert axis.figures["A_forward"].u_sampling > 0
    note = next(x for x in warnings_of(axis) if x.code == "not-estimable")
    assert "one direction only" in note.message


def test_a_transient_is_shown_and_stays() -> None:
    rows = np.arange(50).reshape(2, 5, 5) + 2
    for number, expected in ((1, [(2, 7)]), (3, [])):
        test = positioning(*published(number), rows=rows, file="a.csv")
        found = warnings_of(evaluate(test, None, 2.0, 1, 0))
        assert [x.facts["rows"] for x in found if x.code == "outlying-value"] == expected


def test_limits_are_decided_by_iso_14253_1() -> None:
    budget = InstrumentBudget(device_U_um_per_m=20.0)
    axis = evaluate(positioning(*published(3)), budget, 2.0, 1, 0)
    A, U = axis.figures["A"].value / UM, axis.figures["A"].U / UM
    assert U > 0
    verdicts = {1.1: "conforming", 0.5: "not proven", -0.5: "not proven", -1.1: "nonconforming"}
    for share, verdict in verdicts.items():
        limits = {"A": A + share * U, "dy_y.A": 1.0}
        judged = evaluate(positioning(*published(3)), budget, 2.0, 1, 0, limits)
        assert judged.figures["A"].verdict == verdict


@pytest.mark.parametrize(
    ("length", "pitch"), [(500.0, 10.0), (1000.0, 20.0), (200.0, 100.0), (80.0, 16.0), (2500, 40)]
)
def test_planned_targets_are_no_multiples_of_the_pitch(length: float, pitch: float) -> None:
    found = plan(length, pitch)
    phase = np.mod(found.targets / pitch, 1.0)
    assert np.minimum(phase, 1 - phase).min() > 0.05
    assert len(found.targets) == max(5, math.ceil(5 * length / 1000))
    assert found.targets.min() >= 0
    assert found.targets.max() <= length
    assert np.diff(found.targets).min() > 0
    if pitch < length / 10:
        # A cyclic error is seen at phases all over the pitch.
        assert np.ptp(phase) > 0.3
