"""Directions of whole parts, pairs of approach, and unit vectors of turning and growing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import contrasts
from effect_tables import grid_places, readings_table
from loop_tables import crossed, residuals

from mtu_cli.close_loop_sealed.analyses.loop.directions import (
    reversal_pairs,
    scatter_directions,
    smooth_directions,
)
from mtu_cli.close_loop_sealed.stats.strata import strata_of

SHAPE = (8, 9, 2)


def test_places_are_directions_and_what_is_unknown_or_constant_is_none() -> None:
    table = residuals(crossed(np.random.default_rng(1), SHAPE))
    lines = smooth_directions(table)
    # z is the same everywhere: x and y are left, about their means, up to 1.
    assert lines.shape == (9, 2)
    places = grid_places(9, jitter=3.0)[:, :2]
    centred = places - places.mean(axis=0)
    np.testing.assert_allclose(lines, centred / np.abs(centred).max(axis=0), rtol=1e-12)
    assert smooth_directions(residuals(table.errors, flat=True)).shape == (9, 0)


def test_notable_directions_of_the_models_own_uncertainty_are_added() -> None:
    rng = np.random.default_rng(2)
    bend = rng.normal(size=9)
    of_part = np.zeros((1, 9, 2, 1))
    of_part[0, :, 0, 0] = bend
    errors = rng.normal(size=SHAPE)
    strong = smooth_directions(residuals(errors, of_part=of_part))
    assert strong.shape == (9, 3)
    lines = np.column_stack([np.ones(9), strong[:, :2]])
    left = bend - lines @ np.linalg.lstsq(lines, bend, rcond=None)[0]
    assert abs(strong[:, 2] @ left) == pytest.approx(np.linalg.norm(left), rel=1e-9)
    # A tenth of the entries' variance: |left|^2 of 0.1 or more.
    size = np.linalg.norm(left)
    for factor, count in ((0.5, 3), (0.1, 2)):
        level = np.sqrt(np.mean((errors - errors.mean(axis=0)) ** 2))
        scaled = residuals(errors, of_part=of_part * factor * level / size)
        assert smooth_directions(scaled).shape == (9, count)


def test_at_most_three_more() -> None:
    rng = np.random.default_rng(3)
    common = 10 * rng.normal(size=(1, 9, 2, 6))
    assert smooth_directions(residuals(rng.normal(size=SHAPE), common=common)).shape == (9, 5)


def test_turning_and_growing_parts_move_along_their_directions_alone() -> None:
    table = residuals(np.zeros(SHAPE))
    strata = strata_of(8, smooth_directions(table), 2)
    directions = scatter_directions(table, strata)
    x, y = (table.places[0, :, i] - table.places[0, :, i].mean() for i in (0, 1))
    amount = np.random.default_rng(4).normal(size=8)
    size = np.hypot(np.linalg.norm(x), np.linalg.norm(y))
    for i, shape in enumerate((np.stack([-y, x], axis=1), np.stack([x, y], axis=1))):
        moved, _ = strata.coordinates(amount[:, None, None] * shape)
        total = np.zeros(7)
        other = np.zeros(7)
        for stratum in strata.all:
            if stratum.kind == "line":
                own = moved[stratum.slice]
                total += directions[i, stratum.axis, stratum.line] * own
                other += directions[1 - i, stratum.axis, stratum.line] * own
        np.testing.assert_allclose(total, size * contrasts(8).T @ amount, rtol=1e-9)
        np.testing.assert_allclose(other, 0, atol=1e-9 * size)
        assert np.sum(directions[i] ** 2) == pytest.approx(1.0)


def test_without_x_and_y_nothing_turns() -> None:
    table = replace(residuals(np.zeros(SHAPE)), axes=("x", "z"))
    strata = strata_of(8, smooth_directions(table), 2)
    np.testing.assert_array_equal(scatter_directions(table, strata), 0)
    flat = residuals(np.zeros(SHAPE), flat=True)
    strata = strata_of(8, smooth_directions(flat), 2)
    np.testing.assert_array_equal(scatter_directions(flat, strata), 0)


def test_forward_and_reverse_at_one_place_are_a_pair() -> None:
    table = readings_table()
    pairs = reversal_pairs(table)
    assert pairs is not None
    place = table.places[0, :, 0]
    way = np.broadcast_to(table.covariates["dir_x"], (1, len(place)))[0]
    np.testing.assert_allclose(pairs.T @ pairs, np.eye(pairs.shape[1]), atol=1e-14)
    for column in pairs.T:
        own = np.flatnonzero(column)
        assert len(own) == 2
        assert np.ptp(place[own]) < 1e-3 * np.ptp(place)
        np.testing.assert_allclose(column[own], way[own] / np.sqrt(2))
    assert pairs.shape[1] == len(np.unique(place[way > 0]))


def test_points_and_readings_in_one_direction_have_no_pairs() -> None:
    table = readings_table()
    assert reversal_pairs(replace(table, component=None)) is None
    H = table.places.shape[1]
    one = {**table.covariates, "dir_x": np.ones((1, H))}
    assert reversal_pairs(replace(table, covariates=one)) is None
    without = {k: v for k, v in table.covariates.items() if k != "dir_x"}
    assert reversal_pairs(replace(table, covariates=without)) is None
