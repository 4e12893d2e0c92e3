"""What anova reports: names and units of the contract, nulls, tables, pictures."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle
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


def test_csv_holds_every_feature(planted: AnovaResult) -> None:
    header, rows = csv_rows(planted)
    listed = list(rows)
    assert header == CSV_COLUMNS
    assert len(listed) == 6
    assert all(len(row) == len(header) for row in listed)
    entry = document(planted)["features"][3]
    assert listed[3][header.index("mean_error_um")] == entry["mean_error_um"]
    assert listed[3][header.index("var_part_high95_um2")] == entry["var_part_interval95_um2"][1]


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
    assert "Shares of the variance" in titles[-1]
    bars = [patch.get_width() for patch in drawn.axes[-1].patches if isinstance(patch, Rectangle)]
    assert sum(bars) == pytest.approx(200)
    share = planted.totals[0].repeat_share
    assert 100 * share == pytest.approx(bars[1])
