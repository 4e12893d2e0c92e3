"""Runs there and back: their mean squares by statsmodels, by dense matrices, and by simulation."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from numpy.typing import NDArray
from pass_designs import DRIFT, NO_DRIFT, Design, balanced, dense_covariance, drawn
from scipy.special import stdtrit

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed_model import PassFit, fit_passes

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    # statsmodels ships no types.

IntArray = NDArray[np.int64]

WARM = np.array([[9.0, 0.01], [0.01, 4e-4]])


def in_runs(design: Design) -> IntArray:
    """The run (n,) of each reading: two passes follow each other, there and back."""
    found: IntArray = design.group // 2
    return found


def each_way(design: Design, y: FloatArray, degree: int = 1) -> PassFit:
    runs = in_runs(design)
    return fit_passes(y, design.position, degree, design.group, design.direction, runs)


def warm(design: Design, rng: np.random.Generator, K: FloatArray) -> FloatArray:
    """What both directions of a run share at every reading: a level and a slope of covariance K."""
    run = in_runs(design)
    shared = rng.multivariate_normal(np.zeros(2), K, size=int(run.max()) + 1)[run]
    found: FloatArray = shared[:, 0] + shared[:, 1] * (design.position - design.position.mean())
    return found


MISSING = {
    "readings missing": balanced(10, both=True).without({(0, 5), (1, 1), (1, 2), (4, 0)}),
    "one broke off": balanced(10, both=True).without({(3, i) for i in range(1, 8)}),
    "a pass without fellow": balanced(11, both=True),
}


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("name", MISSING)
def test_unbalanced_runs_against_dense_matrices(name: str, degree: int) -> None:
    """Every reading's covariance with every other written out: D within a pass, K within a run."""
    design = MISSING[name]
    rng = np.random.default_rng(3)
    y = drawn(design, rng, 3 * DRIFT, reversal=3.0) + warm(design, rng, 0.3 * WARM)
    fit = each_way(design, y, degree)
    kept = fit.groups
    runs, signs = kept // 2, fit.group_direction
    both = [r for r in np.unique(runs) if (runs == r).sum() == 2]
    place = [[np.flatnonzero((runs == r) & (signs == s))[0] for s in (1, -1)] for r in both]
    there, back = (fit.pass_coefficients[[pair[i] for pair in place]] for i in (0, 1))
    K = (there - there.mean(axis=0)).T @ (back - back.mean(axis=0)) / (len(both) - 1)
    K = (K + K.T) / 2
    # Nothing is cut here.
    assert np.abs(np.linalg.eigvals(np.linalg.solve(fit.between, K))).max() < 1
    c = design.position.mean()
    X = np.stack([design.position**k for k in range(degree + 1)], axis=1)
    Z = np.column_stack([np.ones(len(y)), design.position - c])
    fellows = (in_runs(design)[:, None] == in_runs(design)) & (
        design.group[:, None] != design.group
    )
    H = np.linalg.inv(X.T @ X) @ X.T
    wanted = dense_covariance(design, degree, fit.s2, fit.D_moment)
    wanted = wanted + H @ np.where(fellows, Z @ K @ Z.T, 0.0) @ H.T
    scale = np.sqrt(np.diag(wanted))
    scaled = np.outer(scale, scale)
    np.testing.assert_allclose(fit.covariance / scaled, wanted / scaled, atol=1e-6)


@pytest.mark.parametrize(
    ("own", "shared"),
    [(NO_DRIFT, NO_DRIFT), (DRIFT, NO_DRIFT), (NO_DRIFT, WARM), (0.3 * DRIFT, 0.3 * WARM)],
    ids=["no drift", "own", "shared", "some of both"],
)
def test_intervals_cover_whatever_directions_share(own: FloatArray, shared: FloatArray) -> None:
    """95 % intervals with t of pass_dof hold the truth in 95 % of 600 simulated fits."""
    design = balanced(10, both=True)
    rng = np.random.default_rng(31)
    truth, at = np.array([3.0, -0.02]), np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 185.0]])
    hits = np.zeros(3)
    for _ in range(600):
        y = drawn(design, rng, own, reversal=3.0) + warm(design, rng, shared)
        fit = each_way(design, y)
        u = np.sqrt(np.einsum("ij,jk,ik->i", at, fit.covariance, at))
        hits += np.abs(at @ (fit.plain.coefficients - truth)) <= stdtrit(fit.pass_dof, 0.975) * u
    assert (np.abs(hits / 600 - 0.95) < 3.3 * np.sqrt(0.95 * 0.05 / 600)).all()
