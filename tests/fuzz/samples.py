"""The shipped files by what reads them, cut to a size at which thousands are read a minute."""

import re
import shutil
from collections.abc import Callable
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from made_files import FILES as INSTRUMENTS
from made_files import MAP, MAPPED
from support import CONFIGS, DATA

from mtu_cli.cli.main import exit_code
from mtu_cli.formats.control import CONTROLLERS
from mtu_cli.formats.control.errors import ErrorTable
from mtu_cli.model.effect_library import BUILT_IN

Kind = Literal[
    "readings", "drift", "points", "machine", "part", "study", "effects", "budget", "graph",
    "components", "thermal", "instrument", "control", "map",
]  # fmt: skip
KINDS: tuple[Kind, ...] = get_args(Kind)


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


MILL, RING, PAPER = "configs/undeclared", "configs/valdes-ring", "configs/gilsinn-ling"
FILES: dict[Kind, dict[str, str | None]] = {
    "readings": {
        "data/undeclared/lbb.csv": f"{MILL}/machine.yaml",
        "data/gilsinn-ling-simulated/lbb.csv": f"{PAPER}-simulated/machine.yaml",
        "data/gilsinn-ling/axis_angle.csv": f"{PAPER}/machine.yaml",
        "data/valdes-ring/laser.csv": f"{RING}/machine.yaml",
        "data/valdes-ring/printed_diameters.csv": f"{RING}/diameter.yaml",
    },
    "drift": {"data/valdes-ring/drift.csv": f"{RING}/machine.yaml"},
    "points": {
        "data/undeclared/cmm.csv": f"{MILL}/part.yaml",
        "data/gilsinn-ling-parts/drilled.csv": f"{PAPER}/part.yaml",
        "data/gilsinn-ling-parts/milled.csv": f"{PAPER}/part.yaml",
        "data/valdes-ring/ring.csv": f"{RING}/part.yaml",
        "data/undeclared/nominals.csv": None,
    },
    "effects": dict.fromkeys(("effects/all.yaml", "effects/few.yaml")),
    "components": dict.fromkeys(("mill.json", "ring.json")),
    "thermal": dict.fromkeys(("drift.json",)),
    "instrument": dict.fromkeys(f"instruments/{name}" for name in INSTRUMENTS),
    "control": dict.fromkeys(f"controls/{name}.tab" for name in CONTROLLERS),
    "map": {"maps/any.yaml": "maps/any.txt"},
}
"""With the context of each; the configurations are those that are shipped, by their schema."""
for _path in sorted(CONFIGS.glob("*/*.yaml")):
    if found := re.match(r"schema: mtu/(\w+)/", _path.read_text("utf-8")):
        _kind: Kind = found[1]  # type: ignore[assignment]  # a word of the contract
        FILES.setdefault(_kind, {})[f"configs/{_path.relative_to(CONFIGS).as_posix()}"] = None
KIND_OF = {name: kind for kind, names in FILES.items() for name in names}

Keep = Callable[[dict[str, str]], bool]


def _of(column: str, *values: str) -> Keep:
    return lambda row: row[column] in values


def _first_passes(row: dict[str, str]) -> bool:
    return row.get("pass", "1") in ("1", "2") and row.get("position_mm", "0") != "50"


CUTS: dict[str, Keep] = {
    "gilsinn-ling-parts/drilled.csv": _of("part", *"12345"),
    "gilsinn-ling-parts/milled.csv": _of("part", *"12345"),
    "gilsinn-ling-simulated/lbb.csv": _first_passes,
    "undeclared/cmm.csv": _of("part", *"12345"),
    "undeclared/lbb.csv": _first_passes,
    "valdes-ring/drift.csv": lambda row: float(row["time_min"]) % 30 == 0,
    "valdes-ring/laser.csv": _first_passes,
    "valdes-ring/ring.csv": _of("part", "1"),
}
LATE_SENSOR = re.compile(r"T_(?:0[7-9]|1\d)_degC")
"""A report of a thermal model grows with the square of the number of sensors: six of them stay."""
FLAT = {
    "machine.yaml": f"{MILL}/machine.yaml", "part.yaml": f"{MILL}/part.yaml",
    "lbb.csv": "data/undeclared/lbb.csv", "cmm.csv": "data/undeclared/cmm.csv",
}  # fmt: skip
FLAT_STUDY = (
    "schema: mtu/study/1\nmachine: machine.yaml\npart: part.yaml\nlbb: [lbb.csv]\n"
    "cmm: [cmm.csv]\nsettings: {coverage_factor: 2, seed: 20040126, correlation: shared}\n"
)
"""Of a study whose files stand beside it."""
KIND_OF |= {f"flat/{name}": KIND_OF[source] for name, source in FLAT.items()}
KIND_OF |= {"flat/mtu.yaml": "study", "maps/any.txt": "instrument"}
REPORTS = {
    "mill.json": f"fit-components {MILL}",
    "ring.json": f"fit-components {RING}",
    "drift.json": f"thermal-fit {RING} --model ridge",
}


