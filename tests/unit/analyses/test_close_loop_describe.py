"""Found effects in the terms of a report: intervals, shares, aliases, what was searched."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from crossed_tables import Floats
from loop_tables import candidate, crossed, offset, prepared_with, residuals, whole_column
from scipy.stats import binom, t

from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.describe import (
    Described,
    candidate_name,
    floor_of,
    found_effects,
)
from mtu_cli.close_loop_sealed.analyses.loop.experiment import NO_RIVALS, Choice
from mtu_cli.close_loop_sealed.analyses.loop.experiment import SAME as NEVER_APART
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import search
from mtu_cli.close_loop_sealed.model.effect_candidate import Column
from mtu_cli.close_loop_sealed.stats.family_gate import Gate

SHAPE = (12, 10, 2)
RNG = np.random.default_rng(1)
PLACE = np.linspace(0.0, 1.0, 10)
PITCH = np.geomspace(0.2, 1.0, 15)


def centred(values: Floats) -> Floats:
    return np.asarray(values - values.mean())


def wave(pitch: float) -> tuple[Column, ...]:
    angle = 2 * np.pi * PLACE[None] / pitch
    return ({0: centred(np.sin(angle))}, {0: centred(np.cos(angle))})


CELLS: Column = {1: centred(RNG.normal(size=(12, 10)))}
SAME: Column = {1: -3.0 * CELLS[1]}
STEP: Column = {0: np.asarray(np.arange(12) >= 5, float)[:, None]}
LIBRARY = (
    candidate("wave", *(wave(pitch) for pitch in PITCH)),
    candidate("cells", (CELLS,)),
    candidate("copy", (SAME,)),
    candidate("step", (STEP,)),
    offset("x"),
    offset("y"),
)


def quiet(rng: np.random.Generator) -> Floats:
    return crossed(rng, SHAPE, part=0.5, column=0.2)


@cache
def ready() -> tuple[Prepared, Gate]:
    own = prepared_with(residuals(quiet(np.random.default_rng(2))), *LIBRARY)
    return own, calibrated(own.scan, 999, 3)


def told(errors: Floats, most: int = 4) -> Described:
    own, gate = ready()
    own = own.with_table(replace(own.table, errors=errors))
    found = search(own, gate, alpha=0.05, most=most)
    return Described(prepared=own, found=found, effects=added(own, found, 1), chosen=())


def described(errors: Floats, most: int = 4) -> tuple[FoundEffect, ...]:
    own = told(errors, most)
    return found_effects(own, [None] * len(own.found.steps))


def strong(seed: int) -> Floats:
    errors = quiet(np.random.default_rng(seed)) + 3.0 * whole_column(CELLS, SHAPE)
    return errors + 4.0 * whole_column(STEP, SHAPE) + [0.0, 1.0]


def by_name(found: tuple[FoundEffect, ...]) -> dict[str, FoundEffect]:
    return {effect.name: effect for effect in found}


def test_parameters_have_students_intervals_that_hold_the_truth() -> None:
    found = by_name(described(strong(4)))
    assert "step" in found
    assert {"cells", "copy"} & set(found)
    wanted = {"cells": 3.0, "copy": -1.0, "step": 4.0}
    for name, effect in found.items():
        for (_, unit, value, u), (low, high, nu) in zip(
            effect.parameters, effect.intervals, strict=True
        ):
            assert unit == "um"
            assert (high - low) / 2 == pytest.approx(t.ppf(0.975, nu) * u, rel=1e-9)
            assert (high + low) / 2 == pytest.approx(value, rel=1e-9)
        value, u = effect.parameters[0][2:]
        if name in wanted:
            assert value == pytest.approx(wanted[name], abs=5 * u)
        np.testing.assert_allclose(
            np.sqrt(np.diag(effect.covariance)), [p[3] for p in effect.parameters]
        )


def test_what_is_the_same_whatever_the_data_is_named_with_it() -> None:
    found = by_name(described(strong(5)))
    name = "cells" if "cells" in found else "copy"
    other = "copy" if name == "cells" else "cells"
    assert found[name].aliases == (other,)
    assert found[name].class_names[0] == name
    assert other in found[name].class_names
    assert found["step"].aliases == ()


@pytest.mark.parametrize(("reason", "expected"), [(NEVER_APART, True), (NO_RIVALS, False)])
def test_what_no_further_parts_tell_apart_is_marked(reason: str, expected: bool) -> None:
    own = told(strong(5))
    planned = [Choice(experiment=None, reason=reason)] * len(own.found.steps)
    assert {effect.inseparable for effect in found_effects(own, planned)} == {expected}


def test_the_share_is_that_of_the_mean_square_of_the_table() -> None:
    errors = strong(6)
    found = by_name(described(errors))
    for name, column in (("step", STEP), ("cells", CELLS), ("copy", SAME)):
        if name in found:
            whole = found[name].parameters[0][2] * whole_column(column, SHAPE)
            whole = whole - whole.mean(axis=(0, 1))
            expected = np.sum(whole**2) / np.sum(errors**2)
            assert found[name].explained_share == pytest.approx(expected, rel=1e-9)
    shift = np.sum(errors[:, :, 1].mean() ** 2) * 120 / np.sum(errors**2)
    assert found["offset-y"].explained_share == pytest.approx(shift, rel=0.05)
    assert found["offset-y"].parameters[0][0] == "shift"
    assert found["offset-y"].equations == {"Ey": "shift"}


def test_the_interval_of_what_was_searched_holds_it() -> None:
    rng, at, count, held = np.random.default_rng(7), 6, 30, 0
    sine, cosine = (whole_column(c, SHAPE) for c in wave(float(PITCH[at])))
    for _ in range(count):
        (effect, *_) = described(quiet(rng) + 2.0 * sine + 1.0 * cosine, most=1)
        assert effect.name == "wave"
        value, low, high = effect.searched["grid"]
        assert low <= value <= high
        held += low <= at <= high
    assert held >= binom.ppf(1e-3, count, 0.95)


def test_a_level_is_a_parameter_and_stands_in_the_equation() -> None:
    errors = quiet(np.random.default_rng(8)) + 4.0 * whole_column(STEP, SHAPE)
    # From below the mean to above it: the mean error is 0, that of the step is not.
    errors[:, :, 0] -= 4.0 * 7 / 12
    (effect,) = described(errors)
    assert effect.name == "step"
    assert [name for name, *_ in effect.parameters] == ["b0", "level"]
    assert effect.equations == {"Ex": "b0 + level"}
    value, u = effect.parameters[1][2:]
    assert value == pytest.approx(-4.0 * 7 / 12, abs=5 * u)


def test_names_beyond_the_candidates_are_drifts_and_fields() -> None:
    own = ready()[0]
    n = len(own.candidates)
    found = [candidate_name(own, i) for i in range(n - 1, n + 4)]
    assert found == [
        "offset-y",
        "unnamed-drift-x",
        "unnamed-drift-y",
        "unnamed-field-x",
        "unnamed-field-y",
    ]


def test_another_form_of_a_cause_that_is_there_is_no_rival() -> None:
    """Two forms of `mixed` differ by `cells`: with one of them found, the other is `cells`."""
    beside: Column = {1: centred(np.random.default_rng(8).normal(size=(12, 10)))}
    tilted: Column = {1: beside[1] + 0.5 * CELLS[1]}
    causes = [
        # Of its levers alone: without equations.
        replace(cause, members=tuple(replace(member, equations={}) for member in cause.members))
        for cause in (candidate("cells", (CELLS,)), candidate("mixed", (beside,), (tilted,)))
    ]
    start = residuals(quiet(np.random.default_rng(2)))
    own = prepared_with(start, *causes, offset("x"), offset("y"))
    errors = quiet(np.random.default_rng(4)) + 3.0 * whole_column(CELLS, SHAPE)
    own = own.with_table(replace(own.table, errors=errors + 2.0 * whole_column(beside, SHAPE)))
    found = search(own, calibrated(own.scan, 999, 3), alpha=0.05, most=4)
    known = Described(prepared=own, found=found, effects=added(own, found, 1), chosen=())
    effects = by_name(found_effects(known, [None] * len(found.steps)))
    assert set(effects) == {"cells", "mixed"}
    for name, effect in effects.items():
        assert effect.class_names == (name,)
        assert effect.aliases == ()
        assert effect.posterior == pytest.approx(1, abs=1e-6)


def test_the_posterior_of_what_has_no_name_is_the_steps() -> None:
    own = told(strong(7))
    steps = tuple(replace(step, unnamed=0.1 * i) for i, step in enumerate(own.found.steps, 1))
    own = replace(own, found=replace(own.found, steps=steps))
    found = found_effects(own, [None] * len(steps))
    assert [effect.unnamed for effect in found] == [step.unnamed for step in steps]


def test_of_one_part_or_feature_the_floor_is_what_repeats_tell_of_a_mean() -> None:
    """Variances of 16 and 4 um^2 of single readings, three of which are an entry."""
    table = SimpleNamespace(
        parts=("P",),
        features=("a", "b"),
        repeat_dof=4,
        repeat_variance=np.array([16e-6, 4e-6]),
        repeats=np.array([[3, 3, 0]]),
        there=np.array([[True, True, False]]),
    )
    null = SimpleNamespace(interaction=np.array([25e-6, 25e-6]))
    own = cast(Prepared, SimpleNamespace(table=table, scan=SimpleNamespace(null=null)))
    assert floor_of(own) == pytest.approx(1e-3 * np.sqrt(10 / 3))
    table.parts = ("P", "Q")
    assert floor_of(own) == pytest.approx(5e-3)
    table.features = ("a",)
    assert floor_of(own) == pytest.approx(1e-3 * np.sqrt(10 / 3))
    table.parts, table.repeat_dof = ("P",), 0
    assert floor_of(own) is None
