"""Readings that look mistaken are told by row; clean ones are not."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from machine_trials import Drift, machine, read_machine
from model_examples import Segment, loaded, readings

from mtu_cli.files.readings import Readings
from mtu_cli.model.reading_doubts import reading_doubts, scale_doubts
from mtu_cli.model.reading_expected import _groups, _medians

FAR = 12.0
"""Standard deviations of repeatability beyond all doubt: 8 is the limit, 1 to 2 is its scatter."""


def mistyped(given: Readings, rows: np.ndarray, by: float) -> Readings:
    error = given.error.copy()
    error[rows] += by
    return replace(given, error=error)


def codes(found: list[object]) -> list[str]:
    return [item.code for item in found]  # type: ignore[attr-defined]  # warnings


def test_clean_machines_are_not_doubted(tmp_path: Path) -> None:
    """Levels and slopes of passes, reversal and bends are the machine's, not slips."""
    known = machine(tmp_path)
    rng = np.random.default_rng(1)
    for drift in (Drift(0.0), Drift(1.0)) * 10:
        given = read_machine(rng, drift)
        assert reading_doubts(known, given) == []
        size = np.array([1.0 if name[0] == "d" else 0.01 for name in given.components])[given.code]
        bend = 2e-3 * given.direction + 1e-6 * (given.position_mm - 80) ** 2
        bent = given.error + size * bend
        assert (
            reading_doubts(known, replace(given, error=np.where(np.isnan(bent), given.error, bent)))
            == []
        )


@pytest.mark.parametrize("passes", [None, 1])
def test_a_slip_is_told_with_its_row_and_what_was_expected(
    tmp_path: Path, passes: int | None
) -> None:
    """Where places are visited again, and where the polynomial alone tells."""
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(2), Drift(1.0))
    name = given.components.index("dx_x")
    own = np.flatnonzero(given.code == name)
    if passes is not None:
        first = given.pass_number[own[0]]
        there = given.direction == given.direction[own[0]]
        kept = np.flatnonzero(((given.pass_number == first) & there) | (given.code != name))
        arrays: dict[str, Any] = {
            key: value[kept]
            for key, value in arrays_of(given).items()
            if isinstance(value, np.ndarray) and len(value) == len(given)
        }
        given = replace(given, **arrays)
        own = np.flatnonzero(given.code == name)
    slip = int(own[3])
    found = reading_doubts(known, mistyped(given, np.array([slip]), 40 * 0.8e-3))
    (warning,) = found
    assert warning.code == "reading-stands-out"
    assert warning.facts.get("about", ()) == (given.components[name],)
    assert f", row {given.row[slip]}, column 'error': dx_x at " in warning.message
    assert f"is {1e3 * given.error[slip] + 32:.4g} um where the others" in warning.message


def arrays_of(given: Readings) -> dict[str, Any]:
    return {name: getattr(given, name) for name in Readings.__slots__}


