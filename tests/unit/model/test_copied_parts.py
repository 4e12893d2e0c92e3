"""Copies of parts are refused, honest parts of a coarse last digit never."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from measured_examples import points

from mtu_cli.errors import InputError
from mtu_cli.files.points import Points
from mtu_cli.model.copied_parts import copied_parts
from mtu_cli.model.part_spread import agreeing, shares_alike
from mtu_cli.stats.least_squares import FloatArray

DIGIT_MM = 0.01


def holes(errors: FloatArray, digit: float = DIGIT_MM) -> Points:
    """Points whose `errors` (parts, repeats, features, 2) in digits round to whole ones."""
    count, repeats, features = errors.shape[:3]
    part, repeat, feature = (
        index.ravel() for index in np.indices((count, repeats, features), np.int64)
    )
    nominal = np.full((len(part), 3), np.nan)
    nominal[:, 0], nominal[:, 1] = 10.0 * feature, 5.0
    measured = nominal.copy()
    measured[:, :2] += digit * np.round(errors.reshape(-1, 2))
    return replace(
        points([("P0", "a", 1, 0.0, 0.0)]),
        parts=tuple(f"P{p}" for p in range(count)),
        part=part,
        features=tuple(f"F{f}" for f in range(features)),
        feature=feature,
        operation=np.full(len(part), -1),
        measured=measured,
        nominal=nominal,
        repeat=repeat + 1,
        row=np.arange(len(part)) + 2,
        file_index=np.zeros(len(part), np.int64),
        sequence=part + 1,
    )


def set_ups(
    seed: int, count: int, per: int, features: int, repeats: int, noise: float, shift: float = 3.0
) -> FloatArray:
    """Errors in digits of `per` parts in each set-up, which shifts them by some digits."""
    rng = np.random.default_rng(seed)
    bias = rng.normal(0, 3.0, (features, 2))
    whole = np.repeat(rng.normal(0, shift, (count, 1, 1, 2)), per, axis=0)
    return bias + whole + rng.normal(0, noise, (count * per, repeats, features, 2))


def verdict(errors: FloatArray, digit: float = DIGIT_MM) -> str:
    try:
        return "asked" if copied_parts(holes(errors, digit), (0, 1)) else ""
    except InputError as error:
        return str(error)


@pytest.mark.parametrize(
    ("count", "per", "features", "repeats", "noise"),
    [(10, 2, 4, 1, 0.1), (10, 2, 4, 1, 0.05), (6, 3, 8, 1, 0.1), (6, 3, 8, 2, 0.05),
     (10, 2, 8, 1, 0.2), (3, 2, 16, 1, 0.05), (150, 2, 8, 1, 0.1)],
)  # fmt: skip
def test_honest_parts_of_common_set_ups_are_asked_about_at_most(
    count: int, per: int, features: int, repeats: int, noise: float
) -> None:
    """Parts of one set-up agree to the last digit by chance, those of others in nothing."""
    found = [verdict(set_ups(seed, count, per, features, repeats, noise)) for seed in range(20)]
    assert set(found) <= {"", "asked"}
    assert "asked" in found


@pytest.mark.parametrize(
    ("count", "per", "features", "noise"),
    [(3, 1, 6, 50.0), (20, 1, 4, 50.0), (10, 2, 8, 5.0), (10, 2, 16, 1.0), (200, 1, 8, 10.0)],
)
def test_copies_are_refused_where_parts_of_a_set_up_differ_by_more_than_a_digit(
    count: int, per: int, features: int, noise: float
) -> None:
    for seed in range(10):
        errors = set_ups(seed, count, per, features, 1, noise, 3 * noise)
        errors[-1] = errors[0]
        last = f"part 'P{len(errors) - 1}' has the same values as part 'P0'"
        assert last in verdict(errors, 0.001)


def test_a_copy_within_the_last_digit_is_asked_about() -> None:
    errors = set_ups(1, 10, 2, 8, 1, 0.5)
    errors[-1] = errors[0]
    assert verdict(errors) == "asked"


def test_where_all_parts_are_equal_nothing_tells_what_they_differ_by() -> None:
    """Two of them: a fine part measured twice, or a coarse display."""
    errors = set_ups(1, 1, 2, 8, 1, 5.0)
    errors[1] = errors[0]
    assert verdict(errors, 0.001) == "asked"


@pytest.mark.parametrize("seed", range(5))
def test_two_set_ups_of_equal_parts_are_asked_about(seed: int) -> None:
    """No part tells what those of one set-up differ by; of three set-ups and more a table was
    pasted again.
    """
    for count, found in ((2, "asked"), (3, "part 'P1' has the same values as part 'P0'")):
        errors = set_ups(seed, count, 2, 8, 1, 5.0)
        errors[1::2] = errors[::2]
        assert found in verdict(errors)
    alone = set_ups(seed, 2, 2, 8, 1, 5.0)
    alone[1] = alone[0]
    assert "part 'P1' has the same values" in verdict(alone)


@pytest.mark.parametrize("seed", range(5))
def test_parts_of_unequal_repeats(seed: int) -> None:
    """Honest ones that shift as a whole, where every fourth is measured three times more."""
    errors = set_ups(seed, 20, 1, 4, 4, 0.02, shift=0.3)
    found = holes(errors)
    kept = np.flatnonzero((found.part % 4 == 0) | (found.repeat == 1))
    names = ("part", "feature", "operation", "measured", "nominal", "repeat", "row", "file_index")
    less = replace(found, **{name: getattr(found, name)[kept] for name in names})
    assert [warning.code for warning in copied_parts(less, (0, 1))] == ["parts-alike"]


@pytest.mark.parametrize("scatter", [0.0, 0.1, 0.5, 1.0, 5.0, 50.0])
def test_agreement_is_that_of_rounded_draws(scatter: float) -> None:
    rng = np.random.default_rng(7)
    n = 400_000
    first = rng.uniform(0, 1, n)
    share = float((np.round(first) == np.round(first + rng.normal(0, scatter, n))).mean())
    error = 4 * np.sqrt(max(share * (1 - share), 1 / n) / n)
    assert agreeing(scatter) == pytest.approx(share, abs=error)


def test_nothing_agrees_where_no_pair_is_known() -> None:
    assert agreeing(np.inf) == 0.0
    found = holes(set_ups(1, 4, 1, 4, 1, 1.0))
    alone = np.zeros(len(found), np.int64)
    assert shares_alike(found, found.operation, (0, 1), alone).tolist() == [0.0] * len(found)


def test_a_shift_of_half_a_digit_is_no_scatter() -> None:
    """Two parts without noise agree, whatever rounding makes of their shift."""
    errors = np.zeros((2, 1, 6, 2))
    errors[:, 0, :, 0] = np.linspace(0.0, 0.9, 6)
    errors[1] += 0.5
    found = holes(errors)
    assert shares_alike(found, found.operation, (0,), found.part)[0] == 1.0
