"""A search without gross entries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.added import added, contribution
from mtu_cli.close_loop_sealed.analyses.loop.from_zero import not_told_from_zero
from mtu_cli.close_loop_sealed.analyses.loop.gross import Gross, set_aside
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.search import Search, search
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.family_gate import Gate

Start = Callable[[ResidualTable], tuple[Prepared, Gate]]
"""Prepares a table without its gross entries, and says by which gate it is judged."""


@dataclass(frozen=True, kw_only=True)
class Searched:
    """What was found in a table, `prepared` without the `gross` entries, by its `gate`."""

    gross: tuple[Gross, ...]
    prepared: Prepared
    gate: Gate
    found: Search


def searched(
    given: ResidualTable, start: Start, *, alpha: float, most: int, seed: int | None = None
) -> Searched:
    """Sets gross entries of a table aside and searches the rest; what an effect explains was no
    gross error, and is taken back. `seed` is that of `added`.
    """
    table, gross = set_aside(given)
    prepared, gate = start(table)
    found = _told(prepared, gate, alpha, most, seed)
    if gross and found.members:
        effects = added(prepared, found)
        said = contribution(effects, given, tuple(prepared.members[m] for m in effects.members))
        left, still = set_aside(replace(given, errors=given.errors - said))
        if not np.array_equal(left.there, table.there):
            errors = np.where(left.there[:, :, None], given.errors, np.nan)
            gross = still
            prepared, gate = start(replace(left, errors=errors))
            found = _told(prepared, gate, alpha, most, seed)
    return Searched(gross=gross, prepared=prepared, gate=gate, found=found)


def _told(prepared: Prepared, gate: Gate, alpha: float, most: int, seed: int | None) -> Search:
    """A search that claims no name which its own estimate does not tell from 0: it is a rival of
    what else passes there, such as the offset beside it, and no finding.
    """
    unsure: frozenset[int] = frozenset()
    while True:
        found = search(prepared, gate, alpha=alpha, most=most, unsure=unsure)
        more = not_told_from_zero(added(prepared, found, seed), found) if found.members else None
        if not more or more <= unsure:
            return found
        unsure |= more
