"""First-order lag of a sampled signal."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray


def first_order_lag(signal: FloatArray, time: FloatArray, time_constants: FloatArray) -> FloatArray:
    """u (k, n, s) with tau du/dt = T - u for each of k time constants; T is (n, s), time (n,).

    Exact for a signal that is linear between its samples:

        u_i = T_i - g tau + (u_(i-1) - T_(i-1) + g tau) exp(-dt/tau),  g = (T_i - T_(i-1))/dt.

    Rows of one time that follow each other are one sample, their mean. The first sample counts as
    settled, and so does one that is earlier than the one before (a new run). tau = 0 gives every
    row's own signal, an infinite step T. Time and time constants are in the same unit.
    """
    new = np.concatenate([[True], np.diff(time) != 0])
    starts, moment = np.flatnonzero(new), np.cumsum(new) - 1
    T, first = signal, signal[starts]
    if len(starts) < len(signal):
        # About the first of them: equal rows keep their value to the last digit.
        sums = np.add.reduceat(signal - first[moment], starts, axis=0)
        T = first + sums / np.bincount(moment)[:, None]
    tau = np.asarray(time_constants, float)
    slow = tau[tau > 0][:, None]
    lagged = np.repeat(T[None], len(slow), axis=0)
    for i, dt in enumerate(np.diff(time[starts]).tolist() if len(slow) else (), start=1):
        if dt > 0:
            rise = (T[i] - T[i - 1]) * (slow / dt)
            lagged[:, i] = T[i] - rise + (lagged[:, i - 1] - T[i - 1] + rise) * np.exp(-dt / slow)
    result = np.repeat(signal[None], len(tau), axis=0)
    result[tau > 0] = lagged[:, moment]
    return result
