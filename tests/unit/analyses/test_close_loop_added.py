"""Found effects together: the null of what is left, levels, and what they say of every cell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats, coordinate_matrix
from loop_tables import candidate, crossed, gls, offset, prepared_with, residuals, whole_column
from scipy.stats import binom, t

from mtu_cli.close_loop_sealed.analyses.loop.added import Added, added, contribution, mean_variance
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.analyses.loop.state import State, Step
from mtu_cli.close_loop_sealed.model.effect_candidate import Column

SHAPE = (10, 9, 1)
STEP: Column = {0: np.asarray(np.arange(10) >= 4, float)[:, None]}
CELLS: Column = {0: np.random.default_rng(1).normal(size=(10, 9))}
CELLS = {0: CELLS[0] - CELLS[0].mean()}
CANDIDATES = (candidate("step", (STEP,)), candidate("cells", (CELLS,)), offset("x"))


def prepared(errors: Floats, flat: bool = True) -> Prepared:
    return prepared_with(residuals(errors, flat=flat), *CANDIDATES)


def found(own: Prepared, *names: str) -> Search:
    """A search that found these, one after the other."""
    index = [own.scan.names.index(name) for name in names]
    nothing = np.zeros(len(own.scan.names))
    steps = tuple(
        Step(
            index=i,
            member=i if i < len(own.scan.columns) else -1,
            p=0.01,
            log_bayes=5.0,
            posterior=1.0,
            credible=(i,),
        )
        for i in index
    )
    return Search(steps=steps, p=nothing, log_bayes=nothing, posterior=nothing, checks=())


def noise(seed: int) -> Floats:
    return crossed(np.random.default_rng(seed), SHAPE)


def dense(own: Prepared, effects: Added, X: Floats) -> tuple[Floats, Floats]:
    """Least squares on all entries, the mean an observation of its own variance among them."""
    assert effects.fit is not None
    left = effects.prepared
    strata = left.scan.frame.strata
    T = coordinate_matrix(left.scan.frame)
    weights = zip(strata.all, effects.fit.weights, strict=True)
    D = np.concatenate([np.full(s.size, 1 / w) for s, w in weights])
    V = T.T @ (D[:, None] * T) + mean_variance(left, 0)
    return gls(X, own.table.errors.ravel(), V)


@pytest.mark.parametrize("level", [0.0, -1.0])
def test_a_mean_that_agrees_moves_no_coefficient(level: float) -> None:
    errors = noise(2) + 3.0 * whole_column(STEP, SHAPE) + 0.8 * whole_column(CELLS, SHAPE) + level
    own = prepared(errors)
    effects = added(own, found(own, "step", "cells"))
    assert effects.levels == ()
    assert effects.fit is not None
    # Beside a free mean error, whatever it is.
    X = [whole_column(c, SHAPE).ravel() for c in (STEP, CELLS)]
    beta, C = dense(own, effects, np.stack([*X, np.ones(90)], axis=1))
    np.testing.assert_allclose(effects.fit.beta, beta[:2], rtol=1e-8)
    np.testing.assert_allclose(effects.fit.at_weights, C[:2, :2], rtol=1e-7, atol=1e-14)


def test_intervals_cover_whatever_the_level_is() -> None:
    """A step of 2 um over a level of -1 um, its own mean's size: the mean error is 0.2 um."""
    rng, count = np.random.default_rng(11), 400
    own = prepared(crossed(rng, SHAPE))
    search, hits, levels = found(own, "step"), 0, 0
    for _ in range(count):
        errors = crossed(rng, SHAPE) + 2.0 * whole_column(STEP, SHAPE) - 1.0
        effects = added(own.with_table(replace(own.table, errors=errors)), search)
        assert effects.fit is not None
        u = np.sqrt(effects.fit.covariance[0, 0])
        hits += bool(abs(effects.fit.beta[0] - 2.0) <= t.ppf(0.975, effects.fit.dof[0]) * u)
        levels += len(effects.levels)
    assert levels < count / 2
    assert binom.ppf(1e-3, count, 0.93) <= hits <= binom.ppf(1 - 1e-3, count, 0.97)


@pytest.mark.parametrize("names", [("step", "cells"), ("step", "offset-x"), ("offset-x",)])
def test_a_mean_that_disagrees_becomes_a_level(names: tuple[str, ...]) -> None:
    errors = noise(3) + 3.0 * whole_column(STEP, SHAPE) + 0.8 * whole_column(CELLS, SHAPE) + 20.0
    own = prepared(errors)
    effects = added(own, found(own, *names))
    (level,) = effects.levels
    columns = [{"step": STEP, "cells": CELLS}[name] for name in names if name != "offset-x"]
    assert level.index == len(columns)
    X = [whole_column(c, SHAPE).ravel() for c in columns]
    beta, C = dense(own, effects, np.stack([*X, np.ones(90)], axis=1))
    assert effects.fit is not None
    np.testing.assert_allclose(effects.fit.beta, beta, rtol=1e-8)
    # Beside what the estimated weights add to the coefficients' covariance.
    k = len(columns)
    means = np.array([whole_column(c, SHAPE).mean() for c in columns])
    turn = np.vstack([np.eye(k), -means])
    more = effects.fit.covariance[:k, :k] - effects.fit.at_weights
    got = effects.fit.covariance - turn @ more @ turn.T
    np.testing.assert_allclose(got, C, rtol=1e-7, atol=1e-13)
    if "offset-x" in names:
        assert level.owner is None
        assert effects.offset(0) == level.index
    else:
        assert level.owner == 0
        assert effects.coefficients(0) == [0, 2]
        assert effects.coefficients(1) == [1]


