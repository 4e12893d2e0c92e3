"""Passes of a mixed model: dense matrices, REML of statsmodels, moments, coverage; their lines."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pass_designs import (
    DRIFT,
    NO_DRIFT,
    UNBALANCED,
    Design,
    balanced,
    dense_covariance,
    dense_variance,
    drawn,
    plain_passes,
)

from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed_model import PassFit, fit_passes


def fitted(design: Design, y: FloatArray, degree: int = 1) -> PassFit:
    return fit_passes(y, design.position, degree, design.group, design.direction)


@pytest.mark.parametrize("name", UNBALANCED)
def test_unbalanced_design_against_dense_matrices(name: str) -> None:
    design = UNBALANCED[name]
    y = drawn(design, np.random.default_rng(2))
    fit, plain = fitted(design, y), plain_passes(design, y)
    np.testing.assert_allclose(fit.pass_coefficients, plain.lines, rtol=1e-9)
    np.testing.assert_allclose(fit.between, plain.S, rtol=1e-9)
    assert fit.s2 == pytest.approx(plain.s2, rel=1e-9)
    assert fit.within_dof == plain.dof
    expected = dense_covariance(design, 1, fit.s2, fit.D_moment)
    np.testing.assert_allclose(fit.covariance, expected, rtol=1e-8)


HALVES = balanced(6).without({(0, i) for i in range(4, 8)} | {(1, i) for i in range(4)})


@pytest.mark.parametrize(
    ("design", "degree", "D"),
    [
        *((design, degree, DRIFT) for design in UNBALANCED.values() for degree in (1, 2, 3)),
        (HALVES, 2, DRIFT),
        (balanced(5).without({(0, i) for i in range(7)}), 1, DRIFT),
        (balanced(5).without({(0, i) for i in range(7)}), 2, DRIFT),
    ],
)
def test_moments_are_unbiased_exactly(design: Design, degree: int, D: FloatArray) -> None:
    """D and s2 are quadratic forms y'Ay: with V = L L' their mean is that over L's columns.

    E y'Ay = tr(A V) = sum_k l_k'A l_k for any mean that the model holds.
    """
    s2 = 0.49
    columns = np.linalg.cholesky(dense_variance(design, s2, D)).T
    fits = [fitted(design, column, degree) for column in columns]
    scale = np.sqrt(np.outer(np.diag(D), np.diag(D)))
    np.testing.assert_allclose(sum(f.D_moment for f in fits) / scale, D / scale, atol=1e-6)
    assert sum(f.s2 for f in fits) == pytest.approx(s2, rel=1e-6)


@settings(derandomize=True, deadline=None, database=None, max_examples=25)
@given(
    st.sampled_from(sorted(UNBALANCED)),
    st.sampled_from([1e-9, 4.8e-6, 1e-3, 1e6]),
    st.sampled_from([1e-3, 0.7, 25.4]),
    st.integers(0, 10**6),
)
def test_units_order_and_names_of_passes_do_not_matter(
    name: str, unit: float, length: float, seed: int
) -> None:
    design = UNBALANCED[name]
    rng = np.random.default_rng(seed)
    y = drawn(design, rng)
    fit = fitted(design, y)
    order = rng.permutation(len(y))
    names = rng.permutation(100)[: design.n_passes]
    other = fit_passes(
        unit * y[order],
        length * design.position[order],
        1,
        names[design.group[order]],
        design.direction[order],
    )
    U = unit * np.diag([1.0, 1 / length])
    np.testing.assert_allclose(other.D, U @ fit.D @ U, rtol=1e-6, atol=0)
    np.testing.assert_allclose(other.D_moment, U @ fit.D_moment @ U, rtol=1e-6, atol=0)
    np.testing.assert_allclose(other.covariance, U @ fit.covariance @ U, rtol=1e-6)
    np.testing.assert_allclose(other.plain.coefficients, U @ fit.plain.coefficients, rtol=1e-8)
    assert other.s2 == pytest.approx(unit**2 * fit.s2, rel=1e-9)


def test_what_is_not_a_covariance_falls_back_to_the_clipped_drift() -> None:
    """Hardly any drift on a lopsided design: the moment C may be indefinite, ours never is."""
    rng = np.random.default_rng(41)
    replaced = 0
    for _ in range(60):
        fit = fitted(HALVES, drawn(HALVES, rng, NO_DRIFT), 2)
        moment = dense_covariance(HALVES, 2, fit.s2, fit.D_moment)
        clipped = dense_covariance(HALVES, 2, fit.s2, fit.D)
        unit = np.sqrt(np.diag(clipped))
        lowest = np.linalg.eigvalsh(moment / np.outer(unit, unit)).min()
        assert np.linalg.eigvalsh(fit.covariance / np.outer(unit, unit)).min() > -1e-9
        if abs(lowest) < 1e-6:
            continue
        wanted = moment if lowest > 0 else clipped
        np.testing.assert_allclose(
            fit.covariance / np.outer(unit, unit), wanted / np.outer(unit, unit), atol=1e-7
        )
        replaced += lowest < 0
    assert 5 < replaced < 60


@pytest.mark.parametrize(
    ("s_level", "s_slope"), [(2.0, 3.0), (0.5, 0.0)], ids=["large", "near repeatability"]
)
def test_intervals_of_unbalanced_passes_cover(s_level: float, s_slope: float) -> None:
    """95 % intervals of level and slope by Student's t with the passes' degrees of freedom, of
    1000 tables of eight passes from which readings are missing: 93 to 97 %.
    """
    rng = np.random.default_rng(20261128)
    truth, passes = np.array([1.0, -2.0]), 8
    place = np.tile(np.linspace(-1.0, 1.0, 9), passes)
    group = np.repeat(np.arange(passes), 9)
    inside = np.zeros(2)
    for _ in range(1000):
        own = rng.normal(size=(2, passes)) * [[s_level], [s_slope]]
        y = truth[0] + own[0, group] + (truth[1] + own[1, group]) * place
        y += rng.normal(size=len(y))
        # Both ends stay, so that every pass has a slope of its own.
        kept = (rng.random(len(y)) < 0.7) | (np.abs(place) == 1.0)
        fit = fit_passes(y[kept], place[kept], 1, group[kept])
        k = coverage_factor(0.95, fit.pass_dof)
        away = np.abs(fit.plain.coefficients - truth)
        inside += away <= k * np.sqrt(np.diag(fit.covariance))
    assert (np.abs(inside / 1000 - 0.95) <= 0.02).all(), inside
