"""Axes and circles: ISO 230-2 and 230-4, lengths."""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from circle_examples import Causes, made
from model_examples import estimate, model_of, part_of, stated
from positioning_examples import positioning, published
from scipy import stats

from mtu_cli.analyses.circular import CircularResult, diagnose
from mtu_cli.analyses.iso230 import (
    ISO,
    corrected,
    evaluate,
    figures_of,
    instrument_u,
    plan,
    sampling_u,
    statistics,
    warnings_of,
)
from mtu_cli.analyses.predictions import LengthsResult, predict_lengths
from mtu_cli.files.readings import Traces
from mtu_cli.files.study import InstrumentBudget
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.settings import Settings
from mtu_cli.reports.fields import RowOf, rows_of
from mtu_cli.reports.standards import circular as document
from mtu_cli.reports.standards import circular_figure as figure
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
    for name in ("E", "M"):
        assert 2 * found[name] / UM == pytest.approx(U, rel=0.03)
    assert found["B"] == found["R"] == 0


def test_readings_are_taken_to_20_degc_where_the_budget_says_so() -> None:
    given: dict[str, Any] = {"T_mean_degC": 23.0, "alpha_um_per_m_K": 10.0}
    readings = np.broadcast_to((0.03 * TARGETS)[:, None], (2, 11, 5))
    test = positioning(TARGETS, readings)
    own, noted = corrected(test, InstrumentBudget(already_at_20=False, **given))
    assert own.readings == pytest.approx(np.zeros((2, 11, 5)), abs=1e-12)
    assert [x.code for x in noted] == ["corrected-to-20"]
    assert corrected(test, InstrumentBudget(already_at_20=True, **given)) == (test, [])


def test_one_direction_has_one_way_figures_alone() -> None:
    targets, readings = published(3)
    readings[1] = np.nan
    axis = evaluate(positioning(targets, readings), None, 2.0, 1, 0)
    there = [name for name in ISO if not math.isnan(axis.figures[name].value)]
    assert there == ["A_forward", "E_forward", "R_forward"]
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


# Circular tests: every cause is returned, with and without correlated noise, and told apart.


NONE = (0.0, 0.0)


def values(result: CircularResult) -> dict[str, float]:
    return {x.name: x.value / x.size for x in result.causes}


@pytest.mark.parametrize("exact", [False, True])
def test_every_cause_is_returned_without_noise(exact: bool) -> None:
    """Of first order to 1 nm, against the exact radius to 0.1 um (um/m of 150 mm: 0.15 um)."""
    causes = Causes()
    found = values(diagnose(made(causes, exact=exact)))
    within = 0.1 if exact else 1e-3
    assert found == pytest.approx(causes.expected(), abs=within)


def misses(results: Iterable[CircularResult], expected: dict[str, float]) -> FloatArray:
    """How many u every cause that is not 0 is off."""
    return np.array([
        abs(x.value / x.size - expected[x.name]) / (x.u / x.size)
        for result in results for x in result.causes if expected[x.name]
    ])  # fmt: skip


def test_every_cause_is_returned_within_3_u_of_correlated_noise() -> None:
    """Of two dozen tests: within 3 u nearly always, within 2 u in nine of ten; u is no smaller and
    not much larger than the scatter.
    """
    tests = (made(Causes(), n=180, s=3e-4, phi=(0.5, 0.8, 0.9)[i % 3], seed=i) for i in range(24))
    z = misses(map(diagnose, tests), Causes().expected())
    assert (z <= 3).mean() >= 0.985
    assert (z <= 2).mean() >= 0.90
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.25


def test_one_direction_does_not_separate_squareness_from_servo_lag() -> None:
    result = diagnose(made(Causes(), ways="ccw ccw"))
    found = values(result)
    assert math.isnan(found["squareness"])
    assert math.isnan(found["servo-mismatch"])
    assert found["backlash-a"] == pytest.approx(4.0, abs=1e-3)
    assert math.isnan(result.D)
    assert math.isnan(result.G_bidirectional)
    (note,) = result.warnings
    assert "one direction only" in note.message
    # Their sum, eps R/2 + s dT v/2, is the cause of that test.
    causes = Causes()
    lag = (causes.lag[0] - causes.lag[1]) * causes.feed / 60
    both = result.cause("squareness-or-servo")
    assert both.value == pytest.approx((causes.lean * causes.radius + lag) / 2, abs=1e-6)
    assert both.exceeds
    assert "Largest significant causes: squareness-or-servo" in document(result).verdict
    two_ways = [each.name for each in diagnose(made(causes)).causes]
    assert "squareness-or-servo" not in two_ways


