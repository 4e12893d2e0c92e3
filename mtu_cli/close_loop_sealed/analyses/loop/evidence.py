"""What one table says of every candidate and check: the evidence that the gate judges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from mtu_cli.close_loop_sealed.analyses.loop.scan import SCATTER_CHECKS, Scan, drawn_statistics
from mtu_cli.close_loop_sealed.stats.column_groups import Packed
from mtu_cli.close_loop_sealed.stats.mean_squares import EntryNoise
from mtu_cli.close_loop_sealed.stats.profile_ratio import MemberRatios, ratios
from mtu_cli.close_loop_sealed.stats.remainder import DRAWN
from mtu_cli.close_loop_sealed.stats.scatter_tests import scatter_p, score_of, two_scatters_p
from mtu_cli.close_loop_sealed.stats.uneven import uneven
from mtu_cli.stats.least_squares import FloatArray, least_squares

OPERATIONS = "operation-scatter"
UNEVEN = 0.01
"""p of operations of one scatter below which members are judged by that of their own entries."""
WITH_TURNS = 0.01
"""p of no shift that goes with the parts' turns, below which it is theirs."""
LONE = 0.2
"""Of the rate of a test of operations, what single axes have: as a rule all scatter alike."""
LEAST_OF_ALL = 0.1
"""Share of an operation's mean square that is its own variance at least."""
CHECKS = (*DRAWN, *SCATTER_CHECKS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """Of one table: `statistics` (F + C,) of drawn candidates and checks, `closed` (S + 2,)
    -log p of scatters and variance checks, `log_bayes` (F + S,), `best` (F,) members, `unnamed`
    (2 A,) log Bayes factors of drifts and of fields without a name, `members` of all mean
    candidates end to end, (1, M).
    """

    statistics: FloatArray
    closed: FloatArray
    log_bayes: FloatArray
    best: np.ndarray
    unnamed: FloatArray
    members: MemberRatios


def evidence(
    scan: Scan,
    pack: Packed,
    y: FloatArray,
    grand: FloatArray,
    aside: frozenset[str] = frozenset(),
) -> Evidence:
    """Everything that the gate judges, of one table: `y` (N,), `grand` (A,).

    `aside` names scatters that were found before, or stand out now: of operations that scatter
    differently each member is judged by the scatter of the entries that it lies in.
    """
    left = pack.without_found(_evened(scan, y, aside))
    known = scan.null.predicted_part
    noise = scan.frame.noise(left, pack.dof, scan.dof, known, scan.predicted_dof)
    scatters = _scatters(scan, left, noise)
    statistics, found, offset = drawn_statistics(scan, pack, left[None], grand[None])
    noisy = dict(zip(scan.scatters, scatters, strict=True)).get(OPERATIONS, 1.0) < UNEVEN
    if noisy or OPERATIONS in aside:
        whole = pack.without_found(_evened(scan, y, aside - {OPERATIONS}))
        own = uneven(pack, *_variances(scan, whole))
        found = ratios(own, whole[None], len(scan.columns))
        statistics[:, : len(scan.columns)] = found.ratio
    strata = scan.frame.strata
    of_model = np.diag(scan.null.predicted_part)[:: 1 + strata.lines]
    predicted = of_model + (np.inf if scan.parts_scatter else 0.0)
    variances = scatter_p(strata, left, noise, predicted, scan.predicted_dof, scan.least)
    p = np.array([*scatters, *variances])
    closed = -np.log(np.maximum(p, 1e-300))
    n = float(pack.dof.max())
    scatter_bayes = np.array([0.5 * score_of(v) - 0.5 * np.log(n) for v in p[: len(scan.scatters)]])
    return Evidence(
        statistics=statistics[0],
        closed=closed,
        log_bayes=np.concatenate([found.log_bayes[0], offset[0], scatter_bayes]),
        best=found.best[0],
        unnamed=np.concatenate(scan.remainder.unnamed(left)),
        members=found.members,
    )


def _evened(scan: Scan, y: FloatArray, aside: frozenset[str]) -> FloatArray:
    """Coordinates in which scatters found before no longer show.

    Operations are brought to the same scatter; parts' turns (or growths) are taken out.
    """
    strata = scan.frame.strata
    found = y
    if OPERATIONS in aside:
        factor = 1 / np.sqrt(variance_by_operation(scan, found))
        found = strata.coordinates(strata.tables(found) * factor[:, None])[0]
    for i, name in enumerate(("rotation-scatter", "scale-scatter")):
        if name in aside:
            found = _without_direction(scan, found, i)
    return found


def variance_by_operation(scan: Scan, y: FloatArray) -> FloatArray:
    """Variances (H,) of the entries of each column's operation over that of all.

    What is left of entries beside parts and their lines is mixed from all columns, by Q (H, H):
    the mean squares of the operations are mixtures of their variances by the squares of Q.
    """
    strata = scan.frame.strata
    there = scan.frame.completion.observed[:, :, None]
    squares = np.mean(strata.tables(_interaction(scan, y)) ** 2, axis=(0, 2), where=there)
    C = strata.columns[:, 1 + strata.lines :]
    own = (scan.operation[:, None] == np.unique(scan.operation)).astype(float)
    share = own.T / own.sum(axis=0)[:, None]
    mixed, mean = share @ (C @ C.T) ** 2 @ own, share @ squares
    found = np.maximum(least_squares(mixed, mean).coefficients, LEAST_OF_ALL * mean)
    variance: FloatArray = own @ np.maximum(found, 1e-300)
    variance /= variance.mean()
    return variance


def _variances(scan: Scan, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variances (H, A) of entries by their operation, and P times those of their columns' means."""
    null = scan.null
    level = np.where(null.interaction > 0, null.interaction, 1.0)
    entry = variance_by_operation(scan, y)[:, None] * level
    return entry, entry + scan.frame.strata.shape[0] * null.column


def along_direction(scan: Scan, y: FloatArray, direction: FloatArray) -> FloatArray:
    """(P - 1,): the contrasts of the parts along a direction (A, 1 + k)."""
    total = np.zeros(scan.frame.strata.shape[0] - 1)
    for stratum in scan.frame.strata.all:
        if stratum.kind == "line":
            total += direction[stratum.axis, stratum.line] * y[stratum.slice]
    return total


def _without_direction(scan: Scan, y: FloatArray, which: int) -> FloatArray:
    direction = scan.directions[which]
    total = along_direction(scan, y, direction)
    found = y.copy()
    size, n = float(total @ total), len(total)
    for stratum in scan.frame.strata.all:
        if stratum.kind == "line":
            found[stratum.slice] -= direction[stratum.axis, stratum.line] * total
        elif stratum.kind == "part" and size > 0:
            # Turned about another point than the middle of its features a part shifts with it.
            own = y[stratum.slice]
            along, square = float(total @ own) ** 2 / size, float(own @ own)
            if fdtrc(1, n - 1, (n - 1) * along / max(square - along, 1e-300)) < WITH_TURNS:
                found[stratum.slice] -= total * (float(total @ own) / size)
    return found


def _interaction(scan: Scan, y: FloatArray) -> FloatArray:
    """The coordinates of the interaction alone, each axis to a mean square of 1."""
    only = np.zeros_like(y)
    for stratum in scan.frame.strata.all:
        if stratum.kind == "interaction":
            own = y[stratum.slice]
            only[stratum.slice] = own / max(float(np.sqrt(np.mean(own**2))), 1e-300)
    return only


def _scatters(scan: Scan, y: FloatArray, noise: EntryNoise) -> list[float]:
    found = []
    for name in scan.scatters:
        if name == OPERATIONS:
            found.append(_operations_p(scan, y))
        else:
            found.append(_direction_p(scan, y, name, noise))
    return found


def interaction_entries(scan: Scan, y: FloatArray) -> tuple[FloatArray, np.ndarray, float]:
    """What is left of entries (P, H, A) beside parts and columns, each axis to a mean square of 1;
    which are there (P, H); and the degrees of freedom an entry.
    """
    strata, there = scan.frame.strata, scan.frame.completion.observed
    P, H, _ = strata.shape
    share = ((P - 1) * (H - 1 - strata.lines) - int((~there).sum())) / int(there.sum())
    return strata.tables(_interaction(scan, y)), there, share


def _operations_p(scan: Scan, y: FloatArray) -> float:
    entries, there, share = interaction_entries(scan, y)
    codes = np.unique(scan.operation)
    if share <= 0:
        return 1.0
    p = []
    # Of two operations one against the other says it all.
    for c in codes[:1] if len(codes) == 2 else codes:
        own = there & (scan.operation == c)
        p.append(_scatters_apart(entries[own], entries[there & ~own], share))
    return min(1.0, len(p) * min(p))


def _scatters_apart(a: FloatArray, b: FloatArray, share: float) -> float:
    """p of entries (n, A) of one variance along all axes together, or (in `LONE` of its errors of
    the first kind) along one of them: what scatters along one is lost among the others.
    """
    A = a.shape[1]
    each = [two_scatters_p(a[:, i], b[:, i], share)[0] for i in range(A)] if A > 1 else []
    together = two_scatters_p(a, b, share)[0]
    return min(1.0, together / (1 - LONE), A * min(each) / LONE) if each else together


def _direction_p(scan: Scan, y: FloatArray, name: str, noise: EntryNoise) -> float:
    """p that parts turn (or grow) more than single entries and the machine's drift explain."""
    which = 0 if name == "rotation-scatter" else 1
    if (noise.dof <= 0).any():
        return 1.0
    total = along_direction(scan, y, scan.directions[which])
    own = scan.turns[which]
    return own.p(float(total @ total), noise.variance, noise.dof, scan.predicted_dof)
