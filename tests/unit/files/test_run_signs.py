"""Runs with the opposite sign are told, and nothing else is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mtu_cli.files.machine import load_machine
from mtu_cli.files.readings import read_readings

FloatArray = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
MACHINE = """schema: mtu/machine/1
name: m
components: {dx_x: {of: x, unit: um, degree: 1}}
equations: {Ex: dx_x}
"""
PLACES = np.arange(0.0, 500.0, 50.0)
PATTERN = 3.0 + 0.02 * PLACES + 2.0 * np.sin(PLACES / 80.0)


def told(
    folder: Path, error: Callable[[int, int], FloatArray], passes: int = 5, ways: bool = True
) -> list[str]:
    """The warnings of readings in um whose runs (pass, direction) have these errors."""
    rows = ["component,position_mm,pass,error,unit" + (",direction" if ways else "")]
    for number in range(1, passes + 1):
        for way in (1, -1):
            run = list(zip(PLACES, error(number, way), strict=True))
            for place, value in run[::way]:
                end = f",{way}" if ways else ""
                rows.append(f"dx_x,{place:g},{number},{value:.6f},um{end}")
    path = folder / "lbb.csv"
    path.write_text("\n".join(rows) + "\n", "utf-8")
    (folder / "m.yaml").write_text(MACHINE, "utf-8")
    components = load_machine(folder / "m.yaml").machine.components
    notes = read_readings([(path, "lbb")], components, for_fit=True).notes
    return [note.message for note in notes if note.code == "run-sign"]


def noisy(rng: np.random.Generator) -> FloatArray:
    return PATTERN + rng.normal(0.0, 0.2, len(PLACES))


@pytest.mark.parametrize("ways", [True, False])
def test_a_run_of_the_opposite_sign_is_told(tmp_path: Path, ways: bool) -> None:
    rng = np.random.default_rng(3)
    (message,) = told(
        tmp_path, lambda k, way: (-1 if k == 3 else 1) * (noisy(rng) + 0.5 * way), ways=ways
    )
    assert message.startswith("lbb.csv, row 42: pass 3 of dx_x has the opposite sign of the other")


@pytest.mark.parametrize("ways", [True, False])
@pytest.mark.parametrize(
    "error",
    [
        lambda k, way, rng: noisy(rng),
        # Lost motion that grows along the axis has one sign one way, the other the other.
        lambda k, way, rng: way * noisy(rng),
        # Two of five: nobody knows which are the odd ones.
        lambda k, way, rng: (-1 if k in (2, 4) else 1) * noisy(rng),
        # One pass alone saw something else, of the same sign or much larger.
        lambda k, way, rng: (-4 if k == 3 else 1) * noisy(rng),
        lambda k, way, rng: noisy(rng) if k != 3 else rng.normal(0.0, 3.0, len(PLACES)),
    ],
    ids=["sound", "windup", "two", "larger", "noise"],
)
def test_other_runs_are_not(
    tmp_path: Path,
    error: Callable[[int, int, np.random.Generator], FloatArray],
    ways: bool,
) -> None:
    rng = np.random.default_rng(4)
    assert not told(tmp_path, lambda k, way: error(k, way, rng), ways=ways)


@pytest.mark.parametrize(("passes", "times"), [(3, 0), (4, 0), (5, 1)])
def test_of_few_runs_none_is_the_odd_one(passes: int, times: int, tmp_path: Path) -> None:
    """Noise of four is that alike now and then."""
    rng = np.random.default_rng(5)
    found = told(tmp_path, lambda k, way: (-1 if k == 3 else 1) * noisy(rng), passes=passes)
    assert len(found) == times


def test_runs_that_do_not_agree_have_no_odd_one(tmp_path: Path) -> None:
    """The third is the opposite of their mean, of which each is far off."""
    rng = np.random.default_rng(6)
    others = {k: noisy(rng) + rng.normal(0.0, 3.0, len(PLACES)) for k in (1, 2, 4, 5)}
    runs = {**others, 3: -np.mean(list(others.values()), axis=0)}
    assert not told(tmp_path, lambda k, way: runs[k])


def test_runs_of_noise_are_told_less_than_once_in_a_thousand(tmp_path: Path) -> None:
    """1000 components of noise, of random walks and of slopes that change from run to run."""
    rng = np.random.default_rng(6)
    kinds = (
        lambda: rng.normal(size=6),
        lambda: np.cumsum(rng.normal(size=6)),
        lambda: 3 * rng.normal() * np.linspace(-1.0, 1.0, 6) + rng.normal(0, 0.3, 6),
    )
    rows = ["component,position_mm,pass,error,unit"]
    for i in range(1000):
        for number in range(1, 6):
            values = kinds[i % 3]()
            rows += [f"c{i},{p * 20},{number},{v:.6f},um" for p, v in enumerate(values)]
    path = tmp_path / "lbb.csv"
    path.write_text("\n".join(rows) + "\n", "utf-8")
    notes = read_readings([(path, "lbb")], None, for_fit=True).notes
    told = [note.message for note in notes if note.code == "run-sign"]
    assert sum(message.count("pass ") for message in told) <= 1
