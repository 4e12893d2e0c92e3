"""What anova reports: names and units of the contract, nulls, tables, pictures."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from matplotlib.text import Text
from measured_examples import part_file, points, study, with_measured

from mtu_cli.analyses.anova import AnovaResult, Method, analyse_variance
from mtu_cli.files.points import Points
from mtu_cli.model.settings import Settings
from mtu_cli.reports.anova import document
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.part_figures import anova as figure
from mtu_cli.reports.tables import plain_text

CONTRACT = (
    "operation", "feature", "axis", "parts", "n", "mean_error_um", "ms_between_um2",
    "ms_within_um2", "df_between", "df_within", "F", "F_critical_95", "p", "var_part_um2",
    "var_repeat_um2", "var_part_interval95_um2", "method", "s_pooled_um", "u_mean_um",
    "u_future_um", "U_future_um", "unusual_parts",
)  # fmt: skip
ARCSEC = math.pi / 180 / 3600


@pytest.fixture(scope="module")
def planted(tmp_path_factory: pytest.TempPathFactory) -> AnovaResult:
    """21 parts, the seventh 60 um off in y."""
    found = study(21, 2, 4)
    measured = found.measured.copy()
    measured[found.part == 6, 1] += 0.06
    part = part_file(tmp_path_factory.mktemp("part"))
    return analyse_variance(with_measured(found, measured), part, "reml", Settings())


def recorded(result: AnovaResult) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(document(result).record(), allow_nan=False))
    return found


def shown(result: AnovaResult, *, detail: bool = False) -> str:
    return plain_text(document(result).shown(detail=detail))


def analysed(found: Points, method: Method = "reml", k: float = 2.0) -> AnovaResult:
    return analyse_variance(found, None, method, Settings(coverage_factor=k))


def test_names_and_units(planted: AnovaResult) -> None:
    results = recorded(planted)
    assert [len(results[k]) for k in ("features", "lengths", "orthogonality")] == [6, 2, 1]
    for entry in results["features"]:
        assert set(CONTRACT) <= set(entry)
    first, one = results["features"][0], planted.features
    assert first["mean_error_um"] == pytest.approx(one.one_way.mean[0] * 1e3)
    assert first["var_part_um2"] == pytest.approx(one.components.part[0] * 1e6)
    assert first["U_future_um"] == pytest.approx(2 * first["u_future_um"])
    assert first["s_pooled_um"] == pytest.approx(math.sqrt(first["ms_within_um2"]))
    low, high = first["interval95_future_um"]
    assert (low + high) / 2 == pytest.approx(first["mean_error_um"])
    assert (high - low) / 2 > first["U_future_um"]
    angles = planted.kinds[2]
    angle = results["orthogonality"][0]
    assert angle["id"] == "xy"
    assert angle["mean_error_arcsec"] == pytest.approx(angles.one_way.mean[0] / ARCSEC)
    assert angle["var_part_arcsec2"] == pytest.approx(angles.components.part[0] / ARCSEC**2)
    assert not any("_um" in name for name in angle)
    (item,) = results["unusual_parts"]
    assert (item["part"], item["where"]["axis"]) == ("P6", "y")
    assert item["deviation_um"] == pytest.approx(60, rel=0.25)
    assert [len(item) for item in (results["trends"], results["capability"])] == [9, 0]
    slopes = {"slope_um", "slope_arcsec"}
    units = [next(name for name in slopes if item[name] is not None) for item in results["trends"]]
    assert units == ["slope_um"] * 8 + ["slope_arcsec"]


def test_undefined_figures_are_null_and_have_no_column() -> None:
    result = analysed(study(1, 1, 1))
    entry = recorded(result)["features"][0]
    assert recorded(result)["unusual_parts"] is None
    undefined = {
        "F", "p", "ms_between_um2", "ms_within_um2", "var_part_um2", "u_mean_um", "u_future_um",
        "var_part_interval95_um2", "s_pooled_um", "var_both_um2", "interval95_future_um",
        "dof_future",
    }  # fmt: skip
    assert {entry[name] for name in undefined} == {None}
    assert np.isfinite(entry["mean_error_um"])
    text = shown(result, detail=True).partition("Features\n")[2]
    assert text.splitlines()[0].split() == ["feature", "axis", "n", "mean", "df", "df"]
    assert shown(result).startswith("Too few parts or repeats")


def test_limits_below_zero_are_marked_as_no_bound() -> None:
    """Repeats to and fro about means that are alike: [0, 0] is no statement on the parts; nothing
    that scatters at all is another matter.
    """
    for scatter, marked in ((1.0, [True, False]), (0.0, [False, False])):
        rows = [
            (f"P{p}", "a", r, scatter * 0.001 * (-1) ** r, scatter * (0.001 * p + 0.0001 * r))
            for p in range(6)
            for r in (1, 2)
        ]
        header, listed = document(analysed(points(rows))).rows()
        column = list(header).index("var_part_limits_below_zero")
        assert [row[column] for row in listed] == marked


def test_tables_and_verdict(planted: AnovaResult) -> None:
    text = shown(planted)
    assert max(map(len, text.splitlines())) <= 100
    assert "F test: parts differ significantly in 6 of 6 features and axes." in text
    assert "Outlying parts: P6." in text
    titles = ("by operation and axis", "Outlying parts\n", "Lengths", "Right angles", "Features\n")
    assert sorted(titles, key=text.index) == list(titles)
    clean = shown(analysed(study(21, 2, 4)), detail=True)
    assert "No part is an outlier.\n" in clean
    assert "MS between" in clean
    assert "MS between" not in text


@pytest.mark.parametrize(("operations", "parts"), [(1, 1), (1, 60), (6, 6)])
def test_nothing_is_written_over_or_outside(operations: int, parts: int) -> None:
    rng = np.random.default_rng(2)
    cases = [
        (f"operation {operation}", (f"part {p}", name, r))
        for operation in range(operations)
        for p in range(parts)
        for name in "abc"
        for r in range(2)
    ]
    rows = [(*case, *(0.01 * rng.standard_normal(2))) for _, case in cases]
    page = figure(analysed(points(rows, [name for name, _ in cases])))
    assert figure_bytes(page, "png").startswith(b"\x89PNG")
    titles = {panel.get_title(loc="left") for panel in page.axes}
    written = [
        item
        for panel in page.axes
        for item in panel.get_children()
        if isinstance(item, Text) and item.get_text() in titles
    ]
    assert len(written) == len(page.axes)
    boxes = [item.get_window_extent() for item in [*written, *page.legends]]
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[i + 1 :])
        assert page.bbox.x0 <= box.x0
        assert box.x1 <= page.bbox.x1
        assert box.y1 <= page.bbox.y1
