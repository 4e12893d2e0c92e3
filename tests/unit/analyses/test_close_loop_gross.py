"""Gross entries: found where they are, and nothing set aside of tables that have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats, half_measured, holes
from loop_tables import crossed, residuals
from numpy.typing import NDArray
from scipy.stats import binom, norm

from mtu_cli.close_loop_sealed.analyses.loop.gross import set_aside
from mtu_cli.close_loop_sealed.stats.nan_median import nan_median

SHAPE = (12, 10, 2)


def noise(seed: int) -> Floats:
    return crossed(np.random.default_rng(seed), SHAPE)


@pytest.mark.parametrize("shape", [SHAPE, (4, 4, 1), (4, 8, 2), (8, 6, 2)])
def test_normal_tables_are_left_alone(shape: tuple[int, int, int]) -> None:
    rng, count = np.random.default_rng(1), 80
    touched = sum(bool(set_aside(residuals(crossed(rng, shape)))[1]) for _ in range(count))
    # The limit is a standard deviation beyond what one table in twenty passes.
    assert touched <= binom.ppf(1 - 1e-3, count, 0.02)


@pytest.mark.parametrize("name", ["holes", "half"])
def test_incomplete_normal_tables_are_left_alone(name: str) -> None:
    there = holes(12, 10, 0.3, 2) if name == "holes" else half_measured(12, 10)
    rng, count = np.random.default_rng(3), 80
    touched = 0
    for _ in range(count):
        touched += bool(set_aside(residuals(crossed(rng, SHAPE), there=there))[1])
    assert touched <= binom.ppf(1 - 1e-3, count, 0.05)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("missing", [0.0, 0.3, 0.9])
@pytest.mark.filterwarnings("ignore:All-NaN slice")
def test_medians_are_those_of_numpy(axis: int, missing: float) -> None:
    rng = np.random.default_rng(8)
    for shape in [(6, 7, 2), (5, 4, 1), (1, 3, 2)]:
        values = rng.normal(size=shape)
        values[rng.random(shape) < missing] = np.nan
        wanted = np.nanmedian(values, axis=axis, keepdims=True)
        np.testing.assert_array_equal(nan_median(values, axis), wanted)


def test_a_table_that_is_left_alone_is_the_same() -> None:
    table = residuals(noise(4))
    assert set_aside(table) == (table, ())


def test_gross_entries_are_found_where_they_are() -> None:
    rng, others = np.random.default_rng(5), 0
    for _ in range(30):
        errors = crossed(rng, SHAPE)
        where = rng.choice(120, 3, replace=False)
        p, h = np.divmod(where, 10)
        axis = rng.integers(2, size=3)
        errors[p, h, axis] += rng.choice([-1, 1], 3) * rng.uniform(15, 60, 3)
        table, found = set_aside(residuals(errors))
        wanted = {(f"P{i + 1}", f"H{j + 1}") for i, j in zip(p, h, strict=True)}
        assert {(g.part, g.feature) for g in found} >= wanted
        others += len(found) > 3
        # In all axes, and those alone.
        assert np.isnan(table.errors[p, h]).all()
        assert (~table.there).sum() == len(found)
        assert np.isfinite(table.errors[table.there]).all()
    assert others <= binom.ppf(1 - 1e-3, 30, 0.05)


def test_parts_that_turn_and_grow_have_no_gross_entries() -> None:
    rng, count = np.random.default_rng(14), 60
    touched = 0
    for _ in range(count):
        table = residuals(crossed(rng, SHAPE))
        places = table.places[0, :, :2] - table.places[0, :, :2].mean(axis=0)
        motion = np.einsum("paj,hj->pha", rng.normal(size=(12, 2, 2)) * 0.2, places)
        touched += bool(set_aside(replace(table, errors=table.errors + motion))[1])
    assert touched <= binom.ppf(1 - 1e-3, count, 0.05)


def test_deviations_are_from_part_and_column() -> None:
    rng = np.random.default_rng(6)
    part, column = 50 * rng.normal(size=(12, 1, 2)), 50 * rng.normal(size=(1, 10, 2))
    errors = part + column + rng.normal(size=SHAPE)
    errors[3, 4] += [40.0, -25.0]
    _, (one,) = set_aside(residuals(errors))
    # Medians of ten and twelve entries: each within about 1.25 / sqrt(10) of its own.
    assert one.deviation == pytest.approx((40.0, -25.0), abs=4.0)
    assert one.score == pytest.approx(40.0, rel=0.25)


@pytest.mark.parametrize(("beyond", "aside"), [(-1.5, 0), (1.5, 1)])
def test_the_limit_is_a_standard_deviation_beyond_the_largest_of_a_table(
    beyond: float, aside: int
) -> None:
    # 120 entries: two-sided 5 % of the largest is 3.53, and one more. One entry by itself in a
    # part and column of small noise is told within a median's error.
    limit = norm.isf(0.05 / (2 * 120)) + 1
    found = 0
    for seed in range(20):
        errors = np.random.default_rng(seed).normal(size=SHAPE)
        errors[2, 3, 0] = limit + beyond
        found += len(set_aside(residuals(errors))[1]) == aside
    assert found >= 16


def test_many_far_entries_are_the_tables_own_distribution() -> None:
    rng = np.random.default_rng(8)
    errors = noise(9)
    errors.reshape(120, 2)[rng.choice(120, 7, replace=False)] += 40.0
    table = residuals(errors)
    assert set_aside(table) == (table, ())


def test_too_few_parts_or_columns_tell_nothing() -> None:
    for shape in ((3, 10, 1), (10, 3, 1), (1, 24, 1), (24, 1, 1)):
        errors = crossed(np.random.default_rng(10), shape)
        errors[0, 0] += 1000.0
        assert set_aside(residuals(errors))[1] == ()


def test_the_last_entry_of_a_part_is_kept() -> None:
    there = np.ones((12, 10), bool)
    there[5, 1:] = False
    # The part's own median takes its only entry: whatever it is, it is not gross.
    errors = noise(11)
    errors[5, 0] += 500.0
    table, found = set_aside(residuals(errors, there=there))
    assert found == ()
    assert table.there[5, 0]


def test_entries_without_scatter_set_nothing_aside() -> None:
    errors = np.zeros(SHAPE)
    errors[0, 0] = 1.0
    assert set_aside(residuals(errors))[1] == ()


def test_repeats_go_with_their_entry() -> None:
    errors = np.random.default_rng(12).uniform(-1.0, 1.0, SHAPE)
    errors[1, 2] += 80.0
    given = replace(residuals(errors), repeats=np.full((12, 10), 3))
    table, found = set_aside(given)
    assert [(g.part, g.feature) for g in found] == [("P2", "H3")]
    assert table.repeats[1, 2] == 0
    assert table.repeats.sum() == 3 * 119
    assert given.repeats[1, 2] == 3


def test_features_on_a_slanting_line_turn_and_grow_alike() -> None:
    """One slope is all that such places tell, whichever way the line lies."""
    rng, count = np.random.default_rng(15), 60
    touched = 0
    for _ in range(count):
        table = residuals(crossed(rng, (12, 20, 2)))
        along = np.linspace(0.0, 200.0, 20)
        places = table.places.copy()
        places[:, :, 0], places[:, :, 1] = along, 40 + 0.3 * along
        motion = 0.03 * rng.normal(size=(12, 1, 2)) * (along - 100.0)[:, None]
        turned = replace(table, errors=table.errors + motion, places=places)
        touched += bool(set_aside(turned)[1])
    assert touched <= binom.ppf(1 - 1e-3, count, 0.05)


def test_a_part_that_was_measured_on_one_line_is_judged_with_the_others() -> None:
    """It tells no slope across the line: of all slopes the smallest is taken."""
    there = np.ones((12, 24), bool)
    there[4, 10:] = False
    errors = crossed(np.random.default_rng(16), (12, 24, 2))
    places = residuals(errors).places
    places[4, :, 1] = places[4, 0, 1]
    places[4, :, 0] = np.linspace(10.0, 140.0, 24)
    errors[4, :, 0] += 0.03 * places[4, :, 0]
    assert set_aside(replace(residuals(errors, there=there), places=places))[1] == ()
    errors[4, 2, 1] += 60.0
    _, (one,) = set_aside(replace(residuals(errors, there=there), places=places))
    assert (one.part, one.feature) == ("P5", "H3")


def test_corners_of_parts_go_farther_by_chance_than_their_middle() -> None:
    """Sixteen holes in a square: a corner bends the line of its part, or is far from the line of
    the others.
    """
    x, y = np.meshgrid(np.linspace(0.0, 300.0, 4), np.linspace(0.0, 240.0, 4))
    places = np.stack([x.ravel(), y.ravel(), np.full(16, 10.0)], axis=1)
    rng, count, touched = np.random.default_rng(6), 200, 0
    for _ in range(count):
        table = residuals(rng.normal(size=(20, 16, 3)) + 0.5 * rng.normal(size=(20, 1, 3)))
        table = replace(table, places=np.broadcast_to(places, (20, 16, 3)).copy())
        touched += bool(set_aside(table)[1])
    assert touched <= binom.ppf(1 - 1e-3, count, 0.02)


def some_holes(rng: np.random.Generator, each: int) -> NDArray[np.bool_]:
    """21 parts of 24 holes, each measured at some of them."""
    there = np.zeros((21, 24), bool)
    for row in there:
        row[rng.choice(24, each, replace=False)] = True
    return there


def lone_corner() -> Floats:
    """23 holes in a patch, one far from them: it makes the line of its part, or none."""
    x, y = np.append(10.0 + np.arange(23), 140.0), np.append(15.0 + np.arange(23) % 5, 140.0)
    return np.stack([x, y, np.full(24, 127.0)], axis=1)


@pytest.mark.parametrize("case", ["eight", "twelve", "corner"])
def test_few_holes_of_a_part_and_a_lone_corner_are_left_alone(case: str) -> None:
    """A place that decides on its part's line is as far off as chance makes it there."""
    rng, count, touched = np.random.default_rng(3), 150, 0
    for _ in range(count):
        errors = rng.normal(size=(21, 24, 2))
        there = some_holes(rng, 8 if case == "eight" else 12) if case != "corner" else None
        table = residuals(errors) if there is None else residuals(errors, there=there)
        if case == "corner":
            table = replace(table, places=np.broadcast_to(lone_corner(), table.places.shape).copy())
        touched += bool(set_aside(table)[1])
    assert touched <= binom.ppf(1 - 1e-3, count, 0.01)


