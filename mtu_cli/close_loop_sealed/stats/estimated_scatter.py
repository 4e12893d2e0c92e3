"""What is estimated along directions whose scatter is itself an estimate of few parts.

Of b directions with a covariance S of n degrees of freedom, the square of the estimate of one
column over the variance that S gives it is

    chi^2_1 n/chi^2_(n-b+1) (1 + chi^2_(b-1)/chi^2_(n-b+2)),

Student's t of what is left of S, and what adjusting for the other directions by an estimated
regression costs (Rao, Biometrika 46 (1959) 49).
"""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray


def scattered(drawn: FloatArray, S: FloatArray, n: float, rng: np.random.Generator) -> FloatArray:
    """`drawn` (B, b) of covariance S, or of 1 where S is less, as it scatters about an S (b, b) of
    `n` degrees of freedom that is not the true one.

    S is in units of the noise of an entry: in no direction the truth is below 1. Where n < b there
    are directions that S does not see: all are taken to scatter alike, which S tells with n b
    degrees of freedom.
    """
    b = len(S)
    sizes, turn = np.linalg.eigh(S)
    seen = np.maximum(sizes, 1.0)
    if n < b:
        sizes = np.full(b, sizes.mean())
        factor = n * b / rng.chisquare(n * b, (len(drawn), 1))
    else:
        factor = n / rng.chisquare(n - b + 1, (len(drawn), 1))
    if 1 < b <= n:
        adjusted = rng.chisquare(b - 1, factor.shape)
        factor *= 1 + adjusted / rng.chisquare(n - b + 2, factor.shape)
    ratio = np.maximum(sizes * factor, 1.0) / seen
    found: FloatArray = (drawn @ turn * np.sqrt(ratio)) @ turn.T
    return found


def inflation(n: float, b: int) -> tuple[float, float]:
    """Of a variance by S: the factor that makes it unbiased, and its degrees of freedom
    m = n - b + 1, at least 1.

    E chi^2_m = m, and E 1/chi^2_(m+1) = 1/(m - 1): n/m (1 + (b - 1)/(m - 1)).
    """
    m = max(n - b + 1, 1.0)
    return (n / m * (1 + (b - 1) / max(m - 1, 1.0)), m) if np.isfinite(n) else (1.0, n)
