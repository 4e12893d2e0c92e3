"""A growth of all axes is one where they agree: how often chance lets them not, and what then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_tables import table
from loop_bench.folds import LIBRARY
from scipy.stats import binom

from mtu_cli.analyses.close_loop.one_size import DISAGREES, is_one_size
from mtu_cli.analyses.close_loop.prepare import Prepared, prepare
from mtu_cli.analyses.close_loop.scan import calibrated
from mtu_cli.analyses.close_loop.search import search
from mtu_cli.analyses.close_loop.state import State, Step
from mtu_cli.model.effect_library import candidates

X, Y = np.meshgrid([20.0, 140.0, 265.0, 380.0], [15.0, 140.0, 290.0])
PLACES = np.stack([X.ravel(), Y.ravel(), np.full(12, 10.0)], axis=1)
FEW = replace(LIBRARY, families=tuple(
    own
    for own in LIBRARY.families
    if own.family.family in ("thermal-growth", "thermal-drift", "offset")
))  # fmt: skip


def day(seed: int, growth: tuple[float, float]) -> Prepared:
    """Twelve parts at 20 to 26 degC; each axis grows by its own, from 0 and 20 degC on."""
    rng = np.random.default_rng(seed)
    T = rng.permutation(np.linspace(20.0, 26.0, 12))[:, None]
    own = table(12, 12, places=PLACES, covariates={"T_room_degC": T})
    own = replace(own, operations=("",), operation=np.zeros(12, np.int64))
    errors = rng.normal(0.0, 1.3e-3, own.errors.shape)
    for axis, g in enumerate(growth):
        errors[..., axis] += g * (T - 20.0) * PLACES[:, axis]
    return prepare(replace(own, errors=errors), candidates(own, FEW), own.pass_dof)


def common(prepared: Prepared) -> Step:
    """The growth of all axes from 20 degC."""
    index = prepared.scan.names.index("thermal-growth")
    member = next(
        m
        for i, m, _ in prepared.scan.walk()
        if i == index and "- 20)" in prepared.members[m].equations["Ex"]
    )
    return Step(index=index, member=member, p=0.0, log_bayes=9.0, posterior=1.0, credible=(index,))


def looked(prepared: Prepared) -> State:
    state = State(prepared, None)
    state.look()
    return state


def test_axes_that_grow_alike_disagree_by_chance_as_rarely_as_stated() -> None:
    runs = 300
    alike = [day(seed, (11e-6, 11e-6)) for seed in range(runs)]
    apart = sum(not is_one_size(looked(own), common(own)) for own in alike)
    # Welch's degrees of freedom are no more than near.
    assert apart <= binom.ppf(1 - 1e-3, runs, 1.5 * DISAGREES)


@pytest.mark.parametrize("seed", range(3))
def test_of_two_axes_that_grow_apart_each_is_found_by_itself(seed: int) -> None:
    prepared = day(seed, (11e-6, 0.0))
    assert not is_one_size(looked(prepared), common(prepared))
    seen = search(prepared, calibrated(prepared.scan, 299, 1), alpha=0.05, most=4)
    names = {prepared.candidates[own.index].name for own in seen.steps}
    assert "thermal-growth-x" in names
    assert names.isdisjoint({"thermal-growth", "thermal-growth-y"})


def test_axes_that_grow_alike_are_found_as_one() -> None:
    prepared = day(1, (11e-6, 11e-6))
    seen = search(prepared, calibrated(prepared.scan, 299, 1), alpha=0.05, most=4)
    assert "thermal-growth" in {prepared.candidates[own.index].name for own in seen.steps}


def test_effects_of_one_axis_and_offsets_are_of_one_size() -> None:
    prepared = day(1, (11e-6, 0.0))
    own = common(prepared)
    index = prepared.scan.names.index("thermal-growth-x")
    first = sum(len(columns) for columns in prepared.scan.columns[:index])
    assert is_one_size(looked(prepared), replace(own, index=index, member=first))
    assert is_one_size(looked(prepared), replace(own, member=-1))
