"""Figures: what they show, that nothing hides anything, and the same bytes every time."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from model_examples import Segment, loaded, readings
from report_examples import SAYS, Example, example

from mtu_cli.model.fit import estimates_from_fit, fit_machine
from mtu_cli.model.settings import Settings
from mtu_cli.reports import (
    machine_figures,
    prediction_figures,
)
from mtu_cli.reports.figures import blank, figure_bytes, styled


def draw(suffix: str) -> bytes:
    @styled
    def inner():  # type: ignore[no-untyped-def]  # a figure, whatever it holds
        page = blank(3.0, 2.0)
        page.subplots().plot([0, 1], [0, 1], "o-", label="a")
        return page

    return figure_bytes(inner(), suffix)


@pytest.mark.parametrize("suffix", ["png", ".svg", ".PDF"])
def test_the_same_figure_has_the_same_bytes_and_no_date(suffix: str) -> None:
    """Whatever settings of matplotlib the user has."""
    import matplotlib

    first = draw(suffix)
    with matplotlib.rc_context({"lines.linewidth": 9.0, "axes.facecolor": "red"}):
        assert draw(suffix) == first
        assert matplotlib.rcParams["lines.linewidth"] == 9.0
    assert len(first) > 1000
    assert not re.search(rb"CreationDate|<dc:date>|20\d\d-\d\d-\d\dT", first)


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Example:
    return example(tmp_path_factory.mktemp("paper"))


def test_ellipses_are_k_sigma_of_the_covariance(paper: Example) -> None:
    from matplotlib.collections import EllipseCollection

    result = paper.points()
    (panel,) = prediction_figures.points(result).axes
    (found,) = [item for item in panel.collections if isinstance(item, EllipseCollection)]
    parts = (found.get_offsets(), found.get_widths(), found.get_heights(), found.get_angles())
    drawn = [*zip(*map(np.asarray, parts), strict=True)]
    assert len(drawn) == 24
    for i, (tip, width, height, turned) in enumerate(drawn):
        place = result.points[i, :2]
        scale = np.linalg.norm(tip - place) / np.linalg.norm(
            result.prediction.mean[2 * i : 2 * i + 2]
        )
        block = result.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] * scale**2
        angle = np.radians(turned)
        along = np.array([np.cos(angle), np.sin(angle)])
        assert (width / 2) ** 2 == pytest.approx(4 * along @ block @ along, rel=1e-6)
        across = np.array([-along[1], along[0]])
        assert (height / 2) ** 2 == pytest.approx(4 * across @ block @ across, rel=1e-6)
        assert abs(along @ block @ across) <= 1e-9 * np.trace(block)


def test_the_covariance_of_each_feature_is_a_block_of_the_whole(paper: Example) -> None:
    """Also where a negative D keeps the whole from being a covariance, and u from it."""
    known = paper.points()
    n, a = len(known.prediction.ids), len(known.prediction.axes)
    first, *others = known.prediction.blocks
    less = replace(first, D=first.D - 3 * np.abs(np.diag(np.diag(first.C + first.D))), between=None)
    prediction = replace(known.prediction, blocks=(less, *others))
    negative = replace(known, prediction=prediction, variance=prediction.variance().total)
    assert not np.allclose(np.diag(prediction.covariance), negative.variance, rtol=1e-9)
    apart = paper.points(Settings(correlation="independent"))
    for result in (known, negative, apart):
        blocks = result.covariance.reshape(n, a, n, a)[np.arange(n), :, np.arange(n), :]
        np.testing.assert_allclose(result.own_covariances, blocks, rtol=1e-9, atol=1e-18)


def test_names_of_the_holes_keep_clear_of_arrows_and_one_another(paper: Example) -> None:
    result = paper.points()
    page = prediction_figures.points(result)
    figure_bytes(page, "png")
    (panel,) = page.axes
    ids = set(result.prediction.ids)
    texts: list[Any] = [text for text in panel.texts if text.get_text() in ids]
    boxes = [text.get_window_extent() for text in texts]
    assert len(boxes) == 24
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[i + 1 :])
    marks = panel.transData.transform(result.points[:, :2])
    for box in boxes:
        assert not any(box.contains(x, y) for x, y in marks)


def test_a_panel_a_component(tmp_path: Path) -> None:
    given = example(tmp_path, passes=3, roles=("lbb", "laser"))
    page = machine_figures.components(given.fit, given.estimates, 2.0, says=SAYS)
    shown = [panel for panel in page.axes if panel.axison]
    assert len(shown) == len(given.estimates.components)
    assert all(panel.get_ylabel() in ("um", "arcsec") for panel in shown)
    assert figure_bytes(page, "png")


def test_band_is_that_of_a_future_reading(paper: Example) -> None:
    page = machine_figures.components(paper.fit, paper.estimates, 2.0)
    panel = next(p for p in page.axes if p.get_title(loc="left").startswith("dx_x"))
    (band,) = panel.collections
    at_zero = np.asarray(band.get_paths()[0].vertices)
    edges = at_zero[np.isclose(at_zero[:, 0], 0.0)][:, 1]
    estimate = paper.estimates.components["dx_x"]
    variance = estimate.covariance[0, 0] + estimate.pass_covariance[0, 0] + estimate.s_repeat**2
    assert edges.max() - edges.min() == pytest.approx(4 * np.sqrt(variance) * 1000, rel=1e-9)


def test_a_pass_that_broke_off_keeps_its_place_and_all_are_drawn(tmp_path: Path) -> None:
    """Pass 2 forward has two readings of eight: the fit leaves it out, the picture does not."""
    known = loaded(tmp_path, "components: {a: {of: x, unit: um}}\nequations: {Ex: a}\n")
    place, rng = np.linspace(0.0, 350.0, 8), np.random.default_rng(1)
    position = np.tile(place, 8)
    number, way = np.repeat(np.arange(8) // 2 + 1, 8), np.repeat([1, -1] * 4, 8)
    kept = (number != 2) | (way < 0) | (position < 60)
    segment = Segment(
        name="a",
        position=position[kept],
        error=1e-3 * (number + 0.1 * rng.normal(size=64))[kept],
        passes=number[kept],
        direction=way[kept],
    )
    fit = fit_machine(known, readings([segment]))
    (item,) = fit.components["a"].instruments
    assert item.passes is not None
    assert (item.fit.n_passes, len(item.passes.keys), len(item.keys_read)) == (7, 7, 8)
    page = machine_figures.components(fit, estimates_from_fit(known, fit), 2.0)
    lines: list[Any] = [line for line in page.axes[0].lines if line.get_marker() in ("<", ">")]
    assert [line.get_marker() for line in lines] == [">", "<"] * 4
    assert [len(line.get_xdata()) for line in lines] == [8, 8, 2, 8, 8, 8, 8, 8]
    # Each at its own height, which is its number.
    assert [round(float(np.mean(line.get_ydata()))) for line in lines] == [1, 1, 2, 2, 3, 3, 4, 4]
    colours = [line.get_color() for line in lines]
    assert colours[0::2] == colours[1::2]
    assert len(set(colours)) == 4
