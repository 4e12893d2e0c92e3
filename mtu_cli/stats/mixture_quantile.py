"""Quantile of a normal distribution whose standard deviation is itself drawn."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

COARSE_DRAWS = 256
COARSE_STEPS = 8
MOST_STEPS = 50
CLOSE_ENOUGH = 1e-5
"""Relative size of the last step; Newton's error after it is of the order of its square."""


def mixture_quantile(scales: FloatArray, probability: float) -> FloatArray:
    """q (outputs,) with mean over j of Phi(q / scales[i, j]) = probability < 1/2.

    The quantile of the first-order form given the draws of its variance scales: what is left
    after the normal part of its scatter is averaged out exactly (Rao-Blackwell). `scales`
    (outputs, m) > 0. The equal tail above zero is at -q.

    Newton's method, first on a subset of the draws for a start, mostly two or three steps on
    all of them. Below zero the distribution function is convex, so that the steps close in
    from one side.
    """
    from scipy.special import ndtri

    m = scales.shape[1]
    coarse = scales[:, :: max(1, m // COARSE_DRAWS)]
    q: FloatArray = np.median(coarse, axis=1) * float(ndtri(probability))
    for _ in range(COARSE_STEPS):
        q = _newton(q, coarse, probability)
    for _ in range(MOST_STEPS):
        before, q = q, _newton(q, scales, probability)
        if np.all(np.abs(q - before) <= CLOSE_ENOUGH * np.abs(q)):
            break
    return q


def _newton(q: FloatArray, scales: FloatArray, probability: float) -> FloatArray:
    from scipy.special import ndtr

    positive = scales > 0.0
    z = np.divide(q[:, np.newaxis], scales, out=np.full_like(scales, -np.inf), where=positive)
    excess = ndtr(z).mean(axis=1) - probability
    density = np.divide(np.exp(-0.5 * z * z), scales, out=np.zeros_like(scales), where=positive)
    slope = density.mean(axis=1) / math.sqrt(2.0 * math.pi)
    step = np.divide(excess, slope, out=np.zeros_like(q), where=slope > 0.0)
    # A step from too far out may land above zero, where the function is no longer convex.
    return np.asarray(np.minimum(q - step, 0.5 * q))
