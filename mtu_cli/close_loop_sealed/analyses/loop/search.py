"""The search: what passes the gate, ranked, taken out, and again until nothing passes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.causes import causes, levels_of
from mtu_cli.close_loop_sealed.analyses.loop.evidence import CHECKS, Evidence
from mtu_cli.close_loop_sealed.analyses.loop.needless import needless
from mtu_cli.close_loop_sealed.analyses.loop.one_size import is_one_size, of_no_size
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.ranking import posterior_of, ranked, scores_of
from mtu_cli.close_loop_sealed.analyses.loop.same_in_all import with_constants
from mtu_cli.close_loop_sealed.analyses.loop.same_strata import hides, is_same
from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan
from mtu_cli.close_loop_sealed.analyses.loop.several import several
from mtu_cli.close_loop_sealed.analyses.loop.state import State, Step
from mtu_cli.close_loop_sealed.analyses.loop.two_forms import in_two_names
from mtu_cli.close_loop_sealed.stats.column_groups import Column
from mtu_cli.close_loop_sealed.stats.family_gate import Gate
from mtu_cli.stats.least_squares import FloatArray

RIVAL = 0.1
"""Posterior of drifts and fields without a name from which on they are a likely rival."""
NONE: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """The steps in the order found; of the first look, family-wise `p`, `log_bayes` and
    `posterior` (F,) by candidate; `checks` (name, family-wise p) of what is left in the end.

    `nameless` are the smooth drifts and fields, by index, that explain as much as the names do, or
    are likely in the place of one or beside them. `stopped`: more passes, but so many causes were
    not asked for.
    """

    steps: tuple[Step, ...]
    p: FloatArray
    log_bayes: FloatArray
    posterior: FloatArray
    checks: tuple[tuple[str, float], ...]
    nameless: tuple[int, ...] = ()
    stopped: bool = False

    def fired(self, alpha: float) -> tuple[str, ...]:
        """The checks that say that something is left."""
        return tuple(name for name, p in self.checks if p < alpha)

    @property
    def without_name(self) -> bool:
        """Whether something that has no name may be there."""
        return bool(self.nameless)

    @property
    def members(self) -> tuple[int, ...]:
        """The members of the effects that have columns, in the order found."""
        return tuple(step.member for step in self.steps if step.member >= 0)


def search(
    prepared: Prepared, gate: Gate, *, alpha: float, most: int, unsure: frozenset[int] = NONE
) -> Search:
    """Searches a table for at most `most` causes (see `causes`) at the family-wise rate `alpha`.
    Candidates that are `unsure` are rivals of what is found, and not found themselves.

    What was found is projected out of data and candidates, with the derivative by what was
    searched: a grid value beside the true one must not look like a second effect. Where the next
    one would be a cause too many, the levels of those found are still looked at. What is `needless`
    beside those found after it is taken back.
    """
    state = State(prepared, gate)
    start, first_p = state.look(), state.first_p
    steps, stopped = _forward(state, [], alpha, most, unsure)
    left_out = unsure
    while (gone := needless(prepared, steps, alpha)) is not None:
        steps = [step for step in steps if step is not gone]
        # What is not told beside the others is not found in their place again.
        left_out = left_out | {gone.index}
        state = _without(prepared, gate, steps)
        steps, stopped = _forward(state, steps, alpha, most, left_out)
    looked = state.looked
    steps = in_two_names(prepared, steps, unsure)
    steps, too_many = with_constants(prepared, gate, steps, alpha, most, unsure)
    never = of_no_size(prepared, [step.member for step in steps if step.member >= 0])
    steps = _without_found(prepared, _beside_others(prepared, steps, never), never)
    return Search(
        steps=tuple(steps),
        p=first_p,
        log_bayes=start.log_bayes,
        posterior=posterior_of(start.log_bayes),
        checks=tuple(zip(CHECKS, state.checks.tolist(), strict=True)),
        nameless=_nameless(prepared.scan, start, looked, steps) if steps else (),
        stopped=stopped or too_many,
    )


def _forward(
    state: State, steps: list[Step], alpha: float, most: int, unsure: frozenset[int]
) -> tuple[list[Step], bool]:
    """The steps with all that passes beside them, and whether causes were too many."""
    prepared = state.prepared
    while more := _more(state, alpha, unsure):
        if causes(prepared, [*steps, *more]) > most:
            level = _next(state, alpha, unsure, levels_of(prepared, steps))
            if level is None:
                return steps, True
            more = [level]
        for step in more:
            steps.append(step)
            state.take_out(step)
        # An offset found before is the level of what explains it better.
        steps = [own for own in steps if own.index not in state.owned]
        state.look()
    return steps, False


def _without(prepared: Prepared, gate: Gate, steps: list[Step]) -> State:
    """What is left beside these steps."""
    state = State(prepared, gate)
    state.look()
    for step in steps:
        state.take_out(step)
    state.look()
    return state


def _nameless(scan: Scan, start: Evidence, last: Evidence, steps: list[Step]) -> tuple[int, ...]:
    """The drifts and fields without a name that say as much as the names found.

    Either all of them explain the first look better than all names together, or one of them
    is a likely rival of a name, or parts drift along every axis and still do beside what was
    found: parts that wander look like a trend, a step, a warm-up.
    """
    first, axes = scan.tested + len(scan.scatters), len(start.unnamed) // 2
    unnamed = np.maximum(start.unnamed, 0.0)
    if unnamed.sum() > sum(max(step.log_bayes, 0.0) for step in steps):
        return tuple((first + np.flatnonzero(unnamed)).tolist())
    rivals = {i for s in steps if s.unnamed > RIVAL for i in s.credible if i >= first}
    if rivals:
        return tuple(sorted(rivals))
    before, after = start.unnamed[:axes], last.unnamed[:axes]
    if axes > 1 and before.min() > 0 and after.max() > 0:
        return tuple((first + np.flatnonzero(after > 0)).tolist())
    return ()


def _beside_others(prepared: Prepared, steps: list[Step], never: frozenset[int]) -> list[Step]:
    """The steps with their classes as they are beside all other effects, of which no member is one
    of those that are `never` rivals.
    """
    if sum(step.member >= 0 for step in steps) < 2:
        return steps
    found = []
    for own in steps:
        if own.member < 0:
            found.append(own)
            continue
        state = State(prepared, None, _hidden(prepared, own, steps))
        for step in steps:
            if step is not own:
                state.take_out(step)
        # Another form of a cause that is there in any case is no rival.
        others = {step.index for step in steps} - {own.index}
        looked = state.look()
        others |= {i for i, m in enumerate(looked.best.tolist()) if m in never} - {own.index}
        scores = scores_of(looked, state.done | others)
        scores[prepared.scan.tested :] = -np.inf
        beside = ranked(prepared.scan, own, scores, state.looked.unnamed)
        # Its own evidence is that of both sizes, of which one is uncertain.
        found.append(replace(beside, log_bayes=own.log_bayes) if own.constant else beside)
    return found


def _hidden(prepared: Prepared, step: Step, steps: Sequence[Step]) -> Column | None:
    """What is the same in all parts of another effect, if this one is just that."""
    scan, flat = prepared.scan, prepared.scan.flat()
    own = flat[step.member]
    if len(own) != 1 or not is_same(scan, own[0]):
        return None
    others = [column for s in steps if s.member >= 0 and s is not step for column in flat[s.member]]
    return own[0] if any(hides(scan, column, own[0]) for column in others) else None


def _without_found(prepared: Prepared, steps: list[Step], never: frozenset[int]) -> list[Step]:
    """The steps without the others in their classes: what was found itself is no rival, nor is what
    has `never` members alone: no axis has the size of it (`of_no_size`).
    """
    owners = prepared.scan.owners()
    alive = {i for m, i in enumerate(owners) if m not in never}
    out = {step.index for step in steps} | (set(owners) - alive)
    return [
        replace(step, credible=tuple(i for i in step.credible if i == step.index or i not in out))
        for step in steps
    ]


def _more(state: State, alpha: float, unsure: frozenset[int]) -> list[Step]:
    """The best of what passes; where nothing does, effects that hide one another."""
    step = _next(state, alpha, unsure)
    return several(state, alpha, unsure) if step is None else [step]


def _next(
    state: State, alpha: float, unsure: frozenset[int], only: frozenset[int] | None = None
) -> Step | None:
    """The best of what passes, is of one size, and is not `unsure`: those do not, and are rivals as
    ever.
    """
    p = state.p.copy()
    p[list(unsure)] = 1.0
    while True:
        step = _step(state.prepared.scan, state.looked, p, alpha, state.done, only)
        if step is None or is_one_size(state, step):
            return step
        p[step.index] = 1.0


def _step(
    scan: Scan,
    looked: Evidence,
    p: FloatArray,
    alpha: float,
    done: set[int],
    only: frozenset[int] | None = None,
) -> Step | None:
    """The best of what passes, of `only` these where that is given; None if nothing does."""
    passing = [i for i in range(len(p)) if p[i] < alpha and i not in done]
    scores = scores_of(looked, done)
    if only is not None:
        # What passes beside them is another cause; what does not is a rival as ever.
        scores[[i for i in passing if i not in only]] = -np.inf
        passing = [i for i in passing if i in only]
    if not passing:
        return None
    # A covariate that explains why parts grow or turn says more than that they do.
    if any(i < scan.tested for i in passing):
        scores[scan.tested :] = -np.inf
        passing = [i for i in passing if i < scan.tested]
    # Of exact aliases the first of the library: a named cause before an unnamed column.
    index = max(passing, key=lambda i: (round(float(scores[i]), 6), -i))
    step = Step(
        index=index,
        member=int(looked.best[index]) if index < len(scan.columns) else -1,
        p=float(p[index]),
        log_bayes=float(scores[index]),
        posterior=1.0,
        credible=(),
    )
    return ranked(scan, step, scores, looked.unnamed)
