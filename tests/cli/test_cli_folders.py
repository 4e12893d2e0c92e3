"""Folders of input, over a copy of `valid/small`: `call.txt` holds the arguments of a call.

valid: `expected.txt` stands in what is said. invalid: every fault of a file at once, in one line
each, nothing written; each line holds that of `expected.txt`. suspicious (alone, not over another):
a warning of the checks begins so, and the run goes on.
"""

import shlex
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from cli_runner import HERE, INVALID, VALID, done, mtu, prepared, refused, report
from support import CONFIGS


def folders(kind: Path) -> list[Path]:
    return sorted(path for path in kind.iterdir() if (path / "call.txt").exists())


def call_of(folder: Path) -> tuple[list[str], list[str]]:
    """The arguments, and the lines expected."""
    call, expected = ((folder / name).read_text("utf-8") for name in ("call.txt", "expected.txt"))
    return shlex.split(call), expected.splitlines()


@pytest.mark.parametrize("folder", folders(VALID), ids=lambda path: path.name)
def test_sound_input(folder: Path, tmp_path: Path) -> None:
    call, expected = call_of(folder)
    result = done(mtu(*call, cwd=prepared(tmp_path / "work", folder)))
    assert [words for words in expected if words not in result.stdout + result.stderr] == []


@pytest.mark.parametrize("folder", folders(INVALID), ids=lambda path: path.name)
def test_faulty_input(folder: Path, tmp_path: Path) -> None:
    call, expected = call_of(folder)
    message = refused(prepared(tmp_path / "work", folder), *call)
    assert message.startswith("mtu: ")
    found = message.removeprefix("mtu: ").splitlines()
    assert len(found) == len(expected), message
    for line, words in zip(found, expected, strict=True):
        assert words in line


@pytest.mark.parametrize("folder", folders(HERE / "suspicious"), ids=lambda path: path.name)
def test_improbable_input(folder: Path, tmp_path: Path) -> None:
    call, expected = call_of(folder)
    work = shutil.copytree(folder, tmp_path / "work")
    told = done(mtu(*call, "--fail-if", "suspicious", cwd=work), 3)
    lines = [line.removeprefix("warning: ") for line in told.stderr.splitlines()]
    for words in expected:
        assert any(line.startswith(words) for line in lines), told.stderr
    # In the report they have their place and facts; without the gate the run is done.
    found = [item for item in report(*call, cwd=work)["warnings"] if "rows" in item["facts"]]
    assert len(found) == len(expected)
    assert all(item["severity"] == "warning" and item["row"] for item in found)


# `mtu fit-components` where a pass is missing, files are given in another order, or one of two
# instruments ran one way.


PLACES = np.arange(0.0, 500.0, 50.0)
LOST_UM = 8.0
"""Forward minus reverse."""


class Pass(NamedTuple):
    """One pass: its number, its direction +1 or -1, its start in min, its errors in um."""

    number: int
    way: int
    start: float
    errors: np.ndarray


def made(runs: int, seed: int, *, drift: float = 0.0, each: bool = True) -> list[Pass]:
    """Runs there and back whose levels differ by 3 um, `drift` um a run; a number `each` pass, or
    one a run.
    """
    rng, found = np.random.default_rng(seed), []
    for run in range(runs):
        level = 3.0 * rng.normal() + drift * run
        for k, way in enumerate((1, -1)):
            line = level + 0.3 * rng.normal() + 0.01 * PLACES + way * LOST_UM / 2
            number = 2 * run + k + 1 if each else run + 1
            errors = line + 0.2 * rng.normal(size=len(PLACES))
            found.append(Pass(number, way, 20.0 * (2 * run + k), errors))
    return found


def written(path: Path, passes: Iterable[Pass], *, clock: bool = False) -> Path:
    """A file of readings."""
    head = "component,position_mm,pass,direction,error,unit"
    lines = [head + ",time_min" * clock]
    for item in passes:
        word = "forward" if item.way > 0 else "reverse"
        for i, (x, e) in enumerate(zip(PLACES, item.errors, strict=True)):
            row = f"dx,{x:g},{item.number},{word},{e:.4f},um"
            lines.append(row + f",{item.start + i:g}" * clock)
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def fit(folder: Path, *files: object, degree: object = 1) -> dict[str, Any]:
    """The report of a fit of one component."""
    text = "schema: mtu/machine/1\nname: one axis\nequations: {Ex: dx}\n"
    text += f"components: {{dx: {{of: x, unit: um, degree: {degree}}}}}\n"
    (folder / "m.yaml").write_text(text, "utf-8")
    return report("fit-components", "-m", "m.yaml", *files, cwd=folder)


def of_dx(found: dict[str, Any]) -> dict[str, Any]:
    component: dict[str, Any] = found["results"]["components"]["dx"]
    return component


