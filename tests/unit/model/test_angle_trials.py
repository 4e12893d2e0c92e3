"""Reduced trials of an angle against all errors drawn and two lines laid through them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from model_examples import estimate, model_of, part_of
from scipy import stats
from support import paper_study

from mtu_cli.findings import InputError
from mtu_cli.model.features import feature_points
from mtu_cli.model.measurands import LARGEST_SLOPE, AngleTrials, PointTrials, check_square
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.stats.least_squares import FloatArray

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


def model_of_case(case: Case, *, independent: bool = False) -> AngleTrials:
    given, row, column = case
    return AngleTrials(given, "a", row, column, independent=independent)


def drawn(model: AngleTrials, seed: int, *, plain: bool = False) -> tuple[FloatArray, FloatArray]:
    """`plain`: of all errors, with lines laid through them."""
    rng = np.random.default_rng(seed)
    draws = PointTrials.draw(model, rng, TRIALS) if plain else model.draw(rng, TRIALS)
    assert draws.linear is not None
    return draws.values[0].copy(), draws.linear[0].copy()


@pytest.mark.parametrize("independent", [False, True])
@pytest.mark.parametrize("name", list(CASES))
def test_the_same_distribution_with_fewer_normals(name: str, independent: bool) -> None:
    reduced = model_of_case(CASES[name], independent=independent)
    # One column of the product is of the means.
    assert reduced.product.shape[1] - 1 < reduced.factor.shape[1]
    values, linear = drawn(reduced, 1)
    slow_values, slow_linear = drawn(reduced, 2, plain=True)
    assert stats.ks_2samp(values, slow_values).pvalue > 1e-3
    assert stats.ks_2samp(linear, slow_linear).pvalue > 1e-3
    # What the first-order form leaves is small: of the values alone it would not be seen.
    curved, slow_curved = values - linear, slow_values - slow_linear
    if name == "t" and not independent:
        return
    error = np.hypot(curved.std(), slow_curved.std()) / np.sqrt(TRIALS)
    assert abs(curved.mean() - slow_curved.mean()) < 4.5 * error


@pytest.mark.parametrize("name", list(CASES))
def test_the_first_order_form_is_exactly_what_is_stated(name: str) -> None:
    reduced = model_of_case(CASES[name])
    _, linear = drawn(reduced, 4)
    dof = float(reduced.linear_dof[0])
    law = stats.norm() if np.isinf(dof) else stats.t(dof)
    standard = (linear - reduced.linear_mean[0]) / reduced.linear_u[0, 0]
    assert stats.kstest(standard, law.cdf).pvalue > 1e-3


def test_no_error_at_all_is_no_scatter() -> None:
    reduced = model_of_case(bent(0.0), independent=True)
    values = reduced.draw(np.random.default_rng(7), 100).values
    assert np.ptp(values) == 0.0
    assert values[0, 0] == pytest.approx(reduced.linear_mean[0], rel=1e-9)


# Which rows and columns have an angle that their slopes stand for.


def test_a_line_that_leans_is_told_with_its_path(tmp_path: Path) -> None:
    """Of its height by more than the limit, to -x; the line before it is square."""
    lean = 1.01 * LARGEST_SLOPE
    text = f"""
    features: {{a: {{x_mm: 0, y_mm: 0}}, b: {{x_mm: 200, y_mm: 0}}, c: {{x_mm: 0, y_mm: 300}},
      d: {{x_mm: {-300 * lean}, y_mm: 300}}}}
    orthogonality: [{{id: q, row: [a, b], column: [a, c]}}, {{id: r, row: [a, b], column: [a, d]}}]
    """
    with pytest.raises(InputError, match=r"orthogonality\[1\].column: .* -5.77 degrees off y"):
        check_square(part_of(tmp_path, text), [0, 1])
    check_square(part_of(tmp_path, text), [0])
