"""Prior of searched values: the speed of the shape, however the value is written."""

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats

from mtu_cli.close_loop_sealed.analyses.loop.shape_prior import shape_weights
from mtu_cli.close_loop_sealed.model.effect_candidate import Member

MINUTES = np.sort(np.random.default_rng(1).uniform(0, 480, 24))[:, None]


def warm_up(tau: float, *, rise: float = 1.0, covariate: str | None = None) -> Member:
    """rise (1 - exp(-t/tau)) of all holes of a part, and its derivative by log(tau)."""
    gone = np.exp(-MINUTES / tau)
    return Member(
        columns=({0: rise * (1 - gone)},),
        tangent=({0: -rise * gone * MINUTES / tau},),
        parameters=(("rise", "um"),),
        equations={},
        searched={"tau_min": tau},
        covariate=covariate,
    )


def turned(low: float, high: float, count: int = 20_001) -> float:
    """The slow plain oracle: the length of the path of the unit shape from one tau to another."""
    shapes = np.concatenate(
        [1 - np.exp(-MINUTES / tau) for tau in np.geomspace(low, high, count)], 1
    )
    shapes = shapes - shapes.mean(axis=0)
    shapes = shapes / np.linalg.norm(shapes, axis=0)
    return float(np.linalg.norm(np.diff(shapes), axis=0).sum())


def share(taus: Floats, low: float, high: float) -> float:
    weights = shape_weights([warm_up(tau) for tau in taus.tolist()])
    assert weights.mean() == pytest.approx(1.0, rel=1e-12)
    return float(weights[(taus > low) & (taus < high)].sum() / weights.sum())


@pytest.mark.parametrize("taus", [np.geomspace(10, 1000, 801), np.linspace(10, 1000, 3001)])
def test_the_weight_of_an_interval_is_the_way_that_the_shape_goes_there(taus: Floats) -> None:
    """On even steps of the logarithm as on even steps of the value."""
    whole = turned(10, 1000)
    for low, high in ((10, 30), (30, 100), (100, 300), (300, 1000)):
        # A grid of so many values has its ends wrong by half a step.
        assert share(taus, low, high) == pytest.approx(turned(low, high) / whole, abs=0.01)


def test_long_time_constants_are_one_straight_line() -> None:
    weights = shape_weights([warm_up(tau) for tau in np.geomspace(10, 1000, 12).tolist()])
    assert weights[-3:].max() < 0.6 < 1.2 < weights[3:6].min()


def test_neither_the_size_nor_the_level_of_a_column_matters() -> None:
    taus = np.geomspace(10, 1000, 12).tolist()
    plain = shape_weights([warm_up(tau) for tau in taus])
    np.testing.assert_allclose(shape_weights([warm_up(tau, rise=1e-6) for tau in taus]), plain)
    moved = [
        Member(
            columns=({0: m.columns[0][0] + 7.0},),
            tangent=m.tangent,
            parameters=m.parameters,
            equations={},
            searched=m.searched,
            covariate=None,
        )
        for m in map(warm_up, taus)
    ]
    np.testing.assert_allclose(shape_weights(moved), plain, rtol=1e-9)


def test_each_covariate_has_its_own_grid_and_places_are_all_alike() -> None:
    taus = np.geomspace(10, 1000, 12).tolist()
    plain = shape_weights([warm_up(tau) for tau in taus])
    both = [warm_up(tau, covariate=name) for tau in taus for name in ("a", "b")]
    np.testing.assert_allclose(shape_weights(both), np.repeat(plain, 2))
    steps = [
        Member(
            columns=({0: (np.arange(24.0) > at)[:, None].astype(float)},),
            parameters=(("jump", "um"),),
            equations={},
            searched={"at": at},
            covariate=None,
        )
        for at in (2.5, 9.5, 16.5)
    ]
    np.testing.assert_array_equal(shape_weights(steps), 1.0)


def test_two_equations_with_the_same_parameter_are_two_grids() -> None:
    taus = np.geomspace(10, 1000, 12)
    plain = shape_weights([warm_up(tau) for tau in taus.tolist()])
    twice = shape_weights([warm_up(tau) for tau in [*taus.tolist(), *taus.tolist()]])
    np.testing.assert_allclose(twice, np.tile(plain, 2))
    falling = shape_weights([warm_up(tau) for tau in [*taus[::-1].tolist(), *taus.tolist()]])
    # The two ends that meet are one value.
    np.testing.assert_allclose(falling, [*plain[::-1], *plain])


@pytest.mark.filterwarnings("error")
def test_a_grid_that_goes_through_zero_is_even() -> None:
    taus = [-100.0, -10.0, 0.0, 10.0, 100.0]
    members = [replace(warm_up(50.0), searched={"at": tau}) for tau in taus]
    np.testing.assert_array_equal(shape_weights(members), 1.0)


def test_shapes_that_do_not_move_are_as_likely_as_each_other() -> None:
    still = [
        Member(
            columns=({0: MINUTES},),
            tangent=({0: MINUTES},),
            parameters=(("rise", "um"),),
            equations={},
            searched={"tau_min": tau},
            covariate=None,
        )
        for tau in (10.0, 20.0, 40.0)
    ]
    np.testing.assert_array_equal(shape_weights(still), 1.0)
