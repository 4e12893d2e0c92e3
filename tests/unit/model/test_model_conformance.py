"""Probability of conformance against scipy and against counted parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from mtu_cli.files.part import Tolerance
from mtu_cli.model.measurands import conformance_of, position_conformance
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.settings import Settings
from mtu_cli.model.variance import Block
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

STEADY = settings(derandomize=True, deadline=None, database=None)


@STEADY
@given(
    st.tuples(st.floats(-100, 100), st.floats(0.1, 100)),
    st.floats(-0.2, 0.2),
    st.floats(1e-4, 0.1),
    st.sampled_from([2.5, 7, 1e9, np.inf]),
)
def test_against_student_and_normal(
    zone: tuple[float, float], error: float, u: float, dof: float
) -> None:
    low, high = zone[0], zone[0] + zone[1]
    found = conformance_of(Tolerance(low, high), UM, error, u, dof)
    assert found is not None
    law = stats.norm(error, u) if dof == np.inf else stats.t(dof, loc=error, scale=u)
    assert found.probability == pytest.approx(law.cdf(high * UM) - law.cdf(low * UM), abs=1e-7)


def test_without_uncertainty_and_without_tolerance() -> None:
    assert conformance_of(None, UM, 0.0, 1.0, np.inf) is None
    zone = Tolerance(-10.0, 12.0)
    for error, inside in ((0.0119, 1.0), (0.0121, 0.0), (-0.0099, 1.0), (-0.011, 0.0)):
        found = conformance_of(zone, UM, error, 0.0, 5.0)
        assert found is not None
        assert found.probability == inside


def _prediction(C: FloatArray, dof: float, visits: tuple[float, float], nu: float) -> Prediction:
    """Two points with errors along x and y: coefficients C (2, 2) of `dof` that both share, and a
    visit of each with s (along x, along y) of `nu`.
    """
    rows, nothing = np.tile(np.eye(2), (2, 1)), np.zeros((2, 2))

    def block(G: FloatArray, s: FloatArray, own: float) -> Block:
        return Block(
            names=("a",),
            columns=(slice(0, 2),),
            G=G,
            C=C,
            D=nothing,
            noise=np.tile(s[:, None], (2, 1)),
            pass_dof=0.0,
            repeat_dof=(own,),
        )

    blocks = block(rows, np.zeros(2), dof), block(0 * rows, np.array(visits), nu)
    return Prediction(
        ids=("p", "q"),
        axes=("x", "y"),
        points=np.zeros((2, 3)),
        mean=np.array([0.0, 0.0, 0.004, -0.003]),
        blocks=blocks,
        independent_variance=np.full(4, 1e-6),
        outside=(),
    )


def test_position_against_counted_parts() -> None:
    """Errors of x and y correlated; every source with its own chi-squared."""
    C, s, n = 1e-6 * np.array([[9.0, 6.0], [6.0, 16.0]]), np.array([0.002, 0.001]), 400_000
    at = _prediction(C, 5.0, (s[0], s[1]), 7.0)
    found = position_conformance(at, [None, 12.0], Settings(trials=n))[1]
    rng = np.random.default_rng(3)
    scale = np.sqrt(5 / rng.chisquare(5, n)), np.sqrt(7 / rng.chisquare(7, n))
    errors = rng.multivariate_normal([0, 0], C, n) * scale[0][:, None] + [0.004, -0.003]
    errors += (rng.standard_normal(n) * scale[1])[:, None] * s
    inside = np.mean(np.hypot(*errors.T) <= 0.006)
    assert found is not None
    assert found.probability == pytest.approx(inside, abs=6.5 * found.se)
    alone = replace(at, axes=("z",), ids=("p", "q", "r", "s"))
    assert position_conformance(alone, [12.0] * 4, Settings()) == (None,) * 4
