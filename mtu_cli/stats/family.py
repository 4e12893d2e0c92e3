"""Tail probabilities of many tests at once, and their family-wise adjustment."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray


def t_tail(t: FloatArray, dof: FloatArray) -> FloatArray:
    """Two-sided p of Student's t."""
    from scipy.special import stdtr

    p: FloatArray = 2 * stdtr(dof, -np.abs(t))
    return np.where(np.isfinite(p), p, 1.0)


def f_tails(ratio: FloatArray, df1: FloatArray, df2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """P(F > ratio) and P(F < ratio); df2 may be infinite. 1 where there is no F."""
    from scipy.special import chdtr, chdtrc, fdtr, fdtrc

    known = np.isfinite(ratio) & (df1 > 0)
    r, d1 = np.where(known, ratio, 1.0), np.where(known, df1, 1.0)
    d2 = np.where(np.isinf(df2), 1.0, df2)
    high = np.where(np.isinf(df2), chdtrc(d1, r * d1), fdtrc(d1, d2, r))
    low = np.where(np.isinf(df2), chdtr(d1, r * d1), fdtr(d1, d2, r))
    return np.where(known, high, 1.0), np.where(known, low, 1.0)


def holm(p: FloatArray) -> FloatArray:
    """Holm's adjusted p values (Scand. J. Statist. 6 (1979) 65) over all of `p` (m,)."""
    m = len(p)
    order = np.argsort(p, kind="stable")
    stepped = np.maximum.accumulate(np.minimum(p[order] * (m - np.arange(m)), 1.0))
    adjusted = np.empty(m)
    adjusted[order] = stepped
    return adjusted