def test_feeds_separate_squareness_from_servo_lag_of_one_direction() -> None:
    feeds = [made(replace(Causes(), feed=feed), ways="ccw") for feed in (1000.0, 4000.0)]
    both = replace(feeds[0], traces=feeds[0].traces + feeds[1].traces)
    result = diagnose(both)
    expected = Causes().expected()
    for name in ("squareness", "servo-mismatch"):
        assert values(result)[name] == pytest.approx(expected[name], abs=1e-3)
    (note,) = result.warnings
    assert note.facts["names"] == ["G_bidirectional", "D"]
    assert "look alike" not in note.message


def test_the_sum_of_squareness_and_lag_scatters_by_its_u() -> None:
    causes = Causes()
    lag = (causes.lag[0] - causes.lag[1]) * causes.feed / 60
    z = []
    for seed in range(40):
        traces = made(causes, ways="ccw", n=180, s=0.0003, phi=0.8, seed=seed)
        both = diagnose(traces).cause("squareness-or-servo")
        z.append((both.value - (causes.lean * causes.radius + lag) / 2) / both.u)
    # Four standard errors of a standard deviation.
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=4 / np.sqrt(2 * len(z)))


def test_the_diagram_holds_the_whole_trace() -> None:
    """A reach of 14 um is no 10."""
    result = diagnose(made(replace(Causes(), lean=200e-6, lag=(0.0, 0.0))))
    panel: Any = figure(result).axes[0]
    drawn = max(np.abs(line.get_ydata()).max() for line in panel.lines)
    assert 13 < drawn < panel.get_rmax()


def test_without_a_feed_there_is_no_servo_time() -> None:
    with_feed = made(Causes())
    traces = replace(with_feed, traces=tuple(replace(t, feed=np.nan) for t in with_feed.traces))
    result = diagnose(traces)
    servo = result.cause("servo-mismatch")
    assert math.isnan(servo.value)
    assert servo.share > 0
    assert f"servo-mismatch ({100 * servo.share:.0f} %)" in document(result).verdict
    assert values(result)["squareness"] == pytest.approx(30.0, abs=1e-3)
    assert [x.facts["names"] for x in result.warnings] == [["servo-mismatch"]]


def test_an_arc_or_radians_are_reported() -> None:
    whole = made(Causes())
    first = whole.traces[0]
    half = replace(
        first,
        angle=first.angle[first.angle < np.pi],
        deviation=first.deviation[first.angle < np.pi],
    )
    radians = replace(first, angle=np.radians(first.angle))
    for arc, degrees in ((half, "180 degrees"), (radians, "6 degrees")):
        (found,) = diagnose(replace(whole, traces=(*whole.traces, arc))).warnings
        assert (found.code, found.value) == ("partial-circle", degrees)
    assert not diagnose(whole).warnings


def test_figures_of_a_trace_are_those_of_its_circle() -> None:
    """Of an ellipse alone G is its range, about whatever centre; F is about the given one."""
    none = Causes(centre=(0.02, 0.0), scale=(1e-4, -1e-4), lean=0, lag=NONE, backlash=NONE,
                  bow=NONE, spike=NONE)  # fmt: skip
    result = diagnose(made(none, n=3600))
    first = result.figures[0]
    assert first.G_lsc == pytest.approx(2 * 150 * 1e-4, rel=1e-4)
    assert first.F_max == pytest.approx(0.02 + 150 * 1e-4, rel=1e-4)
    assert result.cause("centre-offset").value == pytest.approx(0.02, abs=1e-9)
    assert result.G_bidirectional == pytest.approx(first.G_lsc)
    assert pytest.approx(0.0, abs=1e-9) == result.D


PITCHES = (10.0, 8.0)
WAVES = {"cyclic-a-forward": (0.002, 0.4), "cyclic-a-reverse": (0.001, 1.9),
         "cyclic-b-forward": (0.0, 0.0), "cyclic-b-reverse": (0.0015, -0.7)}  # fmt: skip


def with_waves(n: int, s: float = 0.0, seed: int = 0) -> Traces:
    """Traces of axes whose screws err with their pitch, in another phase forward and in reverse."""
    found, traces = made(Causes(), n=n, s=s, phi=0.8, seed=seed), []
    for trace in found.traces:
        c, sine, y = np.cos(trace.angle), np.sin(trace.angle), trace.deviation.copy()
        ways = {"a": (c, -trace.sign * sine > 0), "b": (sine, trace.sign * c > 0)}
        for name, (size, phase) in WAVES.items():
            along, forward = ways[name[7]]
            turns = found.radius * along / PITCHES["ab".index(name[7])]
            wave = size * np.sin(2 * np.pi * turns + phase) * along
            y += wave * (forward == name.endswith("forward"))
        traces.append(replace(trace, deviation=y))
    return replace(found, traces=tuple(traces))


