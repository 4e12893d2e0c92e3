"""Expectations of ordered values and of their squares, exactly."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.coverage import t_quantile

FloatArray = NDArray[np.float64]

LEAST_DOF = 2.0
"""With fewer degrees of freedom the square of the second lowest value has hardly a mean."""
FROM, TO, STEP = -37.0, 6.0, 0.1
"""Of the logit of the probability: rounding is beyond, and the integrands are smooth within."""


@lru_cache(maxsize=64)
def ordered_moments(size: int, most: int, dof: float) -> FloatArray:
    """E y_(j) and E y_(j)^2 (2, most) for j = 1 ... most, the lowest of `size` standard t.

    Of normal variables for infinite `dof`. y_(j) = Q(p_j) with p_j of the beta distribution
    (j, size - j + 1) (David & Nagaraja 2003, 2.1), integrated over logit p by the trapezoidal
    rule. Of the lowest value itself only for many degrees of freedom.
    """
    x = np.arange(FROM, TO, STEP)
    p = 1.0 / (1.0 + np.exp(-x))
    q = t_quantile(p, dof)
    j = np.arange(1, most + 1)[:, None]
    log_b = np.array(
        [
            [math.lgamma(i) + math.lgamma(size - i + 1) - math.lgamma(size + 1)]
            for i in range(1, most + 1)
        ]
    )
    density = np.exp(j * np.log(p) + (size - j + 1) * np.log1p(-p) - log_b) * STEP
    return np.array([density @ q, density @ (q * q)])


def end_weights(size: int, places: FloatArray, probability: float, dof: float) -> FloatArray | None:
    """Weights (tail,) of ordered values that give the quantile Q of `probability`, unbiased.

    The combination of three interpolations `places` (3, tail) that has the expectation 1, Q and
    Q^2 of 1, y and y^2: so a + b y + c y^2 of a normal or t variable y is had without bias however
    few the trials. None where `dof` is too low for squares.
    """
    if dof < LEAST_DOF:
        return None
    first, second = ordered_moments(size, places.shape[1], dof) @ places.T
    q = float(t_quantile(np.array([probability]), dof)[0])
    share = np.linalg.solve(np.array([np.ones(3), first, second]), np.array([1.0, q, q * q]))
    found: FloatArray = share @ places
    return found