@pytest.mark.parametrize("holes_of_each", [12, 16, 24])
def test_gross_entries_of_parts_that_turn_are_found(holes_of_each: int) -> None:
    """Ten standard deviations off, anywhere, where turns make corners go as far."""
    rng, found = np.random.default_rng(8), 0
    for _ in range(40):
        places = rng.uniform(-70, 70, (holes_of_each, 2))
        turn = 0.07 * rng.normal(size=(20, 1))
        errors = rng.normal(size=(20, holes_of_each, 2))
        errors[..., 0] -= turn * places[:, 1]
        errors[..., 1] += turn * places[:, 0]
        part, hole = rng.integers(20), rng.integers(holes_of_each)
        errors[part, hole, 0] += 10.0
        table = residuals(errors)
        moved = table.places.copy()
        moved[..., :2] = places
        aside = set_aside(replace(table, places=moved))[1]
        found += [(own.part, own.feature) for own in aside] == [
            (table.parts[part], table.features[hole])
        ]
    assert found >= 36


@pytest.mark.parametrize("missing", [0.0, 0.3])
@pytest.mark.parametrize("gross", [None, (3, 15.0), (9, 200.0)])
def test_a_feature_far_from_all_others_goes_where_its_part_turns(
    missing: float, gross: tuple[int, float] | None
) -> None:
    """Nine holes together and one 300 mm off, which by itself tells how its part lies."""
    rng, count, right = np.random.default_rng(5), 60, 0
    for _ in range(count):
        near = rng.uniform(5.0, 25.0, (9, 2))
        places = np.concatenate([near, [[320.0, 20.0]]])
        turn = 0.07 * rng.normal(size=(20, 1))
        errors = rng.normal(size=(20, 10, 2))
        errors[..., 0] -= turn * places[:, 1]
        errors[..., 1] += turn * places[:, 0]
        there, part, wanted = rng.random((20, 10)) >= missing, rng.integers(20), []
        if gross:
            errors[part, gross[0], 1] += gross[1]
            there[part, gross[0]] = True
            wanted = [(f"P{part + 1}", f"H{gross[0] + 1}")]
        table = residuals(errors, there=there)
        moved = table.places.copy()
        moved[..., :2] = places
        aside = set_aside(replace(table, places=moved))[1]
        right += [(own.part, own.feature) for own in aside] == wanted
    assert right >= binom.ppf(1e-3, count, 0.98)


