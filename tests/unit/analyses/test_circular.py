"""Circular tests: every cause is returned, with and without correlated noise, and told apart."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from circle_examples import Causes, made

from mtu_cli.analyses.circular import CircularResult, diagnose
from mtu_cli.files.readings import Traces
from mtu_cli.reports.circular import document, figure
from mtu_cli.stats.least_squares import FloatArray

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
        traces = made(causes, ways="ccw", s=0.0003, phi=0.8, seed=seed)
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
    found = diagnose(with_waves(4000), PITCHES)
    assert values(found) == pytest.approx(expected, abs=0.1)
    assert sum(x.share for x in found.causes if x.share == x.share) == pytest.approx(1.0)
    assert found.remainder_rms < 1e-4
    results = (diagnose(with_waves(2000, s=5e-4, seed=seed), PITCHES) for seed in range(12))
    z = misses(results, expected)
    assert (z <= 3).mean() >= 0.98
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.3
