"""Reduced trials of an angle against all errors drawn and two lines laid through them."""

from __future__ import annotations

import numpy as np
import pytest
from model_examples import FloatArray, estimate, model_of
from scipy import stats
from support import paper_study

from mtu_cli.analyses.orthogonality import angle_trials, plain_angle_trials
from mtu_cli.model.features import feature_points
from mtu_cli.model.measurands import AngleTrials, contrasts
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.trials import PointTrials

TRIALS = 200_000
Case = tuple[Prediction, list[str], list[str]]


def of_paper() -> Case:
    study = paper_study()
    entry = study.part.part.orthogonality[0]
    ids, points, _ = feature_points(study.part, study.model, [*entry.row, *entry.column])
    return predict(study.model, ids, points), list(entry.row), list(entry.column)


def bent(size: float, dof: float = 1e9) -> Case:
    """Four features a line a few millimetres apart, errors of that size: far from linear."""
    row = np.array([[0.0, 0], [3, 0.02], [6, -0.01], [10, 0.03]])
    column = np.array([[0.0, 0], [-0.02, 4], [0.01, 7], [0.02, 9]])
    places = np.vstack([row, column[1:]])
    D = np.array([[0.04, 0.001], [0.001, 4e-4]]) * size**2
    a = estimate("a", "x", [0.3, -0.01], D=D, s=0.3 * size, pass_dof=dof, repeat_dof=dof)
    b = estimate("b", "y", [0.1], D=np.array([[0.03]]) * size**2, s=0.2 * size, repeat_dof=dof)
    model = model_of([(a, {"x": "1", "y": "-0.4"}), (b, {"x": "0.5", "y": "1 + y/20"})])
    given = predict(model, list("abcdefg"), np.column_stack([places, np.zeros(7)]))
    return given, list("abcd"), list("aefg")


def disjoint(case: Case) -> Case:
    """Without a feature that both lines have, nothing of them is common but the machine."""
    given, _, _ = case
    return given, list("abc"), list("efg")


CASES = {
    "paper": of_paper(),
    "bent": bent(1.0),
    "disjoint": disjoint(bent(1.0)),
    "t": bent(0.7, dof=6.0),
}


def both(case: Case, independent: bool) -> tuple[AngleTrials, PointTrials]:
    given, row, column = case
    return (
        angle_trials("a", row, column, given, independent=independent),
        plain_angle_trials("a", row, column, given, independent=independent),
    )


def drawn(model: AngleTrials | PointTrials, seed: int) -> tuple[FloatArray, FloatArray]:
    draws = model.draw(np.random.default_rng(seed), TRIALS)
    assert draws.linear is not None
    return draws.values[0].copy(), draws.linear[0].copy()


@pytest.mark.parametrize("independent", [False, True])
@pytest.mark.parametrize("name", list(CASES))
def test_the_same_distribution_with_fewer_normals(name: str, independent: bool) -> None:
    reduced, plain = both(CASES[name], independent)
    assert reduced.drawn + 1 < plain.factor.shape[1]
    values, linear = drawn(reduced, 1)
    slow_values, slow_linear = drawn(plain, 2)
    assert stats.ks_2samp(values, slow_values).pvalue > 1e-3
    assert stats.ks_2samp(linear, slow_linear).pvalue > 1e-3
    # What the first-order form leaves is small: of the values alone it would not be seen.
    curved, slow_curved = values - linear, slow_values - slow_linear
    if name == "t" and not independent:
        return
    error = np.hypot(curved.std(), slow_curved.std()) / np.sqrt(TRIALS)
    assert abs(curved.mean() - slow_curved.mean()) < 4.5 * error


