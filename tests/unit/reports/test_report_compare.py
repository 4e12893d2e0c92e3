"""What compare reports: names and units, the summary, and a picture in which all can be read."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from compare_trials import predicted

from mtu_cli.analyses.compare import Compared, CompareResult, Pooled, compared, judged
from mtu_cli.model.measured import Label, MeasuredTables
from mtu_cli.reports.compare import document, verdict_text
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.numbers import significant
from mtu_cli.reports.part_figures import compare as figure
from mtu_cli.reports.tables import plain_text
from mtu_cli.stats.anova import Cells


def made(labels: list[Label], seed: int) -> Compared:
    """Five parts measured twice; errors of some 10 um, predicted u 5 um; no faults by decree."""
    rng = np.random.default_rng(seed)
    m, n = len(labels), len(labels) // 2
    cells = Cells(
        origin=np.zeros(m),
        n=np.full((m, 5), 2.0),
        mean=0.01 * rng.standard_normal((m, 1)) + 0.003 * rng.standard_normal((m, 5)),
        within=np.full(m, 5e-6),
    )
    u2, mean = np.full(n, 0.005**2), 0.01 * rng.standard_normal(n)
    known = predicted(mean, 0.2 * u2, 0.8 * u2, 0.64 * u2, (np.inf, np.inf))
    tables = MeasuredTables(labels=tuple(labels), parts=tuple("12345"), cells=cells)
    found, _ = judged(
        compared(tables, {name: (known, np.eye(n)) for name in ("drilled", "milled")}, 2.0), None
    )
    return decreed(found)


def decreed(
    found: Compared, *, under: tuple[int, ...] = (), biased: tuple[int, ...] = (), **more: Any
) -> Compared:
    """The same with these faults and no other."""
    rows = range(len(found.labels))
    answers = {
        "biased": tuple(i in biased for i in rows),
        "under_predicted": tuple(i in under for i in rows),
        "over_predicted": tuple(False for _ in rows),
    }
    return replace(found, **{"pooled": {}} | answers | more)


@pytest.fixture(scope="module")
def two() -> CompareResult:
    """24 features along two axes and two lengths, drilled and milled."""
    ids, ways = [str(i + 1) for i in range(24)], ("drilled", "milled")
    features = made([(o, name, axis) for o in ways for axis in "xy" for name in ids], 1)
    lengths = made([(o, name, "") for o in ways for name in ("1-2", "2-3")], 2)
    return CompareResult(
        features=decreed(features, under=(0,)), lengths=lengths, datum="none",
        coverage_factor=2.0, warnings=(),
    )  # fmt: skip


def recorded(result: CompareResult) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(document(result).record(), allow_nan=False))
    return found


def test_report_names_and_units(two: CompareResult) -> None:
    results = recorded(two)
    assert [len(results[kind]) for kind in ("features", "lengths")] == [96, 4]
    first, found = results["features"][0], two.features
    assert (first["operation"], first["id"], first["axis"]) == ("drilled", "1", "x")
    predicted, measured = first["predicted"], first["measured"]
    assert predicted["mean_um"] == pytest.approx(1000 * found.predicted.mean[0])
    assert predicted["U_um"] == pytest.approx(10)
    assert (measured["parts"], measured["n"]) == (5, 10)
    assert first["bias_um"] == pytest.approx(measured["mean_um"] - predicted["mean_um"])
    width = 2 * (abs(measured["mean_um"]) + 2 * measured["u_um"])
    assert first["range_width_um"]["measured"] == pytest.approx(width)
    assert first["verdict"] == "under-predicted"
    drilled, milled = results["summary"]["features"]
    assert drilled["verdicts"]["under-predicted"] == 1
    assert milled["verdicts"]["consistent"] == 48
    ratios = [item["ratio_u"] for item in results["features"] if item["operation"] == "milled"]
    assert milled["ratio_u"] == [min(ratios), max(ratios)]
    assert "all_at_once" not in results["summary"]["lengths"][0]
    # Undefined figures are null.
    none = np.full(96, np.nan)
    other = replace(two, features=replace(found, ratio_u=none, E_n=none), lengths=None)
    results = recorded(other)
    assert (results["features"][0]["ratio_u"], results["features"][0]["E_n"]) == (None, None)
    assert results["summary"]["features"][0]["ratio_u"] is None
    assert (results["lengths"], results["summary"]["lengths"]) == ([], None)


def test_every_fault_is_stated_with_its_size(two: CompareResult) -> None:
    """Both faults of an item, the graver one first; the pooled scatter where nothing else is."""
    found = decreed(two.features, under=(0, 1), biased=(1, 2))
    factor = sorted(found.ratio_scatter[:2])
    off = sorted(1000 * np.abs(found.bias[1:3]))
    ends = [f"{significant(a)} to {significant(b)}" for a, b in (factor, off)]
    drilled, milled = map(verdict_text, found.summaries)
    assert drilled == (
        f"drilled features: under-predicted (2 of 48: scatter {ends[0]} times predicted); "
        f"biased (2 of 48: mean off by {ends[1]} um)"
    )
    assert milled == "milled features: consistent"
    text = plain_text(document(replace(two, features=found)).shown())
    assert max(map(len, text.splitlines())) <= 100
    assert "drilled 2 x  under-predicted, " in text
    pooled = {"drilled": Pooled(items=48, ratio=1.5, p=0.003, verdict="under-predicted")}
    (alone, _) = decreed(two.features, pooled=pooled).summaries
    words = "drilled features: under-predicted (pooled scatter 1.5 times predicted, p 0.003)"
    assert verdict_text(alone) == words
    single, _ = decreed(two.features, under=(3,), pooled=pooled).summaries
    assert "pooled" not in verdict_text(single)


def test_the_picture_shows_the_differences_and_their_verdicts(two: CompareResult) -> None:
    page = figure(two)
    figure_bytes(page, "png")
    (panel,) = page.axes
    names = [label.get_text() for label in panel.get_yticklabels()]
    assert len(names) == 4 + 18
    assert page.get_suptitle().endswith("(22 of 100)")
    row = names.index("drilled 1 x")
    assert [text.get_text() for text in panel.texts][row] == "under-predicted"
    boxes = [text.get_window_extent() for text in (*panel.texts, *panel.get_yticklabels())]
    assert all(page.bbox.x0 <= box.x0 < box.x1 <= page.bbox.x1 for box in boxes)