def test_several_slips_and_readings_of_another_kind(tmp_path: Path) -> None:
    """Few are slips; where many are far off, that is how the component behaves."""
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(3), Drift(0.0))
    own = np.flatnonzero(given.code == given.components.index("dx_x"))
    (warning,) = reading_doubts(known, mistyped(given, own[[3, 40]], FAR * 0.8e-3))
    assert warning.message.count("row ") == 2
    many = mistyped(given, own[:: len(own) // 8], FAR * 0.8e-3)
    assert reading_doubts(known, many) == []


def rows_of(warnings: list[Any]) -> list[int]:
    """Rows that are named, in the order of the message."""
    told = [item.message for item in warnings if item.code == "reading-stands-out"]
    return [int(row) for text in told for row in re.findall(r", row (\d+), column", text)]


@pytest.mark.parametrize("first", [0, 2, 5])
@pytest.mark.parametrize("count", [2, 3, 5])
def test_rows_that_follow_each_other_do_not_blame_the_rest_of_their_pass(
    tmp_path: Path, first: int, count: int
) -> None:
    """More than half of a pass, or the end of one and the start of the next: of eight places."""
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(7), Drift(1.0))
    own = np.flatnonzero(given.code == given.components.index("dx_x"))
    slips = own[first : first + count]
    error = given.error.copy()
    error[slips] = 0.15
    found = reading_doubts(known, replace(given, error=error))
    assert rows_of(found) == given.row[slips].tolist()


@pytest.mark.parametrize("share", [0.1, 0.2])
def test_good_readings_are_never_blamed(tmp_path: Path, share: float) -> None:
    """Of readings in passes, spread or in a row; where a whole pass is off nobody knows."""
    known = machine(tmp_path)
    spread_told = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        given = read_machine(rng, Drift(1.0))
        own = np.flatnonzero(given.code == given.components.index("dy_y"))
        count = int(share * len(own))
        start = int(rng.integers(len(own) - count))
        kinds = {"spread": rng.choice(own, count, replace=False), "row": own[start:][:count]}
        for kind, slips in kinds.items():
            found = reading_doubts(known, mistyped(given, slips, 0.15))
            told = rows_of(found)
            assert set(told) <= set(given.row[slips].tolist())
            every = len(told) == 6 and f"; and {count - 6} more: look" in found[0].message
            spread_told += kind == "spread" and every
    assert spread_told >= 9


def test_a_pass_that_is_torn_in_two_blames_neither_part(tmp_path: Path) -> None:
    """Passes that move by more than the slips: three of eight may be the good ones."""
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(8), Drift(0.0))
    own = np.flatnonzero(given.code == given.components.index("dx_x"))
    moved = 0.05 * np.random.default_rng(9).standard_normal(10)
    error = given.error.copy()
    error[own] += np.repeat(moved, 8)
    error[own[:5]] += 0.1 * np.sign(moved[0])
    assert reading_doubts(known, replace(given, error=error)) == []


