"""Study files (``mtu/study/1``): which files belong together, and the settings of their runs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from mtu_cli.files.contract import Contract, Faults, check_contract
from mtu_cli.files.source import Source, missing_file, resolved
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, read_yaml

STUDY_NAME = "mtu.yaml"
SINGLE = ("machine", "part")
SEVERAL = ("components", "lbb", "laser", "cmm", "drift")

MAX_COVERAGE = 100.0
MIN_TRIALS = 1000
MAX_TRIALS = 10_000_000_000
"""Ten thousand million: an hour of Monte Carlo. More is a slip of the keyboard."""
MAX_DIGITS = 4
MAX_THREADS = 1024

Share = Annotated[float, Field(gt=0, lt=1)]
Count = Annotated[int, Field(ge=1)]


def _listed(value: object) -> object:
    return [value] if isinstance(value, str) else value


FileName = Annotated[str, Field(min_length=1)]
FileNames = Annotated[
    list[FileName], BeforeValidator(_listed, json_schema_input_type=str | list[str])
]


class Settings(Contract):
    """Settings of the commands; options on the command line override them."""

    coverage_factor: Annotated[float, Field(gt=0, lt=MAX_COVERAGE)] | None = Field(
        default=None, description="k of U = k u"
    )
    seed: Annotated[int, Field(ge=0)] | None = Field(
        default=None, description="Seed of Monte Carlo"
    )
    correlation: Literal["shared", "independent"] | None = Field(
        default=None,
        description="Points of a part share components, or stand alone as in the papers",
    )
    trials: Annotated[int, Field(ge=MIN_TRIALS, le=MAX_TRIALS)] | None = Field(
        default=None, description="Monte Carlo trials; adaptive without it"
    )
    digits: Annotated[int, Field(ge=1, le=MAX_DIGITS)] | None = Field(
        default=None, description="Significant digits of u that adaptive Monte Carlo makes sure of"
    )
    probability: Share | None = Field(default=None, description="Coverage probability")
    alpha: Share | None = Field(default=None, description="Family-wise rate of close-loop")
    datum: Literal["none", "offset", "offset,rotation"] | None = Field(
        default=None, description="Freedoms of the part coordinate system"
    )
    max_effects: Count | None = Field(default=None, description="Causes that close-loop may add")
    threads: Annotated[int, Field(ge=1, le=MAX_THREADS)] | None = Field(
        default=None, description="Threads of Monte Carlo"
    )


class Study(Contract):
    """Files that belong together, relative to the study file."""

    schema_: Literal["mtu/study/1"] = Field(alias="schema")
    name: str | None = None
    says: str | None = Field(default=None, description="What it is, in words")
    notes: str | None = Field(default=None, description="Free text")
    machine: FileName | None = Field(default=None, description="Machine YAML")
    part: FileName | None = Field(default=None, description="Part YAML")
    components: FileNames = Field(
        default=[], description="Reports of fit-components and thermal-fit"
    )
    lbb: FileNames = Field(default=[], description="Readings of the laser ball bar")
    laser: FileNames = Field(default=[], description="Readings of the laser interferometer")
    cmm: FileNames = Field(default=[], description="Measured points")
    drift: FileNames = Field(default=[], description="Readings of the thermal drift test")
    settings: Settings = Field(default=Settings(), description="Settings of the commands")


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedStudy:
    """A checked study; `files` gives the paths of each role, in order (none: no entry)."""

    source: Source
    study: Study
    files: dict[str, tuple[Path, ...]]
    document: YamlDocument

    def line_of(self, *path: str | int) -> int | None:
        """The line of a value of the file."""
        return self.document.line_of(*path)


def find_study(start: Path) -> Path | None:
    """The ``mtu.yaml`` of the folder `start` or of the nearest folder above it."""
    for folder in (start, *resolved(start).parents):
        candidate = folder / STUDY_NAME
        if candidate.is_file():
            return candidate
    return None


def load_study(path: Path, role: str = "study", *, there: bool = True) -> LoadedStudy:
    """Reads and checks a study file; the files that it names must be `there`.

    Raises InputError with all faults of the file, each with its line.
    """
    document = read_yaml(path, role)
    folder = path.parent

    def check(study: Study, faults: Faults) -> None:
        for _, place, name in _named(study):
            if there and (missing := missing_file(folder, name)):
                faults.extend(faults.existing(place), [missing])
        for key in SEVERAL:
            names = [(index, name) for index, name in enumerate(getattr(study, key) or ()) if name]
            faults.once((key,), names, "the file")

    study = check_contract(document, Study, "study", check)
    files: dict[str, tuple[Path, ...]] = {}
    for key, _, name in _named(study):
        files[key] = (*files.get(key, ()), folder / name)
    return LoadedStudy(source=document.source, study=study, files=files, document=document)


def _named(study: Study) -> list[tuple[str, YamlPath, str]]:
    named: list[tuple[str, YamlPath, str]]
    named = [(key, (key,), getattr(study, key)) for key in SINGLE if getattr(study, key)]
    for key in SEVERAL:
        names = enumerate(getattr(study, key) or ())
        named += [(key, (key, index), name) for index, name in names if name]
    return named
