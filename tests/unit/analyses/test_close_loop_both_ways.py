"""Readings there and back of which the model knows the drift: what is fitted beside an effect, and
the further passes that tell effects apart, are seen as the table itself is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import table as points_table
from scipy.optimize import least_squares
from separation_examples import LIBRARY, found_as, prepared_of

from mtu_cli.close_loop_sealed.analyses.loop import close_loop
from mtu_cli.close_loop_sealed.analyses.loop.describe import Described, found_effects
from mtu_cli.close_loop_sealed.analyses.loop.follow_up import as_it_is
from mtu_cli.close_loop_sealed.analyses.loop.other_pitches import with_other_pitches
from mtu_cli.close_loop_sealed.analyses.loop.refined import with_refined
from mtu_cli.close_loop_sealed.analyses.loop.separation import sight_of
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable

P, PITCH, AMPLITUDE, NOISE, LEVEL = 5, 10.0, 1.5e-3, 5e-4, 8e-4
PLACES = np.sort(np.r_[0.0, 600.0, np.random.default_rng(5).uniform(10, 590, 29)]).round(2)


def both_ways(seed: int, shares: Floats) -> ResidualTable:
    """A wave in passes there and back, each with a level of its own. The model has a covariance of
    level and slope, and knows that passes scatter by `shares` (3,) of the level's variance: alike
    there and back, each way by itself, and in slope over the whole travel.
    """
    rng = np.random.default_rng(seed)
    x = np.repeat(PLACES, 2)
    sign = np.tile([1.0, -1.0], len(PLACES))
    at = np.stack([x, np.full_like(x, np.nan), np.full_like(x, np.nan)], 1)
    made = points_table(
        P, len(x), axes=("x",), places=at, component="dx_x", covariates={"dir_x": sign[None]}
    )
    errors = rng.normal(0.0, NOISE, made.errors.shape) + rng.normal(0.0, LEVEL, (P, 1, 1))
    errors[:, :, 0] += AMPLITUDE * np.sin(2 * np.pi * x / PITCH)
    slope = (x - x.mean()) / np.ptp(x)
    both, each, tilt = LEVEL * np.sqrt(shares)
    ways = [each * (sign == way) for way in (1.0, -1.0)]
    of_part = np.stack([np.full_like(x, both), *ways, tilt * slope], axis=1)
    common = np.stack([np.full_like(x, 3e-4), 1e-4 * slope], axis=1)
    return replace(
        made, errors=errors, common=common[None, :, None], of_part=of_part[None, :, None]
    )


SHARES = [np.array(own) for own in ([1.0, 0.0, 0.0], [0.9, 0.1, 0.1], [0.0, 1.0, 0.1])]


@pytest.mark.parametrize("shares", SHARES, ids=["alike", "nearly", "apart"])
def test_the_table_as_it_is_has_the_strata_of_the_table(shares: Floats) -> None:
    prepared = prepared_of(both_ways(1, shares))
    sight, frame = sight_of(prepared, as_it_is(prepared.table)), prepared.scan.frame
    assert sight.frame.strata.all == frame.strata.all
    np.testing.assert_allclose(sight.frame.strata.columns, frame.strata.columns, atol=1e-12)


@pytest.mark.parametrize("shares", SHARES, ids=["alike", "nearly", "apart"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_pitch_is_that_of_least_squares(seed: int, shares: Floats) -> None:
    """Of all readings with a level of its own for each pass and a slope in common."""
    table = both_ways(seed, shares)
    prepared = prepared_of(table)
    effects, found = found_as(prepared, ["cyclic-x"])
    told = Described(prepared=prepared, found=found, effects=effects, chosen=())
    told = with_refined(told, LIBRARY, 1, {})
    (effect,) = with_other_pitches(told, found_effects(told, [None]), LIBRARY)
    ((value, low, high),) = effect.searched.values()
    assert effect.alike == ()
    assert low < value < high
    assert abs(value - least_squares_pitch(table)) < 0.1 * (high - low)
    assert high - low < 0.03


def least_squares_pitch(table: ResidualTable) -> float:
    x = table.places[0, :, 0]
    mean = table.errors[:, :, 0].mean(axis=0)

    def left(p: Floats) -> Floats:
        angle = 2 * np.pi * x / p[0]
        own: Floats = mean - p[1] * np.sin(angle) - p[2] * np.cos(angle) - p[3] - p[4] * x / 600
        return own / NOISE

    start = [PITCH, AMPLITUDE, 0.0, 0.0, 0.0]
    return float(least_squares(left, start, xtol=1e-14, ftol=1e-14).x[0])


def test_a_spot_that_shows_in_both_directions_is_named_as_one_position() -> None:
    """A damaged scale or screw is off whichever way it is passed; one way alone is told as that."""
    table = both_ways(4, SHARES[0])
    names = tuple(f"{x:g} {'+-'[i % 2]}" for i, x in enumerate(table.places[0, :, 0]))
    wave = AMPLITUDE * np.sin(2 * np.pi * table.places[..., :1] / PITCH)
    for spot, chosen in (([20, 21], names[20].split()[0]), ([21], names[21])):
        errors = table.errors - wave
        errors[:, spot, 0] += 4e-3
        own = replace(table, features=names, errors=errors)
        found = close_loop((own,), LIBRARY, alpha=0.05, max_effects=4, seed=1)
        assert found.verdict == "named"
        (effect,) = found.effects
        assert (effect.name, effect.chosen) == ("feature-outlier", chosen)
        assert effect.parameters[0][2] == pytest.approx(4e-3, abs=3 * effect.parameters[0][3])
