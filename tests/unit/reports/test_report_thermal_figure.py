"""Pictures of thermal-fit: what they show, and that nothing hides anything."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from thermal_examples import (
    CYCLES,
    constant,
    cubic,
    example,
    many_positions,
)

from mtu_cli.analyses.thermal_fit.result import ComponentDrift
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.machine_figures import drift as figure


def panels(*components: ComponentDrift) -> list[Axes]:
    return figure(example(*components)).axes


def test_curves_lie_side_by_side_and_show_the_readings() -> None:
    found = cubic()
    panel = panels(found)[0]
    lines = [line for line in panel.lines if len(np.asarray(line.get_xdata())) == 60]
    assert len(lines) == 2 * len(found.curves)
    ends = 0.0
    for c in range(len(CYCLES)):
        block = lines[8 * c : 8 * c + 8]
        times = [np.asarray(line.get_xdata()) for line in block]
        assert min(t.min() for t in times) >= ends
        assert all(np.ptp(t) == pytest.approx(190.0) for t in times)
        ends = max(t.max() for t in times)
    curve = found.curves[5]
    measured, modelled = lines[10:12]
    np.testing.assert_allclose(np.asarray(measured.get_ydata()), curve.measured * 1e3)
    np.testing.assert_allclose(np.asarray(modelled.get_ydata()), curve.modelled * 1e3)
    assert measured.get_color() == modelled.get_color() != lines[8].get_color()


@pytest.mark.parametrize("build", [cubic, many_positions])
def test_nothing_is_written_over_anything(build: Any) -> None:
    again = replace(build(), name="again")
    page = figure(example(build(), again, constant("roll_y"), constant(held_out=False)))
    figure_bytes(page, "png")
    boxes: dict[tuple[int, int, str], Any] = {}
    for number, panel in enumerate(page.axes):
        texts: list[Any] = [*panel.texts, panel.xaxis.label, panel.yaxis.label]
        texts += [panel._left_title]  # type: ignore[attr-defined]  # where the house writes titles
        for axis in (panel.xaxis, panel.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
            texts += [tick.label1 for tick in ticks if low <= tick.get_loc() <= high]
        boxes |= {
            (number, i, text.get_text()): text.get_window_extent()
            for i, text in enumerate(texts)
            if text.get_text()
        }
        legend = panel.get_legend()
        if legend is not None:
            boxes[number, -1, "legend"] = legend.get_window_extent()
    assert len(boxes) > 50
    for (first, box), (second, other) in combinations(boxes.items(), 2):
        assert not box.overlaps(other), (first, second)
    assert all(box.x0 >= 0 and box.x1 <= page.bbox.x1 for box in boxes.values())
