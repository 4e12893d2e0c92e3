"""What a search has found so far, and what is left of the data beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.estimate import estimate, raw_design
from mtu_cli.close_loop_sealed.analyses.loop.evidence import Evidence, evidence
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, without_rounding
from mtu_cli.close_loop_sealed.analyses.loop.same_strata import hides, same_of
from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan, beside_found
from mtu_cli.close_loop_sealed.model.effect_candidate import CENTRED
from mtu_cli.close_loop_sealed.stats.column_groups import Column, MemberColumns, Packed, whiten
from mtu_cli.close_loop_sealed.stats.family_gate import Gate
from mtu_cli.stats.least_squares import FloatArray

COUNTS = 0.1
"""Share of a column's information from which on a stratum is freed of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One effect: candidate `index` and its best `member` (-1 for offsets and scatters),
    family-wise `p`, log Bayes factor, posterior among the candidates, and the candidates of
    the 95 % credible set, the best first. Indices beyond the candidates are drifts (by axis)
    and fields (by axis) without a name, which stay in that set until they are out at 1 %;
    `unnamed` is the posterior of these together. `constant`: what is the same in all parts of
    another effect is of a size of its own (`same_in_all`), whether that is proven or not.
    """

    index: int
    member: int
    p: float
    log_bayes: float
    posterior: float
    credible: tuple[int, ...]
    unnamed: float = 0.0
    constant: bool = False


def family_p(scan: Scan, gate: Gate, found: Evidence) -> tuple[FloatArray, FloatArray]:
    """Family-wise p of all candidates (F,) and of the checks (C,)."""
    drawn = gate.family_p(gate.minus_log_p(found.statistics))
    closed = gate.family_p(found.closed)
    F, S = scan.tested, len(scan.scatters)
    return np.concatenate([drawn[:F], closed[:S]]), np.concatenate([drawn[F:], closed[S:]])


class State:
    """What has been found, and what is left of the data beside it."""

    looked: Evidence
    scan: Scan
    pack: Packed
    y: FloatArray
    """Of what is left: coordinates (N,)."""

    def __init__(self, prepared: Prepared, gate: Gate | None, apart: Column | None = None) -> None:
        """`apart` is what is the same in all parts of an effect that was found and is not to hide
        what is looked for there: it has a size of its own.
        """
        self.prepared, self.gate, self.apart = prepared, gate, apart
        self.found: list[MemberColumns] = []
        self.members: list[int] = []
        self.done: set[int] = set()
        self.offsets: set[int] = set()
        self.owned: set[int] = set()
        self.p = self.first_p = self.checks = np.zeros(0)

    def look(self) -> Evidence:
        """Everything that can be tested beside what was found."""
        prepared, y = self.prepared, self.prepared.y
        grand = prepared.grand.copy()
        if self.members:
            columns = prepared.whole(self.members)
            own = columns if self.apart is None else [*columns, (self.apart,)]
            fit = estimate(prepared.scan, y, own)
            design = raw_design(prepared.scan, columns)
            beta = fit.beta[: design.shape[1]]
            y = without_rounding(prepared.table, y - design @ beta)
            grand -= beta @ np.concatenate([prepared.means[m] for m in self.members])
            # What was taken out scatters no more: what it hid may show now.
            prepared = prepared.with_null_of(y)
            self.found = self._freed(prepared.scan, fit.weights)
        grand[list(self.offsets)] = 0.0
        scan = prepared.scan
        pack = scan.pack(self.found)
        # Strata that hold little of an effect are not freed of it: there it is no second one.
        pack.usable[self.members] = False
        looked = evidence(scan, pack, y, grand, self._aside())
        self.scan, self.pack, self.y = scan, pack, y
        first = not self.p.size
        self.looked = looked
        if self.gate is not None:
            gate = self.gate if first else beside_found(self.gate, scan, pack)
            self.p, self.checks = family_p(scan, gate, looked)
            if first:
                self.first_p = self.p
        return looked

    def _freed(self, scan: Scan, weights: FloatArray) -> list[MemberColumns]:
        """The columns that what is left is freed of: of what was found and of its derivatives by
        what was searched, where they count.
        """
        columns = self.prepared.with_tangents(self.members)
        return [
            tuple(where_it_counts(scan, self._hiding(scan, column), weights) for column in member)
            for member in columns
        ]

    def _hiding(self, scan: Scan, column: Column) -> Column:
        """The column less what is the same in all parts, where that has a size of its own."""
        if self.apart is None or not hides(scan, column, self.apart):
            return column
        same = same_of(scan, column)
        return {index: values for index, values in column.items() if index not in same}

    def take_out(self, step: Step) -> None:
        """Takes an effect out of all that follows."""
        scan = self.prepared.scan
        if step.member >= 0:
            self.members.append(step.member)
            self._own_levels(step.member)
            return
        self.done.add(step.index)
        offset = step.index - len(scan.columns)
        if offset < len(scan.offsets):
            self.offsets.add(scan.offsets[offset])

    def _own_levels(self, member: int) -> None:
        """A level along an axis that the effect has a mean of belongs to the effect.

        Not where it has that mean because some parts or columns of a table are left out, nor of an
        effect without an equation, as an outlier: what is not written would take the level along.
        """
        scan, own = self.prepared.scan, self.prepared.members[member]
        if not own.equations:
            return
        columns = own.columns
        means = self.prepared.means[member]
        for i, axis in enumerate(scan.offsets):
            sizes = [float(np.sqrt(np.mean(c[axis] ** 2))) for c in columns if axis in c]
            if axis in own.centred or not sizes:
                continue
            if np.abs(means[:, axis]).max() > CENTRED * max(sizes):
                self.done.add(len(scan.columns) + i)
                self.owned.add(len(scan.columns) + i)
                self.offsets.discard(axis)

    def _aside(self) -> frozenset[str]:
        """Scatters that were found: the checks must not find them again."""
        scan = self.prepared.scan
        return frozenset(scan.names[i] for i in self.done if i >= scan.tested)


def where_it_counts(scan: Scan, column: Column, weights: FloatArray) -> Column:
    """The column in the strata that hold a good share of what it can be told by.

    Elsewhere its estimate is taken off, without a coefficient of its own: a growth with
    temperature has a little of a plain scale in it, which it must not hide.
    """
    shares = {}
    for index, values in column.items():
        own = values.copy()
        whiten(scan.frame.strata, scan.whitening, index, own)
        shares[index] = float(weights[index] * (own @ own))
    least = COUNTS * sum(shares.values())
    return {index: column[index] for index, share in shares.items() if share >= least}
