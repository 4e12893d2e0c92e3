"""All candidates and checks on one table: the statistics that the gate judges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.column_groups import MemberColumns, Packed, packed
from mtu_cli.stats.family_gate import Gate, gate_of
from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.stats.loop_frame import Frame
from mtu_cli.stats.loop_null import NullModel, draw
from mtu_cli.stats.profile_ratio import MemberRatios, Ratios, ratios, unit_information
from mtu_cli.stats.remainder import (
    DRAWN,
    Remainder,
    scatter_p,
    score_of,
    two_scatters_p,
    variance_ratio_p,
)
from mtu_cli.stats.streams import stream
from mtu_cli.stats.uneven import uneven

BATCH = 200
OPERATIONS = "operation-scatter"
UNEVEN = 0.01
"""p of operations of one scatter below which members are judged by that of their own entries."""
LEAST_OF_ALL = 0.1
"""Share of an operation's mean square that is its own variance at least."""
SCATTER_CHECKS = ("column-variance", "part-variance")
CHECKS = (*DRAWN, *SCATTER_CHECKS)


@dataclass(frozen=True, kw_only=True)
class Scan:
    """What is tested, in order: `columns` the members of the mean candidates, then the axes of
    `offsets`, then the drawn checks; `scatters` and the variance checks have p of their own.

    `names` are those of all candidates: mean, offset, scatter; `least` (S,) the variance of
    rounding. `parts_scatter`: the model has scatter of parts, how large is not known before.
    """

    frame: Frame
    dof: FloatArray
    whitening: FloatArray
    names: tuple[str, ...]
    columns: tuple[tuple[MemberColumns, ...], ...]
    base: tuple[MemberColumns, ...]
    offsets: tuple[int, ...]
    scatters: tuple[str, ...]
    remainder: Remainder
    null: NullModel
    operation: np.ndarray
    directions: FloatArray
    predicted_dof: float
    least: FloatArray
    parts_scatter: bool = False

    @property
    def tested(self) -> int:
        """Candidates whose statistic is drawn."""
        return len(self.columns) + len(self.offsets)

    def pack(self, found: Sequence[MemberColumns] = ()) -> Packed:
        """The mean candidates beside what was found."""
        return packed(
            self.frame.strata,
            self.dof,
            self.whitening,
            self.columns,
            (*self.base, *found),
            self.least,
        )


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


def drawn_statistics(
    scan: Scan, pack: Packed, y: FloatArray, grand: FloatArray
) -> tuple[FloatArray, Ratios, FloatArray]:
    """Statistics (B, F + C), the ratios of the mean candidates, log Bayes of offsets (B, A')."""
    found = ratios(pack, y, len(scan.columns))
    offset, log_bayes = _offsets(scan, y, grand)
    checks = scan.remainder.statistics(y)
    return np.concatenate([found.ratio, offset, checks], axis=1), found, log_bayes


