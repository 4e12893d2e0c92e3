"""What anova reports: names and units of the contract, nulls, tables, pictures."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from measured_examples import part_file, study, with_measured

from mtu_cli.analyses.anova import AnovaResult, analyse_variance
from mtu_cli.model.settings import Settings
from mtu_cli.reports.anova import CSV_COLUMNS, csv_rows, document
from mtu_cli.reports.anova_figure import figure
from mtu_cli.reports.anova_table import sentences, table
from mtu_cli.reports.figures import figure_bytes
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


def all_numbers(value: object) -> list[float]:
    if isinstance(value, dict):
        return [x for item in value.values() for x in all_numbers(item)]
    if isinstance(value, list):
        return [x for item in value for x in all_numbers(item)]
    return [value] if isinstance(value, float) else []


def test_names_and_units(planted: AnovaResult) -> None:
    results: dict[str, Any] = json.loads(json.dumps(document(planted), allow_nan=False))
    assert [len(results[k]) for k in ("features", "lengths", "orthogonality")] == [6, 2, 1]
    for entry in results["features"]:
        assert set(CONTRACT) <= set(entry)
    first, one = results["features"][0], planted.features
    assert first["mean_error_um"] == pytest.approx(one.one_way.mean[0] * 1e3)
    assert first["var_part_um2"] == pytest.approx(one.components.part[0] * 1e6)
    assert first["U_future_um"] == pytest.approx(2 * first["u_future_um"])
    assert first["s_pooled_um"] == pytest.approx(math.sqrt(first["ms_within_um2"]))
    assert planted.angles is not None
    angle = results["orthogonality"][0]
    assert angle["id"] == "xy"
    assert angle["mean_error_arcsec"] == pytest.approx(planted.angles.one_way.mean[0] / ARCSEC)
    assert angle["var_part_arcsec2"] == pytest.approx(planted.angles.components.part[0] / ARCSEC**2)
    assert not any("_um" in name for name in angle)
    (item,) = results["unusual_parts"]
    assert (item["part"], item["where"]["axis"]) == ("P6", "y")
    assert item["deviation_um"] == pytest.approx(60, rel=0.25)
    assert results["axis_scatter"][0]["variance_ratio_y_to_x"] > 1


def test_what_cannot_be_had_is_null() -> None:
    results = document(analyse_variance(study(1, 1, 1), None, "reml", Settings()))
    assert results["unusual_parts"] is None
    entry = results["features"][0]
    for name in ("F", "p", "ms_between_um2", "ms_within_um2", "var_part_um2", "u_mean_um",
                 "u_future_um", "var_part_interval95_um2", "s_pooled_um"):  # fmt: skip
        assert entry[name] is None, name
    assert np.isfinite(entry["mean_error_um"])
    assert all(math.isfinite(value) for value in all_numbers(results))


def test_csv_holds_every_kind_in_its_unit(planted: AnovaResult) -> None:
    header, rows = csv_rows(planted)
    assert header == CSV_COLUMNS
    assert header[0] == "kind"
    assert len(set(header)) == len(header)
    listed = [dict(zip(header, row, strict=True)) for row in rows]
    kinds = ["feature"] * 6 + ["length"] * 2 + ["orthogonality"]
    assert [row["kind"] for row in listed] == kinds
    results = document(planted)
    entries = [*results["features"], *results["lengths"], *results["orthogonality"]]
    for row, entry in zip(listed, entries, strict=True):
        angle = row["kind"] == "orthogonality"
        unit, other = ("arcsec", "um") if angle else ("um", "arcsec")
        scalars = {k for k, v in entry.items() if not isinstance(v, list)}
        assert scalars <= set(header)
        assert all(row[name] == entry[name] for name in scalars)
        low, high = entry[f"var_part_interval95_{unit}2"]
        assert (row[f"var_part_low95_{unit}2"], row[f"var_part_high95_{unit}2"]) == (low, high)
        assert row["id"] == entry.get("id", entry.get("feature"))
        assert all(row[name] is None for name in header if f"_{other}" in name)
        assert all(row[name] is not None for name in header if f"_{unit}" in name)
    assert [row["id"] for row in listed[6:]] == ["a-b", "c-a", "xy"]
    assert all(row["feature"] is None for row in listed[6:])


def test_tables_fit_and_speak_plainly(planted: AnovaResult) -> None:
    text = plain_text(table(planted))
    assert max(map(len, text.splitlines())) <= 100
    assert "Part P6 stands out: it lies" in text
    assert "from the mean in y, all features together" in text
    assert "y scatters" in text
    assert text.index("by operation and axis") < text.index("Lengths") < text.index("Features")
    clean = analyse_variance(study(21, 2, 4), None, "reml", Settings())
    assert sentences(clean)[0].startswith("No part stands out")
    assert "no sign that y scatters more than x" in sentences(clean)[1]
    alone = analyse_variance(study(1, 2, 4), None, "reml", Settings())
    assert sentences(alone) == ["Too few parts to say whether one stands out."]


def test_many_features_are_summed_up_and_the_worst_listed() -> None:
    from mtu_cli.reports import anova_table

    found = study(8, 2, 4)
    result = analyse_variance(found, None, "anova", Settings())
    assert len(anova_table._worst(result.features)) == 6
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(anova_table, "SHOWN", 4)
        patch.setattr(anova_table, "WORST", 3)
        worst = anova_table._worst(result.features)
        text = plain_text(table(result))
    size = np.abs(result.features.one_way.mean) + 2 * result.features.u_future
    assert list(worst) == list(np.argsort(-size)[:3])
    assert "the 3 with the largest errors to come, of 6" in text


@pytest.mark.parametrize("parts", [1, 5, 60])
def test_pictures_of_any_number_of_parts(parts: int) -> None:
    result = analyse_variance(study(parts, 1 + parts % 2, 2), None, "reml", Settings())
    first, again = (figure_bytes(figure(result), "png") for _ in range(2))
    assert first == again
    assert first.startswith(b"\x89PNG")


def test_picture_marks_what_stands_out(planted: AnovaResult, tmp_path: Path) -> None:
    drawn = figure(planted)
    titles = [panel.get_title(loc="left") for panel in drawn.axes]
    assert titles[:4] == ["a x", "a y", "b x", "b y"]
    assert titles[-1] == "Shares of the variance"
    bars = [patch.get_width() for patch in drawn.axes[-1].patches if isinstance(patch, Rectangle)]
    assert sum(bars) == pytest.approx(200)
    share = planted.totals[0].repeat_share
    assert 100 * share == pytest.approx(bars[1])


def test_nothing_is_written_over_or_outside(planted: AnovaResult) -> None:
    page = figure(planted)
    figure_bytes(page, "png")
    shares = page.axes[-1]
    legend = shares.get_legend()
    assert legend is not None
    written: list[Any] = [text for text in shares.texts if text.get_text()]
    for panel in page.axes:
        title = panel.get_title(loc="left")
        written += [
            item
            for item in panel.get_children()
            if isinstance(item, Text) and item.get_text() == title
        ]
    assert len(written) == len(page.axes) + 2
    boxes = [item.get_window_extent() for item in [*written, legend, *page.legends]]
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[i + 1 :])
        assert page.bbox.x0 <= box.x0
        assert box.x1 <= page.bbox.x1
        assert box.y1 <= page.bbox.y1


def test_features_left_out_of_the_picture_are_counted() -> None:
    from mtu_cli.reports import anova_figure

    result = analyse_variance(study(5, 2, 4), None, "reml", Settings())
    assert figure(result).legends[0].get_title().get_text() == "Mean errors by part"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(anova_figure, "FEATURES", 2)
        title = figure(result).legends[0].get_title().get_text()
    assert title == "Mean errors by part: 2 of 3 features"
