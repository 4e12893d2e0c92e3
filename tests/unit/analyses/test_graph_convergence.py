"""Every output of a graph ends by itself; chances; what the standard errors are worth."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from graph_examples import graph_of

from mtu_cli.analyses.graph import simulate
from mtu_cli.analyses.graph.simulate import simulate_graph
from mtu_cli.analyses.graph.sweep import sweep_graph
from mtu_cli.analyses.graph.trials import LOOK, Effort, chance_error, chance_trials
from mtu_cli.model.settings import Settings
from mtu_cli.reports import graph as report
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.graph_figure import simulated, swept
from mtu_cli.stats.coverage import numerical_tolerance

HOLE = """
uncertainty: {axis_um: 1}
places:
  x: {kind: coordinate, axis: x, nominal_mm: 5}
  y: {kind: coordinate, axis: y, nominal_mm: 7}
  s: {kind: constant}
  e: {kind: constant, unit: mm}
  ok: {kind: constant}
transitions:
  - {do: meas, out: x}
  - {do: meas, out: y}
  - {do: compute, in: [x, y], out: s, formula: x + y}
  - {do: compute, in: [x, y], out: e, formula: sqrt((x - 5)**2 + (y - 7)**2)}
  - {do: compute, in: [e], out: ok, formula: step(0.002 - e)}
report: [s, e, ok]
"""
"""A sum, its own control; a Rayleigh variable without first order; and P(e <= 2 um) of it."""
U = 1e-3 * math.sqrt(2 - math.pi / 2)
CHANCE = 1 - math.exp(-2)


def test_each_output_ends_by_itself(tmp_path: Path) -> None:
    result = simulate_graph(graph_of(tmp_path, HOLE), Settings())
    s, e, ok = result.coordinates
    assert result.converged
    assert (s.converged, e.converged, ok.converged) == (True, True, True)
    assert s.trials <= LOOK
    # 2 se of the mean of a Rayleigh variable: u = 6.6e-4 wants 5e-6 (JCGM 101, 7.9.2).
    assert e.trials >= (2 * U / 5e-6) ** 2
    assert result.trials == e.trials > ok.trials
    assert e.u == pytest.approx(U, abs=5 * e.se_u)
    assert ok.mean == pytest.approx(CHANCE, abs=5 * ok.errors.mean)
    assert result.warnings[0].facts["names"] == ["e"]


def test_a_hard_output_is_the_only_one_that_is_not_converged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """50 000 trials are too few for e: it takes 68 000 for the mean alone."""
    monkeypatch.setattr(simulate, "SIMULATED", Effort(most=50_000, ends=True))
    result = simulate_graph(graph_of(tmp_path, HOLE), Settings())
    s, e, ok = result.coordinates
    assert (s.converged, e.converged, ok.converged) == (True, False, True)
    assert e.trials <= 50_000
    (told,) = (item for item in result.warnings if item.code == "not-converged")
    start = f"{e.trials} Monte Carlo trials: not converged to 2 significant digits of u"
    assert told.message.startswith(start)
    assert told.message.partition("for ")[2].startswith("e (standard error of u 0.")


def test_the_digits_are_those_asked_for(tmp_path: Path) -> None:
    """In 10 runs u is within its tolerance, two standard errors: in 9.5 of them on average, and in
    fewer than 7 with a probability of 1e-3.
    """
    graph = graph_of(tmp_path, HOLE)
    tolerance = numerical_tolerance(U, 2)
    close = 0
    for seed in range(10):
        (item,) = simulate_graph(graph, Settings(seed=seed), ["e"]).coordinates
        assert item.converged
        close += abs(item.u - U) <= tolerance
    assert close >= 7


def test_a_chance_beside_its_limit_is_the_share_of_the_trials(tmp_path: Path) -> None:
    """Differences over one u see the step; the mean is a share all the same, no control."""
    text = """
places:
  x: {kind: constant, value: 1, u: 0.5}
  ok: {kind: constant}
transitions:
  - {do: compute, in: [x], out: ok, formula: step(1.2 - x)}
