"""The picture of close-loop: its panels for every verdict, and what they draw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from close_loop_examples import (
    ambiguous,
    effect,
    left_over,
    named,
    nothing,
    on_table,
    result,
    several,
)
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle
from matplotlib.quiver import Quiver

from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult
from mtu_cli.close_loop_sealed.reports.close_loop import figure
from mtu_cli.close_loop_sealed.reports.close_loop_curves import MOST, curves
from mtu_cli.reports import figures
from mtu_cli.reports.figures import figure_bytes

EVERY = {
    "named": named,
    "class": ambiguous,
    "unexplained": left_over,
    "none": nothing,
    "several": several,
}


@pytest.mark.parametrize("verdict", EVERY)
def test_every_verdict_can_be_drawn_twice_alike(verdict: str) -> None:
    found = EVERY[verdict]()
    page = figure(found)
    assert figure_bytes(page, ".png") == figure_bytes(figure(found), ".png")
    assert page.axes[-1].get_title(loc="left") == "candidates at the first look"


@pytest.mark.parametrize("found", [nothing(), left_over()])
def test_where_nothing_was_taken_out_residuals_stand_beside_the_arrows(
    found: CloseLoopResult,
) -> None:
    titles = [panel.get_title(loc="left") for panel in figure(found).axes]
    assert titles == [
        "Ex and Ey, z = 127 mm",
        "residuals, part by part",
        "residuals, feature by feature",
        "candidates at the first look",
    ]


def test_the_class_is_coloured_and_the_gate_is_seen() -> None:
    panel = figure(ambiguous()).axes[-1]
    names = [label.get_text() for label in panel.get_yticklabels()]
    rectangles = [patch for patch in panel.patches if isinstance(patch, Rectangle)]
    bars = dict(zip(names, rectangles, strict=True))
    assert names[0] == "backlash-x"
    assert to_hex(bars["backlash-x"].get_facecolor()) == figures.ORANGE
    # In the class by itself, but not past the gate: hollow.
    assert to_hex(bars["abbe-x"].get_edgecolor()) == figures.ORANGE
    assert not to_hex(bars["abbe-x"].get_facecolor(), keep_alpha=True).endswith("ff")
    assert to_hex(bars["scale-x"].get_edgecolor()) == figures.GREY


def test_residuals_stand_over_the_direction_beside_the_effect() -> None:
    item = named().tables[0]
    (curve,) = curves(item)
    (series,) = curve.series
    assert (curve.xlabel, curve.ticks) == ("dir_x", (-1.0, 1.0))
    assert len(series.y) == item.table.there.sum()
    assert series.fitted is not None
    # About the mean of the residuals: the fit jumps by twice the lost motion of 2.05 um.
    measured = item.table.errors[:, :, 0].ravel() / 1e-3
    assert series.y == pytest.approx(measured)
    assert series.fitted.mean() == pytest.approx(measured.mean())
    at = [series.fitted[series.x == side].mean() for side in (1, -1)]
    assert at[0] - at[1] == pytest.approx(4.1)


def test_of_two_effects_each_is_drawn_without_the_other() -> None:
    drift = effect(
        "thermal-drift-x",
        parameters=(("drift", "um/K", 1.5, 0.1),),
        equations={"Ex": "drift*(T_spindle_degC - 23)"},
    )
    item = on_table("named", (effect(), drift))
    table = item.table
    T = np.broadcast_to(table.covariates["T_spindle_degC"], table.there.shape)
    both = item.explained.copy()
    both[:, :, 0] += 1.5e-3 * (T - 23)
    exact = replace(item, table=replace(table, errors=both), explained=both)
    backlash, thermal = curves(exact)
    for curve in (backlash, thermal):
        (series,) = curve.series
        assert series.fitted is not None
        assert series.y == pytest.approx(series.fitted, abs=1e-9)
        assert "other effects taken out" in curve.ylabel
    assert thermal.series[0].fine is not None
    x, y = thermal.series[0].fine
    assert (y[-1] - y[0]) / (x[-1] - x[0]) == pytest.approx(1.5)


def test_an_offset_beside_a_trend_says_what_its_line_is() -> None:
    """Over the parts stands what both do: the line of a constant would not slope."""
    offset = effect("offset-x", equations={"Ex": "shift"}, kind="offset",
                    parameters=(("shift", "um", 2.0, 0.1),))  # fmt: skip
    item = on_table("named", (offset, effect()))
    curve = curves(item)[0]
    assert (curve.ylabel, curve.line) == ("residual Ex, um", "all effects together")
    panel = next(
        panel for panel in figure(result(item)).axes if panel.get_title(loc="left") == "offset-x"
    )
    legend = panel.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["all effects together"]
    (alone,) = curves(on_table("named", (offset,)))
    assert (alone.ylabel, alone.line) == ("residual Ex, um", "")
    (several, _) = curves(on_table("named", (replace(offset, axis=""), effect())))
    assert several.ylabel == "residual, um"
    assert len(several.series) > 1


@pytest.mark.parametrize(
    ("equation", "xlabel", "names"),
    [
        ("lost_motion*(x - 75)", "x, mm", [""]),
        ("lost_motion*(tool_parts - 4)*dir_x", "tool_parts", ["dir_x -1", "dir_x +1"]),
        (
            "lost_motion*(x - 75)*(T_part_degC - 20)",
            "x, mm",
            ["T_part_degC low", "T_part_degC high"],
        ),
        ("lost_motion*(x - 75)/sqrt((x - 75)**2 + y**2)", "the effect as fitted, um", [""]),
    ],
)  # fmt: skip
def test_what_an_effect_is_drawn_over(equation: str, xlabel: str, names: list[str]) -> None:
    item = on_table("named", (effect(equations={"Ex": equation}),))
    (curve,) = curves(item)
    assert curve.xlabel == xlabel
    assert [series.name for series in curve.series] == names
    assert sum(len(series.x) for series in curve.series) == item.table.there.sum()
    figure(result(item))


@pytest.mark.parametrize(
    ("chosen", "kind", "categories"),
    [("H7", "outlier", 12), ("P4", "outlier", 9), ("milled", "mean", 3), (None, "scatter", 9)],
)
def test_effects_without_an_equation_stand_over_what_was_chosen(
    chosen: str | None, kind: str, categories: int
) -> None:
    own = effect("odd-x", equations={}, chosen=chosen, kind=kind)
    item = on_table("named", (own,))
    (curve,) = curves(item)
    assert len(curve.names) == categories
    assert all((series.fitted is None) is (kind == "scatter") for series in curve.series)
    figure(result(item))


def test_missing_cells_are_not_drawn() -> None:
    item = named().tables[0]
    errors, repeats = item.table.errors.copy(), item.table.repeats.copy()
    errors[2, 3], repeats[2, 3] = np.nan, 0
    holed = replace(item, table=replace(item.table, errors=errors, repeats=repeats))
    (curve,) = curves(holed)
    assert len(curve.series[0].y) == item.table.there.size - 1
    assert np.isfinite(curve.series[0].y).all()
    page = figure(result(holed))
    quiver = page.axes[0].collections[0]
    assert isinstance(quiver, Quiver)
    assert np.isfinite(quiver.U).all()
    assert np.isfinite(quiver.V).all()


def test_no_more_than_the_first_effects_are_drawn() -> None:
    own = tuple(effect() for _ in range(MOST + 1))
    assert len(curves(on_table("named", own))) == MOST
    for count, said in ((MOST + 1, True), (MOST, False)):
        title = figure(result(on_table("named", own[:count])))._suptitle.get_text()  # type: ignore[attr-defined]  # by matplotlib
        assert title.endswith(f"({MOST} of {count} drawn)") == said


def test_readings_are_drawn_over_the_position_a_line_each_direction() -> None:
    item = several().tables[0]
    panel = figure(result(item)).axes[0]
    assert panel.get_xlabel() == "x, mm"
    named = [line for line in panel.lines if not str(line.get_label()).startswith("_")]
    lines = {line.get_label(): line for line in named}
    assert list(lines) == ["before, forward", "before, reverse", "after, forward", "after, reverse"]
    shown = {label: np.asarray(line.get_xydata()) for label, line in lines.items()}
    for points in shown.values():
        assert points[:, 0].tolist() == sorted(points[:, 0].tolist())
    mean = {label: points[:, 1].mean() for label, points in shown.items()}
    before = mean["before, forward"] - mean["before, reverse"]
    after = mean["after, forward"] - mean["after, reverse"]
    # Twice the lost motion was taken out.
    assert before - after == pytest.approx(4.1)
    # Behind the means each reading, before and after, in the unit shown.
    dots = [np.asarray(line.get_ydata()) for line in panel.lines if line.get_marker() == "."]
    unit = 1e-3
    both = np.concatenate([item.table.errors, item.table.errors - item.explained])
    assert np.concatenate(dots) == pytest.approx(both[:, :, 0].ravel() / unit)


def test_an_effect_between_passes_alone_is_seen_beside_its_means() -> None:
    """The means stay as they are; the readings come together."""
    item = several().tables[0]
    passes = 5e-3 * (np.arange(len(item.table.parts)) - 0.5 * (len(item.table.parts) - 1))
    moved = np.broadcast_to(passes[:, None, None], item.table.errors.shape)
    item = replace(
        item, table=replace(item.table, errors=item.table.errors + moved), explained=moved
    )
    panel = figure(result(item)).axes[0]
    means = {str(line.get_label()): line for line in panel.lines if line.get_marker() == "o"}
    before, after = means["before, forward"], means["after, forward"]
    assert np.asarray(before.get_ydata()) == pytest.approx(np.asarray(after.get_ydata()))
    dots = [line for line in panel.lines if line.get_marker() == "."]
    seen = {
        colour: np.ptp([line.get_ydata() for line in dots if line.get_color() == colour])
        for colour in (before.get_color(), after.get_color())
    }
    assert seen[before.get_color()] > seen[after.get_color()] + 4.0


def test_the_legend_of_the_ranking_hides_no_bar() -> None:
    """Bars to the left of nothing end where the legend would be."""
    item = nothing().tables[0]
    worse = tuple(
        replace(judged, log_bayes_factor=-1.0 - i) for i, judged in enumerate(item.candidates[:6])
    )
    page = figure(result(replace(item, candidates=worse)))
    with figures.house_style():
        page.draw_without_rendering()
    panel = page.axes[-1]
    legend = panel.get_legend()
    assert legend is not None
    bars = [patch for patch in panel.patches if isinstance(patch, Rectangle)]
    assert len(bars) == len(worse)
    assert not any(legend.get_window_extent().overlaps(bar.get_window_extent()) for bar in bars)


def test_a_pitch_that_is_one_of_many_is_drawn_as_an_example() -> None:
    own = effect(
        "cyclic-x",
        parameters=(("sine", "um", 3.0, 0.3),),
        equations={"Ex": "sine*sin(2*pi*x/43.3)"},
        searched={"pitch_mm": (43.3, 2.0, 65.0)},
        alike=(65.0, 26.04, 2.0),
    )
    page = figure(result(on_table("class", (own,))))
    assert page.get_suptitle() == "Undeclared effects: cyclic-x, one of 4 pitches that fit"
    panel = page.axes[2]
    assert panel.get_title(loc="left") == "cyclic-x, one of 4 pitches that fit"
    # Between the places one such wave is as good as another.
    assert all(np.size(line.get_xdata()) != 400 for line in panel.lines)
    known = figure(result(on_table("named", (replace(own, alike=()),))))
    assert known.axes[2].get_title(loc="left") == "cyclic-x"


def test_the_legend_of_the_axes_stands_above_the_data() -> None:
    page = figure(nothing())
    figure_bytes(page, ".png")
    panel = page.axes[1]
    legend = panel.get_legend()
    assert legend is not None
    low = panel.transData.inverted().transform(legend.get_window_extent())[0, 1]
    highest = max(float(np.max(line.get_ydata())) for line in panel.lines)
    assert highest < low


def test_the_legend_of_the_positions_stands_outside_of_the_data() -> None:
    page = figure(result(several().tables[0]))
    figure_bytes(page, "png")
    panel = next(
        p for p in page.axes if p.get_title(loc="left").startswith("mean errors of the positions")
    )
    assert panel.get_legend() is None
    (legend,) = [found for part in page.subfigs for found in part.legends]
    names = [text.get_text() for text in legend.get_texts()]
    assert names == ["before, forward", "before, reverse", "after, forward", "after, reverse"]
    box = legend.get_window_extent()
    assert not box.overlaps(panel.get_window_extent())
    titles = [*page.texts, *(text for part in page.subfigs for text in part.texts)]
    assert not any(box.overlaps(text.get_window_extent()) for text in titles if text.get_text())
