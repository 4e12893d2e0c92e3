"""Rings that stay oval: strains against those put in, and how often chance makes one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from correct_examples import DIAMETER, error_at, machine, ring_part, ring_places, ring_points, seen
from numpy.typing import NDArray
from scipy.stats import binom

from mtu_cli.analyses.correct import CorrectResult, correct
from mtu_cli.analyses.correct.result import Size
from mtu_cli.analyses.correct.roundness import Oval, Strain, ovals, strain_of
from mtu_cli.analyses.correct.scatter import PointScatter
from mtu_cli.model.geometry import fit_circle, fit_sphere
from mtu_cli.model.settings import Settings
from mtu_cli.reports.correct import warnings

Floats = NDArray[np.float64]
NOISE = 1e-3
ALPHA = 0.05


def strain(points: Floats, K: Floats | None = None) -> Strain:
    """Of a circle (n, 2) or sphere (n, 3)."""
    sphere = points.shape[1] == 3
    fit = (fit_sphere if sphere else fit_circle)(points)
    away = np.zeros((len(points), 3))
    away[:, : points.shape[1]] = points - fit.centre
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    covariance = np.zeros((len(points), len(points))) if K is None else K
    found = strain_of(
        "sphere" if sphere else "circle", "a", fit.radius, fit.residuals, away, covariance
    )
    assert found is not None
    return found


def strained(points: Floats, E: Floats) -> Floats:
    return points + points @ E


@pytest.mark.parametrize("d", [2, 3])
def test_a_strain_is_that_put_in(d: int) -> None:
    rng = np.random.default_rng(3)
    away = rng.standard_normal((40, d))
    points = 50.0 * away / np.linalg.norm(away, axis=1, keepdims=True)
    E = rng.normal(0.0, 1e-5, (d, d))
    E = 0.5 * (E + E.T)
    found = strain(strained(points, E))
    assert found.shown == (2 if d == 2 else 5)
    # All but what makes the radius larger, which is the trace; second order 1e-5.
    own = E - np.trace(E) / d * np.eye(d)
    whole = np.zeros((3, 3))
    whole[:d, :d] = own
    expected = [*np.diag(whole), whole[0, 1], whole[0, 2], whole[1, 2]]
    assert found.value == pytest.approx(expected, abs=1e-3 * np.abs(own).max())


def test_the_covariance_is_that_of_points_that_scatter_and_of_the_model() -> None:
    """Of a ring of uneven points, by the residuals' own propagation in many draws."""
    rng = np.random.default_rng(5)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 9))
    points = 40.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    spread = rng.standard_normal((9, 9)) * NOISE
    K = spread @ spread.T
    draws, unit = 4000, points / 40.0
    rows = rng.standard_normal((draws, 9, 1))
    values = [strain(points + spread @ row * unit, K).value for row in rows]
    found = strain(points, K)
    seen_covariance = np.cov(np.array(values).T)
    scale = np.abs(found.modelled).max()
    # Five standard errors of a variance among 4000.
    assert seen_covariance == pytest.approx(found.modelled, abs=5 * np.sqrt(2 / draws) * scale)
    plain = strain(points, np.eye(9))
    assert plain.modelled == pytest.approx(plain.scattered)


def judged(points: Floats, scatter: PointScatter | None, rings: int = 1) -> tuple[Oval, ...]:
    sizes = correct_sizes()
    return ovals([strain(p) for p in np.split(points, rings)], sizes, scatter)


def correct_sizes() -> list[Size]:
    """A size with the machine's u known for sure."""
    return [
        Size(
            kind="circle", id="a", part="p", operation="", repeat=None, temperature=np.nan,
            size=(80.0, 80.0), form=(0.0, 0.0), reference=80.0, U_reference=np.nan, u=0.0,
            dof=np.inf, points=12, sensitivity=1.0,
        )
    ]  # fmt: skip


TWELVE = 40.0 * np.column_stack([f(2 * np.pi * np.arange(12) / 12) for f in (np.cos, np.sin)])


@pytest.mark.parametrize("origin", ["repeats", "form"])
def test_a_round_ring_is_called_oval_as_often_as_stated(origin: str) -> None:
    runs, rng = 600, np.random.default_rng(8)
    known = PointScatter(variance=NOISE**2, spread=0.0, dof=np.inf, origin="repeats")
    called = 0
    for _ in range(runs):
        points = TWELVE + NOISE * rng.standard_normal((12, 2))
        scatter = known if origin == "repeats" else replace(known, origin="form")
        called += bool(judged(points, scatter))
    assert binom.ppf(1e-3, runs, ALPHA) <= called <= binom.ppf(1 - 1e-3, runs, ALPHA)


