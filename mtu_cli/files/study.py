"""Study files (``mtu/study/1``): which files belong together, and the settings of their runs."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from mtu_cli.files.contract import (
    Contract,
    Faults,
    Loaded,
    Name,
    NonNegative,
    Positive,
    check_contract,
    one_or_more,
    optional,
    present,
)
from mtu_cli.files.machine import UnitName
from mtu_cli.files.source import near_name, resolved, same
from mtu_cli.files.yaml_file import read_yaml

STUDY_NAME = "mtu.yaml"
FROM_HERE = "a path from the folder of the study, or a whole one"
FILES = ("machine", "part", "components", "lbb", "laser", "cmm", "drift")
MAX_COVERAGE = 100.0
MAX_TRIALS = 10_000_000_000
"""Ten thousand million: an hour of Monte Carlo. More is a slip of the keyboard."""
MAX_DIGITS = 4

Datum = Literal["none", "offset", "offset,rotation", "offset,diameter"]
"""Best-fit alignment that may be removed from each part; of a ring its centre and diameter."""
Share = Annotated[float, Field(gt=0, lt=1)]
CoverageFactor = Annotated[float, Field(gt=0, lt=MAX_COVERAGE)]
FileName = Annotated[str, Field(min_length=1)]
FileNames = Annotated[list[FileName], one_or_more(str)]


class Instrument(Contract):
    """An instrument's file, and what it leaves open."""

    file: FileName
    component: Name | None = optional("The component that it reads")
    unit: UnitName | None = optional("Unit of readings without one")
    decimal: Literal[".", ","] | None = optional("Decimal sign, where the file leaves it open")
    directions: Literal["alternate", "forward", "reverse"] | None = optional(
        "Directions of runs, where the file leaves them open"
    )
    map: FileName | None = optional("Mapping profile (mtu/import/1)")


InstrumentFiles = Annotated[list[FileName | Instrument], one_or_more(str | Instrument, str, dict)]


class Settings(Contract):
    """Settings of the commands; options on the command line override them."""

    coverage_factor: CoverageFactor | None = optional("k of U = k u")
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
    alpha: Annotated[float, Field(ge=0.001, lt=1)] | None = optional(
        "Family-wise rate of close-loop"
    )
    datum: Datum | None = optional("Best-fit alignment removed from each part")
    max_effects: Annotated[int, Field(ge=1)] | None = optional("Causes that close-loop may add")
    zeroed: Literal["auto", "cycle", "never"] | None = optional(
        "Whether the drift probe was zeroed in every cycle"
    )
    threads: Annotated[int, Field(ge=1, le=1024)] | None = optional("Threads of Monte Carlo")


class InstrumentBudget(Contract):
    """What is known of the instrument of a positioning test, by ISO/TR 230-9."""

    device_U_um_per_m: NonNegative = optional("Expanded uncertainty of the device", 0.0)  # noqa: N815
    k: Positive = optional("Coverage factor of device_U_um_per_m", 2.0)
    alignment_mm: NonNegative = optional("Lateral offset of the beam over the travel", 0.0)
    T_half_width_K: NonNegative = optional("Half-width of the material temperature", 0.0)
    T_mean_degC: Annotated[float, Field(ge=-60, le=150)] = optional(  # unit
        "Material temperature during the test", 20.0
    )
    alpha_um_per_m_K: NonNegative | None = optional("Expansion coefficient of the axis")  # noqa: N815
    alpha_half_width: NonNegative = optional("Its half-width, um/(m K)", 0.0)
    E_VE_um: NonNegative = optional("Range of the drift test (environment)", 0.0)
    already_at_20: bool | None = optional(
        "Whether the readings are corrected to 20 degC already; false: mtu corrects them"
    )

    def check(self, faults: Faults) -> None:
        """A temperature says nothing without the expansion; nobody corrects to 20 degC twice."""
        warm = self.T_mean_degC != 20.0
        if (warm or self.T_half_width_K) and self.alpha_um_per_m_K is None:
            expected = "the expansion coefficient, um/(m K)"
            faults.add("missing-key", key="alpha_um_per_m_K", expected=expected)
        if warm and self.already_at_20 is None:
            expected = "true where the instrument has corrected the readings to 20 degC, else false"
            faults.add("missing-key", key="already_at_20", expected=expected)


class Study(Contract):
    """Files that belong together, relative to the study file."""

    schema_: Literal["mtu/study/1"] = Field(alias="schema")
    name: Name | None = None
    says: str | None = optional("What it is, in words")
    notes: str | None = optional("Free text")
    machine: FileName | None = optional("Machine YAML")
    part: FileName | None = optional("Part YAML")
    components: FileNames = optional("Reports of fit-components and thermal-fit", [])
    lbb: InstrumentFiles = optional("Readings of the laser ball bar", [])
    laser: InstrumentFiles = optional("Readings of the laser interferometer", [])
    cmm: InstrumentFiles = optional("Measured points", [])
    drift: InstrumentFiles = optional("Readings of the thermal drift test", [])
    budget: InstrumentBudget | None = optional("The instrument of a positioning test")
    settings: Settings = optional("Settings of the commands", Settings())


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedStudy(Loaded):
    """A checked study; `files` gives the paths of each role, in order (none: no entry), and
    `instruments` what it says of some of them.
    """

    study: Study
    files: dict[str, tuple[Path, ...]]
    instruments: dict[Path, Instrument] = field(default_factory=dict)


def find_study(start: Path) -> Path | None:
    """The ``mtu.yaml`` of the folder `start` or of the nearest folder above it."""
    places = (folder / STUDY_NAME for folder in (start, *resolved(start).parents))
    return next(filter(Path.is_file, places), None)


def load_study(
    path: Path, role: str = "study", *, absent: Collection[Path] | None = None
) -> LoadedStudy:
    """Reads and checks a study file; the files that it names must be there, but for those that may
    be `absent` (None: any of them).

    Raises InputError with all faults of the file, each with its line.
    """
    document = read_yaml(path, role)
    folder = path.parent
    files: dict[str, tuple[Path, ...]] = {}
    instruments: dict[Path, Instrument] = {}

    def check(study: Study, faults: Faults) -> None:
        for key in FILES:
            entry = getattr(study, key)
            items = present(entry if isinstance(entry, list) else [entry])
            instruments.update((folder / x.file, x) for _, x in items if isinstance(x, Instrument))
            names = [(i, x.file if isinstance(x, Instrument) else x) for i, x in items]
            if names:
                files[key] = tuple(folder / name for _, name in names)
            for i, name in names:
                file, exceptions = folder / name, absent or ()
                is_needed = absent is not None and not any(same(file, item) for item in exceptions)
                if is_needed and not file.exists():
                    facts = {"value": name, "meant": near_name(file), "expected": FROM_HERE}
                    faults.at(key, i).add("no-such-file", **facts)
            faults.at(key).once(names, "the file")

    study = check_contract(document, Study, "study", check)
    return LoadedStudy(document=document, study=study, files=files, instruments=instruments)
