"""Grids of searched parameters from the values that the data holds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mtu_cli.close_loop_sealed.model.effect_grid import (
    coarseness,
    grid_of,
    periods_apart,
    shortest_of,
)
from mtu_cli.files.effects import Search

VALUES = np.array([4.0, 1.0, 2.0, 4.0, 10.0])


def search(**given: Any) -> Search:
    return Search.model_validate(given)


def test_even_steps_and_even_ratios_between_the_ends_of_the_data() -> None:
    found = grid_of(search(grid="linear", count=4), VALUES, 1)
    np.testing.assert_allclose(found, [1, 4, 7, 10], rtol=1e-15)
    found = grid_of(search(grid="log", **{"from": ["0.1", "low"]}, to=["1000"], count=4), VALUES, 1)
    np.testing.assert_allclose(found, [1, 10, 100, 1000], rtol=1e-14)


def test_half_way_between_the_values_with_a_margin_at_both_ends() -> None:
    assert grid_of(search(grid="between", margin=1), VALUES, 1).tolist() == [1.5, 3.0, 7.0]
    assert grid_of(search(grid="between", margin=2), VALUES, 1).tolist() == [3.0]
    assert grid_of(search(grid="between"), None, 1).tolist() == []


def test_frequencies_from_the_longest_to_the_shortest_no_wider_than_a_quarter_of_a_span() -> None:
    found = grid_of(search(grid="frequency", **{"from": ["2"]}, to=["18"]), VALUES, 1)
    assert (found[0], found[-1]) == pytest.approx((18.0, 2.0))
    steps = np.diff(1.0 / found)
    assert steps.max() <= 1.0 / (4.0 * 9.0) * (1 + 1e-12)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-10)


@pytest.mark.parametrize(
    ("given", "values"),
    [
        ({"grid": "linear"}, None),
        ({"grid": "linear"}, np.array([3.0, 3.0])),
        ({"grid": "linear", "from": ["20"]}, VALUES),
        ({"grid": "linear", "from": ["high"]}, VALUES),
        ({"grid": "log", "from": ["0"]}, VALUES),
        ({"grid": "log"}, VALUES - 5.0),
        ({"grid": "frequency"}, VALUES - 1.0),
    ],
)  # fmt: skip
def test_where_the_data_gives_no_grid_it_is_empty(given: dict[str, Any], values: Any) -> None:
    assert grid_of(search(**given), values, 1).tolist() == []


@pytest.mark.parametrize("less", [0.0, 3e-14])
def test_values_that_differ_by_rounding_are_no_steps(less: float) -> None:
    """Steps of 10 in 13 of 20 pairs that a sum of thirds would make of one value."""
    values = np.repeat(10.0 * np.arange(1, 14), 2) - np.tile([less, 0.0], 13)
    asked = search(grid="frequency", **{"from": ["2", "spacing/2"]}, to=["span/2"], count=500)
    found = grid_of(asked, values, 1)
    assert (found[0], found[-1]) == pytest.approx((60.0, 5.0))
    assert shortest_of(search(**{"from": ["spacing/2"]}), values) == pytest.approx(5.0)


def test_frequencies_are_as_many_as_the_places_demand() -> None:
    """A quarter of a period apart over the span, up to 2000; a number asked for is the most."""
    values = np.array([0.0, 7.0, 500.0])
    asked = {"grid": "frequency", "from": ["2"], "to": ["span/2"]}
    fine = grid_of(search(**asked), values, 1)
    assert len(fine) == np.ceil((1 / 2 - 1 / 250) * 4 * 500) + 1
    assert periods_apart(search(**asked), values, fine) == pytest.approx(248 / 992)
    few = search(**asked, count=500)
    assert periods_apart(few, values, grid_of(few, values, 1)) == pytest.approx(248 / 499)
    assert len(grid_of(search(**asked), 10 * values, 1)) == 2000
    assert periods_apart(search(grid="linear"), values, fine) == 0.0


def test_numbers_alone_need_no_data() -> None:
    found = grid_of(search(grid="linear", **{"from": ["2"]}, to=["4"], count=3), None, 1)
    assert found.tolist() == [2.0, 3.0, 4.0]


def test_large_columns_have_fewer_values() -> None:
    """2e6 numbers at most, and 24 values at least; 40 where nothing is asked for."""
    assert len(grid_of(search(), VALUES, 1)) == 40
    assert len(grid_of(search(count=90), VALUES, 40_000)) == 50
    assert len(grid_of(search(count=90), VALUES, 10_000_000)) == 24


def test_between_many_values_every_so_manieth_is_taken() -> None:
    """As many as large columns leave, or as are asked for, evenly from end to end."""
    values, between = np.arange(1.0, 104.0), search(grid="between", margin=2)
    whole = np.arange(2.5, 102.0)
    np.testing.assert_array_equal(grid_of(between, values, 1), whole)
    np.testing.assert_array_equal(grid_of(between, values, 40_000), whole[::2])
    np.testing.assert_array_equal(grid_of(between, values, 10_000_000), whole[2::5])
    few = search(grid="between", margin=2, count=10)
    np.testing.assert_array_equal(grid_of(few, values, 1), whole[4::10])


def test_what_lies_between_the_values_of_a_grid_is_told() -> None:
    between, values = search(grid="between"), np.repeat(np.arange(1.0, 104.0), 2)
    assert coarseness(between, values, np.arange(2.5, 102.0)) is None
    told = coarseness(between, values, np.arange(4.5, 102.0, 5.0))
    assert told is not None
    assert told.startswith("one in 5 of those of the data")
    assert coarseness(between, values, np.array([4.5])) is None
    assert coarseness(search(grid="linear"), values, np.array([1.0, 50.0])) is None
    wave = search(grid="frequency", **{"from": ["2"]}, to=["50"])
    told = coarseness(wave, values, 1.0 / np.array([0.02, 0.03]))
    assert told is not None
    assert told.startswith("1 periods apart")
    assert coarseness(wave, values, 1.0 / np.array([0.02, 0.0245])) is None


@pytest.mark.parametrize(
    ("bounds", "shortest"),
    [(["2", "spacing/2"], 0.75), (["0.5", "spacing/2"], 0.5), (["3"], 3.0), (["-1", "0"], np.nan)],
)
def test_the_shortest_value_that_any_bound_speaks_of(bounds: list[str], shortest: float) -> None:
    """The spacing of 1, 2, 4 is their median step, 1.5."""
    found = shortest_of(search(grid="frequency", **{"from": bounds}), VALUES[VALUES < 10.0])
    assert found == pytest.approx(shortest, nan_ok=True)


PITCHES: dict[str, Any] = {"grid": "frequency", "from": ["2", "spacing/2"], "to": ["span/2"]}


@pytest.mark.parametrize(
    ("values", "shortest"),
    [
        (np.arange(41) * 15.0, 7.5),
        # A few tenths of a millimetre off even: at 1/15 mm all phases are still within a tenth.
        (np.arange(41) * 15.0 + np.tile([0.0, 0.3, -0.2], 14)[:41], 7.5),
        # Every second place 5 mm further on: all are whole multiples of 10 mm.
        (np.arange(41) * 15.0 + np.tile([0.0, 5.0], 21)[:41], 5.0),
        (np.cumsum(np.tile([13.0, 17.3, 8.9, 19.1, 11.7], 8)), 2.0),
        # Few places have many periods alike, even or not.
        (np.cumsum(np.tile([13.0, 17.3, 8.9, 19.1, 11.7], 3)), 6.5),
    ],
    ids=["even", "nearly", "in-pairs", "uneven", "few"],
)
def test_many_uneven_places_show_pitches_shorter_than_their_steps(
    values: Any, shortest: float
) -> None:
    assert grid_of(search(**PITCHES), values, 1).min() == pytest.approx(shortest, rel=0.02)
