"""Study files (``mtu/study/1``): which files belong together, and the settings of their runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from mtu_cli.files.contract import (
    Contract,
    Faults,
    Loaded,
    Name,
    check_contract,
    optional,
    present,
    short,
)
from mtu_cli.files.source import file_fault, resolved, same
from mtu_cli.files.yaml_file import read_yaml

STUDY_NAME = "mtu.yaml"
SINGLE = ("machine", "part")
SEVERAL = ("components", "lbb", "laser", "cmm", "drift")

FROM_HERE = "a path from the folder of the file that names it, or a whole one"
MAX_COVERAGE = 100.0
MAX_TRIALS = 10_000_000_000
"""Ten thousand million: an hour of Monte Carlo. More is a slip of the keyboard."""
MAX_DIGITS = 4

Datum = Literal["none", "offset", "offset,rotation", "offset,diameter"]
"""Best-fit alignment that may be removed from each part; of a ring its centre and diameter."""
Share = Annotated[float, Field(gt=0, lt=1)]
FileName = Annotated[str, Field(min_length=1)]
FileNames = Annotated[
    list[FileName],
    short(lambda value: isinstance(value, str), lambda value: [value], str | list[str]),
]


class Settings(Contract):
    """Settings of the commands; options on the command line override them."""

    coverage_factor: Annotated[float, Field(gt=0, lt=MAX_COVERAGE)] | None = optional(
        "k of U = k u"
    )
    seed: Annotated[int, Field(ge=0)] | None = optional("Seed of Monte Carlo")
    correlation: Literal["shared", "independent"] | None = optional(
        "Points of a part share components, or stand alone as in the papers"
    )
    trials: Annotated[int, Field(ge=1000, le=MAX_TRIALS)] | None = optional(
        "Monte Carlo trials; adaptive without it"
    )
    digits: Annotated[int, Field(ge=1, le=MAX_DIGITS)] | None = optional(
        "Significant digits of u that adaptive Monte Carlo makes sure of"
    )
    probability: Share | None = optional("Coverage probability")
    alpha: Share | None = optional("Family-wise rate of close-loop")
    datum: Datum | None = optional("Best-fit alignment removed from each part")
    max_effects: Annotated[int, Field(ge=1)] | None = optional("Causes that close-loop may add")
    zeroed: Literal["auto", "cycle", "never"] | None = optional(
        "Whether the drift probe was zeroed in every cycle"
    )
    threads: Annotated[int, Field(ge=1, le=1024)] | None = optional("Threads of Monte Carlo")


class Study(Contract):
    """Files that belong together, relative to the study file."""

    schema_: Literal["mtu/study/1"] = Field(alias="schema")
    name: Name | None = None
    says: str | None = optional("What it is, in words")
    notes: str | None = optional("Free text")
    machine: FileName | None = optional("Machine YAML")
    part: FileName | None = optional("Part YAML")
    components: FileNames = optional("Reports of fit-components and thermal-fit", [])
    lbb: FileNames = optional("Readings of the laser ball bar", [])
    laser: FileNames = optional("Readings of the laser interferometer", [])
    cmm: FileNames = optional("Measured points", [])
    drift: FileNames = optional("Readings of the thermal drift test", [])
    settings: Settings = optional("Settings of the commands", Settings())


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedStudy(Loaded):
    """A checked study; `files` gives the paths of each role, in order (none: no entry)."""

    study: Study
    files: dict[str, tuple[Path, ...]]


def find_study(start: Path) -> Path | None:
    """The ``mtu.yaml`` of the folder `start` or of the nearest folder above it."""
    for folder in (start, *resolved(start).parents):
        candidate = folder / STUDY_NAME
        if candidate.is_file():
            return candidate
    return None


def load_study(
    path: Path, role: str = "study", *, there: bool = True, made: Mapping[str, Path] | None = None
) -> LoadedStudy:
    """Reads and checks a study file; the files that it names must be `there`, but for those that
    are `made` (by their role): what a call writes it does not read.

    Raises InputError with all faults of the file, each with its line.
    """
    document = read_yaml(path, role)
    folder = path.parent
    files: dict[str, tuple[Path, ...]] = {}

    def check(study: Study, faults: Faults) -> None:
        for key in (*SINGLE, *SEVERAL):
            given = getattr(study, key)
            names = present(given) if key in SEVERAL else [(0, given)] if given else []
            new = (made or {}).get(key)
            names = [(i, name) for i, name in names if new is None or not same(folder / name, new)]
            if names:
                files[key] = tuple(folder / name for _, name in names)
            for index, name in names if there else ():
                if fault := file_fault(folder / name, key, name, FROM_HERE, value=name):
                    faults.extend((key, index), [fault])
            faults.once((key,), names, "the file")

    study = check_contract(document, Study, "study", check)
    return LoadedStudy(source=document.source, study=study, files=files, document=document)
