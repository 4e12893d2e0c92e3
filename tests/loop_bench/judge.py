"""What the engine says of one data set."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from shop_day.day import Floats

from loop_bench.days import UM, BenchDay
from loop_bench.folds import LIBRARY
from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.describe import (
    Described,
    candidate_name,
    found_effects,
)
from mtu_cli.close_loop_sealed.analyses.loop.gross import set_aside
from mtu_cli.close_loop_sealed.analyses.loop.held_out import Fold, of_fold
from mtu_cli.close_loop_sealed.analyses.loop.one_table import verdict_of
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect, Verdict
from mtu_cli.close_loop_sealed.analyses.loop.search import Search, search
from mtu_cli.close_loop_sealed.analyses.loop.shown import verdict_on
from mtu_cli.close_loop_sealed.analyses.loop.twofold import twofold

ALPHA = 0.05
MOST = 4


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """`names` of the effects in the order found, with their `classes`; the checks that `fired`;
    `nameless`: a drift or field without a name explained more than any name; `ranked_first`
    without regard to the gate.
    """

    names: tuple[str, ...]
    classes: tuple[tuple[str, ...], ...]
    fired: tuple[str, ...]
    nameless: bool
    ranked_first: str
    gross: int
    seconds: float
    prepared: Prepared
    found: Search

    @property
    def unexplained(self) -> bool:
        return bool(self.fired) or self.nameless

    @property
    def written(self) -> bool:
        """Whether a machine gets an equation."""
        return any(step.index < self.prepared.scan.tested for step in self.found.steps)

    def lone(self) -> bool:
        """Whether the first effect is reported as the only cause that the data allow."""
        if self.unexplained or not self.names or len(self.classes[0]) > 1:
            return False
        return not self._effects(self._told())[0].aliases

    def verdict(self) -> Verdict:
        """As the command gives it, but for other pitches of a wave that fit as well."""
        told = self._told()
        fired = (*self.fired, *twofold(told))
        return verdict_of(self.found, self._effects(told), fired)

    def standing(self) -> tuple[str, ...]:
        """Names that stand though something without a name is there."""
        if not self.unexplained:
            return ()
        told = self._told()
        fired = (*self.fired, *twofold(told))
        return tuple(
            effect.name
            for effect in self._effects(told)
            if verdict_on(effect, fired, without_name=self.nameless) == "named"
        )

    def _told(self) -> Described:
        effects = added(self.prepared, self.found)
        return Described(prepared=self.prepared, found=self.found, effects=effects, chosen=())

    def _effects(self, told: Described) -> tuple[FoundEffect, ...]:
        return found_effects(told, [None] * len(self.found.steps))


def diagnosed(bench: BenchDay, errors: Floats) -> Diagnosis:
    """The diagnosis of errors (P, H, 2) um, timed."""
    given = bench.measured(errors)
    start = time.perf_counter()
    table, gross = set_aside(given)
    prepared = bench.prepared.with_table(table)
    found = search(prepared, bench.gate, alpha=ALPHA, most=MOST)
    seconds = time.perf_counter() - start
    return Diagnosis(
        names=tuple(prepared.candidates[step.index].name for step in found.steps),
        classes=tuple(
            tuple(candidate_name(prepared, i) for i in step.credible) for step in found.steps
        ),
        fired=found.fired(ALPHA),
        nameless=found.without_name,
        ranked_first=prepared.candidates[int(np.argmax(found.log_bayes))].name,
        gross=len(gross),
        seconds=seconds,
        prepared=prepared,
        found=found,
    )


def held_out_after(bench: BenchDay, errors: Floats, folds: Sequence[Fold]) -> float:
    """Mean square, um^2, of held-out parts' errors less what is foretold without them, as the
    command scores it but against the training parts' mean: as the oracle counts.
    """
    table = bench.measured(errors)
    total = 0.0
    for fold in folds:
        rest = errors - of_fold(table, fold, LIBRARY, alpha=ALPHA, most=MOST).foretold / UM
        rest = rest[~fold.split.kept] - rest[fold.split.kept].mean(axis=(0, 1))
        total += float(np.sum(rest**2))
    return total / errors.size
