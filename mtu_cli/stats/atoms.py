"""Coverage intervals of outputs that take few values: a chance that is 0 or 1, a count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.pooling import Estimates

MOST_VALUES = 64
"""An output of no more values than this is a discrete one."""
HEAD = 4096
"""Trials that are looked at first; of fewer nothing is said."""


def with_atoms(estimates: Estimates, samples: FloatArray, probability: float) -> Estimates:
    """The estimates with the interval ends of discrete outputs from the samples (outputs, kept).

    Block averages of ordered values are quantiles of continuous distributions only: of a chance
    of 0.977 they would give a lower end between 0 and 1, which no trial has. The ends of a
    discrete distribution are values of it, the smallest v with F(v) >= (1 - p)/2 and
    F(v) >= (1 + p)/2 (JCGM 101:2008, 7.7.1, for a G that has jumps); the shortest interval is
    that of least width with a share of p or more. They have no standard error: an end is one
    value or another.
    """
    ends = {
        i: _ends(column, probability)
        for i, column in enumerate(samples)
        if len(column) >= HEAD and _is_discrete(column)
    }
    if not ends:
        return estimates
    names = ("low", "high", "shortest_low", "shortest_high")
    columns = {name: getattr(estimates, name).copy() for name in names}
    errors = {name: getattr(estimates, name).copy() for name in ("se_low", "se_high")}
    for i, own in ends.items():
        for name, value in zip(names, own, strict=True):
            columns[name][i] = value
        for error in errors.values():
            error[i] = 0.0
    return replace(estimates, **columns, **errors)


def _is_discrete(column: FloatArray) -> bool:
    return len(np.unique(column[:HEAD])) <= MOST_VALUES and len(np.unique(column)) <= MOST_VALUES


def _ends(column: FloatArray, probability: float) -> tuple[float, float, float, float]:
    values, counts = np.unique(column, return_counts=True)
    F = np.cumsum(counts)
    n, outside = int(F[-1]), 0.5 * (1.0 - probability)
    low = values[np.searchsorted(F, outside * n)]
    high = values[np.searchsorted(F, (1.0 - outside) * n)]
    before = F - counts
    last = np.searchsorted(F, before + probability * n)
    first = np.flatnonzero(last < len(values))
    i = int(first[np.argmin(values[last[first]] - values[first])])
    return float(low), float(high), float(values[i]), float(values[last[i]])
