"""What correct shows: rounding, nulls, and pictures of every kind of result."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from correct_examples import error_at, machine, ring_part, ring_places, ring_points, seen

from mtu_cli.analyses.correct import CorrectResult, correct
from mtu_cli.model.settings import Settings
from mtu_cli.reports.correct import document
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.part_figures import correct as figure
from mtu_cli.reports.tables import plain_text


def result(folder: Path, parts: int = 2, more: str = "", **ring: str) -> CorrectResult:
    """Rings of 180.0134 mm, a um larger than their calibration."""
    true = np.tile(ring_places(diameter=180.0134), (parts, 1))
    temperature = np.full(11 * parts, 21.0) + np.repeat(0.01 * np.arange(parts), 11)
    points = ring_points(
        seen(true, error_at, temperature),
        [f"part {i}" for i in range(parts)],
        None,
        {"T_scale_degC": temperature},
    )
    return correct(machine(folder), ring_part(folder, more, **ring), points, Settings())


def table(found: CorrectResult, *, detail: bool = False) -> str:
    text = plain_text(document(found).shown(detail=detail))
    assert max(map(len, text.splitlines())) <= 100
    return text


def results(found: CorrectResult) -> dict[str, Any]:
    return document(found).record()


def test_errors_are_rounded_to_their_uncertainty(tmp_path: Path) -> None:
    found = result(tmp_path)
    text = table(found)
    before, after = (f"{1000 * value:.2g}" for value in found.rms(["circle"]) or ())
    assert text.startswith(
        f"Correction reduces the rms error of diameters from {before} to {after}"
    )
    first = found.sizes[0]
    (line,) = [item for item in text.splitlines() if item.startswith("ring  part 0 ")]
    # u = 0.4 um: two digits of it are hundredths of a um.
    assert 0.1 < 1000 * first.u_error < 0.99
    assert f"{1000 * first.error[1]:.2f} ± {1000 * first.u_error:.2f}" in line
    assert f"{1000 * first.error[0]:.2f} " in line
    assert f"{first.size[1]:.5f} ± {first.u:.5f}" in line


def test_sizes_without_a_reference_are_shown_as_they_are(tmp_path: Path) -> None:
    found = result(tmp_path, calibrated_mm="")
    text = table(found)
    assert "180.01340 ± 0.000" in text
    assert "calibrated" not in text.partition("error:")[0]
    assert text.startswith("The largest correction is ")
    ring = results(found)["circles"][0]
    nothing = ("calibrated_mm", "reduction_percent", "U_calibrated_um", "s_repeats_um")
    assert all(ring[name] is None for name in nothing)
    assert ring["error_um"] == {"before": None, "after": None}
    assert ring["interval95_um"] is None
    assert ring["diameter_mm"]["after"] == pytest.approx(180.0134)
    # Nothing to draw of rings without a reference: the features are drawn instead.
    (panel,) = figure(found).axes
    assert panel.get_yticklabels()[0].get_text() == "r0 x"


@pytest.mark.parametrize("kind", ["circles", "lengths", "points", "axis"])
def test_pictures(tmp_path: Path, kind: str) -> None:
    found = result(tmp_path, parts=50, more="lengths: [{from: r0, to: r5}]\n", U_um="1.0")
    if kind == "lengths":
        found = replace(found, sizes=found.of_kind("length"))
    if kind in ("points", "axis"):
        found = replace(found, sizes=())
    if kind == "axis":
        found = replace(found, axes=("x",))
    page = figure(found)
    panel = page.axes[0]
    names = [label.get_text() for label in panel.get_yticklabels()]
    if kind in ("circles", "lengths"):
        # A row a part, of the first to the last of 50.
        what = "ring" if kind == "circles" else "r0-r5"
        assert len(names) == 40
        assert all(name.startswith(f"{what} part ") for name in names)
        assert page.get_suptitle().endswith("(40 of 50)")
    else:
        axes = "x" if kind == "axis" else "xy"
        assert names == [f"r{i} {axis}" for i in range(11) for axis in axes]
    assert len(figure_bytes(page, ".png")) > 5000


def test_what_the_correction_leaves_is_in_the_verdict(tmp_path: Path) -> None:
    found = result(tmp_path)
    size = found.sizes[0]
    exact = replace(found, sizes=(replace(size, reference=size.size[0], u=0.0),))
    assert table(exact).startswith("Correction increases the rms error of diameters from 0 to ")
    assert results(exact)["circles"][0]["reduction_percent"] is None