def test_cyclic_errors_of_known_pitches_are_returned_with_all_other_causes() -> None:
    expected = Causes().expected() | {name: 1e3 * size for name, (size, _) in WAVES.items()}
    found = diagnose(with_waves(2000), PITCHES)
    assert values(found) == pytest.approx(expected, abs=0.1)
    assert sum(x.share for x in found.causes if x.share == x.share) == pytest.approx(1.0)
    assert found.remainder_rms < 1e-4
    results = (diagnose(with_waves(1000, s=5e-4, seed=seed), PITCHES) for seed in range(12))
    z = misses(results, expected)
    assert (z <= 3).mean() >= 0.98
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.3


# Lengths: by hand, against counted parts, with bounds of what was not measured.


FAST = Settings(trials=20_000, threads=1)
PART = """
features: {a: {x_mm: 0, y_mm: 0}, b: {x_mm: 100, y_mm: 0}, c: {x_mm: 70, y_mm: 90}}
lengths: [{from: a, to: b, tolerance_um: 9}, {from: b, to: c}, {from: c, to: a, tolerance_um: 4}]
"""


def each(found: LengthsResult) -> list[RowOf]:
    """The lengths one by one."""
    return rows_of(found, len(found.ids))


def machine(s: float = 2e-3, dof: float = np.inf) -> MachineModel:
    scale = estimate(
        "sx",
        "x",
        [1e-3, 2e-5],
        C=np.array([[1e-6, 0], [0, 4e-10]]),
        D=np.array([[4e-6, -2e-9], [-2e-9, 9e-10]]),
        s=s,
        pass_dof=dof,
        repeat_dof=np.inf if np.isinf(dof) else 50.0,
    )
    angle = estimate("t", None, [1e-5], D=np.array([[9e-10]]), pass_dof=dof)
    return model_of([(scale, {"x": "1", "y": "0.3"}), (angle, {"x": "-y", "y": "x"})])


def test_a_length_by_hand(tmp_path: Path) -> None:
    model = stated(
        tmp_path,
        """
        components:
          sx: {of: x, unit: um, coefficients: [1.0, 0.02], s_repeat: 2.0,
               covariance: [[1.0, 0.0], [0.0, 4.0e-4]],
               pass_covariance: [[4.0, 0.0], [0.0, 9.0e-4]], dof: 12}
        equations: {Ex: sx, Ey: 0}
        """,
    )
    found = predict_lengths(model, part_of(tmp_path, PART), FAST)
    first = each(found)[0]
    assert first.nominal == pytest.approx(100.0)
    assert first.error == pytest.approx(0.02 * 100 * 1e-3)
    # The level cancels, the slope over 100 mm does not; two visits.
    of_lines, visits = (4.0e-4 + 9.0e-4) * 100**2, 2 * 4.0
    assert first.variance == pytest.approx((of_lines + visits) * 1e-6)
    shares = first.shares
    assert shares is not None
    of_all = of_lines + visits
    assert shares["coefficients"] == pytest.approx(4.0 / of_all)
    assert shares["passes"] == pytest.approx(9.0 / of_all)
    assert shares["repeatability"] == pytest.approx(8.0 / of_all)
    assert first.dof == pytest.approx((of_lines + visits) ** 2 / (of_lines**2 + visits**2) * 12)
    u = np.sqrt(first.variance)
    t = stats.t(first.dof).ppf(0.975)
    assert tuple(first.interval95) == pytest.approx((first.error - t * u, first.error + t * u))
    ends = [0.0, 100.0]
    apart = sum(1 + 4 + (4e-4 + 9e-4) * p**2 + 4 for p in ends) * 1e-6
    assert first.independent_variance == pytest.approx(apart)
    assert first.conformance is not None
    law = stats.t(first.dof, loc=first.error, scale=u)
    assert first.conformance.probability == pytest.approx(law.cdf(9e-3) - law.cdf(-9e-3))


CLOSE = """
features: {a: {x_mm: 0, y_mm: 0}, b: {x_mm: 0.02, y_mm: 0}}
lengths: [{from: a, to: b}]
"""


