"""What correct shows: rounding, nulls, and pictures of every kind of result."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from correct_examples import error_at, machine, ring_part, ring_places, ring_points, seen

from mtu_cli.analyses.correct import CorrectResult, correct
from mtu_cli.analyses.correct.roundness import Oval
from mtu_cli.analyses.correct.scatter import PointScatter
from mtu_cli.model.settings import Settings
from mtu_cli.reports.correct import csv_rows, document, figure, table, warnings
from mtu_cli.reports.csv_text import csv_text
from mtu_cli.reports.figures import figure_bytes
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


def test_errors_are_rounded_to_their_uncertainty(tmp_path: Path) -> None:
    found = result(tmp_path)
    text = plain_text(table(found))
    assert max(map(len, text.splitlines())) <= 100
    first = found.sizes[0]
    (line,) = [item for item in text.splitlines() if item.startswith("ring  part 0 ")]
    # u = 0.4 um: two digits of it are hundredths of a um.
    assert 0.1 < 1000 * first.u_error < 0.99
    assert f"{1000 * first.error[1]:.2f} ± {1000 * first.u_error:.2f}" in line
    assert f"{1000 * first.error[0]:.2f} " in line
    assert line.endswith(" to 0")


def test_sizes_without_a_reference_are_shown_as_they_are(tmp_path: Path) -> None:
    found = result(tmp_path, calibrated_mm="")
    text = plain_text(table(found))
    assert max(map(len, text.splitlines())) <= 100
    assert "180.01340 ± 0.00" in text or "180.0134 ± 0.00" in text
    ring = document(found)["circles"][0]
    nothing = ("calibrated_mm", "reduction_percent", "E_n", "U_calibrated_um", "s_repeats_um")
    assert all(ring[name] is None for name in nothing)
    assert ring["error_um"] == {"before": None, "after": None}
    assert ring["interval95_um"] == [None, None]
    assert ring["diameter_mm"]["after"] == pytest.approx(180.0134)
    # Nothing to draw of rings without a reference: the points are drawn instead.
    assert len(figure(found).axes) == 2


def test_many_points_are_summed_up(tmp_path: Path) -> None:
    found = result(tmp_path, parts=5)
    text = plain_text(table(found))
    assert "Corrections of the points" in text
    rows = [line.split() for line in text.splitlines() if line.startswith(("x  ", "y  "))]
    assert [row[:2] for row in rows] == [["x", "55"], ["y", "55"]]
    correction = -1000 * found.error[:, 0]
    assert float(rows[0][2]) == pytest.approx(correction.min(), abs=0.05)
    assert float(rows[0][4]) == pytest.approx(correction.max(), abs=0.05)
    header, lines = csv_rows(found)
    assert len(csv_text(header, lines).splitlines()) == 56
    assert "-0.0," not in csv_text(*csv_rows(found))


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
        assert len(names) == 40
        assert "first 40 of 50" in panel.get_title(loc="left")
        assert names[0].startswith("ring, part part 0" if kind == "circles" else "r0-r5, part")
        shades = [item.get_label() for item in panel.collections]
        assert any("calibration" in str(label) for label in shades) == (kind == "circles")
    elif kind == "axis":
        assert names == [f"r{i} x" for i in range(11)]
    else:
        assert [axes.get_title(loc="left").partition(":")[0] for axes in page.axes] == [
            "before", "after",
        ]  # fmt: skip
    assert len(figure_bytes(page, ".png")) > 5000


def test_the_scatter_of_points_and_what_is_exact_is_told(tmp_path: Path) -> None:
    found = result(tmp_path)
    assert document(found)["point_scatter"] == {"s_um": 0.0, "dof": 16.0, "from": "form"}
    text = " ".join(plain_text(table(found)).split())
    assert "points scatter no more than the model says" in text
    assert "no U_um of ring: the calibration counts as exact" in text
    wide = replace(found, scatter=PointScatter(variance=4e-6, spread=1e-12, dof=16, origin="form"))
    assert document(wide)["point_scatter"]["s_um"] == pytest.approx(2)
    text = " ".join(plain_text(table(wide)).split())
    assert "2.0 um beyond the model, seen in the rings' residuals (16 dof)" in text
    assert "their form error counts as scatter" in text
    point = document(wide)["points"][0]
    assert point["u_corrected_um"]["x"] == pytest.approx(np.hypot(point["u_correction_um"]["x"], 2))
    nothing = replace(found, scatter=None)
    assert set(document(nothing)["point_scatter"].values()) == {None}
    assert "the probing's own scatter is not known" in " ".join(plain_text(table(nothing)).split())


def test_three_points_have_no_form(tmp_path: Path) -> None:
    found = result(tmp_path)
    three = replace(found, sizes=tuple(replace(size, points=3) for size in found.sizes))
    lines = plain_text(table(three)).splitlines()
    assert [line.split()[-1] for line in lines if line.startswith("ring  part ")] == ["-", "-"]


def test_an_error_of_exactly_nothing_cannot_be_reduced(tmp_path: Path) -> None:
    found = result(tmp_path)
    size = found.sizes[0]
    exact = replace(size, reference=size.size[0], u=0.0)
    shown = replace(found, sizes=(exact,))
    first, grown, last = warnings(shown)
    assert grown.code == "errors-grown"
    assert first.facts["quantity"] == "reduction_percent"
    assert last.facts["quantity"] == "E_n"
    assert document(shown)["circles"][0]["reduction_percent"] is None
    assert document(shown)["circles"][0]["E_n"] is None
    assert max(map(len, plain_text(table(shown)).splitlines())) <= 100


def test_a_circle_that_gets_rounder_and_yet_further_off_asks_for_its_calibration(
    tmp_path: Path,
) -> None:
    """The form falls from what the machine did to it to rounding."""
    found = result(tmp_path, calibrated_mm="179.5134")
    (size,) = (item for item in found.by_size() if item.id == "ring")
    assert size.grown
    (warned,) = (item for item in warnings(found) if item.code == "errors-grown")
    assert warned.facts["cause"].startswith("ring gets rounder: calibrated_mm is wrong")
    # Where it does not, the model is at fault; a sphere of its name has a form of its own.
    for share, right in ((0.69, True), (0.71, False)):
        less = tuple(replace(own, form=(own.form[0], share * own.form[0])) for own in found.sizes)
        right_one = found.sizes[0].size[1]
        sphere = replace(found.sizes[0], kind="sphere", form=(1e-3, 5e-3), reference=right_one)
        (other,) = (
            i for i in warnings(replace(found, sizes=(*less, sphere))) if i.code == "errors-grown"
        )
        assert ("rounder" in other.message) == right
        assert ("the model does not describe these points" in other.message) != right


def test_what_stays_oval_or_has_no_form_is_not_called_rounder(tmp_path: Path) -> None:
    found = result(tmp_path, calibrated_mm="179.5134")
    oval = Oval(
        kind="circle",
        id="ring",
        operation="",
        axes=("x", "y"),
        shear=False,
        longer=0.05,
        u=2e-3,
        size=3e-4,
    )
    flat = tuple(replace(own, form=(1e-12, 1e-13)) for own in found.sizes)
    for other in (replace(found, ovals=(oval,)), replace(found, sizes=flat)):
        (told,) = (item for item in warnings(other) if item.code == "errors-grown")
        assert "rounder" not in told.message
        assert "the model does not describe these points" in told.message
    # A sphere of its name is another ring.
    sphere = replace(found, ovals=(replace(oval, kind="sphere"),))
    (told,) = (item for item in warnings(sphere) if item.code == "errors-grown")
    assert "rounder" in told.message


def test_errors_left_beyond_no_uncertainty_are_told(tmp_path: Path) -> None:
    """Exactly known: whatever is left is beyond it, and nothing is divided by 0."""
    found = result(tmp_path, calibrated_mm="180.1134")
    sure = replace(found, sizes=tuple(replace(own, u=0.0) for own in found.sizes))
    (told,) = (item for item in warnings(sure) if item.code == "errors-left")
    assert told.facts["mean_um"] == pytest.approx(-100, abs=0.5)
    assert told.facts["half_width_um"] == 0


def test_errors_that_the_correction_leaves_are_told(tmp_path: Path) -> None:
    """A diameter calibrated 0.1 mm too large, of rings that the machine made too small."""
    found = result(tmp_path, calibrated_mm="180.1134")
    (warned,) = (item for item in warnings(found) if item.code.startswith("errors-"))
    assert warned.code == "errors-left"
    assert warned.facts["mean_um"] == pytest.approx(-100, abs=0.5)
    assert warned.facts["half_width_um"] == pytest.approx(0.82, abs=0.005)
    assert warned.message.endswith("or calibrated_mm is wrong")
    right = result(tmp_path, calibrated_mm="180.0134")
    assert not [item for item in warnings(right) if item.code.startswith("errors-")]


def test_the_worst_of_what_is_left_is_farthest_beyond_its_uncertainty(tmp_path: Path) -> None:
    """Not the one that is farthest off."""
    found = result(tmp_path, calibrated_mm="180.1134")
    first = found.sizes[0]
    far, sure = (
        replace(first, id=id, u=u, dof=np.inf, size=(first.reference + 0.1, first.reference + off))
        for id, off, u in (("far", 0.05, 0.02), ("sure", 0.04, 0.001))
    )
    (told,) = (w for w in warnings(replace(found, sizes=(far, sure))) if w.code == "errors-left")
    assert "the mean errors of far, sure exceed" in told.message
    assert "(sure: 40 um" in told.message


def test_notes_are_of_the_circles_that_are_calibrated_and_of_those_that_are_not(
    tmp_path: Path,
) -> None:
    known, none = result(tmp_path), result(tmp_path, calibrated_mm="")
    both = replace(known, sizes=(known.sizes[0], none.sizes[1]))
    notes = [" ".join(plain_text(table(own)).split()) for own in (known, none, both)]
    minus, diameter = "measured minus calibrated diameter", "the diameter, after ± its u"
    assert [minus in note for note in notes] == [True, False, True]
    assert [diameter in note for note in notes] == [False, True, True]
    assert ["u and 95 % with the calibration's" in note for note in notes] == [True, False, True]
    assert ["where no diameter is calibrated, before" in note for note in notes] == [
        False, False, True,
    ]  # fmt: skip
