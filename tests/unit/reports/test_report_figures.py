"""Figures: what they show, that nothing hides anything, and the same bytes every time."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from report_examples import Example, example

from mtu_cli.analyses.fit_components import fit_result
from mtu_cli.reports import (
    fit_components,
    predict_points,
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
    (panel,) = predict_points.figure(result).axes
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


def test_names_of_the_holes_keep_clear_of_arrows_and_one_another(paper: Example) -> None:
    result = paper.points()
    page = predict_points.figure(result)
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


def test_band_is_that_of_a_future_reading(paper: Example) -> None:
    page = fit_components.figure(fit_result("m", paper.fit, paper.estimates))
    panel = next(p for p in page.axes if p.get_title(loc="left").startswith("dx_x"))
    (band,) = panel.collections
    at_zero = np.asarray(band.get_paths()[0].vertices)
    edges = at_zero[np.isclose(at_zero[:, 0], 0.0)][:, 1]
    estimate = paper.estimates.components["dx_x"]
    variance = estimate.covariance[0, 0] + estimate.pass_covariance[0, 0] + estimate.s_repeat**2
    assert edges.max() - edges.min() == pytest.approx(4 * np.sqrt(variance) * 1000, rel=1e-9)
