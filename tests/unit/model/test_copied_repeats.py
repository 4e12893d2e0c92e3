"""Repeats that are copies are told, honest repeats of a coarse last digit are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from compare_trials import fitted, made, study
from measured_examples import points

from mtu_cli.analyses.anova import analyse_variance
from mtu_cli.analyses.compare import compare
from mtu_cli.files.points import Points
from mtu_cli.model.copied_repeats import _mean_range, copied_repeats
from mtu_cli.model.measured_checks import check_measured
from mtu_cli.model.settings import Settings

AXES = (0, 1)


def measured(
    parts: int, repeats: int, noise: float, seed: int, digit: float = 0.001, spread: float = 0.0
) -> Points:
    """Three holes; a CMM whose `noise` is in digits, and differs by part by a factor e^spread."""
    rng = np.random.default_rng(seed)
    rows = []
    for p in range(parts):
        own = noise * float(np.exp(spread * rng.standard_normal()))
        for name in "abc":
            x, y = 3.0 * rng.standard_normal(2)
            for r in range(repeats):
                error = digit * np.round((x, y) + own * rng.standard_normal(2))
                rows.append((f"P{p}", name, r + 1, *error.tolist()))
    return points(rows)


def copied(found: Points, part: int, to: int = 2, source: int = 1) -> Points:
    values = found.measured.copy()
    own = found.part == part
    values[own & (found.repeat == to)] = values[own & (found.repeat == source)]
    return replace(found, measured=values)


def told(found: Points) -> list[str]:
    warnings = copied_repeats(found, AXES)
    assert {item.code for item in warnings} <= {"repeats-alike"}
    return [item.message for item in warnings]


@pytest.mark.parametrize(("repeats", "to", "source"), [(2, 2, 1), (3, 3, 2)])
def test_a_copy_is_told_by_its_rows(repeats: int, to: int, source: int) -> None:
    whole = measured(6, repeats, 100.0, 1, digit=1e-5)
    assert told(whole) == []
    found = copied(whole, 3, to, source)
    (text,) = told(found)
    later, first = (
        int(found.row[(found.part == 3) & (found.repeat == number)][0]) for number in (to, source)
    )
    assert f": part 'P3', cmm.csv, row {later} on, as cmm.csv, row {first} on. Was it" in text
    two = copied(found, 5, to, source)
    (text,) = told(two)
    assert text.startswith("2 repeats have the values of an earlier one in all features, ")


def test_every_command_that_reads_parts_tells_it() -> None:
    """By the check that all of them make: here anova, compare, and what close-loop calls."""
    _, truth, part = study()
    found = copied(made(truth, part, 1), 4)
    said = [
        analyse_variance(found, part, "reml", Settings()).warnings,
        compare(fitted(5, 7), part, found, Settings()).warnings,
        check_measured(found),
    ]
    for warnings in said:
        (own,) = [item for item in warnings if item.code == "repeats-alike"]
        assert f"part {found.parts[4]!r}" in own.message


@pytest.mark.parametrize("noise", [0.05, 0.1, 0.2, 0.5, 2.0])
@pytest.mark.parametrize(("parts", "repeats"), [(1, 2), (1, 4), (2, 2), (5, 2), (20, 3)])
def test_honest_repeats_of_coarse_digits_are_silent(noise: float, parts: int, repeats: int) -> None:
    """From 0.05 um on, to a digit of 1 um; equal or not from part to part."""
    for seed in range(20):
        assert told(measured(parts, repeats, noise, seed)) == []
        assert told(measured(parts, repeats, noise, seed, spread=0.7)) == []


def test_a_part_that_repeats_better_than_the_others_is_no_copy() -> None:
    """To half a digit where others do to two: one such part in sixty agrees in all six values."""
    rng, agreed = np.random.default_rng(5), 0
    for seed in range(300):
        whole = measured(6, 2, 2.0, seed)
        values, own = whole.measured.copy(), whole.part == 0
        values[own] = whole.nominal[own] + 0.001 * np.round(0.5 * rng.standard_normal((6, 3)))
        agreed += bool((values[own][0::2, :2] == values[own][1::2, :2]).all())
        assert told(replace(whole, measured=values)) == []
    assert agreed > 0


def test_where_all_agree_the_digit_says_what_that_means() -> None:
    """n values that all agree: e^-3 is the chance of that where s = 3 sqrt(pi)/2 h/n."""
    for parts, digit in ((3, 1e-4), (30, 0.001)):
        one = measured(parts, 1, 1.0, 2, digit)
        rows = [i for i in range(len(one)) for _ in (0, 1)]
        twice = points(
            [
                (one.parts[one.part[i]], one.features[one.feature[i]], r % 2 + 1,
                 *(one.measured[i, :2] - one.nominal[i, :2]).tolist())
                for r, i in enumerate(rows)
            ]
        )  # fmt: skip
        (text,) = told(twice)
        n = 6 * parts
        assert f"({1e3 * digit:.2g} um): with {n} values the CMM would repeat to within" in text
        assert f" {1e3 * 1.5 * np.sqrt(np.pi) * digit / n:.1g} um. Were they copied?" in text
    # Of a normal CMM with that s one study in twenty agrees in all values.
    s, n = 1.5 * np.sqrt(np.pi) / 60, 60
    rng = np.random.default_rng(3)
    place, noise = rng.uniform(0, 1, (20_000, n)), s * rng.standard_normal((2, 20_000, n))
    equal = (np.round(place + noise[0]) == np.round(place + noise[1])).all(axis=1).mean()
    assert equal == pytest.approx(np.exp(-3), abs=4 * np.sqrt(0.05 * 0.95 / 20_000))
    coarse = copied(measured(1, 2, 1.0, 2, 0.01), 0)
    assert told(coarse) == []


def test_a_display_of_5_um_has_few_values_and_makes_no_copies() -> None:
    """Of parts off by a fifth of its steps, by a CMM that repeats to 0.06 um: 40 honest studies."""
    alarms = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        places = [
            (f"P{p}", name, 0.2 * rng.standard_normal(2)) for p in range(14) for name in "abc"
        ]
        rows = [
            (part, name, r, *(0.005 * np.round(at + 0.012 * rng.standard_normal(2))).tolist())
            for part, name, at in places
            for r in (1, 2)
        ]
        alarms += bool(told(points(rows)))
    assert alarms == 0


def test_several_repeats_of_a_place_that_all_agree_are_held_against_their_range() -> None:
    """Five readings lie 2.326 s apart in the mean, not four times as far as two (1.128 s)."""
    rng = np.random.default_rng(4)
    s, places, studies = 3 / (2.326 * 100), 100, 10_000
    read = rng.uniform(0, 1, (studies, places, 1)) + s * rng.standard_normal((studies, places, 5))
    equal = (np.ptp(np.round(read), axis=2) == 0).all(axis=1).mean()
    assert equal == pytest.approx(np.exp(-3), abs=4 * np.sqrt(0.05 * 0.95 / studies))
    # What a CMM that repeats to 0.06 um may well do is not asked about.
    for parts, seen in ((4, False), (11, True)):
        one = measured(parts, 1, 1.0, 2, 0.001)
        texts = told(
            points(
                [
                    (one.parts[one.part[i]], one.features[one.feature[i]], r + 1,
                     *(one.measured[i, :2] - one.nominal[i, :2]).tolist())
                    for i in range(len(one)) for r in range(5)
                ]
            )
        )  # fmt: skip
        assert bool(texts) is seen
    bound = 3 / (2.326 * 11 * 6)
    assert f"with {11 * 6 * 4} values the CMM would repeat to within {bound:.1g} um" in texts[0]


def test_what_is_not_numbered_or_numbered_as_one_likes_is_told_too() -> None:
    whole = copied(measured(6, 2, 100.0, 1, digit=1e-5), 3)
    (text,) = told(whole)
    assert told(replace(whole, repeat=np.full(len(whole), -1))) == [text]
    assert told(replace(whole, repeat=whole.repeat * 10**9)) == [text]
    assert told(replace(whole, repeat=whole.repeat + 2**53 - 4)) == [text]
    assert told(measured(6, 1, 1.0, 1)) == []


def test_ticks_of_a_clock_number_the_repeats_of_many_parts() -> None:
    """Runs times numbers are beyond 64 bits."""
    whole = copied(measured(1200, 2, 100.0, 1, digit=1e-5), 1199)
    expected = told(whole)
    assert told(replace(whole, repeat=whole.repeat + 2**53 - 4)) == expected


def test_files_that_stand_twice_are_told_once() -> None:
    """Without numbers, as "rows-stand-twice": the same is not said in other words again."""
    one = measured(6, 1, 100.0, 1, digit=1e-5)
    twice = replace(copied(measured(6, 2, 100.0, 1, digit=1e-5), 0), repeat=np.full(36, -1))
    for part in range(6):
        own = twice.part == part
        twice.measured[own] = np.repeat(one.measured[one.part == part], 2, axis=0)
    codes = [item.code for item in check_measured(twice)]
    assert codes.count("rows-stand-twice") == 1
    assert "repeats-alike" not in codes


def test_mean_ranges_of_normal_readings() -> None:
    """The d2 of control charts (ISO 7870-2, factors for the centre line of ranges)."""
    published = {1: 0.0, 2: 1.128, 3: 1.693, 5: 2.326, 10: 3.078, 25: 3.931}
    found = _mean_range(np.array([*published, 2]))
    assert found == pytest.approx([*published.values(), 1.128], abs=5.1e-4)
