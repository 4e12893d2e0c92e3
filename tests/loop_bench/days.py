"""A shop day as the engine sees it: its table, prepared once for all data sets of the day."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from shop_day import REPEATS, Rivals, ShopDay, measure
from shop_day.day import Floats, Kind
from shop_day.noise import SIG_CMM, SIG_PART

from loop_bench.folds import folds_of
from mtu_cli.close_loop_sealed.analyses.loop.held_out import Fold
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.model.effect_candidate import Candidate
from mtu_cli.close_loop_sealed.model.effect_library import candidates, effect_library
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.family_gate import Gate

UM = 1e-3
"""In mm."""
PASS_DOF = 10.0
"""Of the machine's own scatter of parts, which its components were fitted with."""
SAMPLES = 2000
FOLDS = 7
THIRDS = 3
GATE_SEED = 1


def shop_table(day: ShopDay, errors: Floats) -> ResidualTable:
    """The table of errors (P, H, 2) um of a day on a machine whose components are zero, and
    were measured in passes that scatter as the parts do, with `PASS_DOF` degrees of freedom.
    """
    P, H, A = errors.shape
    of_part = np.broadcast_to(SIG_PART * UM * np.eye(A), (1, H, A, A)).copy()
    return ResidualTable(
        axes=("x", "y"),
        component=None,
        unit="um",
        parts=day.parts,
        features=day.features,
        errors=errors * UM,
        repeats=np.full((P, H), REPEATS),
        repeat_variance=np.full(A, (SIG_CMM * UM) ** 2),
        repeat_dof=P * H * (REPEATS - 1),
        places=np.broadcast_to(day.places, (P, H, 3)).copy(),
        operations=day.operations,
        operation=day.operation,
        covariates=dict(day.covariates),
        common=np.zeros((1, H, A, 0)),
        of_part=of_part,
        pass_dof=PASS_DOF,
    )


class BenchDay:
    """A day with its candidates, null and gate; folds and rivals are made when asked for."""

    def __init__(self, kind: Kind, seed: int) -> None:
        self.day = ShopDay(kind, seed=seed)
        start = np.random.default_rng([seed, ord(kind)])
        self.table = shop_table(self.day, measure(self.day, start))
        self.candidates: tuple[Candidate, ...] = candidates(self.table, effect_library())
        self.prepared: Prepared = prepare(self.table, self.candidates, self.table.pass_dof)
        self.gate: Gate = calibrated(self.prepared.scan, SAMPLES, GATE_SEED)

    def measured(self, errors: Floats) -> ResidualTable:
        """The table with other errors (P, H, 2) um."""
        return replace(self.table, errors=errors * UM)

    @cached_property
    def folds(self) -> tuple[Fold, ...]:
        """The blocks that the oracle leaves out, too."""
        return folds_of(self.table, self.candidates, GATE_SEED, self.table.pass_dof, count=FOLDS)

    @cached_property
    def interleaved(self) -> tuple[Fold, ...]:
        """Every third part left out: between the others, as the bar was measured."""
        number = np.arange(self.day.P) % THIRDS
        known = self.table.pass_dof
        return folds_of(self.table, self.candidates, GATE_SEED, known, number=number)

    @cached_property
    def rivals(self) -> Rivals:
        """What every effect could be taken for."""
        return Rivals(self.day)
