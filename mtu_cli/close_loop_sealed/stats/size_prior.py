"""Effects whose size is not known before: how likely each is, and how far it is believed.

The coefficients beta of a member with k columns have Student's t with three degrees of freedom as
their prior: normal given s, beta ~ N(0, s^2 tau^2), with s^2 inverse gamma (3/2, 3/2). Mixtures of
normals with long tails are the answer of Zellner and Siow (in Bayesian Statistics, Valencia 1980,
585; with one degree of freedom) to a size that is not known: an effect as strong as can be is
still believed. tau is what one thinks of: a size that the effect may well have on all that is to be
foretold, where they take one from the design alone. A member that the data hardly show, and that
would be huge elsewhere, is then neither likely nor believed. Given s, with g = s^2 tau^2 x' V^-1 x
(Liang et al., J. Am. Stat. Assoc. 103 (2008) 410, eq. 5, with n degrees of freedom beside what is
free, and the likelihood ratio LR = -n log(1 - R^2)),

    log BF(s) = (n - k)/2 log(1 + g) - n/2 log(1 + g exp(-LR/n)),  E(beta | y, s) = g/(1 + g) b,

b the estimate by generalised least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.close_loop_sealed.stats.profile_ratio import MemberRatios
from mtu_cli.stats.least_squares import FloatArray

SIZES = 2.0 ** np.arange(-2, 11)
"""Values of s: from a quarter of tau to a thousand tau, a factor of two apart."""
WEIGHTS = np.exp(-1.5 / SIZES**2) / SIZES**3
WEIGHTS = WEIGHTS / WEIGHTS.sum()
"""Density of log s where s^2 is inverse gamma (3/2, 3/2)."""
CERTAIN = 1e12
"""Largest g: what stands beside no scatter at all is believed."""
LARGEST = float(np.finfo(np.float64).max)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sized:
    """Of M members, each (M,): `log_bayes` the logarithm of the Bayes factor against nothing, -inf
    of those that cannot be tested; `believed` E(g/(1 + g)), the share of the estimate that is
    expected.
    """

    log_bayes: FloatArray
    believed: FloatArray


def sized(members: MemberRatios, columns: FloatArray, tau: FloatArray) -> Sized:
    """Of one table's `members` (1, M) with `columns` (M,) each, and scales `tau` (M,) of their
    coefficients; inf where nothing scatters. A member without information has g = 0.
    """
    ratio = np.maximum(members.ratio[0], 0.0)
    n = np.maximum(members.dof[0], 1.0)
    g = _spread(tau, members.information[0])
    given = 0.5 * np.maximum(n - columns, 0.0) * np.log1p(g)
    given = given - 0.5 * n * np.log1p(g * np.exp(-ratio / n)) + np.log(WEIGHTS)[:, None]
    top = given.max(axis=0)
    weight = np.exp(given - top)
    total = weight.sum(axis=0)
    tested = members.ratio[0] >= 0
    return Sized(
        log_bayes=np.where(tested, top + np.log(total), -np.inf),
        believed=(weight * g / (1 + g)).sum(axis=0) / total,
    )


def _spread(tau: FloatArray, information: FloatArray) -> FloatArray:
    """g (sizes, M), at most `CERTAIN`: tau is cut before anything is multiplied, as neither its
    square nor that times the information need be a number.
    """
    root: FloatArray = np.sqrt(np.minimum(information, LARGEST))
    most = np.zeros((len(SIZES), len(root)))
    np.divide(CERTAIN**0.5, SIZES[:, None] * root, out=most, where=root > 0.0)
    found: FloatArray = (SIZES[:, None] * np.minimum(tau, most) * root) ** 2
    return found