def _offsets(scan: Scan, y: FloatArray, grand: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Likelihood ratios (B, A') of a mean error, against the scatter of parts and columns."""
    strata = scan.frame.strata
    P, H, _ = strata.shape
    T, BF = np.zeros((len(y), len(scan.offsets))), np.zeros((len(y), len(scan.offsets)))
    for i, axis in enumerate(scan.offsets):
        squares, sign = [], []
        for kind, s in (("part", 1.0), ("column", 1.0), ("interaction", -1.0)):
            stratum = strata.find(kind, axis)  # type: ignore[arg-type]  # a Kind
            if stratum is None:
                continue
            n = max(float(scan.dof[strata.all.index(stratum)]), 1.0)
            squares.append((np.sum(y[:, stratum.slice] ** 2, axis=1) / n, n))
            sign.append(s)
        values = np.array([s * v for s, (v, _) in zip(sign, squares, strict=True)])
        largest = np.max(np.abs(values), axis=0)
        level = np.maximum(values.sum(axis=0), 0.5 * largest)
        spread = np.array([v**2 / n for v, n in squares]).sum(axis=0)
        common = scan.null.common[axis * (1 + strata.lines)]
        variance = level + common @ common
        # Without any scatter every part says the same.
        nu = np.where(level > 0, level**2 / np.maximum(spread, 1e-300), P - 1.0)
        nu = np.maximum(nu, 1.0)
        t2 = grand[:, axis] ** 2 * P * H / np.maximum(variance, 1e-300)
        T[:, i] = nu * np.log1p(t2 / nu)
        BF[:, i] = unit_information(T[:, i], nu, 1)
    return T, BF


def calibrated(scan: Scan, samples: int, seed: int, key: int = 0) -> Gate:
    """The gate of a scan: its statistics on drawn tables in which nothing is undeclared.

    `key` tells the draws of one gate of a call from those of another.
    """
    rng = stream(seed, 6, 2, key)
    empty = [s.slice for s, n in zip(scan.frame.strata.all, scan.dof, strict=True) if n <= 0]
    pack = scan.pack()
    found = []
    for first in range(0, samples, BATCH):
        y, grand = draw(scan.frame, scan.null, min(BATCH, samples - first), rng)
        for place in empty:
            y[:, place] = 0.0
        found.append(drawn_statistics(scan, pack, pack.without_found(y), grand)[0])
    closed = len(scan.scatters) + len(SCATTER_CHECKS)
    return gate_of(np.concatenate(found), rng, independent=closed)


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
    scatters = _scatters(scan, left)
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
    variances = scatter_p(strata, left, pack.dof, predicted, scan.predicted_dof)
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
        factor = 1 / np.sqrt(_by_operation(scan, found))
        found = strata.coordinates(strata.tables(found) * factor[:, None])[0]
    for i, name in enumerate(("rotation-scatter", "scale-scatter")):
        if name in aside:
            found = _without_direction(scan, found, scan.directions[i])
    return found


def _by_operation(scan: Scan, y: FloatArray) -> FloatArray:
    """Variances (H,) of the entries of each column's operation over that of all.

    What is left of entries beside parts and their lines is mixed from all columns, by Q (H, H):
    the mean squares of the operations are mixtures of their variances by the squares of Q.
    """
    strata = scan.frame.strata
    squares = np.mean(strata.tables(_interaction(scan, y)) ** 2, axis=(0, 2))
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
    entry = _by_operation(scan, y)[:, None] * level
    return entry, entry + scan.frame.strata.shape[0] * null.column


def _without_direction(scan: Scan, y: FloatArray, direction: FloatArray) -> FloatArray:
    total = np.zeros(scan.frame.strata.shape[0] - 1)
    lines = [s for s in scan.frame.strata.all if s.kind == "line"]
    for stratum in lines:
        total += direction[stratum.axis, stratum.line] * y[stratum.slice]
    found = y.copy()
    for stratum in lines:
        found[stratum.slice] -= direction[stratum.axis, stratum.line] * total
    return found


def _interaction(scan: Scan, y: FloatArray) -> FloatArray:
    """The coordinates of the interaction alone, each axis to a mean square of 1."""
    only = np.zeros_like(y)
    for stratum in scan.frame.strata.all:
        if stratum.kind == "interaction":
            own = y[stratum.slice]
            only[stratum.slice] = own / max(float(np.sqrt(np.mean(own**2))), 1e-300)
    return only


def _scatters(scan: Scan, y: FloatArray) -> list[float]:
    found = []
    for name in scan.scatters:
        if name == OPERATIONS:
            found.append(_operations_p(scan, y))
        else:
            found.append(_direction_p(scan, y, name))
    return found


def _operations_p(scan: Scan, y: FloatArray) -> float:
    strata = scan.frame.strata
    P, H, _ = strata.shape
    entries = strata.tables(_interaction(scan, y))
    codes = np.unique(scan.operation)
    share = (P - 1) * (H - 1 - strata.lines) / (P * H)
    p = [
        two_scatters_p(entries[:, scan.operation == c], entries[:, scan.operation != c], share)[0]
        # Of two operations one against the other says it all.
        for c in (codes[:1] if len(codes) == 2 else codes)
    ]
    return min(1.0, len(p) * min(p))


def _direction_p(scan: Scan, y: FloatArray, name: str) -> float:
    """p that parts turn (or grow) more than single entries and the machine's drift explain."""
    strata = scan.frame.strata
    P, k = strata.shape[0], strata.lines
    direction = scan.directions[0 if name == "rotation-scatter" else 1]
    total = np.zeros(P - 1)
    level = float(direction.reshape(-1) @ scan.null.predicted_part @ direction.reshape(-1))
    spread = level**2 / scan.predicted_dof
    for stratum in strata.all:
        if stratum.kind == "line":
            total += direction[stratum.axis, stratum.line] * y[stratum.slice]
        elif stratum.kind == "interaction":
            n = float(scan.dof[strata.all.index(stratum)])
            if n <= 0:
                return 1.0
            own = float(np.sum(y[stratum.slice] ** 2)) / n
            share = float(np.sum(direction[stratum.axis, 1 : k + 1] ** 2)) * own
            level += share
            spread += share**2 / n
    return variance_ratio_p(float(np.mean(total**2)), level, P - 1, level**2 / max(spread, 1e-300))


__all__ = ["CHECKS", "Evidence", "Scan", "calibrated", "drawn_statistics", "evidence"]
