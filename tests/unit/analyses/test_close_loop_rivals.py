"""The others of a class in the place of the one found: as if each had been found itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_tables import table as points_table
from separation_examples import LIBRARY, found_as, prepared_of

from mtu_cli.analyses.close_loop.added import added
from mtu_cli.analyses.close_loop.describe import Described, found_effects
from mtu_cli.analyses.close_loop.fixed_point import fixed_points
from mtu_cli.analyses.close_loop.prepare import Prepared
from mtu_cli.analyses.close_loop.refined import searched_members
from mtu_cli.analyses.close_loop.rivals import all_instead, with_rivals
from mtu_cli.model.residual_table import ResidualTable

T = "T_spindle_degC"
FIXED = 300.0


def warming() -> ResidualTable:
    """X grows by 20 um/m/K from x = 300 mm; the temperature follows the time."""
    found = points_table(12, 16)
    warmer = found.covariates[T] - 20.0
    x = found.places[..., 0]
    errors = 1e-3 * np.random.default_rng(2).normal(size=found.errors.shape)
    errors[:, :, 0] += 20e-6 * (x - FIXED) * warmer
    return replace(found, errors=errors, travel={"x": (0.0, 800.0)})


def told(prepared: Prepared, *names: str) -> Described:
    _, found = found_as(prepared, names)
    values = searched_members(prepared, found, LIBRARY)
    effects = added(prepared, found, values=values)
    return Described(prepared=prepared, found=found, effects=effects, chosen=())


@pytest.mark.parametrize(
    "names",
    [("thermal-drift-x", "warm-up-x"), ("warm-up-x", "thermal-drift-x", "trend-x")],
)
def test_a_rival_is_estimated_as_if_it_had_been_found(names: tuple[str, ...]) -> None:
    prepared = prepared_of(warming())
    own = told(prepared, *names)
    effects = found_effects(own, [None])
    others = all_instead(own, effects, LIBRARY)
    (effect,) = with_rivals(effects, others)
    assert {rival.name for rival in effect.rivals} == set(names[1:])
    for rival in effect.rivals:
        (alone,) = found_effects(told(prepared, rival.name), [None])
        assert rival.parameters == alone.parameters
        assert rival.equations == alone.equations
        assert rival.searched == alone.searched
        assert set(rival.class_names) == set(names)


def test_what_has_no_name_is_none_of_three() -> None:
    own = told(prepared_of(warming()), "warm-up-x", "thermal-drift-x", "trend-x")
    (step,) = own.found.steps
    drift = len(own.effects.prepared.candidates)
    found = replace(own.found, steps=(replace(step, credible=(*step.credible, drift)),))
    own = replace(own, found=found)
    (effect,) = found_effects(own, [None])
    assert effect.class_names[-1] == "unnamed-drift-x"
    rivals = [other.rival.name for other in all_instead(own, [effect], LIBRARY)]
    assert sorted(rivals) == ["thermal-drift-x", "trend-x"]


def test_of_a_class_of_four_none_is_estimated() -> None:
    own = told(prepared_of(warming()), "thermal-drift-x", "warm-up-x", "trend-x", "step-x")
    assert all_instead(own, found_effects(own, [None]), LIBRARY) == ()


def test_a_drift_that_stands_for_what_was_found_makes_one_cause_with_the_growth() -> None:
    """Found is a warm-up; that the drift may be it puts the fixed point where it is."""
    prepared = prepared_of(warming())
    both = told(prepared, "warm-up-x", "thermal-drift-x")
    growth = told(prepared, "thermal-growth-x").found.steps[0]
    found = replace(both.found, steps=(*both.found.steps, replace(growth, posterior=1.0)))
    own = replace(both, found=found, effects=added(prepared, found))
    effects = found_effects(own, [None, None])
    assert fixed_points(prepared.table, effects, np.eye(9)) == ()
    (other,) = all_instead(own, effects, LIBRARY)
    assert (other.place, other.rival.name) == (0, "thermal-drift-x")
    (point,) = fixed_points(prepared.table, other.effects, other.covariance, instead=0)
    assert point.given == (0, "thermal-drift-x")
    assert (point.growth, point.drift, point.told) == ((1,), (0,), True)
    assert point.at == pytest.approx(FIXED, abs=4 * point.u)
    assert point.u < 60