@pytest.mark.parametrize("independent", [False, True])
@pytest.mark.parametrize("name", list(CASES))
def test_given_the_coordinates_along_the_moments_are_those_of_the_covariance(
    name: str, independent: bool
) -> None:
    """E and sd of dtheta given u by textbook conditioning of the whole covariance (Schur)."""
    case = CASES[name]
    reduced, plain = both(case, independent)
    given, row, column = case
    F = plain.factor[: plain.k]
    covariance = F @ F.T
    n, c = len(row) - 1, len(column) - 1
    along = np.r_[0:n, 2 * n : 2 * n + c]
    across = np.r_[n : 2 * n, 2 * n + c : 2 * n + 2 * c]
    place = {name: given.points[given.ids.index(name)] for name in (*row, *column)}
    H = contrasts(len(row)), contrasts(len(column))
    design = np.concatenate(
        [
            H[0] @ [place[i][0] for i in row], H[0] @ [place[i][1] for i in row],
            H[1] @ [place[i][1] for i in column], H[1] @ [place[i][0] for i in column],
        ]
    )  # fmt: skip
    mean = design + plain.offset[: plain.k, 0]
    gain = covariance[np.ix_(across, along)] @ np.linalg.pinv(
        covariance[np.ix_(along, along)], rcond=1e-13, hermitian=True
    )
    left = covariance[np.ix_(across, across)] - gain @ covariance[np.ix_(along, across)]
    rng = np.random.default_rng(3)
    for _ in range(5):
        z = rng.standard_normal(reduced.drawn)
        u = mean[along] + moved_along(reduced, plain, along, z)
        expected_v = mean[across] + gain @ (u - mean[along])
        w = np.concatenate([u[:n] / (u[:n] @ u[:n]), u[n:] / (u[n:] @ u[n:])])
        square = slope_of(design[:n], design[n : 2 * n])
        square += slope_of(design[2 * n : 2 * n + c], design[2 * n + c :])
        wanted = -(w @ expected_v) + square
        spread = np.sqrt(w @ left @ w)
        low, high = (at_normals(reduced, np.append(z, e)) for e in (-1.0, 1.0))
        assert (low + high) / 2 == pytest.approx(wanted, rel=1e-8, abs=1e-7 * spread)
        assert (high - low) / 2 == pytest.approx(spread, rel=1e-6)


def slope_of(along: FloatArray, across: FloatArray) -> float:
    return float(along @ across / (along @ along))


def moved_along(
    reduced: AngleTrials, plain: PointTrials, along: FloatArray, z: FloatArray
) -> FloatArray:
    """u less its mean at the normals z behind them."""
    F = plain.factor[along]
    _, size, W = np.linalg.svd(F, full_matrices=False)
    W = W[size > 1e-12 * size[0]]
    assert len(W) == reduced.drawn
    moved: FloatArray = F @ W.T @ z
    return moved


class Given(np.random.Generator):
    """A generator that hands out the normals it is given, and a scale of 1."""

    def __init__(self, normals: FloatArray, dof: float) -> None:
        super().__init__(np.random.PCG64(0))
        self.left, self.dof = list(normals), dof

    def standard_normal(self, *args: object, out: FloatArray, **kwargs: object) -> None:  # type: ignore[override]  # only what the trials use
        out[..., 0] = [self.left.pop(0) for _ in out] if out.ndim > 1 else self.left.pop(0)

    def standard_gamma(self, *args: object, out: FloatArray, **kwargs: object) -> None:  # type: ignore[override]  # chi^2 equal to its degrees of freedom
        out[:] = self.dof / 2


def at_normals(reduced: AngleTrials, normals: FloatArray) -> float:
    rng = Given(normals, float(reduced.linear_dof[0]))
    return float(reduced.draw(rng, 1).values[0, 0])


@pytest.mark.parametrize("name", list(CASES))
def test_the_first_order_form_is_exactly_what_is_stated(name: str) -> None:
    reduced, _ = both(CASES[name], False)
    _, linear = drawn(reduced, 4)
    dof = float(reduced.linear_dof[0])
    law = stats.norm() if np.isinf(dof) else stats.t(dof)
    standard = (linear - reduced.linear_mean[0]) / reduced.linear_u[0, 0]
    assert stats.kstest(standard, law.cdf).pvalue > 1e-3


def test_no_error_at_all_is_no_scatter() -> None:
    given, row, column = bent(0.0)
    reduced = angle_trials("a", row, column, given, independent=True)
    values = reduced.draw(np.random.default_rng(7), 100).values
    assert np.ptp(values) == 0.0
    assert values[0, 0] == pytest.approx(reduced.linear_mean[0], rel=1e-9)


def test_contrasts_keep_sums_of_products() -> None:
    rng = np.random.default_rng(8)
    for n in (2, 3, 7, 20):
        u, v = rng.normal(size=(2, n))
        H = contrasts(n)
        assert H.shape == (n - 1, n)
        assert (H @ u) @ (H @ v) == pytest.approx((u - u.mean()) @ (v - v.mean()))
