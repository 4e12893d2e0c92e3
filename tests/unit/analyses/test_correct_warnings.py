"""What is said of errors that the correction makes or leaves, and what they point to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from correct_examples import error_at, machine, ring_part, ring_places, ring_points, seen

from mtu_cli.analyses.correct import CorrectResult, correct
from mtu_cli.analyses.correct.roundness import Oval
from mtu_cli.model.settings import Settings


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


def test_an_error_of_exactly_nothing_cannot_be_reduced(tmp_path: Path) -> None:
    found = result(tmp_path)
    size = found.sizes[0]
    shown = replace(found, sizes=(replace(size, reference=size.size[0], u=0.0),))
    first, grown, last = shown.warnings
    assert "rms_before_um" in grown.facts
    assert first.facts["quantity"] == "reduction_percent"
    assert last.facts["quantity"] == "E_n"


def test_a_circle_that_gets_rounder_and_yet_further_off_asks_for_its_calibration(
    tmp_path: Path,
) -> None:
    """The form falls from what the machine did to it to rounding."""
    found = result(tmp_path, calibrated_mm="179.5134")
    (size,) = (item for item in found.by_size() if item.id == "ring")
    assert size.grown
    (warned,) = (item for item in found.warnings if "rms_before_um" in item.facts)
    assert warned.facts["cause"].startswith("ring gets rounder: calibrated_mm is wrong")
    # Where it does not, the model is at fault; a sphere of its name has a form of its own.
    for share, right in ((0.69, True), (0.71, False)):
        less = tuple(replace(own, form=(own.form[0], share * own.form[0])) for own in found.sizes)
        right_one = found.sizes[0].size[1]
        sphere = replace(found.sizes[0], kind="sphere", form=(1e-3, 5e-3), reference=right_one)
        (other,) = (
            i for i in replace(found, sizes=(*less, sphere)).warnings if "rms_before_um" in i.facts
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
        (told,) = (item for item in other.warnings if "rms_before_um" in item.facts)
        assert "rounder" not in told.message
        assert "the model does not describe these points" in told.message
    # A sphere of its name is another ring.
    sphere = replace(found, ovals=(replace(oval, kind="sphere"),))
    (told,) = (item for item in sphere.warnings if "rms_before_um" in item.facts)
    assert "rounder" in told.message


def test_errors_left_beyond_no_uncertainty_are_told(tmp_path: Path) -> None:
    """Exactly known: whatever is left is beyond it, and nothing is divided by 0."""
    found = result(tmp_path, calibrated_mm="180.1134")
    sure = replace(found, sizes=tuple(replace(own, u=0.0) for own in found.sizes))
    (told,) = (item for item in sure.warnings if "mean_um" in item.facts)
    assert told.facts["mean_um"] == pytest.approx(-100, abs=0.5)
    assert told.facts["half_width_um"] == 0


def test_errors_that_the_correction_leaves_are_told(tmp_path: Path) -> None:
    """A diameter calibrated 0.1 mm too large, of rings that the machine made too small."""
    found = result(tmp_path, calibrated_mm="180.1134")
    (warned,) = (item for item in found.warnings if item.code.startswith("errors-"))
    assert warned.code == "errors-left"
    assert warned.facts["mean_um"] == pytest.approx(-100, abs=0.5)
    assert warned.facts["half_width_um"] == pytest.approx(0.82, abs=0.005)
    assert warned.message.endswith("or calibrated_mm is wrong")
    right = result(tmp_path, calibrated_mm="180.0134")
    assert not [item for item in right.warnings if item.code.startswith("errors-")]


def test_the_worst_of_what_is_left_is_farthest_beyond_its_uncertainty(tmp_path: Path) -> None:
    """Not the one that is farthest off."""
    found = result(tmp_path, calibrated_mm="180.1134")
    first = found.sizes[0]
    far, sure = (
        replace(first, id=id, u=u, dof=np.inf, size=(first.reference + 0.1, first.reference + off))
        for id, off, u in (("far", 0.05, 0.02), ("sure", 0.04, 0.001))
    )
    (told,) = (w for w in replace(found, sizes=(far, sure)).warnings if "mean_um" in w.facts)
    assert "the mean errors of far, sure exceed" in told.message
    assert "(sure: 40 um" in told.message