def test_validation_fails_where_the_errors_are_as_large_as_the_length(tmp_path: Path) -> None:
    """20 um apart with u = 10 um: the length is no longer a line in the errors."""
    model = model_of([(estimate(axis, "x", [0.0], s=0.01), {axis: "1"}) for axis in "xy"])
    found = predict_lengths(model, part_of(tmp_path, CLOSE), FAST)
    item = each(found)[0]
    assert item.validation.passed is False
    (failed,) = [warning for warning in found.warnings if warning.code == "validation-failed"]
    assert "a-b" in failed.message
    # The truth by plain draws: two visits of 10 um along each axis.
    rng = np.random.default_rng(3)
    e = np.sqrt(2) * 0.01 * rng.standard_normal((2, 400_000))
    grown = np.hypot(0.02 + e[0], e[1]) - 0.02
    low, high = np.quantile(grown, [0.025, 0.975])
    assert found.run.low[0] == pytest.approx(low, abs=3e-4)
    assert found.run.high[0] == pytest.approx(high, abs=6e-4)
    assert abs(item.interval95[0] - low) > 10 * item.validation.tolerance


def test_joint_conformance_against_counted_parts(tmp_path: Path) -> None:
    """Correlated lengths, one without a tolerance: parts drawn by hand."""
    model = machine(s=1e-3)
    part = part_of(tmp_path, PART)
    found = predict_lengths(model, part, FAST)
    assert found.joint_conformance is not None
    rng = np.random.default_rng(5)
    n = 200_000
    p = np.array([[0.0, 0], [100, 0], [70, 90]])
    S = np.array([[1e-6, 0], [0, 4e-10]]) + np.array([[4e-6, -2e-9], [-2e-9, 9e-10]])
    b = rng.multivariate_normal([1e-3, 2e-5], S, size=n)
    t = 1e-5 + 3e-5 * rng.standard_normal((n, 1))
    sx = b[:, :1] + b[:, 1:] * p[:, 0] + 1e-3 * rng.standard_normal((n, 3))
    x, y = p[:, 0] + sx - p[:, 1] * t, p[:, 1] + 0.3 * sx + p[:, 0] * t
    ab = np.hypot(x[:, 1] - x[:, 0], y[:, 1] - y[:, 0]) - 100
    ca = np.hypot(x[:, 2] - x[:, 0], y[:, 2] - y[:, 0]) - np.hypot(70, 90)
    good = (np.abs(ab) <= 9e-3) & (np.abs(ca) <= 4e-3)
    _, probability, error = found.joint_conformance
    assert probability == pytest.approx(good.mean(), abs=4.5 * np.hypot(error, 0.5 / np.sqrt(n)))
    alone = [item.conformance.probability for item in each(found) if item.conformance]
    assert alone == pytest.approx(
        [np.mean(np.abs(ab) <= 9e-3), np.mean(np.abs(ca) <= 4e-3)], abs=5e-3
    )
    # The product would be wrong: the lengths share the part's state.
    assert abs(np.prod(alone) - good.mean()) > 10 * error


def test_bounds_of_unmeasured_correlation(tmp_path: Path) -> None:
    a = estimate("a", "x", [0.0, 0.0], D=np.diag([0, 9e-10]))
    b = estimate("b", "y", [0.0, 0.0], D=np.diag([0, 4e-10]))
    model = model_of([(a, {"x": "1"}), (b, {"y": "1"})])
    text = "features: {a: {x_mm: 0, y_mm: 0}, b: {x_mm: 100, y_mm: 100}}\n"
    found = predict_lengths(model, part_of(tmp_path, text + "lengths: [{from: a, to: b}]"), FAST)
    item = each(found)[0]
    u = np.array([3e-5, 2e-5]) * 100 / np.sqrt(2)
    assert np.sqrt(item.variance) == pytest.approx(np.hypot(*u))
    assert tuple(item.u_bounds) == pytest.approx((u[0] - u[1], u[0] + u[1]))
    assert item.pair == ("a", "b")


def test_the_bounds_name_an_uncertain_constant(tmp_path: Path) -> None:
    a = estimate("a", "x", [0.0, 1e-4], D=np.diag([0, 9e-10]))
    model = replace(model_of([(a, {"x": "L"})]), constants={"L": (1.0, 0.2)})
    text = "features: {a: {x_mm: 0, y_mm: 0}, b: {x_mm: 100, y_mm: 0}}\n"
    found = predict_lengths(model, part_of(tmp_path, text + "lengths: [{from: a, to: b}]"), FAST)
    assert each(found)[0].pair == ("a", "L")