"""
    result = simulate_graph(graph_of(tmp_path, text), Settings(trials=30_000))
    (ok,) = result.coordinates
    assert ok.first_order_u > 0
    assert ok.validation is None
    hits = ok.mean * 30_000
    assert hits == pytest.approx(round(hits), abs=1e-6)
    assert ok.u == pytest.approx(math.sqrt(ok.mean * (1 - ok.mean)), rel=1e-4)
    chance = 0.5 * math.erfc(-0.4 / math.sqrt(2))
    assert ok.mean == pytest.approx(chance, abs=5 * ok.errors.mean)
    assert result.warnings[0].code == "not-converged"


def test_a_chance_that_never_fails_has_a_standard_error() -> None:
    assert chance_error(1.0, 998) == chance_error(0.0, 998) == 1e-3
    assert chance_error(0.5, 100) == 0.05
    # No digit of a u of 0 is known, whatever the count.
    assert chance_trials(1.0, 2, ends=True) == chance_trials(0.0, 2, ends=False) == math.inf
    # u = 0.4 has a tolerance of 0.005.
    assert chance_trials(0.2, 2, ends=True) == pytest.approx((2 * 0.4 / 0.005) ** 2, rel=1e-12)


def test_report_of_a_chance(tmp_path: Path) -> None:
    result = simulate_graph(graph_of(tmp_path, HOLE), Settings(trials=20_000))
    made = report.simulate(result)
    places, chances = (each.sheet(2, detail=False) for each in made.tables)
    assert [row[0] for row in places.rows] == ["s", "e"]
    ((name, nominal, shown, trials),) = chances.rows
    assert (name, nominal, trials) == ("ok", "1", "20000")
    chance, error = map(float, shown.split(" ± "))
    # sqrt(p (1 - p)/20000) = 0.00242, to two digits.
    assert error == pytest.approx(0.0024, abs=1e-9)
    assert chance == pytest.approx(CHANCE, abs=5 * error)
    found = made.record()["places"]
    assert found["e"]["value"]["chance"] is None
    assert found["ok"]["value"]["chance"]["probability"] == pytest.approx(chance, abs=5e-5)
    assert found["ok"]["value"]["monte_carlo"]["se_mean"] == pytest.approx(error, abs=5e-5)
    assert figure_bytes(simulated(result), "png").startswith(b"\x89PNG")
    alone = report.simulate(simulate_graph(result.graph, Settings(trials=1000), ["ok"]))
    verdict, sheet = alone.shown()
    assert str(verdict).startswith("The chance that ok is 1 is 0.8")
    assert getattr(sheet, "title", "") == "Chances"


def test_a_chance_is_swept(tmp_path: Path) -> None:
    """P(e <= 2) = 1 - exp(-2/u1^2) with u1 in um; no formula for u is fitted to it."""
    graph = graph_of(tmp_path, HOLE)
    told: list[tuple[int, int | None]] = []
    settings = replace(Settings(), progress=lambda done, total: told.append((done, total)))
    grid = {"axis_um": [0.4, 1.0, 2.0], "probe_um": [0.0]}
    result = sweep_graph(graph, settings, "ok", grid)
    assert result.chance
    # P(e > 2 um) = exp(-12.5), 1 in 270 000, of axis_um 0.4 is beyond so many trials.
    assert [item.converged for item in result.grid] == [False, True, True]
    assert not result.converged
    assert result.formula is None
    for item in result.grid:
        chance = 1 - math.exp(-2 / item.at["axis_um"] ** 2)
        assert item.mean == pytest.approx(chance, abs=5 * item.se_mean)
        assert item.se_mean > 0
    (warned,) = result.warnings
    assert warned.message.startswith(
        f"{result.grid[0].trials} Monte Carlo trials: not converged to 2"
    )
    assert warned.message.endswith("; at 1 of 3 points of the grid")
    assert f"a chance is up to {result.grid[0].se_mean:.2g};" in warned.message
    made = report.sweep(simulate_graph(graph, Settings(trials=100), ["ok"]), result)
    sheet = made.tables[0].sheet(2, detail=False)
    assert sheet.title == "chance of ok"
    assert [row[2].split(" ± ")[0][:4] for row in sheet.rows][1] == "0.86"
    header, rows = made.rows()
    first = dict(zip(header, next(iter(rows)), strict=True))
    assert (first["mean"], first["se_mean"]) == (result.grid[0].mean, result.grid[0].se_mean)
    assert figure_bytes(swept(result), "png").startswith(b"\x89PNG")
    assert {done for done, _ in told} == {0, 1, 2}
    assert {total for _, total in told} == {3}


def test_a_chance_that_hardly_ever_fails_depends_on_probing(tmp_path: Path) -> None:
    """No trial of a few hundred fails: that is not the same as not to depend on it."""
    graph = graph_of(tmp_path, HOLE.replace("0.002 - e", "0.006 - e"))
    both = {"axis_um": [1.0, 1.5], "perpendicular_um": [0.0, 0.1]}
    result = sweep_graph(graph, Settings(trials=5000), "ok", both)
    assert result.without == ()
    text = HOLE.replace("out: x}", "out: x, uncertainty: {probe_um: 0}}")
    alone = sweep_graph(
        graph_of(tmp_path, text.replace("out: y}", "out: y, uncertainty: {probe_um: 0}}")),
        Settings(trials=5000), "ok", {"axis_um": [1.0, 1.5], "probe_um": [1.0, 2.0]},
    )  # fmt: skip
    assert alone.without == ("probe_um",)
    (told,) = (item for item in alone.warnings if item.code == "unrelated")
    assert told.message == "ok does not depend on probe_um"


def test_the_mean_of_what_is_swept_is_in_the_table(tmp_path: Path) -> None:
    """A Rayleigh variable: the mean is sqrt(pi/2) u1, 1.25 and 2.51 um above its nominal 0."""
    graph = graph_of(tmp_path, HOLE)
    result = sweep_graph(graph, Settings(), "e", {"axis_um": [1.0, 2.0]})
    assert result.converged
    made = report.sweep(simulate_graph(graph, Settings(trials=100), ["e"]), result)
    sheet = made.tables[0].sheet(2, detail=False)
    assert sheet.columns[1].title == "mean less nominal\num"
    for row, u1 in zip(sheet.rows, (1, 2), strict=True):
        # To the last place of u, 0.66 and 1.3 um.
        assert float(row[1]) == pytest.approx(math.sqrt(math.pi / 2) * u1, abs=0.051)
    for item in result.grid:
        mean = math.sqrt(math.pi / 2) * 1e-3 * item.at["axis_um"]
        assert item.mean == pytest.approx(mean, abs=5 * item.se_mean)


def test_coordinates_of_points_in_a_formula(tmp_path: Path) -> None:
    """The difference of two probed points along x, with u1 of both: u = sqrt 2 um."""
    text = """
