"""A growth of all axes is one where they agree: how often chance lets them not, and what then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_tables import table
from loop_bench.folds import LIBRARY
from scipy.stats import binom
from scipy.stats import t as student

from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.classes import class_of
from mtu_cli.close_loop_sealed.analyses.loop.jointly import jointly
from mtu_cli.close_loop_sealed.analyses.loop.one_size import (
    DISAGREES,
    _by_axis,
    is_one_size,
    of_no_size,
)
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import search
from mtu_cli.close_loop_sealed.analyses.loop.state import State, Step
from mtu_cli.close_loop_sealed.model.effect_library import EffectLibrary, candidates

X, Y = np.meshgrid([20.0, 140.0, 265.0, 380.0], [15.0, 140.0, 290.0])
PLACES = np.stack([X.ravel(), Y.ravel(), np.full(12, 10.0)], axis=1)


def only(*families: str) -> EffectLibrary:
    own = tuple(own for own in LIBRARY.families if own.family.family in families)
    return replace(LIBRARY, families=own)


FEW = only("thermal-growth", "thermal-drift", "offset")


def day(
    seed: int,
    growth: tuple[float, float],
    sensors: tuple[str, ...] = ("T_room_degC",),
    screw: float = 0.0,
    library: EffectLibrary = FEW,
) -> Prepared:
    """Twelve parts at 20 to 26 degC; each axis grows by its own, from 0 and 20 degC on, with the
    first of the sensors, and X by `screw` more with the last.
    """
    rng = np.random.default_rng(seed)
    own_T = {name: rng.permutation(np.linspace(20.0, 26.0, 12))[:, None] for name in sensors}
    T, last = own_T[sensors[0]], own_T[sensors[-1]]
    own = table(12, 12, places=PLACES, covariates=own_T)
    own = replace(own, operations=("",), operation=np.zeros(12, np.int64))
    errors = rng.normal(0.0, 1.3e-3, own.errors.shape)
    for axis, g in enumerate(growth):
        errors[..., axis] += g * (T - 20.0) * PLACES[:, axis]
    errors[..., 0] += screw * (last - 20.0) * PLACES[:, 0]
    return prepare(replace(own, errors=errors), candidates(own, library), own.pass_dof)


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


@pytest.mark.parametrize("form", ["- 20)", "- 23)"])
@pytest.mark.parametrize("seed", range(3))
def test_beside_the_growth_of_one_axis_there_is_no_growth_of_all(seed: int, form: str) -> None:
    """Of X that grows twice as much as Y half stays when X was found: that is no size."""
    prepared = day(seed, (22e-6, 11e-6))
    own, state = common(prepared), looked(prepared)
    index = prepared.scan.names.index("thermal-growth-x")
    (member,) = (
        m
        for i, m, _ in prepared.scan.walk()
        if i == index and form in prepared.members[m].equations["Ex"]
    )
    state.take_out(replace(own, index=index, member=member))
    assert not is_one_size(state, own)


@pytest.mark.parametrize("seed", range(4))
def test_where_each_axis_grows_by_itself_a_growth_of_all_is_no_rival(seed: int) -> None:
    prepared = day(seed, (24e-6, 12e-6))
    seen = search(prepared, calibrated(prepared.scan, 299, 1), alpha=0.05, most=5)
    names = [prepared.candidates[own.index].name for own in seen.steps]
    assert {"thermal-growth-x", "thermal-growth-y"} <= set(names)
    every = {prepared.candidates[i].name for own in seen.steps for i in own.credible}
    assert "thermal-growth" not in every
    found = added(prepared, seen, 1)
    for step in seen.steps:
        if step.member >= 0:
            assert (
                prepared.scan.names.index("thermal-growth")
                not in class_of(found.prepared, seen, step).members
            )


def test_what_rules_out_a_growth_of_all_axes() -> None:
    """Growths of two axes with one temperature that differ; of another one it may be there."""
    screw, room = "T_screw_degC", "T_room_degC"
    apart, alike = (day(1, own, (room, screw)) for own in ((24e-6, 12e-6), (11e-6, 11e-6)))

    def members(prepared: Prepared, name: str, T: str) -> set[int]:
        index = prepared.scan.names.index(name)
        owned = (m for m, i in enumerate(prepared.scan.owners()) if i == index)
        return {m for m in owned if prepared.members[m].covariate == T}

    def never(prepared: Prepared, *known: tuple[str, str]) -> set[int]:
        return set(of_no_size(prepared, [min(members(prepared, *own)) for own in known]))

    x, y, drift = "thermal-growth-x", "thermal-growth-y", "thermal-drift-x"
    out = members(apart, "thermal-growth", room)
    assert out
    assert never(apart, (x, room), (y, room)) == out
    assert never(apart, (drift, room), (y, room), (x, room)) == out
    assert never(apart, (x, room)) == never(apart) == set()
    assert never(apart, (x, room), (y, screw)) == never(apart, (x, room), (drift, room)) == set()
    assert never(alike, (x, room), (y, room)) == set()
    # Two forms of one axis, from 20 degC and from the mean of the day, are no two axes.
    forms = sorted(members(apart, x, room))
    assert len(forms) == 2
    assert of_no_size(apart, forms) == frozenset()
    other = min(members(apart, y, room))
    assert set(of_no_size(apart, [*forms, other])) == out


def test_sizes_are_those_of_the_growths_whatever_was_found_before_them() -> None:
    """A bend of two columns stands before the growths, which differ; it is as large as one."""
    bends = only("thermal-growth", "curvature", "offset")
    own = day(1, (24e-6, 12e-6), library=bends)
    alike = day(1, (11e-6, 11e-6), library=bends)
    names = own.scan.names
    firsts = {names[i]: m for i, m, _ in reversed([*own.scan.walk()])}
    (both,) = (
        m for i, m, columns in own.scan.walk() if names[i] == "curvature-x" and len(columns) == 2
    )
    found = [both, firsts["thermal-growth-x"], firsts["thermal-growth-y"]]
    assert of_no_size(own, found)
    assert not of_no_size(alike, found)


def test_a_growth_of_all_with_another_temperature_stays_a_rival() -> None:
    """X grows with the screw, too: beside that a growth of all with the room is still told."""
    for seed in range(6):
        prepared = day(seed, (8e-6, 8e-6), ("T_room_degC", "T_screw_degC"), 12e-6)
        seen = search(prepared, calibrated(prepared.scan, 299, 1), alpha=0.05, most=5)
        common = prepared.scan.names.index("thermal-growth")
        found = added(prepared, seen, 1)
        told = {
            index
            for step in seen.steps
            if step.member >= 0
            for index in (*step.credible, *class_of(found.prepared, seen, step).members)
        }
        assert common in told


def test_sizes_agree_by_the_F_of_their_difference() -> None:
    """Of two axes it is the square of Student's t of what their slopes differ by."""
    seen = set()
    for seed in range(20):
        prepared = day(seed, (11e-6, 12.2e-6))
        state, own = looked(prepared), common(prepared)
        split = _by_axis(prepared, own.member)
        _, fit = jointly(prepared, split)
        d = fit.beta[0] - fit.beta[1]
        C = fit.covariance
        t = abs(d) / np.sqrt(C[0, 0] + C[1, 1] - 2 * C[0, 1])
        p = 2 * student.sf(t, fit.dof.min())
        assert is_one_size(state, own) == (p >= DISAGREES)
        seen.add(bool(p >= DISAGREES))
    assert seen == {True, False}
