"""Probability of conformance against scipy and against counted parts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from mtu_cli.model.trials import conformance_of

STEADY = settings(derandomize=True, deadline=None, database=None)


@STEADY
@given(
    st.floats(0.1, 100), st.floats(-0.2, 0.2), st.floats(1e-4, 0.1), st.sampled_from([2.5, 7, 1e9])
)
def test_against_student_and_normal(tol: float, error: float, u: float, dof: float) -> None:
    found = conformance_of(tol, error, u, dof)
    assert found is not None
    law = stats.t(dof, loc=error, scale=u)
    wanted = law.cdf(tol * 1e-3) - law.cdf(-tol * 1e-3)
    assert found.probability == pytest.approx(wanted, abs=1e-7)
    normal = conformance_of(tol, error, u, np.inf)
    assert normal is not None
    gauss = stats.norm(loc=error, scale=u)
    inside = gauss.cdf(tol * 1e-3) - gauss.cdf(-tol * 1e-3)
    assert normal.probability == pytest.approx(inside, abs=1e-9)


def test_against_counted_parts() -> None:
    draws = 0.004 + 0.006 * stats.t(6).rvs(200_000, random_state=np.random.default_rng(1))
    inside = np.mean(np.abs(draws) <= 0.012)
    found = conformance_of(12.0, 0.004, 0.006, 6.0)
    assert found is not None
    assert found.probability == pytest.approx(inside, abs=4.5 * np.sqrt(inside / 200_000))


def test_without_uncertainty_and_without_tolerance() -> None:
    assert conformance_of(None, 0.0, 1.0, np.inf) is None
    inside, outside = conformance_of(10.0, 0.0099, 0.0, 5.0), conformance_of(10.0, -0.011, 0.0, 5)
    assert inside is not None
    assert outside is not None
    assert (inside.probability, outside.probability) == (1.0, 0.0)
    assert inside.tolerance == pytest.approx(0.01)