uncertainty: {axis_um: 1}
places:
  P: {kind: point, nominal_mm: [1, 2, 3]}
  Q: {kind: point, nominal_mm: [4, 6, 8]}
  v: {kind: vector}
  n: {kind: vector}
  dx: {kind: constant}
  dy: {kind: constant}
  share: {kind: constant}
transitions:
  - {do: meas, out: P, along: x}
  - {do: meas, out: Q, along: x}
  - {do: vector, in: [P, Q], out: v}
  - {do: unit_v, in: [v], out: n}
  - {do: compute, in: [P, Q], out: dx, formula: Q.x - P.x}
  - {do: compute, in: [v], out: dy, formula: v.j}
  - {do: compute, in: [n, v], out: share, formula: n.k + v.k/mm}
report: [dx, dy, share]
"""
    text = text.replace("[n, v]", "[n, v, mm]").replace(
        "  dx:", "  mm: {kind: constant, value: 1, unit: mm}\n  dx:"
    )
    graph = graph_of(tmp_path, text)
    dx, dy, share = simulate_graph(graph, Settings(trials=20_000)).coordinates
    assert (dx.nominal, dy.nominal) == (3, 4)
    assert share.nominal == pytest.approx(5 / math.sqrt(50) + 5)
    assert [item.output.unit for item in (dx, dy, share)] == ["mm", "mm", "1"]
    # Sums are their own control variates.
    assert dx.u == pytest.approx(math.sqrt(2) * 1e-3, rel=1e-9)
    assert dy.u == pytest.approx(math.sqrt(2) * 1e-3, rel=1e-9)
