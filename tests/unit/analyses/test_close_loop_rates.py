"""A small part of the bench of close-loop: few enough data sets to be drawn on every run."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from loop_bench import cells
from loop_bench.cells import CELLS, Cell, Measure, Record, record
from loop_bench.days import FOLDS, THIRDS, BenchDay
from loop_bench.figures import binomial, class_holds, exact_pair, flagged, right_first
from loop_bench.judge import diagnosed, held_out_after
from loop_bench.laser_runs import clean_run
from loop_bench.pieces import DAYS, indices
from scipy import stats
from shop_day import Noise, blocks, effect, interleaved, measure, oracle_held_out
from shop_day.day import Kind

DAY, SEED = 500, 5
"""Neither of the days that the engine was tuned on nor of those that it is judged on."""
NULLS = 75


@cache
def bench(kind: Kind) -> BenchDay:
    return BenchDay(kind, DAY)


def records(kind: Kind, cell: Cell, count: int) -> list[Record]:
    return [record(bench(kind), cell, SEED, index) for index in range(count)]


def cell(measure: Measure, *families: str) -> Cell:
    return Cell(measure=measure, count=len(families), amplitude=1.0, families=families)


def test_false_alarms_are_as_rare_as_stated() -> None:
    # Of 300 data sets at a rate from 3 to 7 %: 1 to 37 alarms, but in one case of a thousand.
    drawn: list[tuple[Kind, Noise]] = [
        ("A", "normal"), ("B", "hole-errors"), ("A", "noisy-axis"), ("B", "normal"),
    ]  # fmt: skip
    alarms = sum(
        found["alarm"]
        for kind, noise in drawn
        for found in records(kind, Cell(measure="null", count=NULLS, noise=noise), NULLS)
    )
    total = NULLS * len(drawn)
    least, most = stats.binom.ppf(5e-4, total, 0.03), stats.binom.ppf(1 - 5e-4, total, 0.07)
    assert least <= alarms <= most


def test_clean_laser_runs_raise_as_few_alarms() -> None:
    count = 40
    drawn = [clean_run("A", np.random.default_rng([SEED, i])) for i in range(count)]
    assert sum(found["alarm"] for found in drawn) <= stats.binom.ppf(1 - 5e-4, count, 0.07)


TOLD = ("backlash", "scale", "squareness", "abbe", "radial", "thermal-growth", "feature-outlier",
        "cyclic", "operation-scatter", "rotation-scatter")  # fmt: skip


def test_a_planned_day_names_what_is_as_large_as_the_scatter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Scores of held-out parts take four fifths of a record's time, and are not looked at here.
    monkeypatch.setattr(cells, "held_out_after", lambda *_: np.nan)
    found = records("B", cell("library", *TOLD), 2 * len(TOLD))
    wrong = [(item["truths"], item["names"]) for item in found if not right_first(item)]
    assert not wrong
    assert all(class_holds(item) and not flagged(item) for item in found)


def test_bending_by_heat_is_flagged_and_gets_no_lone_name() -> None:
    found = records("A", cell("outside", "thermal-bending"), 10)
    assert all(flagged(item) and not item["lone"] for item in found)


def test_two_effects_are_told_apart() -> None:
    told = ("backlash", "squareness", "abbe", "feature-outlier")
    found = records("B", cell("pairs", *told), 10)
    assert sum(exact_pair(item) for item in found) >= 9


def test_held_out_scores_are_counted_as_the_oracle_counts() -> None:
    day = bench("B")
    rng = np.random.default_rng(SEED)
    truth = effect(day.day, "backlash-x", rng, 2.0)
    errors = measure(day.day, rng, [truth])
    splits = list(blocks(day.day.P, FOLDS))
    oracle = oracle_held_out(errors, [truth], splits)
    # One column and nothing else is found in every fold: the oracle knows as much, but the
    # noise's variances too.
    assert held_out_after(day, errors, day.folds) == pytest.approx(oracle.after, rel=2e-3)
    quiet = measure(day.day, rng)
    assert not diagnosed(day, quiet).names
    nothing = oracle_held_out(quiet, [], interleaved(day.day.P, THIRDS))
    # Where nothing passes the gate next to nothing is foretold: less than a hundredth of the
    # mean square, which has 2 x 504 entries and a standard error of four hundredths.
    assert held_out_after(day, quiet, day.interleaved) == pytest.approx(nothing.after, rel=1e-2)


@pytest.mark.parametrize(("hits", "count"), [(0, 10), (3, 50), (250, 5000), (7, 7)])
def test_binomial_intervals_are_those_of_clopper_and_pearson(hits: int, count: int) -> None:
    expected = stats.binomtest(hits, count).proportion_ci(0.95, "exact")
    assert binomial(hits, count) == pytest.approx((expected.low, expected.high), rel=1e-9)


def test_the_bench_counts_as_its_bar_asks() -> None:
    counts = {item.name: item.count for item in CELLS}
    nulls = [count for name, count in counts.items() if name.startswith("null-")]
    assert nulls == [5000] * 6
    for item in CELLS:
        days = [set(indices(item, item.count, day)) for day in range(DAYS)]
        assert sum(map(len, days)) == item.count
        assert set().union(*days) == set(range(item.count))
    assert min(count for name, count in counts.items() if name != "command-1") == 500