@dataclass
class Sheet:
    """A table of texts: its comments, its header, its rows, and how it is written."""

    comments: list[str]
    header: list[str]
    rows: list[list[str]]
    separator: str = ","
    quoted: bool = False

    def text(self) -> str:
        lines = [self.separator.join(map(self._cell, row)) for row in (self.header, *self.rows)]
        return "\n".join([*self.comments, *lines]) + "\n"

    def _cell(self, cell: str) -> str:
        return '"' + cell.replace('"', '""') + '"' if self.quoted else cell


def sheet_of(text: str) -> Sheet:
    """The table of a shipped file, which has plain cells."""
    lines = text.splitlines()
    comments = [line for line in lines if line.startswith("#")]
    header, *rows = [line.split(",") for line in lines if not line.startswith("#")]
    return Sheet(comments, header, rows)


def prepared_folder(folder: Path) -> Path:
    """Shipped configurations, data with fewer rows, effects and reports, under `folder`.

    Raises RuntimeError where a report cannot be made of the sound files.
    """
    shutil.copytree(CONFIGS, folder / "configs", dirs_exist_ok=True)
    pictures = shutil.ignore_patterns("pictures")
    shutil.copytree(DATA, folder / "data", dirs_exist_ok=True, ignore=pictures)
    for name, keep in CUTS.items():
        path = folder / "data" / name
        path.write_text(cut(path.read_text("utf-8"), keep), "utf-8")
    points = folder / "data" / "undeclared" / "cmm.csv"
    points.with_name("nominals.csv").write_text(with_nominals(points.read_text("utf-8")), "utf-8")
    for name in ("effects", "flat", "instruments", "controls", "maps"):
        (folder / name).mkdir(exist_ok=True)
    families = BUILT_IN.read_text("utf-8")
    (folder / "effects" / "all.yaml").write_text(families, "utf-8")
    few = "\n\n".join(families.partition("\neffects:\n")[2].split("\n\n")[2:6])
    few = few.replace("family: ", "family: own-").replace("name: ", "name: own-")
    head = "schema: mtu/effects/1\neffects:\n"
    (folder / "effects" / "few.yaml").write_text(head + few + "\n", "utf-8")
    for name, source in FLAT.items():
        shutil.copyfile(folder / source, folder / "flat" / name)
    (folder / "flat" / "mtu.yaml").write_text(FLAT_STUDY, "utf-8")
    write_foreign(folder)
    for name, call in REPORTS.items():
        with chdir(folder):
            code = exit_code([*call.split(), "-q", "-o", name])
        if code != 0:
            raise RuntimeError(f"mtu {call}: {code}")
    return folder


def write_foreign(folder: Path) -> None:
    """Made files of instruments, tables of controls, and a mapping profile."""
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


def cut(text: str, keep: Keep) -> str:
    """The rows of a table that `keep` wants, without most of its columns of temperatures."""
    sheet = sheet_of(text)
    rows = [row for row in sheet.rows if keep(dict(zip(sheet.header, row, strict=True)))]
    kept = [i for i, name in enumerate(sheet.header) if not LATE_SENSOR.fullmatch(name)]
    sheet.header, *sheet.rows = ([row[i] for i in kept] for row in (sheet.header, *rows))
    return sheet.text()


def with_nominals(text: str) -> str:
    """Points with the nearest whole millimetres as their nominal places."""
    sheet = sheet_of(text)
    places = [sheet.header.index(name) for name in ("x_mm", "y_mm")]
    sheet.header += ["nominal_x_mm", "nominal_y_mm"]
    for row in sheet.rows:
        row += [f"{float(row[index]):.0f}" for index in places]
    return sheet.text()


def sample(folder: Path, name: str, context: str | None = None) -> Sample:
    """A file of a prepared folder."""
    return Sample(
        kind=KIND_OF[name],
        path=folder / name,
        content=(folder / name).read_bytes(),
        context=None if context is None else folder / context,
    )


def samples_of(folder: Path) -> dict[Kind, list[Sample]]:
    """The samples of a prepared folder by kind."""
    return {kind: [sample(folder, *item) for item in FILES[kind].items()] for kind in KINDS}
