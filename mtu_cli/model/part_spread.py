"""How far parts are apart but for a shift of each as a whole, in steps of the CMM's last digit."""

from __future__ import annotations

import math

import numpy as np

from mtu_cli.files.features_alike import SAME_MM
from mtu_cli.files.points import Points
from mtu_cli.model.residual_cells import IntArray
from mtu_cli.stats.least_squares import FloatArray

COMPARED = 200
"""Parts, and features of them, that are held against each other: enough to know the nearest."""
FEWEST_FREE = 2
"""Values beyond the shifts from which on a pair tells how far two parts are apart."""
PHASE = 0.25
"""Mean square, at most, of what rounding alone makes of a shift that is no whole number of digits:
some values move by the digit below, the others by the one above."""


def shares_alike(
    points: Points, operation: IntArray, axes: tuple[int, ...], equal: IntArray
) -> FloatArray:
    """The share (n,) of the values of a point's `operation` (n,) in which two parts of one set-up
    agree: that of the nearest pair, each part's own shift along each of the `axes` taken off; of
    no pair 0. Parts with the same number in `equal` (n,) are no pair.

    Parts of different set-ups share nothing, to the last digit, where a set-up is a shift by
    some digits; what they share but for it says how often two of one set-up are equal.
    """
    found = np.zeros(len(points))
    for code in np.unique(operation):
        own = np.flatnonzero(operation == code)
        # Parts of one set-up follow each other: of many the first, not every other one.
        for many in (points.part, points.feature):
            own = own[many[own] <= np.unique(many[own])[:COMPARED][-1]]
        measured = points.measured[own][:, axes]
        least = _nearest(measured, points.part[own], points.feature[own], equal[own])
        found[operation == code] = agreeing(math.sqrt(least))
    return found


def _nearest(measured: FloatArray, part: IntArray, feature: IntArray, equal: IntArray) -> float:
    """The least variance of the difference of two parts about its mean along each axis, in digits;
    of values `measured` (n, axes) mm the first of a `part` and a `feature` (n,) counts.
    """
    names, first, p = np.unique(part, return_index=True, return_inverse=True)
    features, c = np.unique(feature, return_inverse=True)
    table = np.full((len(names), len(features), measured.shape[1]), np.nan)
    table[p.reshape(-1)[::-1], c.reshape(-1)[::-1]] = measured[::-1]
    table = (table - np.nanmedian(table, axis=0)) / _digit(table)
    group, least = equal[first], math.inf
    for i in range(len(names) - 1):
        others = table[i + 1 :][group[i + 1 :] != group[i]]
        least = min(least, _least(others, table[i]))
    return least


def _digit(table: FloatArray) -> float:
    """The CMM's last digit, mm: the least step between two values of a cell of a table (parts,
    cells, axes), or between two such steps, where few parts of different set-ups have large ones.
    """
    steps = np.unique(np.diff(np.sort(table, axis=0), axis=0))
    least = np.diff(steps[np.isfinite(steps)], prepend=0.0)
    return float(least[least > SAME_MM].min(initial=np.inf))


def _least(others: FloatArray, own: FloatArray) -> float:
    """The least variance about its mean along each axis of others (k, cells, axes) less `own`,
    beyond what rounding alone may make of it.
    """
    away = others - own
    known = np.isfinite(away)
    count = known.sum(axis=1)
    away = np.where(known, away, 0.0)
    mean = away.sum(axis=1) / np.maximum(count, 1)
    squares = (np.where(known, away - mean[:, np.newaxis], 0.0) ** 2).sum(axis=(1, 2))
    free = np.maximum(count - 1, 0).sum(axis=1)
    beyond = np.maximum(squares - PHASE * count.sum(axis=1), 0.0) / np.maximum(free, 1)
    return float(beyond[free >= FEWEST_FREE].min(initial=np.inf))


def agreeing(scatter: float) -> float:
    """The probability that two values round to the same whole number, wherever between two of
    them they lie, where their difference is normal with standard deviation `scatter`:
    the mean of max(0, 1 - |difference|).
    """
    if scatter == 0.0:
        return 1.0
    if math.isinf(scatter):
        return 0.0
    within = math.erf(1 / (scatter * math.sqrt(2)))
    return within + scatter * math.sqrt(2 / math.pi) * math.expm1(-1 / (2 * scatter**2))
