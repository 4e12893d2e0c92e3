"""The others of a class in the place of the one found: as if each had been found itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_tables import table as points_table
from separation_examples import LIBRARY, found_as, prepared_of

from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.describe import Described, found_effects
from mtu_cli.close_loop_sealed.analyses.loop.fixed_point import fixed_points
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.refined import searched_members, with_refined
from mtu_cli.close_loop_sealed.analyses.loop.rivals import MOST, all_instead, with_rivals
from mtu_cli.close_loop_sealed.analyses.loop.shape_profile import with_shapes
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable

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
        by_itself = with_refined(told(prepared, rival.name), LIBRARY, None, {})
        (alone,) = with_shapes(by_itself, found_effects(by_itself, [None]), LIBRARY)
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


def test_of_a_long_class_the_likeliest_are_estimated() -> None:
    names = ("thermal-drift-x", "warm-up-x", "trend-x", "step-x", "offset-x")
    own = told(prepared_of(warming()), *names[:4])
    effects = found_effects(own, [None])
    assert len(all_instead(own, effects, LIBRARY)) == MOST - 1
    prepared = prepared_of(warming())
    own = told(prepared, *names[:2], "trend-x", "step-x", "covariate-x")
    (effect,) = found_effects(own, [None])
    rivals = [other.rival.name for other in all_instead(own, [effect], LIBRARY)]
    assert len(rivals) == MOST - 1
    assert set(rivals) < set(effect.class_names)


def test_another_effect_has_another_size_beside_a_rival() -> None:
    """Both axes grow: a shift outward from the centre in place of the scale of x takes most of
    that of y with it.
    """
    found = points_table(12, 16)
    x, y = found.places[..., 0], found.places[..., 1]
    errors = 1e-3 * np.random.default_rng(2).normal(size=found.errors.shape)
    errors[:, :, 1] += 40e-6 * (y - y.mean())
    errors[:, :, 0] += 40e-6 * (x - x.mean())
    own = told(prepared_of(replace(found, errors=errors)), "scale-x", "radial")
    scale = told(own.prepared, "scale-y").found.steps[0]
    both = replace(own.found, steps=(*own.found.steps, replace(scale, posterior=1.0)))
    own = replace(own, found=both, effects=added(own.prepared, both))
    first, second = found_effects(own, [None, None])
    first, second = with_rivals((first, second), all_instead(own, (first, second), LIBRARY))
    (radial,) = first.rivals
    (other,) = radial.changed
    assert other.name == "scale-y"
    assert second.parameters[0][2] == pytest.approx(40e-6, rel=0.1)
    assert abs(other.parameters[0][2]) < 20e-6
    # As if both had been found: what is told of it is that of the pair.
    pair = replace(
        both, steps=(replace(told(own.prepared, "radial").found.steps[0]), both.steps[1])
    )
    alone = found_effects(replace(own, found=pair, effects=added(own.prepared, pair)), [None, None])
    assert other.parameters == alone[1].parameters


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
