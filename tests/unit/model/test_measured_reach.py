"""Readings that are not on the part are refused by row and column; those of honest parts never."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from measured_examples import points, study

from mtu_cli.errors import InputError
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.datum import Datum
from mtu_cli.model.measured_checks import refuse_mistaken
from mtu_cli.model.measured_reach import reach_problems
from mtu_cli.model.measured_rows import LARGEST_MM

ROW = 7
"""Of feature a of P1 at (10, 20); the features are at most 223.6 mm apart."""


def slipped(found: Points, value: float, row: int = ROW) -> Points:
    measured = found.measured.copy()
    measured[row, 0] = value
    return replace(found, measured=measured)


def refused(found: Points, datum: Datum | None = None) -> tuple[Finding, ...]:
    with pytest.raises(InputError) as caught:
        refuse_mistaken(found, datum)
    return tuple(caught.value.findings)


@pytest.mark.parametrize("datum", [None, "none", "offset", "offset,rotation"])
@pytest.mark.parametrize(
    ("value", "hint"),
    [
        (10004.0, ": um taken for mm, or a decimal point left out?"),
        (1000.4, ": is its decimal point in its place?"),
        (345.0, ""),
        (-700.0, ""),
    ],
)
def test_a_reading_off_the_part_is_refused(datum: Datum | None, value: float, hint: str) -> None:
    """Whatever the freedoms of the datum would make of the others of its part."""
    (problem,) = refused(slipped(study(6, 2, 3), value), datum)
    assert (problem.file, problem.row, problem.column) == ("cmm.csv", ROW + 2, "x_mm")
    assert problem.value == f"{value:.9g}"
    assert problem.text.startswith("feature 'a' of part 'P1' is farther from its nominal than")
    assert problem.expected == f"about 10, not 223.6 mm or more from it{hint}"


def test_parts_are_told_apart_from_readings() -> None:
    """Parts that lie elsewhere, turned or mirrored, and slips that stay on the part, pass."""
    found = study(6, 2, 3)
    own = (found.part == 2)[:, None]
    for changed in (found.measured + 5000.0, -found.measured, found.measured[:, [1, 0, 2]]):
        refuse_mistaken(replace(found, measured=np.where(own, changed, found.measured)))
    refuse_mistaken(slipped(found, 100.04))
    refuse_mistaken(slipped(found, 233.0))


def test_a_part_that_lies_elsewhere_is_judged_from_where_it_lies() -> None:
    found = study(6, 2, 3)
    put = np.random.default_rng(5).normal(0.0, 900.0, (6, 3))[found.part]
    apart = replace(found, measured=found.measured + put)
    refuse_mistaken(apart, "offset")
    off = slipped(apart, apart.measured[ROW, 0] + 224.0)
    assert [item.row for item in refused(off, "offset")] == [ROW + 2]


def test_parts_of_few_readings_are_judged_together() -> None:
    """A small part has a reach of 10 mm; one of one hole lies where the others do."""
    one = points([(f"P{p}", "a", -1, 0.001 * p, 0.0) for p in range(7)])
    refuse_mistaken(slipped(one, 19.9, 3))
    (problem,) = refused(slipped(one, 100.0, 3))
    assert (
        problem.expected
        == "about 10, not 10 mm or more from it: is its decimal point in its place?"
    )


def test_all_of_them_are_told() -> None:
    found = slipped(slipped(study(6, 2, 3), 1e4), -1e5, 20)
    assert [item.row for item in refused(found)] == [9, 22]


def test_a_sign_is_asked_about() -> None:
    found = study(6, 2, 3)
    measured = found.measured.copy()
    row = int(np.flatnonzero(found.feature == 2)[0])
    measured[row, 1] *= -1
    (problem,) = refused(replace(found, measured=measured))
    assert problem.column == "y_mm"
    assert str(problem.expected).endswith(": is its sign right?")


def test_a_reading_of_every_part_moves_all_of_their_places() -> None:
    """Taken about the means of their parts, all points are far off: the readings are, not they."""
    found = study(3, 1, 3)
    measured = found.measured.copy()
    measured[found.feature == 0, 0] += 500.0
    assert [item.row for item in refused(replace(found, measured=measured), "offset")] == [2, 5, 8]


def test_what_is_no_coordinate_of_a_machine_is_told_elsewhere() -> None:
    found = study(6, 2, 3)
    assert len(list(reach_problems(slipped(found, 0.99 * LARGEST_MM), (0, 1), 0.5))) == 1
    assert not list(reach_problems(slipped(found, 1.01 * LARGEST_MM), (0, 1), 0.5))
