"""Passes in another unit than the others are refused, honest ones never."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from test_readings_file import MACHINE

from mtu_cli.errors import InputError
from mtu_cli.files.pass_units import _bends
from mtu_cli.files.readings import read_readings

HEAD = "component,position_mm,pass,direction,error,unit\n"
PLACES = np.arange(9) * 75.0
BOTH = np.concatenate([PLACES, PLACES[::-1]])
WAYS = ["forward"] * 9 + ["reverse"] * 9


def passes(count: int = 5, slope: float = 0.02, seed: int = 1) -> np.ndarray:
    """Errors (passes, 18) in um, there and back, that scatter by 0.7 within a pass and by 2 from
    pass to pass.
    """
    rng = np.random.default_rng(seed)
    level = rng.normal(scale=2, size=(count, 1))
    return 3 * (slope != 0) + slope * BOTH + level + rng.normal(scale=0.7, size=(count, 18))


def told(path: Path, errors: np.ndarray, unit: str = "um", name: str = "dx_x") -> list[str]:
    """What is said of passes of one component, refusals and warnings."""
    lines = [
        f"{name},{place},{number},{way},{error:.6g},{unit}\n"
        for number, own in enumerate(errors, 1)
        for place, way, error in zip(BOTH, WAYS, own, strict=True)
        if np.isfinite(error)
    ]
    path.write_text(HEAD + "".join(lines))
    try:
        found = read_readings([(path, "lbb")], MACHINE, for_fit=True)
    except InputError as error:
        return [str(problem) for problem in error.findings]
    return [f"{note.code} {note.message}" for note in found.notes]


@pytest.mark.parametrize("slope", [0.02, 0.0])
@pytest.mark.parametrize("number", [1, 2, 5])
def test_a_pass_in_mm_in_a_column_of_um(number: int, slope: float, tmp_path: Path) -> None:
    errors = passes(slope=slope)
    assert told(tmp_path / "r.csv", errors) == []
    errors[number - 1] /= 1000
    first = f"{float(f'{errors[number - 1, 0]:.6g}'):.6g} um"
    assert told(tmp_path / "r.csv", errors) == [
        f"r.csv, row {2 + 18 * (number - 1)}, column 'error': pass {number} of dx_x is of another "
        f"size than the other passes: '{first}'; expected errors as in the other passes: "
        "these look like mm in a column of um, or the others are in the wrong unit"
    ]


@pytest.mark.parametrize(
    ("factor", "unit", "words"),
    [
        (1e3, "um", "like nm in a column of um"),
        (1e-3, "mm", "1000 times too small"),
        (1 / 25.4, "um", "pass-unit .*like thousandths of an inch in a column of um"),
    ],
)
def test_other_units(factor: float, unit: str, words: str, tmp_path: Path) -> None:
    errors = passes() / (1000 if unit == "mm" else 1)
    errors[2] *= factor
    (found,) = told(tmp_path / "r.csv", errors, unit)
    assert re.search(words, found), found


def test_of_two_passes_the_later_one_is_told(tmp_path: Path) -> None:
    errors = passes(2)
    errors[0] /= 1000
    (found,) = told(tmp_path / "r.csv", errors)
    assert "pass 2 of dx_x" in found
    assert "these look like nm in a column of um, or the others are in the wrong unit" in found


def test_slips_and_steady_passes_are_no_unit(tmp_path: Path) -> None:
    """One reading that is 200 times too large, a pass that drifted, one that is twice as quiet, a
    display that shows nothing.
    """
    errors = passes()
    errors[1, 4] *= 200
    errors[2] += 60
    errors[3] = np.mean(errors[3]) + (errors[3] - np.mean(errors[3])) / 2
    errors[4] = 3.0
    assert not any("another size" in item for item in told(tmp_path / "r.csv", errors))


def other_size(path: Path, errors: np.ndarray, unit: str = "um", name: str = "dx_x") -> list[str]:
    return [item for item in told(path, errors, unit, name) if "another size" in item]


def test_units_of_nearly_one_size_are_not_told_apart(tmp_path: Path) -> None:
    """4.85 urad are an arcsec: a pass may scatter as many times more."""
    errors = passes()
    errors[2] *= 4.848
    assert other_size(tmp_path / "r.csv", errors, "arcsec", "ez_x") == []
    errors[2] *= 3600 / 4.848
    assert len(other_size(tmp_path / "r.csv", errors, "arcsec", "ez_x")) == 1


def test_a_pass_that_is_as_far_from_0_as_the_others_is_in_their_unit(tmp_path: Path) -> None:
    """A thousandth of the scatter, as of means of many readings, about the same errors."""
    errors = passes()
    line = 3 + 0.02 * BOTH
    errors[2] = line + (errors[2] - line) / 1000
    assert other_size(tmp_path / "r.csv", errors) == []


@pytest.mark.parametrize(
    ("factor", "louder", "seen"), [(1e-3, 3, 1), (1e-3, 12, 0), (1 / 25.4, 1, 1), (1 / 25.4, 5, 0)]
)
def test_a_pass_must_scatter_about_as_the_others(
    factor: float, louder: float, seen: int, tmp_path: Path
) -> None:
    errors = passes(slope=0.0)
    errors[2] = errors[2].mean() + louder * (errors[2] - errors[2].mean())
    errors[2] *= factor
    assert len(other_size(tmp_path / "r.csv", errors)) == seen


@pytest.mark.parametrize(
    ("factor", "rows", "seen"), [(1e-3, 6, 0), (1e-3, 7, 1), (1 / 25.4, 15, 0), (1 / 25.4, 16, 1)]
)
def test_few_readings_tell_no_scatter(factor: float, rows: int, seen: int, tmp_path: Path) -> None:
    """Two of each way make no bend: 7 rows there have 5, enough for a thousand; 9 there and 7 back
    have 12, enough for an inch.
    """
    errors = passes()
    errors[2] *= factor
    errors[2, rows:] = np.nan
    assert len(other_size(tmp_path / "r.csv", errors)) == seen


def test_honest_passes_are_left_alone(tmp_path: Path) -> None:
    """Of components that are 0 within noise, with a coarse display or without."""
    for seed in range(60):
        errors = passes(2 + seed % 5, slope=0.0, seed=seed)
        if seed % 2:
            errors = np.round(errors)
        assert told(tmp_path / "r.csv", errors + 1e-9 * np.arange(18)) == []


def test_bends_know_no_level_slope_or_reversal() -> None:
    way = np.repeat([1, -1], 9).astype(np.int8)
    line = 5 + 0.1 * BOTH + 3 * (way > 0)
    assert np.allclose(_bends(BOTH, way, line), 0, atol=1e-9)
    assert len(_bends(BOTH, way, line)) == 14
    uneven = np.cumsum([0.0, 10, 90, 35, 2, 60, 75, 8, 120])
    sloped = 5 + 0.1 * uneven
    assert np.allclose(_bends(uneven, way[:9], sloped), 0, atol=1e-9)
    line[4] += 2
    assert np.sort(_bends(BOTH, way, line))[-3:] == pytest.approx([1, 1, 2])