def test_an_effect_without_a_mean_has_no_level() -> None:
    own = prepared(noise(4) + 50.0)
    assert added(own, found(own, "cells")).levels == ()


def test_what_no_equation_says_takes_no_level() -> None:
    """As of an outlier: whoever writes the rest to a machine would lose it."""
    own = prepared(noise(3) + 3.0 * whole_column(STEP, SHAPE) + 20.0)
    silent = replace(own.members[0], equations={})
    own = replace(own, members=(silent, *own.members[1:]))
    assert added(own, found(own, "step")).levels == ()
    state = State(own, None)
    state.take_out(found(own, "offset-x").steps[0])
    state.take_out(found(own, "step").steps[0])
    assert state.offsets == {0}
    told = State(prepared(own.table.errors), None)
    told.take_out(found(own, "offset-x").steps[0])
    told.take_out(found(own, "step").steps[0])
    assert told.offsets == set()


def test_the_null_is_that_of_what_is_left() -> None:
    quiet = noise(5)
    own = prepared(quiet + 40.0 * whole_column(STEP, SHAPE))
    effects = added(own, found(own, "step"))
    assert effects.fit is not None
    rest = quiet + (40.0 - effects.fit.beta[0]) * whole_column(STEP, SHAPE)
    null = prepared(rest - effects.fit.beta[1] if effects.levels else rest).scan.null
    for what in ("interaction", "column", "part"):
        expected = getattr(null, what)
        np.testing.assert_allclose(
            getattr(effects.prepared.scan.null, what), expected, rtol=0.02, atol=0.05
        )
    # Before, the step was taken for scatter of the parts.
    assert own.scan.null.part[0, 0] > 20 * effects.prepared.scan.null.part[0, 0]


def test_nothing_found_says_nothing() -> None:
    own = prepared(noise(6))
    effects = added(own, found(own))
    assert effects.fit is None
    assert effects.levels == ()
    np.testing.assert_array_equal(contribution(effects, own.table, ()), np.zeros(SHAPE))


def test_contributions_are_columns_times_coefficients_and_levels() -> None:
    errors = noise(7) + 3.0 * whole_column(STEP, SHAPE) + 20.0
    own = prepared(errors)
    effects = added(own, found(own, "step", "cells"))
    assert effects.fit is not None
    step, cells, level = effects.fit.beta
    members = tuple(own.members[m] for m in effects.members)
    expected = step * whole_column(STEP, SHAPE) + cells * whole_column(CELLS, SHAPE) + level
    np.testing.assert_allclose(contribution(effects, own.table, members), expected, rtol=1e-12)


def test_intervals_cover_where_parts_have_lines_and_the_null_is_fitted_anew() -> None:
    # The way of the command: null of what is left, whitening by it, weights, Student's t.
    rng, count, hits = np.random.default_rng(8), 400, np.zeros(2)
    own = prepared(crossed(rng, SHAPE), flat=False)
    search = found(own, "step", "cells")
    places = own.table.places[0, :, :2] / 50.0
    effect = 4.0 * whole_column(STEP, SHAPE) + 0.5 * whole_column(CELLS, SHAPE)
    for _ in range(count):
        lines = rng.normal(size=(10, 2)) @ places.T
        errors = crossed(rng, SHAPE) + lines[..., None] + effect
        effects = added(own.with_table(replace(own.table, errors=errors)), search)
        assert effects.fit is not None
        u = np.sqrt(np.diag(effects.fit.covariance))[:2]
        k = t.ppf(0.975, effects.fit.dof[:2])
        hits += np.abs(effects.fit.beta[:2] - [4.0, 0.5]) <= k * u
    for value in hits:
        assert binom.ppf(1e-3, count, 0.93) <= value <= binom.ppf(1 - 1e-3, count, 0.97)


def test_the_variance_of_the_mean_is_that_of_drawn_means() -> None:
    own = prepared(noise(9), flat=False)
    null = replace(
        own.scan.null,
        interaction=np.ones(1),
        column=np.full(1, 0.25),
        part=np.diag([9 * 1.44, 0.0, 0.0]),
    )
    own = replace(own, scan=replace(own.scan, null=null))
    rng = np.random.default_rng(10)
    means = [crossed(rng, SHAPE, part=1.2, column=0.5).mean() for _ in range(4000)]
    assert np.var(means) == pytest.approx(mean_variance(own, 0), rel=5 * np.sqrt(2 / 4000))
