"""Nominal places written for measured ones are refused; good parts and coarse digits are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from measured_examples import points, study

from mtu_cli.errors import InputError
from mtu_cli.files.points import Points
from mtu_cli.model.drawn_parts import refuse_drawn_parts
from mtu_cli.model.measured_checks import check_measured

PLANE = (0, 1)


def drawn(found: Points, part: int) -> Points:
    own = (found.part == part)[:, None]
    return replace(found, measured=np.where(own, found.nominal, found.measured))


def test_a_part_written_from_the_drawing_is_refused() -> None:
    found = study(6, 2, 3, 0.001, 0.0005)
    refuse_drawn_parts(found, PLANE)
    with pytest.raises(InputError) as caught:
        check_measured(drawn(drawn(found, 2), 4))
    assert [item.row for item in caught.value.problems] == [14, 26]
    (what,) = {item.what.replace("P4", "P2") for item in caught.value.problems}
    assert what.startswith("part 'P2' is on its nominal in all of 6 values, to the last digit")


def test_one_hole_on_its_nominal_is_no_drawing() -> None:
    """Two values of few parts, and all parts alike: nothing tells."""
    found = study(6, 2, 3)
    own = ((found.part == 2) & (found.feature == 1))[:, None]
    refuse_drawn_parts(replace(found, measured=np.where(own, found.nominal, found.measured)), PLANE)
    one = points([(f"P{p}", "a", 1, 0.001 * p, 0.002 * p) for p in range(5)])
    refuse_drawn_parts(one, PLANE)
    refuse_drawn_parts(replace(found, measured=found.nominal), PLANE)


@pytest.mark.parametrize("digit", [0.001, 0.005, 0.01])
def test_coarse_digits_are_no_drawing(digit: float) -> None:
    """Parts of one set-up are off by a digit together, or differ by less than one."""
    for seed in range(200):
        rng = np.random.default_rng(seed)
        found = study(8, 1 + seed % 2, seed, 0.002, 0.0005)
        shift = rng.normal(0.0, digit, (8, 3))[found.part]
        for errors in (found.measured - found.nominal, found.measured - found.nominal + shift):
            rounded = found.nominal + digit * np.round(errors / digit)
            refuse_drawn_parts(replace(found, measured=rounded), PLANE)
