"""Columns of positions and errors that are each other's are refused, sound ones never."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from support import DATA

from mtu_cli.errors import InputError
from mtu_cli.files.csv_file import read_table
from mtu_cli.files.readings import SPEC
from mtu_cli.files.swapped_columns import refuse_swapped

Rows = list[tuple[str, float, int, float]]
"""Component, position in mm, pass, error in um."""
DELIVERED = sorted(DATA.glob("*/lbb.csv")) + sorted(DATA.glob("*/laser.csv"))


def judged(folder: Path, rows: Rows, *, swapped: bool = False, role: str = "lbb") -> str:
    """What is said of a file, "" where nothing is."""
    columns = ("error", "pass", "position_mm") if swapped else ("position_mm", "pass", "error")
    lines = [f"{name},{place!r},{number},{error!r},um" for name, place, number, error in rows]
    path = folder / "r.csv"
    path.write_text("\n".join([f"component,{','.join(columns)},unit", *lines, ""]))
    try:
        refuse_swapped(read_table(path, role, SPEC))
    except InputError as error:
        return str(error)
    return ""


def run(
    seed: int = 1,
    passes: int = 3,
    targets: tuple[float, ...] = (0.0, 100.0, 200.0, 300.0),
    *,
    jitter: float = 0.0,
    digits: int = 3,
) -> Rows:
    """Passes there and back, with errors of some um; `jitter` of the positions in mm."""
    random = np.random.default_rng(seed)
    return [
        (
            "dx_x",
            place + round(float(random.normal(0, jitter)), 4) if jitter else place,
            number,
            round(0.01 * place + float(random.normal(0, 2)), digits),
        )
        for number in range(1, passes + 1)
        for place in (*targets, *targets[::-1])
    ]


def test_targets_as_errors_are_refused(tmp_path: Path) -> None:
    rows = run()
    assert judged(tmp_path, rows) == ""
    assert judged(tmp_path, rows, swapped=True) == (
        "r.csv, row 1: the columns 'error' and 'position_mm' look swapped: the errors of dx_x are "
        "0, 100, 200, ... in every pass, and its positions differ from pass to pass; expected "
        "targets in 'position_mm', what was read there in 'error'"
    )


@pytest.mark.parametrize("digits", [1, 3])
@pytest.mark.parametrize("seed", range(5))
def test_errors_of_few_digits_that_repeat_by_chance_do_not_hide_it(
    seed: int, digits: int, tmp_path: Path
) -> None:
    assert judged(tmp_path, run(seed, 5, digits=digits), swapped=True)


@pytest.mark.parametrize(
    "rows",
    [
        run(passes=1),
        run(targets=(0.0, 400.0)),
        run(jitter=0.05),
        # Of interpolation within a pitch, by an instrument that shows whole um.
        run(targets=(0.0, 0.2, 0.4, 0.6, 0.8, 1.0), jitter=0.01, digits=0),
        # Without noise, and steep.
        [("dx_x", place, p, 5 * place) for p in (1, 2) for place in (0.0, 1.0, 2.0, 3.0)],
        # At one place, thrice a pass.
        [("dx_x", 50.0, p, error) for p in (1, 2, 3) for error in (0.0, 1.0, 2.0)],
        # An instrument that drifts by a um a pass.
        [("dx_x", 0.1 * k, p, float(k + p)) for p in (1, 2) for k in range(4)],
    ],
    ids=["one pass", "two places", "as reached", "whole um", "steep", "one place", "drift"],
)
def test_what_may_be_right_passes(rows: Rows, tmp_path: Path) -> None:
    assert judged(tmp_path, rows) == ""


def test_one_component_with_repeated_positions_speaks_for_the_columns(tmp_path: Path) -> None:
    odd = [("dy_y", error, number, place) for _, place, number, error in run()]
    assert judged(tmp_path, odd)
    assert judged(tmp_path, [*odd, *run()]) == ""


def test_a_component_without_an_axis_does_not(tmp_path: Path) -> None:
    angle = [("axy", 0.0, number, 3.0 + number / 7) for number in (1, 2, 3)]
    assert judged(tmp_path, [*run(), *angle], swapped=True)


def test_drift_readings_are_not_judged(tmp_path: Path) -> None:
    assert judged(tmp_path, run(), swapped=True, role="drift") == ""


@pytest.mark.parametrize("path", DELIVERED, ids=lambda path: path.parent.name)
def test_delivered_readings_are_sound_and_told_when_swapped(path: Path, tmp_path: Path) -> None:
    refuse_swapped(read_table(path, "lbb", SPEC))
    text = path.read_text()
    header = "component,position_mm,pass,direction,error,unit"
    other = "component,error,pass,direction,position_mm,unit"
    assert header in text
    rows = [line for line in text.replace(header, other).splitlines() if ",," not in line]
    (tmp_path / "swapped.csv").write_text("\n".join(rows))
    with pytest.raises(InputError, match="look swapped"):
        refuse_swapped(read_table(tmp_path / "swapped.csv", "lbb", SPEC))


@pytest.mark.parametrize("seed", range(20))
def test_positions_that_are_repeated_are_positions(seed: int, tmp_path: Path) -> None:
    """Whatever the errors are, the same ones in every pass among them."""
    random = np.random.default_rng(seed)
    places = random.choice([0.0, 0.5, 1.0, 50.0, 400.0], 8)
    errors = np.sort(random.integers(-300, 300, 8))
    rows = [
        ("dx_x", float(place), number, float(error))
        for number in (1, 2)
        for place, error in zip(places, errors, strict=True)
    ]
    assert judged(tmp_path, rows) == ""


@pytest.mark.parametrize("large", [1e308, -1.7e308])
def test_what_is_too_large_to_be_subtracted_is_told_by_others(tmp_path: Path, large: float) -> None:
    rows = [("a", place, number, 1.0) for number in (1, 2) for place in (0.0, 100.0, large, -large)]
    assert judged(tmp_path, rows) == judged(tmp_path, rows, swapped=True) == ""


def test_a_coarse_display_of_small_errors_is_sound(tmp_path: Path) -> None:
    """In nm, of um steps; and of um steps over a stage of a millimetre: positions as read."""
    read = ((0.0012, 99.998, 200.003, 299.999), (0.0007, 100.004, 199.996, 300.002))
    for scale, unit, errors in ((1.0, "nm", (0, 1000, 2000, 3000)), (3e-3, "um", (0, 1, 2, 3))):
        rows = [
            f"a,{scale * place!r},{number},{error},{unit}"
            for number, places in enumerate(read, 1)
            for place, error in zip(places, errors, strict=True)
        ]
        path = tmp_path / "r.csv"
        path.write_text("\n".join(["component,position_mm,pass,error,unit", *rows, ""]))
        refuse_swapped(read_table(path, "lbb", SPEC))


@pytest.mark.parametrize("places", [(0.0, 2.5, 5.0, 7.5, 10.0), (0.0, 5.0, 10.0, 20.0, 30.0)])
@pytest.mark.parametrize("falling", [False, True])
def test_places_read_back_of_a_short_stage_are_places(
    places: tuple[float, ...], falling: bool, tmp_path: Path
) -> None:
    """Whatever steep errors its display of 5 arcsec shows, the same in every pass.

    Set by hand they lie about round numbers; what differs by more is no place.
    """
    errors = (0.0, 5.0, 10.0, 15.0, 25.0)[:: -1 if falling else 1]
    for jitter, sound in ((0.002, True), (0.1, True), (0.4, False)):
        rng = np.random.default_rng(3)
        rows = [
            ("a", round(place + float(rng.uniform(-jitter, jitter)), 4), number, 4 * error)
            for number in (1, 2, 3)
            for place, error in zip(places, errors, strict=True)
        ]
        assert (judged(tmp_path, rows) == "") == sound


@pytest.mark.parametrize(
    ("step", "off", "sound"),
    [(1.0, 0.02, True), (2.0, 0.03, True), (25.0, 0.5, True), (5.0, 0.1, True), (3.1, 0.1, False)],
)
def test_places_set_by_hand_are_places(
    step: float, off: float, sound: bool, tmp_path: Path
) -> None:
    """To a scale and a dial of 10 um; steps of no round number are held to be errors."""
    rng = np.random.default_rng(4)
    rows = [
        ("a", round(step * i + float(rng.uniform(-off, off)), 3), number, 30 * step * i)
        for number in (1, 2, 3)
        for i in range(4)
    ]
    assert (judged(tmp_path, rows) == "") == sound


def test_errors_in_nm_are_held_against_um(tmp_path: Path) -> None:
    """Of 10 um steps over 300 mm: 100 nm per mm, but 0.1 um."""
    read_at = ((0.0012, 99.998, 200.003, 299.999), (0.0007, 100.004, 199.996, 300.002))
    rows = [
        f"a,{place!r},{number},{error},nm"
        for number, places in enumerate(read_at, 1)
        for place, error in zip(places, (0, 10_000, 20_000, 30_000), strict=True)
    ]
    path = tmp_path / "r.csv"
    path.write_text("\n".join(["component,position_mm,pass,error,unit", *rows, ""]))
    refuse_swapped(read_table(path, "lbb", SPEC))


def test_only_a_component_that_is_steep_itself_has_swapped_columns(tmp_path: Path) -> None:
    coarse = [
        ("a", place + 0.001 * number * (place + 1), number, error)
        for number in (1, 2)
        for place, error in zip((0.0, 100.0, 200.0, 300.0), (0.0, 1.0, 2.0, 3.0), strict=True)
    ]
    steep = [("b", float(i), number, 1e4 * i + number) for number in (1, 2) for i in range(2)]
    assert judged(tmp_path, coarse + steep) == ""


@pytest.mark.parametrize(("travel", "most"), [(300, 15), (300, 100), (500, 30), (1000, 50)])
def test_machines_of_all_sizes_with_swapped_columns_are_refused(
    tmp_path: Path, travel: int, most: int
) -> None:
    """Targets of a tenth of the travel, errors that rise to `most` um and scatter by 1 um."""
    rng = np.random.default_rng(3)
    rows = [
        ("a", float(most * i / 10 + rng.normal()), number, float(travel * i / 10))
        for number in (1, 2, 3)
        for i in range(11)
    ]
    assert "look swapped" in judged(tmp_path, rows)


def test_numbers_without_a_difference_give_no_warning(tmp_path: Path) -> None:
    rows = [f"a,{50 * i},{number},1e307,mm" for number in (1, 2, 3) for i in range(7)]
    path = tmp_path / "r.csv"
    path.write_text("\n".join(["component,position_mm,pass,error,unit", *rows, ""]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refuse_swapped(read_table(path, "lbb", SPEC))
