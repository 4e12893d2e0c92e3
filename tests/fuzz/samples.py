"""The shipped files by what reads them, cut to a size at which thousands are read a minute."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import dedent
from typing import Literal, get_args

import numpy as np
from made_files import FILES as INSTRUMENTS
from made_files import MAP, MAPPED
from support import CONFIGS, DATA
from watched_process import MTU

from fuzz.table_damage import sheet_of
from mtu_cli.formats.control import CONTROLLERS
from mtu_cli.formats.control.errors import ErrorTable
from mtu_cli.model.effect_library import BUILT_IN

Kind = Literal[
    "readings", "drift", "points", "machine", "part", "study", "effects", "budget", "graph",
    "components", "thermal", "instrument", "control", "map",
]  # fmt: skip
KINDS: tuple[Kind, ...] = get_args(Kind)

Row = dict[str, str]


@dataclass(frozen=True, kw_only=True)
class Sample:
    """A sound file of the work folder and what else its reader is told.

    `context` is the machine of readings and the part of points.
    """

    kind: Kind
    path: Path
    content: bytes
    context: Path | None = None

    @property
    def form(self) -> str:
        """Csv, yaml or json; of files of other programs as they are called."""
        return self.path.suffix.lstrip(".")

    @property
    def structured(self) -> bool:
        """Whether it is a table or a tree of values of ours."""
        return self.kind not in ("instrument", "control")


def _first_passes(row: Row) -> bool:
    return row.get("pass", "1") in ("1", "2") and row.get("position_mm", "0") != "50"


def _first_parts(row: Row) -> bool:
    return row["part"] in ("1", "2", "3", "4", "5")


def _first_part(row: Row) -> bool:
    return row["part"] == "1"


def _every_half_hour(row: Row) -> bool:
    return float(row["time_min"]) % 30 == 0


CUTS: dict[str, Callable[[Row], bool]] = {
    "gilsinn-ling-parts/drilled.csv": _first_parts,
    "gilsinn-ling-parts/milled.csv": _first_parts,
    "gilsinn-ling-simulated/lbb.csv": _first_passes,
    "undeclared/cmm.csv": _first_parts,
    "undeclared/lbb.csv": _first_passes,
    "valdes-ring/drift.csv": _every_half_hour,
    "valdes-ring/laser.csv": _first_passes,
    "valdes-ring/ring.csv": _first_part,
}
FEW_SENSORS = ("valdes-ring/drift.csv",)
"""Tables that keep the first six of their columns of temperatures: a report of a thermal model
grows with the square of them."""
LATE_SENSOR = re.compile(r"T_(?:0[7-9]|1\d)_degC")
FLAT_STUDY = (
    "schema: mtu/study/1\nmachine: machine.yaml\npart: part.yaml\nlbb: [lbb.csv]\n"
    "cmm: [cmm.csv]\nsettings: {coverage_factor: 2, seed: 20040126, correlation: shared}\n"
)
"""Of a study whose files stand beside it."""
REPORTS: dict[str, Sequence[str]] = {
    "mill.json": ("fit-components", "configs/undeclared"),
    "ring.json": ("fit-components", "configs/valdes-ring"),
    "drift.json": ("thermal-fit", "configs/valdes-ring", "--model", "ridge"),
}


def prepared_folder(folder: Path) -> Path:
    """Shipped configurations, data with fewer rows, effects and reports, under `folder`.

    Raises RuntimeError where a report cannot be made of the sound files.
    """
    shutil.copytree(CONFIGS, folder / "configs", dirs_exist_ok=True)
    pictures = shutil.ignore_patterns("pictures")
    shutil.copytree(DATA, folder / "data", dirs_exist_ok=True, ignore=pictures)
    for name, keep in CUTS.items():
        path = folder / "data" / name
        text = cut(path.read_text("utf-8"), keep)
        path.write_text(with_few_sensors(text) if name in FEW_SENSORS else text, "utf-8")
    points = folder / "data" / "undeclared" / "cmm.csv"
    points.with_name("nominals.csv").write_text(with_nominals(points.read_text("utf-8")), "utf-8")
    effects = folder / "configs" / "effects"
    effects.mkdir(exist_ok=True)
    families = BUILT_IN.read_text("utf-8")
    (effects / "all.yaml").write_text(families, "utf-8")
    first = families.index("\neffects:\n") + len("\neffects:\n")
    few = "\n\n".join(families[first:].split("\n\n")[2:6])
    few = few.replace("family: ", "family: own-").replace("name: ", "name: own-")
    (effects / "few.yaml").write_text(dedent(few) + "\n", "utf-8")
    (folder / "flat").mkdir(exist_ok=True)
    (folder / "flat" / "mtu.yaml").write_text(FLAT_STUDY, "utf-8")
    write_foreign(folder)
    for name, call in REPORTS.items():
        done = subprocess.run(
            [MTU, *call, "-q", "-o", name], cwd=folder, capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            raise RuntimeError(f"mtu {' '.join(call)}: {done.stderr}")
    return folder


def write_foreign(folder: Path) -> None:
    """Made files of instruments, tables of controls, a mapping profile, and readings of the moves
    that verify a table.
    """
    for name in ("instruments", "controls", "maps"):
        (folder / name).mkdir(exist_ok=True)
    for name, (_, content) in INSTRUMENTS.items():
        (folder / "instruments" / name).write_bytes(content)
    for name, control in CONTROLLERS.items():
        at = 65.536 * np.arange(9)
        table = ErrorTable.of(at, 1e-4 * at, 1e-4 * at - 2e-3)
        text = control.text(control.zero(table, 0.0), parameters_of(name))
        (folder / "controls" / f"{name}.tab").write_text(text, "utf-8", newline="")
    (folder / "maps" / "any.yaml").write_text(MAP, "utf-8")
    (folder / "maps" / "any.txt").write_text(MAPPED, "utf-8")


def parameters_of(name: str) -> dict[str, str]:
    """Parameters of a control with all that a table needs."""
    known = CONTROLLERS[name].parameters
    given = {"type": "0", "counts_per_mm": "1000"}
    return {**known, **{key: value for key, value in given.items() if key in known}}


def cut(text: str, keep: Callable[[Row], bool]) -> str:
    """The rows of a table that `keep` wants, and all that stands above them."""
    sheet = sheet_of(text)
    sheet.rows = [row for row in sheet.rows if keep(dict(zip(sheet.header, row, strict=True)))]
    return sheet.text()


def with_few_sensors(text: str) -> str:
    """A table without most of its columns of temperatures."""
    sheet = sheet_of(text)
    kept = [i for i, name in enumerate(sheet.header) if not LATE_SENSOR.fullmatch(name)]
    sheet.header = [sheet.header[i] for i in kept]
    sheet.rows = [[row[i] for i in kept] for row in sheet.rows]
    return sheet.text()


def with_nominals(text: str) -> str:
    """Points with the nearest whole millimetres as their nominal places."""
    sheet = sheet_of(text)
    places = [sheet.header.index(name) for name in ("x_mm", "y_mm")]
    sheet.header += ["nominal_x_mm", "nominal_y_mm"]
    for row in sheet.rows:
        row += [f"{float(row[index]):.0f}" for index in places]
    return sheet.text()


MILL, RING = "configs/undeclared", "configs/valdes-ring"
FILES: dict[Kind, dict[str, str | None]] = {
    "readings": {
        "data/undeclared/lbb.csv": f"{MILL}/machine.yaml",
        "data/gilsinn-ling-simulated/lbb.csv": "configs/gilsinn-ling-simulated/machine.yaml",
        "data/gilsinn-ling/axis_angle.csv": "configs/gilsinn-ling/machine.yaml",
        "data/valdes-ring/laser.csv": f"{RING}/machine.yaml",
        "data/valdes-ring/printed_diameters.csv": f"{RING}/diameter.yaml",
    },
    "drift": {"data/valdes-ring/drift.csv": f"{RING}/machine.yaml"},
    "points": {
        "data/undeclared/cmm.csv": f"{MILL}/part.yaml",
        "data/gilsinn-ling-parts/drilled.csv": "configs/gilsinn-ling/part.yaml",
        "data/gilsinn-ling-parts/milled.csv": "configs/gilsinn-ling/part.yaml",
        "data/valdes-ring/ring.csv": f"{RING}/part.yaml",
        "data/undeclared/nominals.csv": None,
    },
    "machine": dict.fromkeys(
        (
            "configs/gilsinn-ling/machine.yaml", "configs/gilsinn-ling-simulated/machine.yaml",
            "configs/gilsinn-ling-simulated/truth.yaml", "configs/gilsinn-ling-parts/truth.yaml",
            f"{MILL}/machine.yaml", f"{MILL}/truth.yaml", f"{RING}/machine.yaml",
            f"{RING}/truth.yaml", f"{RING}/diameter.yaml", "configs/valdes-cmm/machine.yaml",
        )
    ),
    "part": dict.fromkeys(
        ("configs/gilsinn-ling/part.yaml", f"{MILL}/part.yaml", f"{RING}/part.yaml")
    ),
    "study": dict.fromkeys(
        (
            "configs/gilsinn-ling/mtu.yaml", "configs/gilsinn-ling-simulated/mtu.yaml",
            "configs/gilsinn-ling-parts/mtu.yaml", f"{MILL}/mtu.yaml", f"{RING}/mtu.yaml",
            "configs/valdes-cmm/mtu.yaml",
        )
    ),
    "effects": dict.fromkeys(("configs/effects/all.yaml", "configs/effects/few.yaml")),
    "budget": dict.fromkeys(
        (
            "configs/budgets/gum-h1-end-gauge.yaml", "configs/budgets/gum-h2-impedance.yaml",
            "configs/budgets/ring-gauge-diameter.yaml", "configs/budgets/valdes-x275.yaml",
        )
    ),
    "graph": dict.fromkeys(
        (
            "configs/graphs/axes-a-and-c.yaml", "configs/graphs/ball-centre.yaml",
            "configs/graphs/bore-to-bore.yaml", "configs/graphs/rotary-axis-a.yaml",
            "configs/graphs/rotary-axis-c.yaml", "configs/graphs/work-coordinates.yaml",
        )
    ),
    "components": dict.fromkeys(("mill.json", "ring.json")),
    "thermal": dict.fromkeys(("drift.json",)),
    "instrument": dict.fromkeys(f"instruments/{name}" for name in INSTRUMENTS),
    "control": dict.fromkeys(f"controls/{name}.tab" for name in CONTROLLERS),
    "map": {"maps/any.yaml": "maps/any.txt"},
}  # fmt: skip


def samples_of(folder: Path) -> dict[Kind, list[Sample]]:
    """The samples of a prepared folder by kind."""
    return {
        kind: [
            Sample(
                kind=kind,
                path=folder / name,
                content=(folder / name).read_bytes(),
                context=None if context is None else folder / context,
            )
            for name, context in FILES[kind].items()
        ]
        for kind in KINDS
    }
