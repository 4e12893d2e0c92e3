"""The scatter of measured points: against a plain likelihood, and what it adds to u."""

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
from scipy.optimize import minimize_scalar

from mtu_cli.analyses.correct import correct
from mtu_cli.analyses.correct.scatter import PointScatter, Squares, point_scatter, ring_squares
from mtu_cli.model.geometry import fit_circle
from mtu_cli.model.settings import Settings
from mtu_cli.stats.coverage import welch_satterthwaite


def estimate(squares: Squares) -> PointScatter:
    none = np.full((11, 3), np.nan)
    found = point_scatter(ring_points(ring_places(), ["a"]), none, none, [squares])
    assert found is not None
    return found


def test_alike_squares_give_observed_less_modelled() -> None:
    squares = Squares(
        sums=np.array([9.0, 3.0, 6.0]) * 1e-6, dof=np.ones(3), modelled=np.full(3, 2e-6)
    )
    found = estimate(squares)
    assert found.variance == pytest.approx(4e-6)
    # Half the variance of a mean square of 6e-6 with 3 degrees of freedom.
    assert found.spread == pytest.approx(36e-12 / 3)
    assert (found.dof, found.origin) == (3, "form")
    less = Squares(sums=squares.sums / 9, dof=squares.dof, modelled=squares.modelled)
    assert estimate(less).variance == 0


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


def test_directions_of_a_ring_leave_out_centre_and_radius() -> None:
    """Without a model the squares are the residuals' own; modelled ovality is taken off."""
    rng = np.random.default_rng(4)
    points = ring_places()[:, :2] + 1e-3 * rng.standard_normal((11, 2))
    fit = fit_circle(points)
    away = np.zeros((11, 3))
    away[:, :2] = (points - fit.centre) / np.linalg.norm(points - fit.centre, axis=1)[:, None]
    plain = ring_squares(fit.residuals, away, np.zeros((11, 11)), 2)
    assert plain is not None
    assert len(plain.sums) == 8
    # The residuals are orthogonal to centre and radius at the minimum.
    assert plain.sums.sum() == pytest.approx((fit.residuals**2).sum(), rel=ROUNDING)
    oval = np.cos(2 * np.arctan2(away[:, 1], away[:, 0]))
    modelled = ring_squares(fit.residuals, away, 7e-6 * np.outer(oval, oval), 2)
    assert modelled is not None
    # One direction, with what least squares leaves of it.
    X = np.column_stack([away[:, :2], np.ones(11)])
    left = oval - X @ np.linalg.lstsq(X, oval, rcond=None)[0]
    assert modelled.modelled.max() == pytest.approx(7e-6 * left @ left)
    assert np.sort(modelled.modelled)[:-1] == pytest.approx(np.zeros(7), abs=7e-6 * ROUNDING)
    assert ring_squares(fit.residuals[:3], away[:3], np.eye(3), 2) is None


def test_u_and_dof_are_those_of_a_sum_of_variances() -> None:
    found = PointScatter(variance=4e-6, spread=16e-12 / 8, dof=8, origin="form")
    u, dof = found.added(np.array([1e-3, 2e-3]), np.array([5.0, np.inf]), 0.5)
    assert u**2 == pytest.approx([3e-6, 6e-6])
    assert dof[0] == pytest.approx(welch_satterthwaite(np.array([1.0, 2.0]), np.array([5.0, 8.0])))
    assert dof[1] == pytest.approx(8 * 9)


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
