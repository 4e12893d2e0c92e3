"""What passes and is not told from 0 by its own estimate is no finding."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from crossed_tables import Floats
from loop_tables import candidate, crossed, offset, prepared_with, residuals
from scipy.stats import t as student

from mtu_cli.close_loop_sealed.analyses.loop import searched as module
from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.from_zero import not_told_from_zero
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import Search, search
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.family_gate import Gate

SHAPE = (14, 10, 1)
RNG = np.random.default_rng(5)
SHAPES = {name: RNG.normal(size=(1, 10)) for name in ("tilt", "bend", "bow")}
SHAPES = {name: (s - s.mean()) / np.std(s) for name, s in SHAPES.items()}
LIBRARY = (*(candidate(name, ({0: s},)) for name, s in SHAPES.items()), offset("x"))


def table(seed: int, *, tilt: float = 0.0, bend: float = 0.0, shift: float = 0.0) -> ResidualTable:
    """Entries of unit variance whose columns' means are all the same, beside the effects: sizes
    in standard deviations of a mean over the parts.
    """
    errors = crossed(np.random.default_rng(seed), SHAPE, part=0.3, column=0.0)
    errors -= errors.mean(axis=0)
    own = tilt * SHAPES["tilt"] + bend * SHAPES["bend"] + shift
    noise = np.random.default_rng(seed + 100).normal(size=(1, 10))
    errors[..., 0] += (own + 0.05 * noise) / np.sqrt(SHAPE[0])
    return residuals(errors)


@cache
def gate() -> Gate:
    own = residuals(crossed(np.random.default_rng(1), SHAPE, part=0.3, column=0.0))
    return calibrated(prepared_with(own, *LIBRARY).scan, 1999, 3)


def names(prepared: Prepared, found: Search) -> list[str]:
    return [prepared.candidates[step.index].name for step in found.steps]


def claimed(own: Prepared, *claims: str) -> Search:
    """A search that found these, each alone in its class."""
    index = [[c.name for c in own.candidates].index(name) for name in claims]
    steps = [
        Step(index=i, member=i if i < 3 else -1, p=0.01, log_bayes=5.0, posterior=1.0,
             credible=(i,))
        for i in index
    ]  # fmt: skip
    none = np.zeros(0)
    return Search(steps=tuple(steps), p=none, log_bayes=none, posterior=none, checks=())


def held(own: Prepared, found: Search) -> set[str]:
    return {own.candidates[i].name for i in not_told_from_zero(added(own, found, 1), found)}


def test_a_lone_effect_none_of_whose_parameters_is_told_from_0_is_not() -> None:
    own = prepared_with(table(1, tilt=8.0, shift=9.0), *LIBRARY)
    assert held(own, claimed(own, "tilt", "bend", "offset-x")) == {"bend"}
    assert held(own, claimed(own, "bend")) == {"bend"}
    assert held(own, claimed(own, "tilt")) == set()
    # An offset is what is left of a mean, and judged as such.
    assert held(own, claimed(own, "offset-x")) == set()


def test_the_interval_is_students_at_95_percent() -> None:
    """By its estimate, uncertainty and degrees of freedom, just on either side of the bound."""
    told = []
    for size in np.arange(0.02, 0.2, 0.002):
        own = prepared_with(table(1, bend=float(size)), *LIBRARY)
        found = claimed(own, "bend")
        fit = added(own, found, 1).fit
        assert fit is not None
        ratio = abs(float(fit.beta[0])) / np.sqrt(float(fit.covariance[0, 0]))
        bound = float(student.ppf(0.975, np.ravel(fit.dof)[0]))
        told.append(ratio / bound)
        assert held(own, found) == (set() if ratio > bound else {"bend"})
    assert max(own for own in told if own < 1) > 0.9
    assert min(own for own in told if own > 1) < 1.1


def test_one_parameter_that_is_told_from_0_is_enough() -> None:
    pair = candidate("pair", ({0: SHAPES["tilt"]}, {0: SHAPES["bend"]}))
    own = prepared_with(table(1, tilt=8.0), pair)
    found = claimed(own, "pair")
    assert held(own, found) == set()
    nothing = prepared_with(table(1), pair)
    assert held(nothing, found) == {"pair"}


def test_of_several_that_fit_none_is_claimed_alone() -> None:
    own = prepared_with(table(1, tilt=8.0), *LIBRARY)
    found = claimed(own, "bend")
    step = replace(found.steps[0], credible=(1, 2))
    one_of_two = replace(found, steps=(step,))
    assert not_told_from_zero(added(own, one_of_two, 1), one_of_two) == frozenset()


def test_what_is_unsure_is_a_rival_and_no_finding() -> None:
    own = prepared_with(table(2, tilt=8.0), *LIBRARY)
    assert names(own, search(own, gate(), alpha=0.05, most=4)) == ["tilt"]
    assert search(own, gate(), alpha=0.05, most=4, unsure=frozenset({0})).steps == ()


def test_the_search_is_made_again_without_what_is_not_told_from_0(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given, asked = table(3, tilt=8.0), []

    def claims(prepared: Prepared, *_: Gate, unsure: frozenset[int], **__: object) -> Search:
        asked.append(unsure)
        return claimed(prepared, *(("tilt",) if unsure else ("tilt", "bend")))

    def start(own: ResidualTable) -> tuple[Prepared, Gate]:
        return prepared_with(own, *LIBRARY), gate()

    monkeypatch.setattr(module, "search", claims)
    found = module.searched(given, start, alpha=0.05, most=4, seed=1)
    assert asked == [frozenset(), frozenset({1})]
    assert names(found.prepared, found.found) == ["tilt"]


def test_what_was_unsure_once_stays_so(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[frozenset[int]] = []

    def claims(prepared: Prepared, *_: Gate, unsure: frozenset[int], **__: object) -> Search:
        asked.append(unsure)
        return claimed(prepared, "tilt", *(("bend", "bow")[len(unsure) :][:1]))

    def start(own: ResidualTable) -> tuple[Prepared, Gate]:
        return prepared_with(own, *LIBRARY), gate()

    monkeypatch.setattr(module, "search", claims)
    module.searched(table(3, tilt=8.0), start, alpha=0.05, most=4, seed=1)
    assert asked == [frozenset(), frozenset({1}), frozenset({1, 2})]


def test_the_sizes_are_those_of_the_tables() -> None:
    """A guard of the tests themselves: the columns' means scatter far less than entries do."""
    errors: Floats = table(1).errors[..., 0]
    assert SHAPE[0] * np.var(errors.mean(axis=0)) < 0.01 * np.var(errors - errors.mean(axis=0))
