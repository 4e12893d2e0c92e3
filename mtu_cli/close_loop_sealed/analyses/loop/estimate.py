"""Coefficients of the effects that were found, jointly, with their covariance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan
from mtu_cli.close_loop_sealed.stats.column_groups import MemberColumns, whitened
from mtu_cli.close_loop_sealed.stats.loop_null import draw
from mtu_cli.close_loop_sealed.stats.strata import Strata
from mtu_cli.close_loop_sealed.stats.stratified import StratifiedFit, stratified_fit
from mtu_cli.stats.least_squares import FloatArray, least_squares, shortened
from mtu_cli.stats.streams import stream

DRAWN = 3_000
BATCH_ENTRIES = 2_000_000
MOST_ENTRIES = 60_000_000
FEWEST_DRAWN = 200
FLAT = 1e-3
"""Of chi^2: a change that the data do not see."""


def raw_design(scan: Scan, members: Sequence[MemberColumns]) -> FloatArray:
    """The columns of all members, (N, k)."""
    strata = scan.frame.strata
    columns = [column for member in members for column in member]
    X = np.zeros((strata.size, len(columns)))
    for j, column in enumerate(columns):
        for index, values in column.items():
            X[strata.all[index].slice, j] = values
    return X


def estimate(
    scan: Scan, y: FloatArray, members: Sequence[MemberColumns], beside: FloatArray | None = None
) -> StratifiedFit:
    """Generalised least squares of `y` (N,) on the columns of `members`, beside the polynomial
    that the readings themselves gave and the columns `beside` (N, m).
    """
    strata = scan.frame.strata
    X = whitened_design(scan, members, beside)
    places = [stratum.slice for stratum in strata.all]
    own = whitened(strata, scan.whitening, y)
    fit = stratified_fit(X, own, places, scan.dof, entries_of(strata))
    return fit.only(sum(len(member) for member in members))


def entries_of(strata: Strata) -> NDArray[np.int64]:
    """By stratum (S,) the interaction of its axis, which every mean square has in it; itself in a
    table of one part, that has none.
    """
    own = {s.axis: i for i, s in enumerate(strata.all) if s.kind == "interaction"}
    return np.array([own.get(s.axis, i) for i, s in enumerate(strata.all)], np.int64)


def whitened_design(
    scan: Scan, members: Sequence[MemberColumns], beside: FloatArray | None = None
) -> FloatArray:
    """The whitened columns (N, k): of members, `beside` and of the readings' polynomial."""
    X = raw_design(scan, [*members, *scan.base])
    whole = X if beside is None else np.concatenate([X, beside], axis=1)
    return whitened(scan.frame.strata, scan.whitening, whole)


def root_weights(strata: Strata, weights: FloatArray) -> FloatArray:
    """Roots (N,) of the weights (S,) of each coordinate's stratum."""
    return np.concatenate(
        [np.full(s.size, np.sqrt(w)) for s, w in zip(strata.all, weights, strict=True)]
    )


def of_coordinates(scan: Scan, members: Sequence[MemberColumns], weights: FloatArray) -> FloatArray:
    """(N, k): beta, at these weights (S,), is its transpose times the coordinates."""
    strata = scan.frame.strata
    k = sum(len(member) for member in members)
    X = whitened_design(scan, members)
    w = np.concatenate(
        [np.full(s.size, weight) for s, weight in zip(strata.all, weights, strict=True)]
    )
    rows = shortened(np.sqrt(w)[:, None] * X)
    C = least_squares(rows, np.zeros(len(rows))).unscaled_covariance[:k]
    # beta = C X'W H y with the whitening H: applied to the k columns, not to all that is drawn.
    return whitened(strata, scan.whitening.transpose(0, 2, 1), w[:, None] * (X @ C.T))


def searched_spread(
    scan: Scan,
    members: Sequence[MemberColumns],
    weights: FloatArray,
    slopes: FloatArray,
    most: FloatArray,
) -> FloatArray:
    """What it adds to the covariance of beta that m values of what was searched are estimates,
    too: S (k + m, m), of beta and of these values, of which S S' is added. `slopes` (N, m) are the
    derivatives of what the effects say by them.

    No combination of these values is less certain than by their standard uncertainties `most`
    (m,), which the search alone leaves. What changes nothing of the data, as a pitch at three
    places, is no estimate: whoever writes one value has chosen it, and beta is of that.

    With the columns X and the slopes T, whitened and weighted, c = (X'X)^-1 X'T and R = T - X c,
    S S' has the blocks c M c', -c M and M, M = (R'R)^-1: those of the inverse of [X T]'[X T], less
    that of X'X.
    """
    strata = scan.frame.strata
    k = sum(len(member) for member in members)
    root = root_weights(strata, weights)[:, None]
    X = root * whitened_design(scan, members)
    T = root * whitened(strata, scan.whitening, slopes)
    fits = [least_squares(X, column) for column in T.T]
    c = np.stack([fit.coefficients for fit in fits], axis=1)
    R = T - X @ c
    held, turn = np.linalg.svd(R * most, full_matrices=False)[1:]
    both = np.concatenate([-c[:k], np.eye(len(most))])
    share = np.where(held**2 < FLAT, 0.0, 1.0 / np.maximum(held, 1.0))
    found: FloatArray = both @ (most[:, None] * turn.T * share)
    return found


def drawn_covariance(
    scan: Scan, members: Sequence[MemberColumns], weights: FloatArray, seed: int | None
) -> FloatArray:
    """The covariance (k + A) x2 of beta, at these weights (S,), and of the grand means behind
    it, from tables drawn of the null; without a `seed` from few of them.

    In a table that is incomplete, whose parts were set free, or whose axes share an
    uncertainty, coordinates are correlated: the weights are then not the inverse covariance.
    """
    strata = scan.frame.strata
    of_drawn = of_coordinates(scan, members, weights)
    most = FEWEST_DRAWN if seed is None else DRAWN
    samples = int(np.clip(MOST_ENTRIES // max(strata.size, 1), FEWEST_DRAWN, most))
    batch = max(1, BATCH_ENTRIES // max(strata.size, 1))
    rng = stream(seed or 0, 6, 1)
    found = []
    for first in range(0, samples, batch):
        y, grand = draw(scan.frame, scan.null.as_estimated(), min(batch, samples - first), rng)
        found.append(np.concatenate([y @ of_drawn, grand], axis=1))
    drawn = np.concatenate(found)
    covariance: FloatArray = drawn.T @ drawn / len(drawn)
    return covariance
