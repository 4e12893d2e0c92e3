"""First-order lag of a sampled signal."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray


def first_order_lag(signal: FloatArray, time: FloatArray, time_constants: FloatArray) -> FloatArray:
    """u (k, n, s) with tau du/dt = T - u for each of k time constants; T is (n, s), time (n,).

    Exact for a signal that is linear between its samples:

        u_i = T_i - g tau + (u_(i-1) - T_(i-1) + g tau) exp(-dt/tau),  g = (T_i - T_(i-1))/dt.

    The first sample counts as settled, and so does a sample that is not later than the one
    before (a new run). tau = 0 gives T itself, so does an infinite step. Time and time constants
    are in the same unit.
    """
    n = len(signal)
    tau = np.asarray(time_constants, float)[:, None]
    result = np.repeat(signal[None], len(tau), axis=0)
    slow = np.flatnonzero(tau[:, 0] > 0)
    if not len(slow):
        return result
    tau = tau[slow]
    state = np.repeat(signal[:1], len(slow), axis=0)
    steps = np.diff(time)
    for i in range(1, n):
        dt = steps[i - 1]
        if dt > 0:
            rise = (signal[i] - signal[i - 1]) * (tau / dt)
            state = signal[i] - rise + (state - signal[i - 1] + rise) * np.exp(-dt / tau)
        else:
            state = np.repeat(signal[i : i + 1], len(slow), axis=0)
        result[slow, i] = state
    return result


def lag_of_moments(signal: FloatArray, time: FloatArray, time_constants: FloatArray) -> FloatArray:
    """`first_order_lag` (k, n, s) where rows of one time that follow each other are one sample.

    Their mean counts, because a step of no length would start a new run; tau = 0 gives every
    row's own signal.
    """
    new = np.concatenate([[True], np.diff(time) != 0])
    if new.all():
        return first_order_lag(signal, time, time_constants)
    starts, moment = np.flatnonzero(new), np.cumsum(new) - 1
    first = signal[starts]
    # About one of them: equal rows keep their value to the last digit.
    more = np.add.reduceat(signal - first[moment], starts, axis=0)
    mean = first + more / np.bincount(moment)[:, None]
    result = first_order_lag(mean, time[starts], time_constants)[:, moment]
    result[np.asarray(time_constants) <= 0] = signal
    return result
