"""Nominal places written for measured ones are refused; good parts and coarse digits are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from measured_examples import points, study

from mtu_cli.errors import InputError
from mtu_cli.files.points import Points
from mtu_cli.model.drawn_parts import drawn_axes, drawn_parts
from mtu_cli.model.measured_checks import check_measured

PLANE = (0, 1)


def drawn(found: Points, part: int) -> Points:
    own = (found.part == part)[:, None]
    return replace(found, measured=np.where(own, found.nominal, found.measured))


def test_a_part_written_from_the_drawing_is_refused() -> None:
    found = study(6, 2, 3, 0.001, 0.0005)
    assert drawn_parts(found, PLANE) == []
    with pytest.raises(InputError) as caught:
        check_measured(drawn(drawn(found, 2), 4))
    assert [item.row for item in caught.value.findings] == [14, 26]
    (what,) = {item.text.replace("P4", "P2") for item in caught.value.findings}
    assert what.startswith("part 'P2' is on its nominal in all of 6 values, to the last digit")


def test_an_axis_on_its_nominal_everywhere_is_told() -> None:
    """Every part of it, whatever the other axes are."""
    found = study(6, 2, 3)
    assert drawn_axes(found, PLANE) == []
    flat = found.measured.copy()
    flat[:, 1] = found.nominal[:, 1]
    (told,) = drawn_axes(replace(found, measured=flat), PLANE)
    assert told.code == "axis-on-nominal"
    assert told.message.startswith("y_mm is on its nominal in all of 36 values, to the last digit")
    assert "not measured, or is it shown too coarsely?" in told.message
    assert told in check_measured(replace(found, measured=flat))
    # One value that is not, be it by a last digit, or values of another axis: somebody measured.
    off = flat.copy()
    off[17, 1] += 1e-5
    assert drawn_axes(replace(found, measured=off), PLANE) == []
    both = drawn_axes(replace(found, measured=found.nominal), PLANE)
    assert [item.message[:4] for item in both] == ["x_mm", "y_mm"]
    # Three values in a row happen.
    few = points([("P0", name, 1, 0.001, 0.0) for name in "abc"])
    assert drawn_axes(few, PLANE) == []


@pytest.mark.parametrize(("s_part", "told"), [(0.0003, 2), (0.004, 0)])
def test_digits_that_hide_the_scatter_are_told_as_that(s_part: float, told: int) -> None:
    """Steps of 0.01 mm: parts that scatter by less than a thirtieth of one have been measured, and
    nothing is seen of it; of those that scatter by more, some are a step off.
    """
    found = study(20, 2, 5, s_part, 0.0002)
    errors = 0.01 * np.round((found.measured - found.nominal) / 0.01)
    assert len(drawn_axes(replace(found, measured=found.nominal + errors), PLANE)) == told


def test_one_hole_on_its_nominal_is_no_drawing() -> None:
    """Two values of few parts, and all parts alike: nothing tells."""
    found = study(6, 2, 3)
    own = ((found.part == 2) & (found.feature == 1))[:, None]
    here = replace(found, measured=np.where(own, found.nominal, found.measured))
    assert drawn_parts(here, PLANE) == []
    one = points([(f"P{p}", "a", 1, 0.001 * p, 0.002 * p) for p in range(5)])
    assert drawn_parts(one, PLANE) == []
    assert drawn_parts(replace(found, measured=found.nominal), PLANE) == []


@pytest.mark.parametrize("digit", [0.001, 0.005, 0.01])
def test_coarse_digits_are_no_drawing(digit: float) -> None:
    """Parts of one set-up are off by a digit together, or differ by less than one."""
    for seed in range(200):
        rng = np.random.default_rng(seed)
        found = study(8, 1 + seed % 2, seed, 0.002, 0.0005)
        shift = rng.normal(0.0, digit, (8, 3))[found.part]
        for errors in (found.measured - found.nominal, found.measured - found.nominal + shift):
            rounded = found.nominal + digit * np.round(errors / digit)
            assert drawn_parts(replace(found, measured=rounded), PLANE) == []


@pytest.mark.parametrize(("digit", "refused"), [(0.001, True), (0.005, False), (0.01, False)])
@pytest.mark.parametrize("between", [0.0, 0.0004])
def test_to_coarse_digits_a_good_part_is_on_its_nominal(
    digit: float, between: float, refused: bool
) -> None:
    """After a machine was set right. Digits of coordinates, or of deviations from nominal places
    that have more.
    """
    found = study(8, 1, 3, 0.2, 0.0)
    errors = digit * np.round((found.measured - found.nominal) / digit)
    errors[found.part == 5] = 0.0
    nominal = found.nominal + between
    rounded = replace(found, nominal=nominal, measured=nominal + errors)
    if refused:
        with pytest.raises(InputError, match="part 'P5' is on its nominal in all of 6 values"):
            check_measured(rounded)
    else:
        (told,) = [item for item in check_measured(rounded) if item.code == "part-on-nominal"]
        assert told.message.startswith("cmm.csv, row 17: part 'P5' is on its nominal in all of 6")


Row = tuple[str, str, int, float, float]


def rows(errors: np.ndarray) -> list[Row]:
    """Of errors (parts, repeats, 3, 2), mm, of the three holes."""
    parts, repeats, _, _ = errors.shape
    return [
        (f"P{p}", name, r, float(errors[p, r, i, 0]), float(errors[p, r, i, 1]))
        for p in range(parts)
        for r in range(repeats)
        for i, name in enumerate("abc")
    ]


def errors_but(part: int, repeats: int = 2) -> np.ndarray:
    errors = np.random.default_rng(3).normal(0.0, 0.01, (4, repeats, 3, 2))
    errors[part] = 0.0
    return errors


def refused(found: list[Row]) -> list[str]:
    try:
        assert drawn_parts(points(found), PLANE) == []
    except InputError as error:
        return [item.text.split()[1] for item in error.findings]
    return []


def test_parts_with_one_reading_do_not_hide_a_drawing() -> None:
    """A rejected part of which one hole was measured says nothing of how often errors agree."""
    found = rows(errors_but(2))
    assert refused([row for row in found if row[0] != "P3" or row[1:3] == ("a", 0)]) == ["'P2'"]
    # Nor is anything known where every other part has one.
    assert refused([row for row in found if row[0] == "P2" or row[1:3] == ("a", 0)]) == []


@pytest.mark.parametrize(
    ("second", "expected"),
    [((0, 0, 1, 1, 2, 3), ["'P2'"]), ((0, 0, 0, 1, 2, 3), [])],
)
def test_errors_agree_as_often_as_in_the_part_where_they_do_most(
    second: tuple[int, ...], expected: list[str]
) -> None:
    """Along x 4 of 15 pairs of P1 agree, along y 2 or 3: of 30 and one more 7 or 8. In all of six
    values one of four parts agrees by chance in 4 (7/31)^6 = 5e-4 of studies, or in 1.2e-3.
    """
    errors = errors_but(2)
    errors[1, :, :, 0] = 0.01 * np.reshape((0, 0, 0, 1, 1, 2), (2, 3))
    errors[1, :, :, 1] = 0.01 * np.reshape(second, (2, 3))
    assert refused(rows(errors)) == expected


def test_few_values_or_one_axis_on_the_nominal_are_no_drawing() -> None:
    errors = errors_but(2, 9)
    found = rows(errors)
    assert refused(found) == ["'P2'"]
    assert refused([row for row in found if row[0] != "P2" or row[1] == "b"]) == []
    errors[2, :, :, 1] = 0.01
    assert refused(rows(errors)) == []
