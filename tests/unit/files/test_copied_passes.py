"""Copies of passes are refused, honest passes of a coarse display never."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_readings_file import MACHINE

from mtu_cli.errors import InputError
from mtu_cli.files.copied_passes import _as_most_others
from mtu_cli.files.readings import read_readings

HEAD = "component,position_mm,pass,direction,error,unit\n"


def rows(errors: np.ndarray, first: int = 1, digits: int = 2) -> str:
    """Passes (n, positions), forward alone."""
    return "".join(
        f"dx_x,{20 * x},{first + p},forward,{error:.{digits}f},um\n"
        for p, own in enumerate(errors)
        for x, error in enumerate(own)
    )


def told(tmp_path: Path, *contents: str, for_fit: bool = True) -> list[str]:
    files = []
    for index, content in enumerate(contents):
        (tmp_path / f"r{index}.csv").write_text(HEAD + content)
        files.append((tmp_path / f"r{index}.csv", "laser"))
    try:
        read_readings(files, MACHINE, for_fit=for_fit)
    except InputError as error:
        return [str(problem) for problem in error.findings]
    return []


def drawn(count: int, positions: int = 8, scatter: float = 1.0, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.linspace(0, 5, positions) + rng.normal(scale=scatter, size=(count, positions))


def test_passes_that_were_pasted_again_and_numbered_on(tmp_path: Path) -> None:
    three = drawn(3)
    assert told(tmp_path, rows(three)) == []
    (found,) = told(tmp_path, rows(three) + rows(three[1:2], 4))
    assert found == (
        "r0.csv, row 26, column 'pass': pass 4 of 'dx_x' has the same readings as pass 2, to the "
        "last digit; expected each pass once"
    )
    assert len(told(tmp_path, rows(three) + rows(three, 4))) == 3
    assert told(tmp_path, rows(three) + rows(three, 4), for_fit=False) == []


def test_in_another_order_and_in_another_file(tmp_path: Path) -> None:
    three = drawn(3)
    lines = rows(three[:1], 4).splitlines(keepends=True)
    backwards = "".join(reversed(lines))
    assert "pass 4 of 'dx_x' has" in told(tmp_path, rows(three) + backwards)[0]
    (found,) = told(tmp_path, rows(three), backwards + rows(drawn(1, seed=2), 5))
    assert found.startswith("r1.csv, row 2, column 'pass': pass 4 of 'dx_x' has")
    other_way = rows(three[:1], 4).replace("forward", "reverse")
    assert told(tmp_path, rows(three) + other_way) == []


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("scatter", [0.0, 0.03, 0.1, 0.2])
def test_honest_passes_of_a_coarse_display(tmp_path: Path, scatter: float, seed: int) -> None:
    """Steps of 1 um: passes agree in many readings, and now and then in all."""
    assert told(tmp_path, rows(drawn(10, 8, scatter, seed), digits=0)) == []


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("scatter", [0.1, 0.2, 0.3])
def test_honest_passes_of_a_coarse_display_that_drift(
    tmp_path: Path, scatter: float, seed: int
) -> None:
    """Levels of 3 steps of 1 um: passes of unlike levels agree nowhere, of like ones in all."""
    levels = np.random.default_rng(100 + seed).normal(scale=3.0, size=(20, 1))
    assert told(tmp_path, rows(levels + drawn(20, 8, scatter, seed), digits=0)) == []


@pytest.mark.parametrize("seed", range(10))
def test_a_copy_is_found_at_few_places_with_a_coarse_digit(tmp_path: Path, seed: int) -> None:
    """Of six differences two agree by chance in most pairs: that is no level of theirs."""
    errors = drawn(20, 6, 3.0, seed)
    (found,) = told(tmp_path, rows(errors, digits=0) + rows(errors[4:5], 21, digits=0))
    assert "pass 21 of 'dx_x' has the same readings as pass 5" in found


def test_copies_among_passes_that_drift(tmp_path: Path) -> None:
    drifting = np.arange(6.0)[:, np.newaxis] + drawn(6)
    (found,) = told(tmp_path, rows(drifting) + rows(drifting[2:3], 7))
    assert "pass 7 of 'dx_x' has the same readings as pass 3" in found


def test_where_all_passes_are_equal_nothing_is_said(tmp_path: Path) -> None:
    """Readings that were made without scatter."""
    assert told(tmp_path, rows(np.repeat(drawn(1), 4, axis=0))) == []
    two_ways = drawn(2)
    assert told(tmp_path, rows(np.concatenate([two_ways, two_ways, two_ways]))) == []


def test_of_few_readings_nothing_is_said(tmp_path: Path) -> None:
    three = drawn(3, 3)
    assert told(tmp_path, rows(three) + rows(three[:1], 4)) == []
    four = drawn(6, 4)
    assert len(told(tmp_path, rows(four) + rows(four[:1], 7))) == 1


@pytest.mark.parametrize(
    ("apart", "agree"),
    [
        ([0.3], 0.0),
        ([1.0, 2.0, 3.0, 4.0], 0.0),
        ([1.0, 1.0, 2.0, 2.0, 5.0], 0.0),
        # Without itself each of the pair is at one of four levels of one difference.
        ([1.0, 1.0, 2.0, 3.0, 4.0], 2 / 4),
        ([1.0, 1.0, 1.0, 2.0, 3.0], 3.0),
        ([1.0, 1.0, 1.0, 2.0, 2.0], 3 / 2),
        ([7.0] * 6, 6.0),
    ],
)
def test_a_reading_agrees_if_it_is_at_the_level_of_most_others(
    apart: list[float], agree: float
) -> None:
    """Against each left out in turn, with every most frequent level of the rest alike."""
    assert _as_most_others(np.array(apart)) == pytest.approx(agree)
    plain = 0.0
    for i, own in enumerate(apart):
        rest = apart[:i] + apart[i + 1 :]
        most = max(map(rest.count, rest), default=0)
        levels = {x for x in rest if rest.count(x) == most}
        plain += (own in levels) / max(len(levels), 1)
    assert plain == pytest.approx(agree)


def test_equal_differences_of_decimals_are_equal(tmp_path: Path) -> None:
    """Of 3.3 - 1.1 and 2.9 - 0.7 um the last bits differ."""
    low = np.array([[0.1, 0.7, 1.1, 1.3, 2.3, 3.1, 4.3, 4.9]])
    levels = np.array([[0.0], [0.7], [1.4], [2.2], [2.9]])
    honest = np.vstack([low + levels, low + levels[2:3]])
    assert told(tmp_path, rows(honest, digits=1)) == []
