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


def test_an_axis_written_from_the_drawing_is_told(folder: Path) -> None:
    """Along z every part is perfect, and a machine would be judged by that."""

    def nominal(column: str, cell: str) -> tuple[str, str]:
        return column, cell if column != "z_mm" or cell == column else f"{round(float(cell)):d}.000"

    points = written(folder, "drawn.csv", nominal)
    told = done(mtu("compare", *FILES, "--cmm", points, cwd=folder)).stderr
    count = len((folder / points).read_text().splitlines()) - 1
    assert f"z of all points as the drawing (rows 2 to {count + 1})" in told
    assert told.count("[copied-values]") == 1
    plain = done(mtu("compare", *FILES, "--cmm", "cmm.csv", cwd=folder)).stderr
    assert "copied-values" not in plain
