"""Points that are not what a command takes them for: the same words from every command."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from cli_runner import done, mtu

MACHINE = """\
schema: mtu/machine/1
name: three axes
components:
  px: {of: x, unit: um, coefficients: [2, -0.02], u_future: 0.5}
  py: {of: y, unit: um, coefficients: [1, 0.03], u_future: 0.5}
  pz: {of: z, unit: um, coefficients: [0, 0.01], u_future: 0.5}
equations: {Ex: px, Ey: py, Ez: pz}
"""
PART = """\
schema: mtu/part/1
name: two steps
features:
  a: {x_mm: 20, y_mm: 10, z_mm: 0}
  b: {x_mm: 220, y_mm: 10, z_mm: 0}
  c: {x_mm: 220, y_mm: 150, z_mm: 40}
  d: {x_mm: 20, y_mm: 150, z_mm: 40}
  e: {x_mm: 120, y_mm: 80, z_mm: 40}
"""
FILES = ("-m", "machine.yaml", "-p", "part.yaml")
COMMANDS = ("compare", "correct")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six parts of a machine with three axes."""
    work = tmp_path_factory.mktemp("odds")
    (work / "machine.yaml").write_text(MACHINE)
    (work / "part.yaml").write_text(PART)
    done(mtu("simulate", *FILES, "--parts", "6", "--write-cmm", "cmm.csv", cwd=work))
    return work


def written(folder: Path, name: str, changed: Callable[[str, str], tuple[str, str]]) -> str:
    """The points with every (column, cell) changed; the header is changed with its own name."""
    lines = [x for x in (folder / "cmm.csv").read_text().splitlines() if not x.startswith("#")]
    header = lines[0].split(",")
    names = [changed(column, column)[0] for column in header]
    rows = [
        [changed(*pair)[1] for pair in zip(header, line.split(","), strict=True)]
        for line in lines[1:]
    ]
    (folder / name).write_text("\n".join(",".join(row) for row in [names, *rows]) + "\n")
    return name


@pytest.mark.parametrize("command", COMMANDS)
def test_an_axis_under_another_name_is_told(folder: Path, command: str) -> None:
    """Nothing is judged along z: not without a word."""
    points = written(folder, "zz.csv", lambda c, cell: ("zz_mm" if c == "z_mm" else c, cell))
    found = done(mtu(command, *FILES, "--cmm", points, "-q", cwd=folder))
    told = [line for line in found.stderr.splitlines() if line.endswith("[axis-not-measured]")]
    assert len(told) == 1
    assert "z_mm" in told[0]


def test_points_in_metres_are_refused_alike(folder: Path) -> None:
    """Their error is no machine's: nothing may be written into a machine, or said of a part."""

    def in_metres(column: str, cell: str) -> tuple[str, str]:
        if column not in ("x_mm", "y_mm", "z_mm") or cell == column:
            return column, cell
        return column, f"{float(cell) / 1000:.9f}"

    points = written(folder, "metres.csv", in_metres)
    found = [
        done(mtu(command, *FILES, "--cmm", points, "-o", "out.json", cwd=folder), 2).stderr
        for command in ("close-loop", "correct")
    ]
    assert found[0] == found[1]
    assert found[0].startswith("mtu: metres.csv, row 2: the points are typically 149.")
    assert "in metres, not mm (rows 2 to 61)" in found[0]
    assert not (folder / "out.json").exists()


@pytest.mark.parametrize("command", [*COMMANDS, "anova"])
def test_an_axis_written_from_the_drawing_is_told(folder: Path, command: str) -> None:
    """Along z every part is perfect, and a machine would be judged by that."""

    def nominal(column: str, cell: str) -> tuple[str, str]:
        return column, cell if column != "z_mm" or cell == column else f"{round(float(cell)):d}.000"

    points = written(folder, "drawn.csv", nominal)
    files = FILES if command != "anova" else FILES[2:]
    told = done(mtu(command, *files, "--cmm", points, cwd=folder)).stderr
    count = len((folder / points).read_text().splitlines()) - 1
    assert f"z of all points as the drawing (rows 2 to {count + 1})" in told
    assert told.count("[copied-values]") == 1
    plain = done(mtu(command, *files, "--cmm", "cmm.csv", cwd=folder)).stderr
    assert "copied-values" not in plain
