"""Lengths: by hand, against counted parts, with bounds of what was not measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from model_examples import estimate, model_of, part_of, stated
from scipy import stats

from mtu_cli.analyses.predictions import LengthsResult, predict_lengths
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.settings import Settings
from mtu_cli.reports.fields import RowOf, rows_of

FAST = Settings(trials=20_000, threads=1)
PART = """
features: {a: {x_mm: 0, y_mm: 0}, b: {x_mm: 100, y_mm: 0}, c: {x_mm: 70, y_mm: 90}}
lengths: [{from: a, to: b, tolerance_um: 9}, {from: b, to: c}, {from: c, to: a, tolerance_um: 4}]
"""


def each(found: LengthsResult) -> list[RowOf]:
    """The lengths one by one."""
    return rows_of(found, len(found.ids))


def machine(s: float = 2e-3, dof: float = np.inf) -> MachineModel:
    scale = estimate(
        "sx",
        "x",
        [1e-3, 2e-5],
        C=np.array([[1e-6, 0], [0, 4e-10]]),
        D=np.array([[4e-6, -2e-9], [-2e-9, 9e-10]]),
        s=s,
        pass_dof=dof,
        repeat_dof=np.inf if np.isinf(dof) else 50.0,
    )
    angle = estimate("t", None, [1e-5], D=np.array([[9e-10]]), pass_dof=dof)
    return model_of([(scale, {"x": "1", "y": "0.3"}), (angle, {"x": "-y", "y": "x"})])


def test_a_length_by_hand(tmp_path: Path) -> None:
    model = stated(
        tmp_path,
        """
        components:
          sx: {of: x, unit: um, coefficients: [1.0, 0.02], s_repeat: 2.0,
               covariance: [[1.0, 0.0], [0.0, 4.0e-4]],
               pass_covariance: [[4.0, 0.0], [0.0, 9.0e-4]], dof: 12}
        equations: {Ex: sx, Ey: 0}
        """,
    )
    found = predict_lengths(model, part_of(tmp_path, PART), FAST)
    first = each(found)[0]
    assert first.nominal == pytest.approx(100.0)
    assert first.error == pytest.approx(0.02 * 100 * 1e-3)
    # The level cancels, the slope over 100 mm does not; two visits.
    of_lines, visits = (4.0e-4 + 9.0e-4) * 100**2, 2 * 4.0
    assert first.variance == pytest.approx((of_lines + visits) * 1e-6)
    shares = first.shares
    assert shares is not None
    of_all = of_lines + visits
    assert shares.coefficients == pytest.approx(4.0 / of_all)
    assert shares.passes == pytest.approx(9.0 / of_all)
    assert shares.repeatability == pytest.approx(8.0 / of_all)
    assert first.dof == pytest.approx((of_lines + visits) ** 2 / (of_lines**2 + visits**2) * 12)
    u = np.sqrt(first.variance)
    t = stats.t(first.dof).ppf(0.975)
    assert tuple(first.interval95) == pytest.approx((first.error - t * u, first.error + t * u))
    ends = [0.0, 100.0]
    apart = sum(1 + 4 + (4e-4 + 9e-4) * p**2 + 4 for p in ends) * 1e-6
    assert first.independent_variance == pytest.approx(apart)
    assert first.conformance is not None
    law = stats.t(first.dof, loc=first.error, scale=u)
    assert first.conformance.probability == pytest.approx(law.cdf(9e-3) - law.cdf(-9e-3))


CLOSE = """
features: {a: {x_mm: 0, y_mm: 0}, b: {x_mm: 0.02, y_mm: 0}}
lengths: [{from: a, to: b}]
"""


def test_validation_fails_where_the_errors_are_as_large_as_the_length(tmp_path: Path) -> None:
    """20 um apart with u = 10 um: the length is no longer a line in the errors."""
    model = model_of([(estimate(axis, "x", [0.0], s=0.01), {axis: "1"}) for axis in "xy"])
    found = predict_lengths(model, part_of(tmp_path, CLOSE), FAST)
    item = each(found)[0]
    assert item.validation.passed is False
    (failed,) = [warning for warning in found.warnings if warning.code == "validation-failed"]
    assert "a-b" in failed.message
    # The truth by plain draws: two visits of 10 um along each axis.
    rng = np.random.default_rng(3)
    e = np.sqrt(2) * 0.01 * rng.standard_normal((2, 400_000))
    grown = np.hypot(0.02 + e[0], e[1]) - 0.02
    low, high = np.quantile(grown, [0.025, 0.975])
    assert found.run.low[0] == pytest.approx(low, abs=3e-4)
    assert found.run.high[0] == pytest.approx(high, abs=6e-4)
    assert abs(item.interval95[0] - low) > 10 * item.validation.tolerance


def test_joint_conformance_against_counted_parts(tmp_path: Path) -> None:
    """Correlated lengths, one without a tolerance: parts drawn by hand."""
    model = machine(s=1e-3)
    part = part_of(tmp_path, PART)
    found = predict_lengths(model, part, FAST)
    assert found.joint_conformance is not None
    rng = np.random.default_rng(5)
    n = 200_000
    p = np.array([[0.0, 0], [100, 0], [70, 90]])
    S = np.array([[1e-6, 0], [0, 4e-10]]) + np.array([[4e-6, -2e-9], [-2e-9, 9e-10]])
    b = rng.multivariate_normal([1e-3, 2e-5], S, size=n)
    t = 1e-5 + 3e-5 * rng.standard_normal((n, 1))
    sx = b[:, :1] + b[:, 1:] * p[:, 0] + 1e-3 * rng.standard_normal((n, 3))
    x, y = p[:, 0] + sx - p[:, 1] * t, p[:, 1] + 0.3 * sx + p[:, 0] * t
    ab = np.hypot(x[:, 1] - x[:, 0], y[:, 1] - y[:, 0]) - 100
    ca = np.hypot(x[:, 2] - x[:, 0], y[:, 2] - y[:, 0]) - np.hypot(70, 90)
    good = (np.abs(ab) <= 9e-3) & (np.abs(ca) <= 4e-3)
    _, probability, error = found.joint_conformance
    assert probability == pytest.approx(good.mean(), abs=4.5 * np.hypot(error, 0.5 / np.sqrt(n)))
    alone = [item.conformance.probability for item in each(found) if item.conformance]
    assert alone == pytest.approx(
        [np.mean(np.abs(ab) <= 9e-3), np.mean(np.abs(ca) <= 4e-3)], abs=5e-3
    )
    # The product would be wrong: the lengths share the part's state.
    assert abs(np.prod(alone) - good.mean()) > 10 * error


def test_bounds_of_unmeasured_correlation(tmp_path: Path) -> None:
    a = estimate("a", "x", [0.0, 0.0], D=np.diag([0, 9e-10]))
    b = estimate("b", "y", [0.0, 0.0], D=np.diag([0, 4e-10]))
    model = model_of([(a, {"x": "1"}), (b, {"y": "1"})])
    text = "features: {a: {x_mm: 0, y_mm: 0}, b: {x_mm: 100, y_mm: 100}}\n"
    found = predict_lengths(model, part_of(tmp_path, text + "lengths: [{from: a, to: b}]"), FAST)
    item = each(found)[0]
    u = np.array([3e-5, 2e-5]) * 100 / np.sqrt(2)
    assert np.sqrt(item.variance) == pytest.approx(np.hypot(*u))
    assert tuple(item.u_bounds) == pytest.approx((u[0] - u[1], u[0] + u[1]))
    assert item.pair == ("a", "b")