def codes(found: dict[str, Any]) -> set[str]:
    return {item["code"] for item in found["warnings"]}


@pytest.mark.parametrize("missing", [1, 2, 5, 6])
def test_a_missing_pass_leaves_its_fellow_alone(missing: int, tmp_path: Path) -> None:
    """The other runs stay as they were: the scatter of runs and of directions is not mixed."""
    passes = made(8, 1)
    whole = of_dx(fit(tmp_path, "--lbb", written(tmp_path / "a.csv", passes)))
    left = [item for item in passes if item.number != missing]
    found = of_dx(fit(tmp_path, "--lbb", written(tmp_path / "b.csv", left)))
    assert found["passes_read"] == 15
    halves = [own["half_difference_mean_square"][0][0] for own in (whole, found)]
    assert halves[1] == pytest.approx(halves[0], rel=0.5)
    u = [np.sqrt(own["covariance"][0][0]) for own in (whole, found)]
    assert u[1] == pytest.approx(u[0], rel=0.3)


def test_the_order_of_files_does_not_decide_on_a_drift(tmp_path: Path) -> None:
    passes = made(8, 2, drift=3.0)
    early = written(tmp_path / "early.csv", passes[:8], clock=True)
    late = written(tmp_path / "late.csv", passes[8:], clock=True)
    orders = [(early, late), (late, early)]
    found = [fit(tmp_path, "--lbb", a, "--lbb", b) for a, b in orders]
    assert ["passes-drift" in codes(each) for each in found] == [True, True]
    assert of_dx(found[0])["trend"] == pytest.approx(of_dx(found[1])["trend"])


@pytest.mark.parametrize("way", [1, -1])
def test_an_instrument_that_ran_one_way_reads_the_same_axis(way: int, tmp_path: Path) -> None:
    """Its line is half of the reversal away, as the other instrument knows."""
    both = made(8, 3, each=False)
    alone = [item for item in made(8, 4, each=False) if item.way == way]
    lbb, laser = (written(tmp_path / f"{i}.csv", own) for i, own in enumerate((both, alone)))
    found = fit(tmp_path, "--lbb", lbb, "--laser", laser)
    assert "instruments-disagree" not in codes(found)
    dx = of_dx(found)
    assert dx["agreement_p"] > 0.05
    level, u = dx["coefficients"][0], np.sqrt(dx["covariance"][0][0])
    assert abs(level) < 2.5 * u
    (separate,) = (x for x in dx["instruments"] if x["role"] == "laser")
    assert separate["coefficients"][0] == pytest.approx(way * LOST_UM / 2, abs=3.0)


def test_two_instruments_choose_one_degree(tmp_path: Path) -> None:
    files = [written(tmp_path / f"{i}.csv", made(5, i, each=False)) for i in (5, 6)]
    found = of_dx(fit(tmp_path, "--lbb", files[0], "--laser", files[1], degree="auto"))
    assert found["degree"] == 1
    assert [own["n"] for own in found["instruments"]] == [100, 100]


def test_the_component_that_was_read_apart_is_named_alone(tmp_path: Path) -> None:
    """Not the others, whose passes are the same."""
    lines = (CONFIGS.parent / "data" / "undeclared" / "lbb.csv").read_text("utf-8").splitlines()
    left = [line for line in lines if not line.startswith("dx_x") or ",2,reverse," not in line]
    (tmp_path / "lbb.csv").write_text("\n".join(left), "utf-8")
    machine = CONFIGS / "undeclared" / "machine.yaml"
    found = report("fit-components", "-m", machine, "--lbb", "lbb.csv", cwd=tmp_path)
    what = "correlation of drift with other components"
    open_ = [
        x["component"] for x in found["results"]["observability"] if x["not_determined"] == what
    ]
    assert open_ == ["dx_x", "axy"]


@pytest.mark.parametrize("numbered", [True, False], ids=["one pass", "no pass column"])
def test_a_single_pass_tells_no_effect_from_its_scatter(numbered: bool, tmp_path: Path) -> None:
    """What moves a whole pass is not tested; what bends it is, and is not there."""
    fit(tmp_path, "--lbb", written(tmp_path / "r.csv", made(5, 1)))
    file = written(tmp_path / "one.csv", made(1 if numbered else 5, 2, each=False))
    if not numbered:
        rows = [line.split(",") for line in file.read_text("utf-8").splitlines()]
        file.write_text("\n".join(",".join(r[:2] + r[3:]) for r in rows) + "\n", "utf-8")
    results = report("close-loop", "-m", "m.yaml", "--lbb", file, cwd=tmp_path)["results"]
    assert results["verdict"] == "none"
    tested = {item["name"]: item["p_familywise"] for item in results["candidates"]}
    assert tested["backlash-x"] is None
    assert tested["scale-x"] is None
    assert tested["curvature-x"] > 0.05
