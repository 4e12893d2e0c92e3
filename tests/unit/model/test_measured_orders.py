"""A part whose axes are swapped or run the other way, or whose features are in another order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from measured_examples import study, with_measured
from numpy.typing import NDArray

from mtu_cli.model.measured_checks import check_measured
from mtu_cli.model.measured_orders import other_order

FloatArray = NDArray[np.float64]
LIMIT = 0.5
PLACES = np.array(
    [[10.0, 20, 5], [60, 25, 5], [140, 30, 30], [15, 80, 30], [70, 130, 45], [130, 145, 60]]
)


def measured(seed: int = 1) -> FloatArray:
    """Each place three times, with errors of some um."""
    noise = np.random.default_rng(seed).normal(0.0, 5e-3, (18, 3))
    return np.repeat(PLACES, 3, axis=0) + noise


NOMINAL = np.repeat(PLACES, 3, axis=0)
TURNED: dict[str, Callable[[FloatArray], FloatArray]] = {
    "x and y swapped": lambda m: m[:, [1, 0, 2]],
    "y and z swapped": lambda m: m[:, [0, 2, 1]],
    "x, y and z swapped": lambda m: m[:, [1, 2, 0]],
    "x counted the other way": lambda m: np.column_stack([150 - m[:, 0], m[:, 1:]]),
    "y counted the other way": lambda m: m * [1, -1, 1],
    "x and y counted the other way": lambda m: m * [-1, -1, 1],
    "x and y swapped, and x counted the other way": lambda m: np.column_stack(
        [m[:, 1], 150 - m[:, 0], m[:, 2]]
    ),
    "features in another order": lambda m: m.reshape(6, 3, 3)[::-1].reshape(18, 3),
}


@pytest.mark.parametrize("order", TURNED)
def test_what_was_done_to_a_part_is_named(order: str) -> None:
    done = TURNED[order](measured())
    said = other_order(done, NOMINAL, (0, 1, 2), LIMIT)
    assert said == order


@pytest.mark.parametrize(
    "change",
    [
        lambda m: m + np.array([5.0, 0.0, 0.0]),
        lambda m: m + np.array([0.0, 0.0, 60.0]),
        lambda m: m / 25.4,
        lambda m: np.random.default_rng(2).uniform(0, 150, m.shape),
        # Two features in the place of each other are no order of the part's.
        lambda m: m[[3, 4, 5, 0, 1, 2, *range(6, 18)]],
    ],
    ids=["moved", "moved in z", "inches", "anywhere", "two exchanged"],
)
def test_what_is_no_order_is_not_named(change: object) -> None:
    assert callable(change)
    assert other_order(change(measured()), NOMINAL, (0, 1, 2), LIMIT) == ""
    assert other_order(measured()[:2], NOMINAL[:2], (0, 1, 2), LIMIT) == ""


def test_a_part_of_several_is_named_in_the_warning() -> None:
    """Each with its own; the points of many are judged together."""
    found = study(6, 4, 3)
    changed = found.measured.copy()
    for part, order in ((2, [1, 0, 2]), (4, [0, 1, 2])):
        rows = found.part == part
        changed[rows] = found.measured[rows][:, order] * ([-1, 1, 1] if part == 4 else 1)
    (warning,) = check_measured(with_measured(found, changed))
    assert "of part 'P2' this looks like x and y swapped; of part 'P4' this" in warning.message
    assert warning.message.endswith("looks like x counted the other way")
    own = np.isin(found.part, [1, 2])[:, None]
    alike = np.where(own, found.measured[:, [1, 0, 2]], found.measured)
    (warning,) = check_measured(with_measured(found, alike))
    assert warning.message.endswith("of parts 'P1' and 'P2' this looks like x and y swapped")
    many = np.where(found.part[:, None] < 4, found.measured[:, [1, 0, 2]], found.measured)
    (warning,) = check_measured(with_measured(found, many))
    assert warning.message.endswith("row 2): this looks like x and y swapped")


def test_a_part_that_lies_elsewhere_is_no_row_in_another_order() -> None:
    """A row of holes a pitch farther on, or off along an axis in which all have one place."""
    row = np.column_stack([np.linspace(0, 400, 5), np.full(5, 30.0), np.zeros(5)])
    there = np.repeat(row, 3, axis=0)
    done = there + np.random.default_rng(3).normal(0.0, 5e-3, there.shape)
    for by in ([100.0, 0, 0], [0, 10.0, 0], [0, 0, 10.0]):
        assert other_order(done + by, there, (0, 1, 2), LIMIT) == ""
    assert other_order(400 - done, 400 - there[::-1], (0, 1, 2), LIMIT) != ""


def test_one_bad_point_hides_no_order() -> None:
    bad = measured()[:, [1, 0, 2]]
    bad[4] += 3.0
    assert other_order(bad, NOMINAL, (0, 1, 2), LIMIT) == "x and y swapped"
    half = measured()
    half[:9] = half[:9, [1, 0, 2]]
    assert other_order(half, NOMINAL, (0, 1, 2), LIMIT) == ""
