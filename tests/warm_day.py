"""A day that warms up from part to part, with errors of X, and steps as a search finds them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from crossed_tables import Floats
from effect_tables import shop_covariates
from effect_tables import table as points_table
from separation_examples import LIBRARY, index, members_of

from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.describe import Described
from mtu_cli.close_loop_sealed.analyses.loop.own_constant import owners_of
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.model.effect_library import candidates
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable

T = "T_spindle_degC"
PARTS, FEATURES = 12, 16
KNOWN = (
    *("thermal-growth-x", "thermal-drift-x", "trend-x", "offset-x"),
    *("wear-approach-x", "step-x", "step-y", "squareness-xy", "thermal-squareness-xy"),
)


@cache
def empty() -> tuple[ResidualTable, Prepared]:
    """A day that warms up from 20 to 26 degC, from part to part."""
    warm = 20.0 + 6.0 * np.arange(PARTS)[:, None] / (PARTS - 1)
    table = points_table(PARTS, FEATURES, covariates=shop_covariates(PARTS, FEATURES) | {T: warm})
    table = replace(table, errors=1e-3 * np.random.default_rng(2).normal(size=table.errors.shape))
    known = [c for c in candidates(table, LIBRARY) if c.name in KNOWN]
    return table, prepare(table, known)


def with_x(errors: Floats) -> Prepared:
    """The day with errors along x beside its scatter, mm."""
    table, prepared = empty()
    whole = table.errors.copy()
    whole[:, :, 0] += errors
    return prepared.with_table(replace(table, errors=whole))


def step(prepared: Prepared, name: str, of: int = 0, rivals: Sequence[str] = ()) -> Step:
    """A step of member `of` of a candidate, which these rivals may be as well."""
    own = index(prepared, name)
    return Step(
        index=own,
        member=members_of(prepared, name)[of] if own < len(prepared.scan.columns) else -1,
        p=0.01,
        log_bayes=0.0,
        posterior=1.0,
        credible=(own, *(index(prepared, rival) for rival in rivals)),
    )


def of_covariate(prepared: Prepared, name: str, covariate: str | None) -> list[int]:
    """Which members of a candidate are of a covariate."""
    own = [prepared.members[m] for m in members_of(prepared, name)]
    return [i for i, member in enumerate(own) if member.covariate == covariate]


def found(prepared: Prepared, *steps: Step) -> Search:
    none = np.zeros(len(prepared.candidates))
    return Search(steps=steps, p=none, log_bayes=none, posterior=none, checks=())


def described(prepared: Prepared, own: Search) -> Described:
    effects = added(prepared, own, owners=owners_of(prepared, own))
    return Described(prepared=prepared, found=own, effects=effects, chosen=())