def in_passes(count: int, places: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, passes and errors of a wavy component, passes x places."""
    rng = np.random.default_rng(11)
    position, number = (
        np.tile(np.linspace(0, 400, places), count),
        np.repeat(np.arange(count), places),
    )
    error = 3e-3 * np.sin(position / 60) + 1e-3 * rng.standard_normal(count)[number]
    return position, number, error + 1e-3 * rng.standard_normal(len(position))


@pytest.mark.parametrize(
    ("passes", "slips", "told"),
    [
        # Four of the five of a pass: it has moved, or they are gross. The next pass tells.
        (10, [10, 11, 12, 13], []),
        (10, [11, 12, 13, 14, 15], [15]),
        # Two of the three visits to a place: the curve tells.
        (3, [7, 12], [7, 12]),
    ],
)
def test_what_stands_for_a_pass_or_a_place_of_which_most_is_gross(
    tmp_path: Path, passes: int, slips: list[int], told: list[int]
) -> None:
    known = machine(tmp_path)
    position, number, error = in_passes(passes, 5)
    error[slips] += 0.3
    given = readings([Segment(name="dx_x", position=position, passes=number, error=error)])
    assert rows_of(reading_doubts(known, given)) == given.row[told].tolist()


def test_slips_of_a_single_pass_do_not_hide_each_other(tmp_path: Path) -> None:
    """At the end of the travel, where a line bends to them."""
    known = machine(tmp_path)
    position = np.linspace(0, 300, 31)
    error = 1e-5 * position + 1e-3 * np.random.default_rng(6).standard_normal(31)
    error[-5:] += 0.2
    given = readings([Segment(name="dx_x", position=position, error=error, role="laser")])
    assert rows_of(reading_doubts(known, given)) == given.row[-5:].tolist()


def test_a_long_axis_has_larger_errors_and_a_poor_one_is_asked_about(tmp_path: Path) -> None:
    """55 um/m over 24 m are its scale; what is beyond all limits is told if it is not refused."""
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(5), Drift(0.0))
    length = np.array([name[0] == "d" for name in given.components])[given.code]
    far = 160 * given.position_mm
    scale = np.where(length, 1e-6 * far, 0.0)
    for slope, count in ((55, 0), (300, 1), (12000, 1)):
        large = replace(given, error=given.error + slope * scale, position_mm=far)
        found = reading_doubts(known, large)
        assert [item.code for item in found] == ["readings-large"] * count


@pytest.mark.parametrize(("some", "size"), [(8, 0.3), (2, 1.2)])
@pytest.mark.parametrize("files", [1, 8])
def test_large_readings_are_told_by_their_files(
    tmp_path: Path, files: int, some: int, size: float
) -> None:
    """Of the files that are large, six by name; the typical size is theirs."""
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(5), Drift(0.0))
    named = replace(given.sources[0], shown="sound.csv")
    sources = (named, *(replace(named, shown=f"run{i}.csv") for i in range(8)))
    own = given.code == given.components.index("dx_x")
    count = np.arange(len(given))
    index = np.where(own & (count // 8 % 9 < some), 1 + count % files, 0)
    error = np.where(index > 0, size, 1e-3 * own)
    large = replace(given, error=error, file_index=index, sources=sources, roles=9 * ("lbb",))
    (warning,) = [w for w in reading_doubts(known, large) if w.code == "readings-large"]
    names = [f"run{i}.csv" for i in range(min(files, 6))] + ["2 more"] * (files == 8)
    told = f"in {', '.join(names)}: dx_x (typically {1e3 * size:.3g} um); are"
    assert warning.message == f"large errors for a machine {told} they in the unit they state?"


@pytest.mark.parametrize("count", [7, 40_000])
def test_groups_and_their_medians(count: int) -> None:
    """Against numpy's rows that are alike and the median of each; also of very many groups."""
    rng = np.random.default_rng(6)
    keys = rng.integers(0, count, 4 * count) / 3, rng.integers(-1, 2, 4 * count)
    found, values = _groups(*keys), rng.normal(size=4 * count).round(2)
    expected = np.unique(np.column_stack(keys), axis=0, return_inverse=True)[1].reshape(-1)
    assert (found == expected).all()
    medians = _medians(found, values)
    for group in rng.choice(found, 20):
        own = found == group
        np.testing.assert_allclose(medians[own], np.median(values[own]), rtol=1e-14, atol=1e-16)


def test_units_and_positions_that_look_like_others_are_asked_about(tmp_path: Path) -> None:
    given = read_machine(np.random.default_rng(4), Drift(0.0))
    large = replace(given, error=100 * given.error)
    (warning,) = reading_doubts(machine(tmp_path), large)
    assert warning.code == "readings-large"
    assert "large errors for a machine in lbb.csv: dx_x (typically " in warning.message
    names = sorted(name for name in given.components if name != "axy")
    lines = "".join(
        f"  {n}: {{of: {n[-1]}, unit: {'um' if n[0] == 'd' else 'urad'}}}\n" for n in names
    )
    known = loaded(
        tmp_path,
        "axes: {x: {travel_mm: [0, 1000]}, y: {travel_mm: [0, 800]}}\n"
        f"components:\n{lines}  axy: {{unit: urad}}\nequations: {{Ex: dx_x}}\n",
    )
    metres = replace(given, position_mm=given.position_mm / 1000)
    (warning,) = reading_doubts(known, metres)
    assert warning.code == "positions-narrow"
    assert "metres in a column of mm" in warning.message


@pytest.mark.parametrize(
    ("times", "size", "words"),
    [(1.0, 1000.0, "metres"), (0.99, 1000.0, "metres"), (1.0, 25.4, "inches"),
     (1.9, 25.4, "inches"), (1.0, 10.0, None), (2.5, 25.4, None), (1.0, 60.0, None)],
)  # fmt: skip
def test_positions_over_the_whole_travel_in_another_unit_are_asked_about(
    times: float, size: float, words: str | None, tmp_path: Path
) -> None:
    """Of a travel so many times what is measured. A few per cent of it are inches where they are
    more than half of it then; of anything else nobody knows.
    """
    given = read_machine(np.random.default_rng(4), Drift(0.0))
    travel = times * float(np.nanmax(given.position_mm) - np.nanmin(given.position_mm))
    names = [name for name in given.components if name != "axy"]
    lines = "".join(
        f"  {n}: {{of: {n[-1]}, unit: {'um' if n[0] == 'd' else 'urad'}}}\n" for n in names
    )
    known = loaded(
        tmp_path,
        f"axes: {{x: {{travel_mm: [0, {travel}]}}, y: {{travel_mm: [0, {travel}]}}}}\n"
        f"components:\n{lines}  axy: {{unit: urad}}\nequations: {{Ex: dx_x}}\n",
    )
    other = replace(given, position_mm=given.position_mm / size)
    found = [item for item in reading_doubts(known, other) if item.code == "positions-narrow"]
    assert len(found) == (words is not None)
    for item in found:
        assert f"cover at most 1/{size:g} of the travel" in item.message
        assert f"are they {words} in a column of mm?" in item.message


def test_errors_that_look_like_mm_marked_as_um(tmp_path: Path) -> None:
    """All lengths below 0.05 um, angles as they were; one good component among others is fine."""
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(4), Drift(0.0))
    lengths = np.array([name[0] == "d" for name in given.components])[given.code]
    small = replace(given, error=np.where(lengths, given.error / 1000, given.error))
    (warning,) = reading_doubts(known, small)
    assert warning.code == "readings-small"
    largest = 1e3 * np.abs(small.error[lengths]).max()
    assert f"no length is off by more than {largest:.2g} um" in warning.message
    assert reading_doubts(known, replace(given, error=np.where(lengths, 0, given.error))) == []
    one = given.code == given.components.index("dx_x")
    assert reading_doubts(known, replace(given, error=np.where(one, 1e-3, 1) * given.error)) == []