def test_what_repeats_share_is_told_by_their_mean() -> None:
    """A strain of half the points' scatter: in the mean of sixteen repeats it is eight of it."""
    rng = np.random.default_rng(9)
    E = np.array([[0.0, 1.0], [1.0, 0.0]]) * 0.25 * NOISE / 40.0
    known = PointScatter(variance=NOISE**2, spread=0.0, dof=np.inf, origin="repeats")
    many = np.concatenate(
        [strained(TWELVE, E) + NOISE * rng.standard_normal((12, 2)) for _ in range(64)]
    )
    (found,) = judged(many, known, 64)
    assert found.shear
    assert found.axes == ("x", "y")
    assert judged(many[:12], known) == ()
    # The rest of one ring's form is in every repeat.
    assert judged(many, replace(known, origin="form"), 64) == ()
    assert judged(many, None, 64) == ()


def test_four_points_that_show_no_rest_are_no_oval_by_their_form_alone() -> None:
    four = strained(TWELVE[::3], np.diag([1e-3, 0.0]))
    own = strain(four)
    assert own.shown == 1
    assert own.rest is None
    assert ovals([own], correct_sizes(), None) == ()


def lacking(folder: Path, strain_at: Floats) -> CorrectResult:
    """Two parts on a machine with an error that its model lacks, read twice each."""
    rng = np.random.default_rng(1)
    true = np.tile(ring_places(diameter=DIAMETER), (4, 1))
    T = np.full(44, 21.0)
    measured = seen(true, lambda p, t: error_at(p, t) + p @ strain_at, T)
    measured[:, :2] += 5e-4 * rng.standard_normal((44, 2))
    points = ring_points(
        measured, ["p", "p", "q", "q"], [1, 2, 1, 2], covariates={"T_scale_degC": T}
    )
    return correct(machine(folder), ring_part(folder), points, Settings())


@pytest.mark.parametrize(
    ("angle", "longer"), [(200e-6, "along x + y than along x - y"),
                          (-200e-6, "along x - y than along x + y")],
)  # fmt: skip
def test_a_squareness_that_the_model_lacks_is_told(
    tmp_path: Path, angle: float, longer: str
) -> None:
    strain_at = np.zeros((3, 3))
    strain_at[1, 0] = angle
    found = lacking(tmp_path, strain_at)
    (oval,) = found.ovals
    assert abs(oval.size) == pytest.approx(abs(angle), rel=0.05)
    assert oval.longer == pytest.approx(DIAMETER * abs(angle), rel=0.05)
    (told,) = (w for w in warnings(found) if w.code == "oval-left")
    assert longer in told.message
    assert "a squareness of x and y of 41 arcsec" in told.message


@pytest.mark.parametrize("axis", [0, 1])
def test_a_scale_that_the_model_lacks_is_told(tmp_path: Path, axis: int) -> None:
    strain_at = np.zeros((3, 3))
    strain_at[axis, axis] = 300e-6
    found = lacking(tmp_path, strain_at)
    (told,) = (w for w in warnings(found) if w.code == "oval-left")
    longer, shorter = ("x", "y") if axis == 0 else ("y", "x")
    assert f"54 um longer along {longer} than along {shorter}" in told.message
    assert "a scale of x or y, 300 um/m between them" in told.message


def test_a_machine_that_its_model_describes_leaves_a_ring_round(tmp_path: Path) -> None:
    found = lacking(tmp_path, np.zeros((3, 3)))
    assert found.ovals == ()
    assert "oval-left" not in [w.code for w in warnings(found)]


def test_a_ring_without_calibration_may_be_as_oval_as_it_was_made(tmp_path: Path) -> None:
    strain_at = np.zeros((3, 3))
    strain_at[1, 0] = 200e-6
    rng = np.random.default_rng(1)
    true = np.tile(ring_places(diameter=DIAMETER), (2, 1))
    T = np.full(22, 21.0)
    measured = seen(true, lambda p, t: error_at(p, t) + p @ strain_at, T)
    measured[:, :2] += 5e-4 * rng.standard_normal((22, 2))
    points = ring_points(measured, ["p", "q"], covariates={"T_scale_degC": T})
    part = ring_part(tmp_path, calibrated_mm="")
    assert correct(machine(tmp_path), part, points, Settings()).ovals == ()
