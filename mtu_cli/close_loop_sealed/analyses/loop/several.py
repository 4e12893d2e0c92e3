"""Several effects that hide one another: none passes beside the others.

A scale and a squareness of one axis lie in the few coordinates that the means over all parts have.
Looked for one by one, each has the other for scatter, and the larger both are, the more of it. All
smooth directions together (the check `common-shape`) show that something is there; the fewest
effects are taken that leave each other told.

A step and a drift with temperature do the same to the means of parts: of all pairs the one that
leaves least is taken where its F passes among all of them (Bonferroni), at a rate of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import fdtrc

from mtu_cli.close_loop_sealed.analyses.loop.evidence import CHECKS
from mtu_cli.close_loop_sealed.analyses.loop.same_strata import ALIAS, whitened_column
from mtu_cli.close_loop_sealed.analyses.loop.state import State, Step
from mtu_cli.close_loop_sealed.stats.profile_ratio import unit_information
from mtu_cli.close_loop_sealed.stats.remainder import COMMON_SHAPE
from mtu_cli.stats.least_squares import FloatArray, beside

SMOOTH = 0.5
"""Share of a column in the smooth directions from which on it is one of those that hide others."""


OF_PAIRS = 0.2
"""Share of the rate of false alarms that pairs may add to that of all tests by themselves."""


@dataclass(frozen=True, slots=True)
class _Lone:
    """Candidate `index`, its `member`, and its column (n,) in one stratum, whitened, freed of what
    was found.
    """

    index: int
    member: int
    column: FloatArray


def several(state: State, alpha: float, unsure: frozenset[int]) -> list[Step]:
    """Effects that are told beside each other where none passes by itself: along the smooth
    directions of an axis, else in the means of parts. None where there are none.
    """
    return _of_shape(state, alpha, unsure) or _of_parts(state, alpha, unsure)


def _of_shape(state: State, alpha: float, unsure: frozenset[int]) -> list[Step]:
    """The fewest effects along the smooth directions of an axis, each of which is told (p below
    `alpha`, F) beside the others, where the check of all of these passes `alpha` among all tests;
    of as many those that leave the least, of the axis that shows most.
    """
    p = float(state.checks[CHECKS.index(COMMON_SHAPE)])
    if p >= alpha:
        return []
    left = state.pack.without_found(state.y)
    strata = state.scan.frame.strata.all
    shown = {
        s: _shown(left[stratum.slice], len(stratum.lead))
        for s, stratum in enumerate(strata)
        if stratum.kind == "column" and len(stratum.lead) > 1
    }
    for s in sorted(shown, key=lambda own: -shown[own]):
        known, y = list(_lone(state, s, unsure, smooth=True)), left[strata[s].slice]
        n = float(state.pack.dof[s])
        for count in range(2, len(strata[s].lead) + 1):
            told = [_told(y, n, own, p, alpha) for own in combinations(known, count)]
            best = min((own for own in told if own is not None), key=_left, default=None)
            if best is not None:
                return best[1]
    return []


def _of_parts(state: State, alpha: float, unsure: frozenset[int]) -> list[Step]:
    """The pair of effects in the means of parts along an axis that leaves least of them, where F
    passes among all pairs (`OF_PAIRS`), and of each beside the other among all effects.
    """
    left = state.pack.without_found(state.y)
    strata = state.scan.frame.strata.all
    places = [s for s, stratum in enumerate(strata) if stratum.kind == "part"]
    known = {s: list(_lone(state, s, unsure)) for s in places}
    pairs = sum(len(own) * (len(own) - 1) // 2 for own in known.values())
    best: tuple[float, list[Step]] = (OF_PAIRS * alpha, [])
    for s in places:
        y, n = left[strata[s].slice], float(state.pack.dof[s])
        pair = _best_pair(y, known[s]) if n > 2 else None
        if pair is None:
            continue
        share, chosen = pair
        p = pairs * float(fdtrc(2, n - 2, share / max(1 - share, 1e-300) * (n - 2) / 2))
        told = _told(y, n, chosen, p, alpha / len(known[s])) if p < best[0] else None
        if told is not None:
            best = p, told[1]
    return best[1]


def _best_pair(y: FloatArray, known: Sequence[_Lone]) -> tuple[float, tuple[_Lone, _Lone]] | None:
    """The pair of two candidates that has most of y (n,), and its share of the squares."""
    if len(known) < 2 or not y.any():
        return None
    X = np.stack([own.column / np.linalg.norm(own.column) for own in known], axis=1)
    r, alike = X.T @ y / np.linalg.norm(y), X.T @ X
    other = np.array([own.index for own in known])
    apart = 1 - alike**2
    share = r[:, None] ** 2 + r**2 - 2 * np.outer(r, r) * alike
    usable = (apart > ALIAS) & (other[:, None] != other)
    share = np.where(usable, share / np.where(usable, apart, 1.0), -np.inf)
    i, j = sorted(divmod(int(np.argmax(share)), len(known)))
    if not usable[i, j]:
        return None
    return min(float(share[i, j]), 1.0), (known[i], known[j])


def _shown(y: FloatArray, k: int) -> float:
    """The squares of coordinates (n,) along k smooth directions over those beside."""
    return float(y[:k] @ y[:k]) / max(float(y[k:] @ y[k:]), 1e-300)


def _left(told: tuple[float, list[Step]]) -> float:
    return told[0]


def _lone(state: State, s: int, unsure: frozenset[int], *, smooth: bool = False) -> Iterator[_Lone]:
    """Members of one column that lies in stratum `s` alone; if `smooth`, with most of it along
    smooth directions.
    """
    scan = state.scan
    k, Q = len(scan.frame.strata.all[s].lead), state.pack.found.get(s)
    for index, m, member in scan.walk():
        free = index not in state.done | unsure and m not in state.members
        if free and len(member) == 1 and set(member[0]) == {s}:
            own = whitened_column(scan, member[0], [s])
            if smooth and own[:k] @ own[:k] <= SMOOTH * (own @ own):
                continue
            left = own if Q is None else own - Q @ (Q.T @ own)
            if left @ left > ALIAS * (own @ own):
                yield _Lone(index, m, left)


def _told(
    y: FloatArray, n: float, chosen: Sequence[_Lone], p: float, alpha: float
) -> tuple[float, list[Step]] | None:
    """The squares that effects leave of y, with n degrees of freedom, and their steps; None where
    one of them is not told beside the others.
    """
    if len({own.index for own in chosen}) < len(chosen):
        return None
    count = len(chosen)
    dof = n - count
    rows = np.stack([own.column / np.linalg.norm(own.column) for own in chosen] + [y], axis=1)
    rest = float(beside(rows, count)[0, 0]) ** 2
    steps = []
    for i, own in enumerate(chosen):
        order = [*(j for j in range(count) if j != i), i, count]
        (size, along), _ = beside(rows[:, order], count - 1)
        share = along**2 / max(rest, 1e-300)
        if dof < 1 or size**2 <= ALIAS or fdtrc(1, dof, share * dof) >= alpha:
            return None
        steps.append(
            Step(
                index=own.index,
                member=own.member,
                p=p,
                log_bayes=float(unit_information(n * np.log1p(share), n, 1)),
                posterior=1.0,
                credible=(own.index,),
            )
        )
    return rest, steps