def test_positions_that_lie_farther_apart_than_the_axis_travels_are_asked_about(
    tmp_path: Path,
) -> None:
    known = loaded(
        tmp_path,
        "axes: {x: {travel_mm: [0, 600]}}\ncomponents: {px: {of: x, unit: um}}\n"
        "equations: {Ex: px}\n",
    )
    rng = np.random.default_rng(4)

    def told(last: float, start: float = 0.0) -> list[str]:
        position = start + np.tile(np.append(np.linspace(0, 500, 9), last), 4)
        error = 1e-3 * rng.normal(size=len(position))
        given = readings([Segment(name="px", position=position, error=error, role="laser")])
        return [w.message for w in scale_doubts(known, given) if w.code == "positions-wide"]

    # A laser may have its zero anywhere.
    assert told(600.0) == told(600.0, 900.0) == told(610.0) == []
    (text,) = told(720.0)
    assert text.endswith("px 720 mm (travel of x: 600 mm)")


@pytest.mark.parametrize(
    ("positions", "travel", "told"),
    [
        # One turn of a screw, by whole, half and tenths of mm; 20 in are more than 500 mm.
        (np.arange(21.0), 500.0, False), (np.arange(41) / 2, 500.0, False),
        (np.arange(201) / 10, 800.0, False), (np.arange(21.0), 1000.0, False),
        # A machine of 20 in, or one of 21.
        (np.arange(21.0), 508.0, True), (np.arange(161) / 8, 508.0, True),
        (np.arange(21.0), 533.4, True), (np.arange(21.0), 600.0, False),
        # Steps of 25 mm, converted, of somewhat more than half of a travel too.
        (25 * np.arange(21) / 25.4, 500.0, True),
        ((25 * np.arange(21) / 25.4).round(3), 900.0, True),
    ],
)  # fmt: skip
def test_a_short_way_of_a_long_axis_is_inches_by_its_steps_or_its_ends(
    positions: np.ndarray, travel: float, told: bool, tmp_path: Path
) -> None:
    known = loaded(
        tmp_path,
        f"axes: {{x: {{travel_mm: [0, {travel}]}}, y: {{travel_mm: [0, 700]}}}}\n"
        "components: {px: {of: x, unit: um}, py: {of: y, unit: um}}\nequations: {Ex: px + py}\n",
    )
    error = 1e-3 * np.random.default_rng(4).normal(size=len(positions))
    own = Segment(name="px", position=positions, error=error, role="laser")

    def narrow(*others: Segment) -> bool:
        found = scale_doubts(known, readings([own, *others]))
        return "positions-narrow" in {item.code for item in found}

    assert narrow() == told
    # Of one file all positions are in one unit; other files may be in another.
    there = 600 * np.linspace(0, 1, len(positions))
    for role in ("laser", "lbb"):
        mm = Segment(name="py", position=there, error=error, role=role)
        assert narrow(mm) == (told and role == "lbb")


def test_one_turn_of_a_screw_far_from_the_zero_is_no_inch() -> None:
    """20 mm of an axis that travels 500; from 100 on, as inches, at 2.5 m."""
    from mtu_cli.files.reading_cells import narrow_unit

    turn = np.arange(21.0)
    assert narrow_unit(turn, {"x": (0.0, 500.0)}, "x") == "inch"
    assert narrow_unit(turn + 100, {"x": (0.0, 500.0)}, "x") is None
