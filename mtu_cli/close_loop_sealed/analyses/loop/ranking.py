"""How likely candidates are beside one another: posteriors, credible sets, places."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.evidence import Evidence
from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.stats.column_groups import MemberColumns
from mtu_cli.stats.least_squares import FloatArray

CREDIBLE = 0.95
EXCLUDED = 0.01
"""Posterior below which a drift or field without a name is out: no list of the library is complete,
so that a lone name asks for more than the 95 % among names.
"""
HALF = 0.49
"""Of a column that lies evenly in two axes each holds this share."""


def posterior_of(log_bayes: FloatArray) -> FloatArray:
    """Posterior (F,) of candidates that are equally likely before."""
    weight = np.exp(log_bayes - log_bayes.max(initial=-np.inf))
    found: FloatArray = weight / weight.sum()
    return found


def scores_of(looked: Evidence, done: set[int]) -> FloatArray:
    scores = looked.log_bayes.copy()
    scores[list(done)] = -np.inf
    return scores


def ranked(scan: Scan, step: Step, scores: FloatArray, unnamed: FloatArray) -> Step:
    """The step with the posterior and the credible set that these scores give.

    A drift or field without a name is a rival of effects that lie where it would, and in the
    credible set until it is `EXCLUDED`. A mean error is no rival of an effect that was found
    beside a free mean, nor such an effect one of it: either may act without the other. Of the
    passes of one run it is: what drifts begins with the run, and has a mean of its own there. Nor
    is what acts along other axes alone: it leaves the error that was found as it is.
    """
    scores = np.where(_along(scan, step), scores, -np.inf)
    first = len(scan.columns)
    if step.member >= 0:
        scores[first : scan.tested] = -np.inf
    elif step.index < scan.tested and not scan.readings:
        scores[:first] = scores[scan.tested :] = -np.inf
    rivals = np.where(same_place(scan, step), unnamed, -np.inf)
    posterior = posterior_of(np.concatenate([scores, rivals]))
    order = np.argsort(-posterior, kind="stable")
    count = int(np.searchsorted(np.cumsum(posterior[order]), CREDIBLE)) + 1
    credible = [
        int(i)
        for rank, i in enumerate(order)
        if rank < count or (i >= len(scores) and posterior[i] >= EXCLUDED)
    ]
    if step.index not in credible:
        credible.insert(0, step.index)
    return replace(
        step,
        log_bayes=float(scores[step.index]),
        posterior=float(posterior[step.index]),
        credible=tuple(credible),
        unnamed=float(posterior[len(scores) :].sum()),
    )


def _along(scan: Scan, step: Step) -> np.ndarray:
    """Which candidates (F + S,) act along an axis of an effect; scatters do along all of them."""
    strata, F = scan.frame.strata.all, len(scan.columns)

    def axes(members: Iterable[MemberColumns]) -> set[int]:
        return {strata[i].axis for member in members for column in member for i in column}

    found = np.ones(scan.tested + len(scan.scatters), bool)
    if step.index >= scan.tested:
        return found
    offset = step.member < 0
    own = {scan.offsets[step.index - F]} if offset else axes([scan.flat()[step.member]])
    found[:F] = [not own.isdisjoint(axes(members)) for members in scan.columns]
    found[F : scan.tested] = [axis in own for axis in scan.offsets]
    return found


def same_place(scan: Scan, step: Step) -> np.ndarray:
    """Whether an effect lies (by half of its columns at least) in the part stratum of each
    axis, then in the column stratum of each.
    """
    A = scan.frame.strata.shape[2]
    squares = {"part": np.zeros(A), "column": np.zeros(A)}
    total = 0.0
    if step.member >= 0:
        for column in scan.flat()[step.member]:
            for index, values in column.items():
                stratum = scan.frame.strata.all[index]
                size = float(values @ values)
                total += size
                if stratum.kind in squares:
                    squares[stratum.kind][stratum.axis] += size
    return np.concatenate([squares["part"], squares["column"]]) > HALF * total
