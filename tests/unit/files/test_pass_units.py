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
    ]
    path.write_text(HEAD + "".join(lines))
    try:
        found = read_readings([(path, "lbb")], MACHINE, for_fit=True)
    except InputError as error:
        return [str(problem) for problem in error.problems]
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
    line[4] += 2
    assert np.sort(_bends(BOTH, way, line))[-3:] == pytest.approx([1, 1, 2])
