"""The scatter of measured points against a plain likelihood, what it adds to u, and the form left
over: the stated rate of false alarms, and an angle that the model lacks.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from correct_examples import (
    DIAMETER,
    ROUNDING,
    error_at,
    machine,
    ring_part,
    ring_places,
    ring_points,
    seen,
)
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import binom

from mtu_cli.analyses.correct import CorrectResult, correct
from mtu_cli.analyses.correct.scatter import (
    FormLeft,
    PointScatter,
    Ring,
    Squares,
    _estimate,
    forms_left,
    unexplained,
)
from mtu_cli.model.geometry import fit_circle
from mtu_cli.model.settings import Settings

Floats = NDArray[np.float64]
NOISE = 1e-3


def ring(points: Floats, K: Floats | None = None, dof: float = np.inf) -> Ring:
    """A calibrated circle through points (n, 2) with the modelled covariance K along its radii."""
    fit, n = fit_circle(points), len(points)
    away = np.column_stack([fit.away, np.zeros(n)])
    covariance = np.zeros((n, n)) if K is None else K
    return Ring(
        kind="circle", id="a", operation="", calibrated=True, residuals=fit.residuals, away=away,
        K=covariance, dof=dof,
    )  # fmt: skip


def estimate(squares: Squares) -> PointScatter:
    return _estimate(squares, "form")


def test_unlike_squares_give_the_largest_likelihood() -> None:
    rng = np.random.default_rng(3)
    modelled, dof = rng.uniform(0, 4, 40), rng.integers(1, 4, 40).astype(float)
    sums = (modelled + 1.5) * rng.chisquare(dof)

    def plain(variance: float) -> float:
        each = modelled + variance
        return float(np.sum(dof * np.log(each) + sums / each))

    best = minimize_scalar(plain, bounds=(0, 20), method="bounded", options={"xatol": 1e-10})
    found = estimate(Squares(sums=sums * 1e-6, dof=dof, modelled=modelled * 1e-6))
    # A minimum is flat: its place is found to some roots of the rounding of its value.
    place = 10 * np.sqrt(np.finfo(float).eps)
    assert found.variance == pytest.approx(best.x * 1e-6, rel=place)


@pytest.mark.parametrize("repeats", [1, 2])
def test_the_scatter_of_rings_is_found(tmp_path: Path, repeats: int) -> None:
    """40 rings with 2 um on every coordinate, besides 0.4 and 0.5 um that the model knows."""
    rng = np.random.default_rng(5)
    n, places = 20 * repeats, np.tile(ring_places(diameter=DIAMETER), (20, 1))
    visit = rng.standard_normal(places.shape) * [0.4e-3, 0.5e-3, 0]
    measured = np.tile(
        (seen(places, error_at, np.full(220, 20.0)) + visit).reshape(20, 1, 11, 3),
        (1, repeats, 1, 1),
    ).reshape(-1, 3)
    measured = measured + 2e-3 * rng.standard_normal(measured.shape)
    points = ring_points(
        measured,
        [str(i // repeats) for i in range(n)],
        [1 + i % repeats for i in range(n)],
        {"T_scale_degC": np.full(11 * n, 20.0)},
    )
    result = correct(machine(tmp_path), ring_part(tmp_path), points, Settings())
    scatter = result.scatter
    assert scatter is not None
    assert scatter.origin == ("form" if repeats == 1 else "repeats")
    assert scatter.dof == (160 if repeats == 1 else 440)
    # The standard error of a standard deviation of nu degrees of freedom is its 1/sqrt(2 nu).
    assert scatter.s == pytest.approx(2e-3, rel=4 / np.sqrt(2 * scatter.dof))
    more = result.u_corrected[:, :2] ** 2 - result.u[:, :2] ** 2
    assert more == pytest.approx(np.full((11 * n, 2), scatter.variance), rel=ROUNDING)
    assert [item.code for item in result.warnings] == []


def noisy(rng: np.random.Generator, visits: int, K: Floats | None = None) -> list[Ring]:
    """Visits of one round ring, on a machine that shifts its points by K in all of them."""
    true = ring_places()[:, :2]
    shift = np.zeros(11) if K is None else rng.multivariate_normal(np.zeros(11), K)
    moved = true + shift[:, None] * (true - [200.0, 180.0]) / 90.0
    return [ring(moved + NOISE * rng.standard_normal((11, 2)), K) for _ in range(visits)]


def repeats_of(rng: np.random.Generator, dof: float) -> PointScatter:
    """The variance of the points as repeats of so many degrees of freedom estimate it."""
    variance = NOISE**2 * (rng.chisquare(dof) / dof)
    return PointScatter(variance=variance, spread=0.0, dof=dof, origin="repeats")


@pytest.mark.parametrize(("dof", "oval"), [(None, 2.0), (8.0, 0.0)])
def test_p_of_a_round_ring_is_uniform(dof: float | None, oval: float) -> None:
    """By repeats and by visits; exact of noise alone, on the safe side beside a modelled oval."""
    rng, runs = np.random.default_rng(6), 1500
    angle = 2 * np.pi * np.arange(11) / 11
    K = None if not oval else (oval * NOISE) ** 2 * np.outer(np.cos(2 * angle), np.cos(2 * angle))
    p = []
    for _ in range(runs):
        scatter = None if dof is None else repeats_of(rng, dof)
        (form,) = forms_left(noisy(rng, 1 if dof else 3, K), scatter)
        p.append(form.p)
    for level in (0.05, 0.2):
        below = np.sum(np.array(p) < level)
        assert below <= binom.ppf(1 - 1e-4, runs, level)
        assert oval or below >= binom.ppf(1e-4, runs, level)


def test_a_form_is_tested_where_its_scatter_is_known_by_something_else() -> None:
    rng = np.random.default_rng(7)
    one = noisy(rng, 1)
    assert forms_left(one, None) == ()
    assert forms_left(one, PointScatter(variance=1.0, spread=0, dof=8, origin="form")) == ()
    assert forms_left([ring(ring_places()[:3, :2])] * 2, None) == ()
    # Without any scatter a form of rounding is none, and a true one certain.
    squashed = ring_places()[:, :2] * [1.0, 1 - 1e-5]
    for places, certain in ((ring_places()[:, :2], False), (squashed, True)):
        (form,) = forms_left([ring(places)] * 2, None)
        assert (form.p < 1e-6) is certain


def test_rings_are_judged_together_where_they_are_calibrated() -> None:
    def form(id: str, p: float, *, calibrated: bool = True) -> FormLeft:
        return FormLeft(
            kind="circle", id=id, operation="", calibrated=calibrated, visits=2, rms=1.0,
            explained=1.0, F=1.0, p=p,
        )  # fmt: skip

    known = [form("a", 0.02), form("b", 0.03), form("made", 1e-9, calibrated=False)]
    assert [item.id for item in unexplained(known)] == ["a"]


@pytest.mark.parametrize("angle", [0.0, 50e-6])
def test_a_squareness_that_the_model_lacks_is_left_as_form(tmp_path: Path, angle: float) -> None:
    """Two parts read twice; 50 urad on a ring of 180 mm make an ellipse of 4.5 um."""
    rng = np.random.default_rng(1)
    true, T = np.tile(ring_places(diameter=DIAMETER), (4, 1)), np.full(44, 21.0)
    lacking = np.zeros((3, 3))
    lacking[1, 0] = angle
    measured = seen(true, lambda p, t: error_at(p, t) + p @ lacking, T)
    measured[:, :2] += 5e-4 * rng.standard_normal((44, 2))
    points = ring_points(measured, ["p", "p", "q", "q"], [1, 2, 1, 2], {"T_scale_degC": T})
    result = correct(machine(tmp_path), ring_part(tmp_path), points, Settings())
    (form,) = result.forms
    assert (form.id, form.visits) == ("ring", 4)
    assert codes_of(result) == (["form-left"] if angle else [])
    # Residuals of (r angle/2) sin 2 phi; what the model and probing explain is below 1 um.
    expected = DIAMETER / 4 * angle * np.sqrt(11 / 8 / 2)
    assert form.rms == pytest.approx(expected, abs=0.5e-3)
    assert form.explained < 1e-3


def codes_of(result: CorrectResult) -> list[str]:
    return [item.code for item in result.warnings]
