"""Folders of input, over a copy of `valid/small`: `call.txt` holds the arguments of a call.

valid: `expected.txt` stands in what is said. invalid: every fault of a file at once, in one line
each, nothing written; each line holds that of `expected.txt`. suspicious (alone, not over another):
a warning of the checks begins so, and the run goes on.
"""

import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli_runner import HERE, INVALID, VALID, done, machine_file, mtu, prepared, refused, report
from support import CONFIGS


def folders(kind: Path) -> list[Path]:
    return sorted(path for path in kind.iterdir() if (path / "call.txt").exists())


def call_of(folder: Path) -> tuple[list[str], list[str]]:
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


# Readings of which a component, or a pass, stands alone.


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
    machine_file(tmp_path, "{dx: {of: x, unit: um, degree: 1}}", "{Ex: dx}")
    rng = np.random.default_rng(2)
    rows = ["component,position_mm,direction,error,unit" + ",pass" * numbered]
    for level in 3.0 * rng.normal(size=1 if numbered else 5):
        for way, lost in (("forward", 4.0), ("reverse", -4.0)):
            line = level + lost + 0.3 * rng.normal()
            for x in range(0, 500, 50):
                error = line + 0.01 * x + 0.2 * rng.normal()
                rows.append(f"dx,{x},{way},{error:.4f},um" + ",1" * numbered)
    (tmp_path / "one.csv").write_text("\n".join(rows), "utf-8")
    results = report("close-loop", "-m", "m.yaml", "--lbb", "one.csv", cwd=tmp_path)["results"]
    assert results["verdict"] == "none"
    tested = {item["name"]: item["p_familywise"] for item in results["candidates"]}
    assert tested["backlash-x"] is None
    assert tested["scale-x"] is None
    assert tested["curvature-x"] > 0.05
