"""What anova reports: names and units of the contract, nulls, tables, pictures."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle
from matplotlib.quiver import Quiver
from matplotlib.text import Text
from measured_examples import part_file, points, study, with_measured

from mtu_cli.analyses.anova import AnovaResult, analyse_variance
from mtu_cli.files.points import Points
from mtu_cli.model.settings import Settings
from mtu_cli.reports import figures
from mtu_cli.reports.anova import CSV_COLUMNS, csv_rows, document
from mtu_cli.reports.anova_figure import figure
from mtu_cli.reports.anova_table import table
from mtu_cli.reports.anova_words import sentences
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.numbers import significant
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
    (scatter,) = results["axis_scatter"]
    assert scatter["variance_ratio_y_to_x"] > 1
    assert scatter["of"] == "parts"
    low, high = first["interval95_future_um"]
    assert (low + high) / 2 == pytest.approx(first["mean_error_um"])
    assert (high - low) / 2 > first["U_future_um"]
    assert first["dof_future"] < 21
    assert results["datum"] == "none"


def test_what_cannot_be_had_is_null() -> None:
    results = document(analyse_variance(study(1, 1, 1), None, "reml", Settings()))
    assert results["unusual_parts"] is None
    entry = results["features"][0]
    for name in ("F", "p", "ms_between_um2", "ms_within_um2", "var_part_um2", "u_mean_um",
                 "u_future_um", "var_part_interval95_um2", "s_pooled_um", "var_both_um2",
                 "interval95_future_um", "dof_future"):  # fmt: skip
        assert entry[name] is None, name
    assert np.isfinite(entry["mean_error_um"])
    assert all(math.isfinite(value) for value in all_numbers(results))


def test_limits_below_zero_are_told_as_no_bound() -> None:
    """Repeats to and fro about means that are alike: [0, 0] is no statement on the parts."""
    rows = [
        (f"P{p}", "a", r, 0.001 * (-1) ** r, 0.001 * p + 0.0001 * r)
        for p in range(6)
        for r in (1, 2)
    ]
    result = analyse_variance(points(rows), None, "reml", Settings())
    x, y = document(result)["features"]
    assert x["var_part_interval95_um2"] == [0, 0]
    assert (x["var_part_limits_below_zero"], y["var_part_limits_below_zero"]) == (True, False)
    note = "[0, 0] bounds no s: both limits of the variance were below 0"
    assert note in " ".join(plain_text(table(result)).split())
    header, listed = csv_rows(result)
    column = header.index("var_part_limits_below_zero")
    assert [row[column] for row in listed] == [True, False]
    # An interval from 0 on is one.
    one = next(
        found.features
        for seed in range(20)
        for found in [analyse_variance(study(5, 2, seed, 0.0, 0.001), None, "reml", Settings())]
        if ((found.features.interval == [0, 0]).sum(axis=1) == 1).any()
    )
    only_low = (one.interval == 0).sum(axis=1) == 1
    assert not one.below_zero[only_low].any()
    # Nothing that scatters at all is another matter, and has a warning of its own.
    even = analyse_variance(
        points([(*row[:3], 0.0, 0.0) for row in rows]), None, "reml", Settings()
    )
    assert not even.features.below_zero.any()
    assert note not in " ".join(plain_text(table(even)).split())


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
        scalars = {k for k in entry if k != "unusual_parts" and "interval" not in k}
        assert scalars <= set(header)
        assert all(row[name] == entry[name] for name in scalars)
        for name, interval in ((f"var_part_{{}}95_{unit}2", f"var_part_interval95_{unit}2"),
                               (f"future_{{}}95_{unit}", f"interval95_future_{unit}")):  # fmt: skip
            assert [row[name.format(end)] for end in ("low", "high")] == entry[interval]
        assert row["id"] == entry.get("id", entry.get("feature"))
        assert all(row[name] is None for name in header if f"_{other}" in name)
        # Parts and CMM are told apart here.
        told = [name for name in header if f"_{unit}" in name and "both" not in name]
        assert all(row[name] is not None for name in told)
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
    assert "No sign that y scatters more than x" in sentences(clean)[1]


def test_mean_squares_stand_in_a_table_of_their_own(planted: AnovaResult) -> None:
    below = plain_text(table(planted)).partition("Mean squares\n")[2].splitlines()[2:]
    results = document(planted)
    listed = [(f"{x['id']}", x, "um") for x in results["lengths"]]
    listed += [(f"{x['id']}", x, "arcsec") for x in results["orthogonality"]]
    listed += [(f"{x['feature']} {x['axis']}", x, "um") for x in results["features"]]
    for (name, entry, unit), line in zip(listed, below, strict=False):
        between, within = (entry[f"ms_{of}_{unit}2"] for of in ("between", "within"))
        assert f" {name} " in " ".join(line.replace("- ", " ").split())
        assert line.split()[-6:] == [
            str(entry["df_between"]),
            str(entry["df_within"]),
            significant(between, 3),
            significant(within, 3),
            f"{unit}^2",
            significant(entry["F"], 3),
        ]
    for parts, repeats in ((1, 2), (8, 1)):
        assert "Mean squares" not in spoken(study(parts, repeats, 4))[1]


def spoken(found: Points) -> tuple[list[str], str]:
    result = analyse_variance(found, None, "reml", Settings())
    return sentences(result), plain_text(table(result))


def test_what_can_be_had_is_said_and_the_rest_has_no_column() -> None:
    (one,), text = spoken(study(1, 1, 4))
    assert one.startswith("One part, measured once: its errors are below.")
    for word in ("part s", "CMM s", "interval", "F 95 %", "U future", "unusual", "differ", " - "):
        assert word not in text.partition("Features")[2] + text.partition("One part")[0], word
    (one,), text = spoken(study(1, 2, 4))
    assert one.startswith("One part: its mean errors and the CMM's scatter are below.")
    assert "CMM s" in text
    words, text = spoken(study(8, 1, 4))
    assert words[0].startswith("No repeats: the scatter from part to part holds the CMM's.")
    assert text.replace("\n", " ").count("part+CMM s") == 3
    assert " part s " not in text.replace("\n", " ")
    # The interval beside it, and a number where the summary has one.
    line = next(line for line in text.splitlines() if line.startswith("a        x"))
    assert "[" in line


def test_digits_of_a_mean_without_uncertainty() -> None:
    found = study(1, 1, 4)
    measured = found.measured + np.array([0.0146333, -0.0062667, 0.0])
    _, text = spoken(with_measured(found, measured))
    cells = [line.split()[-1] for line in text.splitlines() if line[:2] in ("a ", "b ", "c ")]
    assert len(cells) == 6
    assert all(len(cell.strip("-").replace(".", "")) <= 3 for cell in cells)


@pytest.mark.parametrize("parts", [4, 6])
@pytest.mark.parametrize(("axis", "other"), [("x", "y"), ("y", "x")])
def test_an_axis_without_any_scatter(parts: int, axis: str, other: str) -> None:
    found = study(parts, 2, 3)
    measured = found.measured.copy()
    still = "xy".index(other)
    measured[:, still] = found.nominal[:, still]
    words, _ = spoken(with_measured(found, measured))
    assert words[-1].startswith(f"Parts scatter in {axis}, and not to be seen in {other}")
    assert ("may be chance" in words[-1]) == (parts == 4)
    assert figure_bytes(figure(analyse_variance(with_measured(found, measured), None, "reml",
                                                Settings())), "png")  # fmt: skip


def test_operations_are_tested_together() -> None:
    rows = []
    rng = np.random.default_rng(4)
    for _ in range(2):
        for p in range(12):
            for name in "abc":
                x, y = rng.standard_normal(2) * [0.004, 0.016]
                rows.append((f"P{p}", name, -1, x, y))
    names = ["drilled"] * 36 + ["milled"] * 36
    words, _ = spoken(points(rows, names))
    assert words[-2].startswith("drilled: y scatters")
    assert words[-1].startswith("milled: y scatters")
    assert words[-1].endswith("all operations together (Holm).")


def test_many_features_are_summed_up_and_the_worst_listed() -> None:
    from mtu_cli.reports import anova_table

    result = analyse_variance(study(8, 2, 4), None, "anova", Settings(coverage_factor=3))
    found = result.features
    size = np.abs(found.one_way.mean) + 3 * found.u_future
    assert found.largest(3) == list(np.argsort(-size))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(anova_table, "SHOWN", 4)
        patch.setattr(anova_table, "WORST", 3)
        text = plain_text(table(result))
    assert "the 3 with the largest errors to come, of 6 features and axes" in text
    first = found.tables.labels[found.largest(3)[0]]
    below = text.partition("Features")[2].splitlines()
    assert below[3].split()[:2] == [first[1], first[2]]


@pytest.mark.parametrize("parts", [1, 5, 60])
def test_pictures_of_any_number_of_parts(parts: int) -> None:
    result = analyse_variance(study(parts, 1 + parts % 2, 2), None, "reml", Settings())
    first, again = (figure_bytes(figure(result), "png") for _ in range(2))
    assert first == again
    assert first.startswith(b"\x89PNG")


def test_one_part_is_drawn_as_a_map() -> None:
    found = study(1, 1, 2)
    drawn = figure(analyse_variance(found, None, "reml", Settings()))
    (panel,) = drawn.axes
    assert panel.get_title(loc="left").startswith("Part P0: errors of 3 features, actual minus")
    (arrows,) = [item for item in panel.collections if isinstance(item, Quiver)]
    errors = (found.measured - found.nominal)[:, :2] / 1e-3
    drawn_at = np.column_stack([arrows.U, arrows.V])
    # One scale for all of them.
    scale = drawn_at[0, 0] / errors[0, 0]
    np.testing.assert_allclose(drawn_at, scale * errors, rtol=1e-9)


def test_one_part_of_three_axes_is_drawn_level_by_level() -> None:
    found = study(1, 1, 2)
    heights = found.nominal.copy()
    heights[:, 2] = [10.0, 60.0, 60.0]
    measured = heights + 0.01 * np.arange(9).reshape(3, 3)
    drawn = figure(
        analyse_variance(
            replace(found, nominal=heights, measured=measured), None, "reml", Settings()
        )
    )
    titles = [panel.get_title(loc="left") for panel in drawn.axes]
    assert titles == [
        f"{what}, z = {z} mm" for what in ("Ex and Ey", "Ez (up is +)") for z in (10, 60)
    ]


@pytest.mark.parametrize(("count", "longest"), [(12, 2), (40, 2), (40, 9)])
def test_names_of_parts_do_not_run_into_one_another(count: int, longest: int) -> None:
    rng = np.random.default_rng(2)
    rows = [(f"{p:0{longest}d}", "a", 0, *(0.01 * rng.standard_normal(2))) for p in range(count)]
    page = figure(analyse_variance(points(rows), None, "reml", Settings()))
    with figures.house_style():
        page.draw_without_rendering()
    for panel in page.axes[:2]:
        boxes = [label.get_window_extent() for label in panel.get_xticklabels()]
        assert len(boxes) >= count / 2
        assert not any(a.overlaps(b) for a, b in pairwise(boxes))


def test_picture_marks_what_stands_out(planted: AnovaResult) -> None:
    drawn = figure(planted)
    titles = [panel.get_title(loc="left") for panel in drawn.axes]
    assert sorted(titles[:6:2]) == ["a x", "b x", "c x"]
    assert titles[-1] == "Shares of the variance: part to part (blue), CMM (orange)"
    bars = [patch.get_width() for patch in drawn.axes[-1].patches if isinstance(patch, Rectangle)]
    assert sum(bars) == pytest.approx(200)
    share = planted.totals[0].repeat_share
    assert 100 * share == pytest.approx(bars[1])
    (legend,) = drawn.legends
    assert "part that stands out here by itself" in [t.get_text() for t in legend.get_texts()]


def test_what_is_drawn_first() -> None:
    """A part that stands out in y of b: b comes before larger errors elsewhere."""
    found = study(21, 2, 4)
    measured = found.measured.copy()
    measured[:, 0] += np.where(found.feature == 2, 0.05, 0.0)
    measured[(found.part == 3) & (found.feature == 1), 1] += 0.12
    result = analyse_variance(with_measured(found, measured), None, "reml", Settings())
    assert [name for _, name in result.shown][:2] == ["b", "c"]


def test_no_limits_where_nothing_can_be_decided() -> None:
    few, enough = (
        figure(analyse_variance(study(n, 2, 4), None, "reml", Settings())) for n in (3, 21)
    )
    texts = [[text.get_text() for text in page.legends[0].get_texts()] for page in (few, enough)]
    assert [any("stands out" in text for text in own) for own in texts] == [False, True]


@pytest.mark.parametrize("operations", [1, 6])
def test_nothing_is_written_over_or_outside(operations: int) -> None:
    rng = np.random.default_rng(2)
    rows, names = [], []
    for operation in range(operations):
        for p in range(6):
            for name in "abc":
                for r in range(2):
                    rows.append((f"part {p}", name, r, *(0.01 * rng.standard_normal(2))))
                    names.append(f"operation {operation}")
    page = figure(analyse_variance(points(rows, names), None, "reml", Settings()))
    figure_bytes(page, "png")
    shares = page.axes[-1]
    written: list[Any] = [text for text in shares.texts if text.get_text()]
    for panel in page.axes:
        title = panel.get_title(loc="left")
        written += [
            item
            for item in panel.get_children()
            if isinstance(item, Text) and item.get_text() == title
        ]
    assert len(written) == len(page.axes) + 2 * operations
    boxes = [item.get_window_extent() for item in [*written, *page.legends]]
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[i + 1 :])
        assert page.bbox.x0 <= box.x0
        assert box.x1 <= page.bbox.x1
        assert box.y1 <= page.bbox.y1


def test_features_left_out_of_the_picture_are_counted() -> None:
    from mtu_cli.reports import anova_figure

    result = analyse_variance(study(5, 2, 4), None, "reml", Settings())
    whole = figure(result).legends[0].get_title().get_text()
    assert whole == "Mean errors by part and feature"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(anova_figure, "FEATURES", 2)
        title = figure(result).legends[0].get_title().get_text()
    assert title == f"{whole}: 2 of 3 features, those that stand out and the largest first"
