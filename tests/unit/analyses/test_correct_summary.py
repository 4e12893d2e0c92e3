"""Corrected points and sizes summed up, and the warnings of what a correction leaves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from correct_examples import (
    ROUNDING_MM,
    error_at,
    machine,
    ring_part,
    ring_places,
    ring_points,
    rings,
    seen,
)

from mtu_cli.analyses.correct import CorrectResult, Size, correct
from mtu_cli.analyses.correct.result import SizeErrors
from mtu_cli.findings import Finding
from mtu_cli.model.settings import Settings


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> CorrectResult:
    """Two rings of 180.0134 mm, a um larger than their calibration."""
    folder = tmp_path_factory.mktemp("rings")
    true = np.tile(ring_places(diameter=180.0134), (2, 1))
    T = np.full(22, 21.0) + np.repeat([0.0, 0.01], 11)
    points = ring_points(seen(true, error_at, T), ["a", "b"], None, {"T_scale_degC": T})
    return correct(machine(folder), ring_part(folder), points, Settings())


def by_size(result: CorrectResult, sizes: list[Size]) -> tuple[SizeErrors, ...]:
    return replace(result, sizes=tuple(sizes)).by_size()


def left(result: CorrectResult, *sizes: Size) -> list[Finding]:
    return [w for w in replace(result, sizes=sizes).warnings if w.code.startswith("errors-")]


def test_means_by_feature_and_the_largest_correction(tmp_path: Path) -> None:
    _, measured, temperature = rings(3)
    measured = measured.copy()
    measured[4, 1] = np.nan
    points = ring_points(measured, ["a", "a", "b"], [1, 2, 1], {"T_scale_degC": temperature})
    # One feature more often than the others, and one not at all.
    points = replace(points, feature=np.where(points.feature == 7, 6, points.feature))
    result = correct(machine(tmp_path), None, points, Settings())
    found = result.by_feature()
    assert found.features == tuple(name for name in points.features if name != "r7")
    for m, name in enumerate(found.features):
        own = [i for i in range(len(points)) if points.features[points.feature[i]] == name]
        for values, summed in (
            (points.nominal, found.places),
            (points.measured - points.nominal, found.before),
            (result.corrected - points.nominal, found.after),
        ):
            for k in range(2):
                wanted = sum(values[i, k] for i in own) / len(own)
                assert summed[m, k] == pytest.approx(wanted, abs=ROUNDING_MM, nan_ok=True)
    largest, axis = result.largest
    assert axis == "xy"[int(np.nanargmax(np.nanmax(np.abs(result.error[:, :2]), axis=0)))]
    assert largest == np.nanmax(np.abs(result.error))


def test_errors_of_a_size_over_its_parts(result: CorrectResult) -> None:
    """Against sums over the parts; off only where no interval explains the mean after."""
    (summed,) = result.by_size()
    sizes = result.of_kind("circle")
    assert (summed.kind, summed.id, summed.parts) == ("circle", "ring", 2)
    for side in (0, 1):
        errors = [size.error[side] for size in sizes]
        assert summed.mean[side] == pytest.approx(sum(errors) / 2)
        assert summed.rms[side] == pytest.approx((sum(x * x for x in errors) / 2) ** 0.5)
    # Calibrated as it was measured, the ring is off by what the correction does.
    exact = [replace(size, reference=size.size[0]) for size in sizes]
    (turned,) = by_size(result, exact)
    assert turned.rms[0] == 0.0
    assert turned.off
    unsure = [replace(size, u=abs(size.error[1])) for size in exact]
    assert not by_size(result, unsure)[0].off
    assert by_size(result, [replace(size, reference=float("nan")) for size in sizes]) == ()


def test_errors_of_many_sizes_are_judged_together(result: CorrectResult) -> None:
    """Of 20 rings of a machine without errors, that the model describes; one in twenty is beyond
    its interval. What parts were made to is no error of the machine.
    """
    ring = replace(result.sizes[0], u=0.001, dof=np.inf, reference=0.0, U_reference=np.nan)
    alarms, runs = 0, 1000
    for z in np.random.default_rng(1).normal(size=(runs, 20)):
        sizes = [replace(ring, id=f"r{i}", size=(0.0, 0.001 * z[i])) for i in range(20)]
        alarms += any(item.off for item in by_size(result, sizes))
    assert alarms / runs == pytest.approx(0.05, abs=0.02)
    off = replace(ring, size=(0.0, 0.0031))
    lengths = [replace(off, kind="length", id=f"A-{i}") for i in range(100)]
    assert [item.off for item in by_size(result, [off, *lengths])] == [True] + 100 * [False]


def test_an_error_of_exactly_nothing_is_not_reduced(result: CorrectResult) -> None:
    size = result.sizes[0]
    exact = replace(result, sizes=(replace(size, reference=size.size[0], u=0.0),))
    first, grown = exact.warnings
    assert grown.code == "errors-left"
    assert "rms 0 um before" in grown.message
    assert first.facts["quantity"] == "reduction_percent"


def test_errors_that_the_correction_leaves(result: CorrectResult) -> None:
    """A diameter calibrated 0.1 mm too large, of rings that the machine made too small."""
    right = [replace(size, reference=180.0134) for size in result.sizes]
    assert left(result, *right) == []
    wrong = [replace(size, reference=180.1134) for size in result.sizes]
    (warned,) = left(result, *wrong)
    assert warned.code == "errors-left"
    assert warned.facts["mean_um"] == pytest.approx(-100, abs=0.5)
    assert warned.facts["half_width_um"] == pytest.approx(0.82, abs=0.005)
    # Exactly known: whatever is left is beyond it, and nothing is divided by 0.
    (warned,) = left(result, *[replace(size, u=0.0) for size in wrong])
    assert warned.facts["half_width_um"] == 0
    # The worst is the one farthest beyond its uncertainty, not the one that is farthest off.
    far, sure = (
        replace(wrong[0], id=id, u=u, dof=np.inf, size=(180.2134, 180.1134 + off))
        for id, off, u in (("far", 0.05, 0.02), ("sure", 0.04, 0.001))
    )
    (warned,) = left(result, far, sure)
    assert "the mean errors of far, sure exceed" in warned.message
    assert "(sure: 40 um" in warned.message
