"""The shape of a component that its readings choose: a degree, or a table fitted to them.

`degree: auto` takes what predicts held-out passes: every run is left out once, and every shape,
fitted to the others, predicts its readings but for their level, which drifts. The simplest shape is
chosen that is no worse than the best by more than a standard error of the difference, run by run
(after the rule of Breiman et al., Classification and Regression Trees (1984), 3.4.3).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mtu_cli.model.basis import TableShape
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.stats.kernels import line
from mtu_cli.stats.least_squares import FloatArray, IntArray, least_squares, polynomial
from mtu_cli.stats.mixed_model import PassFit, fit_passes
from mtu_cli.stats.smooth_profile import FEWEST_RUNS, SmoothProfile, smooth_profile

MOST_AUTO = 5
"""Highest degree that is chosen: more bends are a table."""


def chosen_degree(
    position: FloatArray, error: FloatArray, group: IntArray | None, run: IntArray | None
) -> int | None:
    """The degree that held-out runs choose; None for a table. 1 of fewer than three runs."""
    places = len(np.unique(position))
    if group is None or run is None or len(runs := np.unique(run)) < FEWEST_RUNS:
        return min(1, places - 1)
    shapes: list[int | None] = [*range(min(MOST_AUTO, places - 1) + 1), None]
    losses = np.full((len(shapes), len(runs)), np.nan)
    for fold, left in enumerate(runs):
        seen = run != left
        unseen = [np.flatnonzero(group == g) for g in np.unique(group[~seen])]
        for i, degree in enumerate(shapes):
            found = _predicted(position, error, group, run, seen, degree)
            if found is not None:
                losses[i, fold] = np.mean([np.var(error[rows] - found[rows]) for rows in unseen])
    kept = np.flatnonzero(np.isfinite(losses).all(axis=1))
    best = kept[np.argmin(losses[kept].mean(axis=1))]
    worse = losses[kept] - losses[best]
    se = worse.std(axis=1, ddof=1) / np.sqrt(len(runs))
    return shapes[int(kept[np.flatnonzero(worse.mean(axis=1) <= se)[0]])]


def _predicted(
    position: FloatArray,
    error: FloatArray,
    group: IntArray,
    run: IntArray,
    seen: FloatArray,
    degree: int | None,
) -> FloatArray | None:
    """Readings (n,) but for the level of each pass, by the shape fitted to those `seen`."""
    bend = np.zeros(len(error))
    if degree is None:
        profile = smooth_profile(position[seen], error[seen], group[seen], run[seen])
        if profile is None:
            return None
        bend, degree = profile.bend_at(position), 1
    middle, half = float(position.mean()), float(np.ptp(position)) / 2 or 1.0
    powers = polynomial((position - middle) / half, degree)[:, 1:]
    levels = (group[seen, None] == np.unique(group[seen])).astype(np.float64)
    fit = least_squares(np.column_stack([levels, powers[seen]]), (error - bend)[seen])
    return bend + powers @ fit.coefficients[levels.shape[1] :]


def fit_table(
    position: FloatArray,
    error: FloatArray,
    group: IntArray | None,
    direction: FloatArray,
    runs: IntArray | None,
) -> tuple[PassFit, SmoothProfile] | None:
    """The profile of a table, and the passes' lines beside its bend; None of too few readings."""
    own = np.zeros(len(error), np.int64) if group is None else group
    profile = smooth_profile(position, error, own, own if runs is None else runs)
    if profile is None:
        return None
    fit = fit_passes(error - profile.bend_at(position), position, 1, group, direction, runs)
    changed: dict[str, Any] = {
        "s2": profile.s2,
        "within_rss": profile.rss,
        "within_dof": profile.dof,
        "pooled_rss": fit.pooled_rss - (fit.within_rss - profile.rss),
        "pooled_dof": fit.pooled_dof - (fit.within_dof - profile.dof),
    }
    return replace(fit, **changed), profile


def as_table(
    of_line: ComponentEstimate,
    fit: PassFit,
    profile: SmoothProfile,
    position: FloatArray,
    error: FloatArray,
) -> ComponentEstimate:
    """The table of the line and the bend: values at the positions that were read.

    The bend holds no line of the readings, however many there are at each position.
    """
    table = TableShape(
        at=profile.knots, roughness=profile.roughness, own=profile.own, own_dof=profile.own_dof
    )
    at = np.searchsorted(profile.knots, position)
    counts, L = np.bincount(at), line(profile.knots, 0.0)
    T = table.of_line(fit.center, len(fit.D))
    without_line = np.eye(len(L)) - L @ np.linalg.solve((L.T * counts) @ L, L.T * counts)
    of_bend = without_line @ profile.covariance @ without_line.T
    D, halves = T @ fit.D_moment @ T.T, fit.half_differences
    means = np.bincount(at, error) / counts
    s2 = float(((error - means[at]) ** 2).sum()) / max(len(error) - len(L), 1)
    return replace(
        of_line,
        coefficients=L @ of_line.coefficients + profile.bend,
        covariance=L @ of_line.covariance @ L.T + of_bend,
        pass_covariance=(D + D.T) / 2,
        half_differences=None if halves is None else T @ halves @ T.T,
        independent_covariance=np.diag(s2 / counts),
        independent_s=float(np.sqrt(s2)),
        table=table,
    )
