"""Components of variance by REML against statsmodels, closed forms and the edges."""

from __future__ import annotations

import warnings
from contextlib import suppress

import numpy as np
import pytest
from anova_designs import PAPER, cells, drawn, simulated

from mtu_cli.stats.anova import moments, one_way
from mtu_cli.stats.least_squares import FloatArray, IntArray
from mtu_cli.stats.reml import reml

DESIGNS = [PAPER, (3, 1, 2, 4, 1), (2, 2, 5, 1, 1, 3, 4), (6, 1, 1, 1, 1, 1)]


def other(values: FloatArray, part: IntArray) -> tuple[float, float]:
    """statsmodels' MixedLM: where its gradients lead nowhere, without them."""
    statsmodels = pytest.importorskip("statsmodels.api")
    model = statsmodels.MixedLM(values, np.ones((len(values), 1)), groups=part)
    fits = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in ("bfgs", "powell"):
            # Its optimisers may step onto a singular Hessian.
            with suppress(np.linalg.LinAlgError):
                # What is called converged by default is good to three digits only.
                fits.append(model.fit(reml=True, method=[name], gtol=1e-8))
                if fits[-1].converged:
                    break
    best = max((fit for fit in fits if np.isfinite(fit.llf)), key=lambda fit: fit.llf)
    return float(np.ravel(best.cov_re)[0]), float(best.scale)


@pytest.mark.parametrize("repeats", DESIGNS)
@pytest.mark.parametrize("s_part", [0.0, 0.4, 4.0])
def test_against_statsmodels(repeats: tuple[int, ...], s_part: float) -> None:
    """To four digits; near 0, where statsmodels' optimisers reach no more, of s_repeat^2."""
    values, part = simulated(repeats, 3, s_part, 1.0, 21)
    found = reml(cells(values, part, len(repeats)))
    for i, row in enumerate(values):
        expected = other(row, part)
        near = 1e-4 * expected[1] if expected[0] < 0.1 * expected[1] else 0.0
        assert found.part[i] == pytest.approx(expected[0], rel=1e-4, abs=near)
        assert found.repeat[i] == pytest.approx(expected[1], rel=1e-4)


@pytest.mark.parametrize("s_part", [0.0, 1.0, 100.0, 4e4, 1e5, 1e7])
def test_balanced_data_have_the_moment_estimate(s_part: float) -> None:
    """Where it is not negative (Searle, Casella & McCulloch 1992, 3.8); F up to 1e14 and more."""
    found = drawn((3,) * 8, 300, s_part, 1.0, 2)
    table = one_way(found)
    expected = moments(table)
    positive = expected.part_estimate > 1e-6
    assert positive.sum() > 100
    ours = reml(found)
    np.testing.assert_allclose(ours.part[positive], expected.part[positive], rtol=1e-6)
    np.testing.assert_allclose(ours.repeat[positive], expected.repeat[positive], rtol=1e-6)


def test_what_the_data_cannot_tell() -> None:
    no_repeats = reml(drawn((1,) * 5, 1, 1.0, 1.0, 1))
    assert np.isnan([no_repeats.part[0], no_repeats.repeat[0]]).all()
    values, part = simulated((6,), 1, 1.0, 1.0, 1)
    one_part = reml(cells(values, part, 1))
    assert np.isnan(one_part.part[0])
    assert one_part.repeat[0] == pytest.approx(values[0].var(ddof=1), rel=1e-9)
    single = reml(drawn((1,), 1, 1.0, 1.0, 1))
    assert np.isnan([single.part[0], single.repeat[0]]).all()


def test_equal_repeats_leave_the_variance_of_the_means() -> None:
    values, part = simulated((3, 1, 2, 2), 1, 1.0, 0.0, 3)
    found = reml(cells(values, part, 4))
    means = [values[0][part == i][0] for i in range(4)]
    assert found.repeat[0] == 0
    assert found.part[0] == pytest.approx(np.var(means, ddof=1), rel=1e-9)
