"""Chances and other jumps of a graph: when are mean, u and interval sure?"""

from __future__ import annotations

import math
from pathlib import Path
from statistics import NormalDist

import numpy as np
import pytest
from graph_examples import graph_of

from mtu_cli.analyses.graph import simulate, sweep
from mtu_cli.analyses.graph.simulate import SimulatedCoordinate, simulate_graph
from mtu_cli.analyses.graph.sweep import sweep_graph
from mtu_cli.analyses.graph.trials import (
    SIMULATED,
    Effort,
    chance_end_errors,
    chance_error,
    chance_intervals,
    chance_trials,
    chance_u_error,
)
from mtu_cli.model.settings import Settings
from mtu_cli.reports import graph as report
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.graph_figure import simulated, swept
from mtu_cli.reports.numbers import chance_text
from mtu_cli.stats.coverage import numerical_tolerance

LIMIT = """
uncertainty: {axis_um: 1}
places:
  x: {kind: coordinate, axis: x, nominal_mm: 0}
  far: {kind: constant}
transitions:
  - {do: meas, out: x}
  - {do: compute, in: [x], out: far, formula: 'FORMULA'}
report: [far]
"""
FEW = Effort(most=200_000, ends=True)


def beyond(chance: float) -> str:
    """A formula that is 1 with this chance."""
    return f"step(x - {1e-3 * NormalDist().inv_cdf(1 - chance)!r})"


def found(folder: Path, formula: str, settings: Settings) -> SimulatedCoordinate:
    (item,) = simulate_graph(
        graph_of(folder, LIMIT.replace("FORMULA", formula)), settings
    ).coordinates
    return item


def test_u_of_a_rare_chance_has_its_digits(tmp_path: Path) -> None:
    """p = 0.002: u = 0.0447 wants 0.0005, for which 2 se(p) takes 32 000 trials and 2 se(u) takes
    4 million. Errors of u of one standard error are 0.48 of its tolerance.
    """
    U = math.sqrt(0.002 * 0.998)
    tolerance = numerical_tolerance(U, 2)
    assert tolerance == 0.0005
    items = [found(tmp_path, beyond(0.002), Settings(seed=seed)) for seed in range(3)]
    for item in items:
        assert item.converged
        assert 2 * item.errors.u <= tolerance
        assert item.trials < SIMULATED.chances
        assert abs(item.mean - 0.002) <= 5 * item.errors.mean
        # Four standard errors.
        assert abs(item.u - U) <= 2 * tolerance
        assert item.interval == (0.0, 0.0)
    # More than one of three beyond two standard errors: once in 250.
    assert sum(abs(item.u - U) <= tolerance for item in items) >= 2


def test_a_chance_that_wants_more_than_it_may_have_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulate, "SIMULATED", FEW)
    graph = graph_of(tmp_path, LIMIT.replace("FORMULA", beyond(0.002)))
    result = simulate_graph(graph, Settings())
    (item,) = result.coordinates
    assert (item.trials, item.converged, result.converged) == (200_000, False, False)
    (told,) = result.warnings
    assert told.message.startswith(
        "200000 Monte Carlo trials: not converged to 2 significant digits"
    )
    assert told.message.partition("for ")[2].startswith("far (chance 0.002")


