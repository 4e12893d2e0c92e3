"""Capability: the noncentral t far out, and quantiles of a radial error."""

import numpy as np
import pytest
from scipy.stats import ncx2

from mtu_cli.stats.process import noncentrality, radial_quantile


def test_noncentrality_goes_on_where_t_is_large() -> None:
    """As sqrt(chi^2/dof): the series of the distribution would hardly end."""
    for dof in (2, 9, 299):
        near, far = (noncentrality(dof, 0.975, t) / t for t in (-999.9, -1000.1))
        assert near == pytest.approx(far, rel=5e-4)
        assert noncentrality(dof, 0.025, -4e6) > noncentrality(dof, 0.975, -4e6)


@pytest.mark.parametrize("size", [0.0, 2.0])
def test_the_quantile_of_a_radial_error(size: float) -> None:
    """Equal variances: sqrt of a noncentral chi-squared; unequal ones against samples."""
    centre = np.array([size, 0.0])
    expected = np.sqrt(ncx2.ppf(0.9973, 2, max(size**2, 1e-12)))
    assert radial_quantile(centre, np.eye(2), 0.9973) == pytest.approx(expected, rel=1e-6)
    C = np.array([[1.0, 0.6], [0.6, 0.5]])
    drawn = np.random.default_rng(1).multivariate_normal(centre, C, 400_000)
    within = np.mean(np.hypot(*drawn.T) <= radial_quantile(centre, C, 0.9973))
    assert within == pytest.approx(0.9973, abs=4 * np.sqrt(0.0027 / 400_000))