@pytest.mark.parametrize("kind", ["loose", "step"])
def test_what_many_entries_of_one_feature_do_is_not_set_aside(kind: str) -> None:
    """A loose feature, and one that lies elsewhere from a part on, are found and not hidden."""
    rng = np.random.default_rng(17)
    for _ in range(20):
        errors = rng.normal(size=(20, 12, 2))
        if kind == "loose":
            errors[:, 4, 0] += 6.0 * rng.normal(size=20)
        else:
            errors[14:, 4, 0] += 7.0
        errors[2, 8, 1] += 30.0
        _, found = set_aside(residuals(errors))
        own = [g.part for g in found if g.feature == "H5"]
        assert len(own) <= 2
        assert [g.part for g in found if g.feature == "H9"] == ["P3"]


def test_a_place_of_one_part_that_differs_by_little_takes_no_line_away() -> None:
    rng, count, touched = np.random.default_rng(18), 60, 0
    for _ in range(count):
        errors = rng.normal(size=(12, 10, 2))
        table = residuals(errors)
        places = table.places.copy()
        places[4, 3, 2] += 1e-2
        turn = 0.05 * rng.normal(size=(12, 1))
        errors[..., 0] -= turn * places[..., 1]
        errors[..., 1] += turn * places[..., 0]
        touched += bool(set_aside(replace(table, errors=errors, places=places))[1])
    assert touched <= binom.ppf(1 - 1e-3, count, 0.02)


def test_rounded_errors_have_the_scatter_of_their_step() -> None:
    """Of a step of six standard deviations nearly all entries are 0."""
    rng = np.random.default_rng(19)
    errors = 6.0 * np.round(rng.normal(size=SHAPE) / 6.0)
    errors[3, 4, 0] += 60.0
    table = replace(residuals(errors), resolution=(6.0, 6.0))
    assert [(g.part, g.feature) for g in set_aside(table)[1]] == [("P4", "H5")]
    errors[3, 4, 0] -= 54.0
    assert set_aside(replace(table, errors=errors))[1] == ()
