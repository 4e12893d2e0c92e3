"""What compare reports: names and units, the summary, and a picture in which all can be read."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from compare_trials import predicted

from mtu_cli.analyses.compare import Compared, CompareResult
from mtu_cli.analyses.compare.evidence import Pooled, judged, summarised
from mtu_cli.analyses.compare.evidence import compared as evidence
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.reports.compare import document, verdict_text
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.numbers import significant
from mtu_cli.reports.part_figures import compare as figure
from mtu_cli.reports.tables import plain_text
from mtu_cli.stats.anova import Cells

Labels = list[tuple[str, str, str]]
K = 2.0


def compared(labels: Labels, seed: int) -> Compared:
    """Five parts measured twice; errors of some 10 um, predicted u 5 um; verdicts by decree."""
    rng = np.random.default_rng(seed)
    m = len(labels)
    cells = Cells(
        origin=np.zeros(m),
        n=np.full((m, 5), 2.0),
        mean=0.01 * rng.standard_normal((m, 1)) + 0.003 * rng.standard_normal((m, 5)),
        within=np.full(m, 5e-6),
    )
    # A feature is predicted once, whatever the operation.
    one = {label[1:]: 0.01 * rng.standard_normal() for label in labels}
    u2 = np.full(m, 0.005**2)
    means = np.array([one[label[1:]] for label in labels])
    known = predicted(means, 0.2 * u2, 0.8 * u2, 0.64 * u2, (np.inf, np.inf))
    tables = MeasuredTables(labels=tuple(labels), parts=tuple("12345"), cells=cells)
    found, _ = judged(evidence(tables, known, np.eye(m), K), None)
    return decreed(found, under=(0,))


def decreed(
    found: Compared, *, under: tuple[int, ...] = (), biased: tuple[int, ...] = ()
) -> Compared:
    """The same with these faults and no other."""
    rows = range(len(found.labels))
    no = tuple(False for _ in rows)
    return replace(
        found,
        biased=tuple(i in biased for i in rows),
        under_predicted=tuple(i in under for i in rows),
        over_predicted=no,
        pooled=(),
    )


def with_features(result: CompareResult, features: Compared) -> CompareResult:
    """The result with other features, summed up again."""
    return replace(result, features=features, feature_summaries=summarised(features))


def result_of(
    features: int,
    operations: tuple[str, ...] = ("",),
    axes: str = "xy",
    lengths: bool = True,
) -> CompareResult:
    ids = tuple(str(i + 1) for i in range(features))
    labels = [(o, name, axis) for o in operations for axis in axes for name in ids]
    pairs = [(o, name, "") for o in operations for name in ("1-2", "2-3")]
    found, others = compared(labels, 1), compared(pairs, 2)
    return CompareResult(
        features=found,
        lengths=others if lengths else None,
        feature_summaries=summarised(found),
        length_summaries=summarised(others, "lengths") if lengths else (),
        datum="none",
        coverage_factor=K,
        warnings=(),
    )


@pytest.fixture(scope="module")
def two() -> CompareResult:
    return result_of(24, ("drilled", "milled"))


def recorded(result: CompareResult) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(document(result).record(), allow_nan=False))
    return found


def shown(result: CompareResult) -> str:
    return plain_text(document(result).shown())


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
    assert first["ratio_u"] == pytest.approx(measured["u_um"] / predicted["u_um"])
    width = 2 * (abs(measured["mean_um"]) + 2 * measured["u_um"])
    assert first["range_width_um"]["measured"] == pytest.approx(width)
    assert first["verdict"] == "under-predicted"
    assert results["lengths"][0]["axis"] is None
    drilled, milled = results["summary"]["features"]
    assert drilled["verdicts"]["under-predicted"] == 1
    assert milled["verdicts"] == {
        "consistent": 48, "biased": 0, "under-predicted": 0, "over-predicted": 0,
    }  # fmt: skip
    ratios = [item["ratio_u"] for item in results["features"] if item["operation"] == "milled"]
    assert milled["ratio_u"] == [min(ratios), max(ratios)]
    assert "all_at_once" not in results["summary"]["lengths"][0]


def test_undefined_figures_are_null(two: CompareResult) -> None:
    none = np.full(len(two.features.labels), np.nan)
    found = replace(two.features, ratio_u=none, E_n=none)
    results = recorded(with_features(two, found))
    entry = results["features"][0]
    assert (entry["ratio_u"], entry["E_n"]) == (None, None)
    assert entry["ratio_range"] is not None
    assert results["summary"]["features"][0]["ratio_u"] is None
    alone = recorded(replace(two, lengths=None, length_summaries=()))
    assert (alone["lengths"], alone["summary"]["lengths"]) == ([], None)


def test_a_sentence_an_operation_and_kind_and_a_line_an_item(two: CompareResult) -> None:
    """Both faults of an item are stated, the graver one first, with their sizes."""
    found = decreed(two.features, under=(0, 1), biased=(1, 2))
    result = with_features(two, found)
    factor = sorted(found.ratio_scatter[:2])
    off = sorted(1000 * np.abs(found.bias[1:3]))
    ends = [f"{significant(a)} to {significant(b)}" for a, b in (factor, off)]
    drilled, milled = recorded(result)["summary"]["features"]
    assert drilled["verdict_text"] == (
        f"drilled features: under-predicted (2 of 48: scatter {ends[0]} times predicted); "
        f"biased (2 of 48: mean off by {ends[1]} um)"
    )
    assert milled["verdict_text"] == "milled features: consistent"
    assert drilled["verdicts"]["biased"] == 1
    text = shown(result)
    assert " ".join(text.split()).startswith(f"{drilled['verdict_text']}. ")
    assert max(map(len, text.splitlines())) <= 100
    (line,) = [line for line in text.splitlines() if line.startswith("drilled 2 x")]
    assert line.startswith("drilled 2 x  under-predicted, ")


def test_what_only_the_pooled_scatter_shows_is_stated(two: CompareResult) -> None:
    none = decreed(two.features)
    pooled = Pooled(operation="drilled", items=48, ratio=1.5, p=0.003, verdict="under-predicted")
    (drilled, _) = summarised(replace(none, pooled=(pooled,)))
    text = "drilled features: under-predicted (pooled scatter 1.5 times predicted, p 0.003)"
    assert verdict_text(drilled) == text
    single, _ = summarised(replace(decreed(two.features, under=(3,)), pooled=(pooled,)))
    assert "pooled" not in verdict_text(single)
    entry = recorded(with_features(two, replace(none, pooled=(pooled,))))["summary"]["features"]
    assert entry[0]["all_at_once"] == {
        "items": 48, "ratio_scatter": 1.5, "p_scatter_familywise": 0.003,
        "verdict": "under-predicted",
    }  # fmt: skip
    assert entry[1]["all_at_once"] is None


def test_the_picture_shows_the_differences_and_their_verdicts(two: CompareResult) -> None:
    page = figure(two)
    figure_bytes(page, "png")
    (panel,) = page.axes
    names = [label.get_text() for label in panel.get_yticklabels()]
    assert len(names) == 4 + 18
    assert page.get_suptitle().endswith("(22 of 100)")
    row = names.index("drilled 1 x")
    assert [text.get_text() for text in panel.texts][row] == "under-predicted"
    containers: list[Any] = list(panel.containers)
    (lines,) = [item.lines for item in containers if item.get_label() == "measured"]
    bias = 1000 * (two.features.measured.mean[0] - two.features.predicted.mean[0])
    assert np.asarray(lines[0].get_xdata())[row] == pytest.approx(bias)
    boxes = [text.get_window_extent() for text in (*panel.texts, *panel.get_yticklabels())]
    assert all(page.bbox.x0 <= box.x0 < box.x1 <= page.bbox.x1 for box in boxes)