@pytest.mark.parametrize("formula", ["step(x - 0.0062)", "1 - step(x - 0.0062)"])
def test_a_chance_that_no_trial_met(
    formula: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """1 in 3.5 thousand million. Of u = sqrt(p (1 - p)) no digit is known: se(u) = 1/(2 sqrt n)."""
    monkeypatch.setattr(simulate, "SIMULATED", FEW)
    result = simulate_graph(graph_of(tmp_path, LIMIT.replace("FORMULA", formula)), Settings())
    (item,) = result.coordinates
    assert (item.u, item.trials, item.converged) == (0.0, 200_000, False)
    assert item.errors.mean == pytest.approx(5e-6, rel=1e-4)
    assert item.errors.u == pytest.approx(0.5 / math.sqrt(200_000), rel=1e-12)
    assert item.interval == (item.mean, item.mean)
    sheet = report.simulate(result).tables[1].sheet(2, detail=False)
    bound = "< 1.5e-5" if item.mean == 0 else "> 0.999985"
    assert sheet.rows == [("far", sheet.rows[0][1], bound, "200000")]
    assert sheet.notes[0].startswith("< and >: none or all")
    (told,) = (own for own in result.warnings if own.code == "not-converged")
    assert told.message.endswith(f"for far (chance {item.mean:.2g}, standard error 5e-06)")


@pytest.mark.parametrize("trials", [1000, 200_000, 2_500_000])
def test_the_bound_of_a_chance_holds_nineteen_times_in_twenty(trials: int) -> None:
    """At the bound, n trials hit nothing with (1 - p)^n = 0.05."""
    least, most = (
        chance_text(mean, chance_error(mean, trials), trials).split() for mean in (0.0, 1.0)
    )
    assert (1.0 - float(least[1])) ** trials == pytest.approx(0.05, rel=0.1)
    assert (least[0], most[0]) == ("<", ">")
    assert 1.0 - float(most[1]) == pytest.approx(float(least[1]), rel=1e-6)


def test_a_chance_that_some_trials_met_has_its_spread() -> None:
    assert chance_text(4e-7, 4e-7, 2_500_000) == "4.0e-7 ± 4.0e-7"
    # What does not vary is sure.
    assert chance_text(1.0, 0.0, 10) == "1 ± 0"


def test_a_jump_that_no_trial_met(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is no chance has not even a standard error: how far it jumps is not known."""
    monkeypatch.setattr(simulate, "SIMULATED", FEW)
    graph = graph_of(tmp_path, LIMIT.replace("FORMULA", "5*step(x - 0.0062)"))
    result = simulate_graph(graph, Settings())
    (item,) = result.coordinates
    assert (item.mean, item.u, item.trials) == (0.0, 0.0, 200_000)
    assert (item.converged, item.fixed, item.chance) == (False, False, False)
    errors = item.errors
    assert all(math.isnan(own) for own in (errors.mean, errors.u, errors.low, errors.high))
    (told,) = (own for own in result.warnings if own.code == "not-converged")
    assert told.message.endswith("for far (no trial made it jump, and none rules out that it may)")
    made = report.simulate(result)
    document = made.record()["places"]["far"]["value"]
    assert set(document["monte_carlo"].values()) == {None}
    header, rows = made.rows()
    assert dict(zip(header, next(iter(rows)), strict=True))["se_u"] is None
    assert made.tables[0].sheet(2, detail=False).rows[0][:4] == ("far", "0", "0", "0")
    assert figure_bytes(simulated(result), "png").startswith(b"\x89PNG")


def test_a_sweep_of_a_jump_that_no_trial_met(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweep, "SWEPT", Effort(most=50_000, ends=False))
    graph = graph_of(tmp_path, LIMIT.replace("FORMULA", "5*step(x - 0.0062)"))
    result = sweep_graph(graph, Settings(), "far", {"axis_um": [0.5, 1.0]})
    assert not any(item.converged for item in result.grid)
    assert math.isnan(result.largest_error)
    (told,) = (own for own in result.warnings if own.code == "not-converged")
    assert told.message.endswith("rules out that it may; at 2 of 2 points of the grid")
    assert figure_bytes(swept(result), "png").startswith(b"\x89PNG")


def test_a_jump_that_few_trials_met_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """5 once in 33 000. An adaptive count that begins anew may see none, and end at once."""
    monkeypatch.setattr(simulate, "SIMULATED", FEW)
    formula = f"5*{beyond(3e-5)}"
    for seed in range(6):
        item = found(tmp_path, formula, Settings(seed=seed))
        assert not item.converged
        # An adaptive count ends with a whole block.
        assert 190_000 < item.trials <= 200_000
        # Six hits; none of six with a probability of 0.0025.
        assert 0 < item.mean <= 5 * (6 + 5 * math.sqrt(6)) / 200_000
        assert item.u > 0
        assert item.errors.u > 0


def test_an_end_of_the_interval_beside_its_limit(tmp_path: Path) -> None:
    """High is 1 where p > 0.025. p = 0.0255 is two standard errors from it after 390 000 trials."""
    near = found(tmp_path, beyond(0.0255), Settings(trials=20_000, digits=1))
    assert not near.converged
    assert near.errors.low == 0.0
    assert math.isnan(near.errors.high)
    far = found(tmp_path, beyond(0.0255), Settings(trials=2_000_000, digits=1))
    assert far.converged
    assert (far.interval, far.errors.low, far.errors.high) == ((0.0, 1.0), 0.0, 0.0)
    assert far.shortest == (0.0, 0.0)


@pytest.mark.parametrize(
    ("chance", "ends", "wanted"),
    [
        (0.5, False, 0.25 * (2 / 0.005) ** 2),
        (0.002, False, (0.996 / 0.0005) ** 2),
        (0.998, True, (0.996 / 0.0005) ** 2),
        (0.03, True, (0.94 / 0.005) ** 2),
        (0.026, True, 4 * 0.026 * 0.974 / 0.001**2),
        (0.974, True, 4 * 0.026 * 0.974 / 0.001**2),
        (0.026, False, (0.948 / 0.005) ** 2),
    ],
)
def test_trials_that_a_chance_wants(chance: float, ends: bool, wanted: float) -> None:
    """Of p, of u or of an end of the interval, whichever takes the most."""
    assert chance_trials(chance, 2, ends=ends) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("chance", [0.002, 0.1, 0.5, 0.9])
def test_standard_errors_against_binomial_counts(chance: float) -> None:
    """Of 20 000 counts of n = 50 000: root mean square errors of p and of u."""
    n, m = 50_000, 20_000
    p = np.random.default_rng(5).binomial(n, chance, m) / n
    errors = np.sqrt(p * (1 - p)) - math.sqrt(chance * (1 - chance))
    # Five standard errors of a root mean square: of normal errors, or, of u at p = 1/2, of a chi
    # square of one degree of freedom, whose square has the mean 3 and the variance 96.
    five = 5 / math.sqrt(2 * m)
    five_u = 5 * math.sqrt(96) / 6 / math.sqrt(m) if chance == 0.5 else five
    assert np.sqrt(np.mean((p - chance) ** 2)) == pytest.approx(chance_error(chance, n), rel=five)
    # The curvature of u is left out: of p = 0.002, se(p)/(4 p) = 0.025 of its error.
    error = chance_u_error(chance, n)
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(error, rel=five_u + 0.025**2)


@pytest.mark.parametrize("ones", [0, 24, 25, 26, 49, 50, 51, 500, 949, 950, 974, 975, 976, 1000])
def test_intervals_of_a_chance_against_its_sorted_trials(ones: int) -> None:
    """Of 1000 zeros and ones; the shortest is that of all that hold 950."""
    values = np.repeat([0.0, 1.0], [1000 - ones, ones])
    symmetric, shortest = chance_intervals(ones / 1000)
    F = np.array([np.mean(values <= v) for v in values])
    assert symmetric == (values[F >= 0.025 - 1e-12][0], values[F >= 0.975 - 1e-12][0])
    held = [(b - a, a, b) for a in (0.0, 1.0) for b in (a, 1.0)
            if np.sum((values >= a) & (values <= b)) >= 950]  # fmt: skip
    assert shortest == min(held)[1:]


def test_ends_are_one_value_or_the_other() -> None:
    assert chance_end_errors(0.5, 1000) == (0.0, 0.0)
    low, high = chance_end_errors(0.976, 1000)
    assert math.isnan(low)
    assert high == 0.0
    assert chance_end_errors(0.0, 100) == (0.0, 0.0)
