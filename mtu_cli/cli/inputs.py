"""What a call names on the command line or in its study, read when it is needed."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast

from mtu_cli.cli.option_values import no_number
from mtu_cli.cli.options import Options
from mtu_cli.files.covariates import DIRECTIONS, direction_sign
from mtu_cli.files.csv_table import cell_text
from mtu_cli.files.study import LoadedStudy, find_study, load_study
from mtu_cli.findings import Finding, InputError, error, finding, suggestion
from mtu_cli.model.datum import DATUMS, Datum

if TYPE_CHECKING:
    from mtu_cli.checks import Data
    from mtu_cli.files.machine import LoadedMachine
    from mtu_cli.files.part import LoadedPart
    from mtu_cli.files.points import Points
    from mtu_cli.files.readings import Readings
    from mtu_cli.files.reports_read import ComponentsReport, ModelReports, ThermalReport
    from mtu_cli.files.source import Source

T = TypeVar("T")
Kind = Literal["machine", "part", "reports", "readings", "drift", "points"]
OF_ANY_MACHINE = ("anova",)
"""Commands that look at parts alone: wherever those were made, the machine is not read."""


@dataclass
class Inputs:
    """The files of one call. Options override the study; a study is looked for (mtu.yaml in
    this folder or above) only where neither STUDY nor -m is given.
    """

    options: Options
    sources: list[Source] = field(default_factory=list)
    suspicions: list[Finding] = field(default_factory=list)
    """What the checks warn of, of all that was read so far."""

    @cached_property
    def study(self) -> LoadedStudy | None:
        """The study of the call, if it has one."""
        path: Path | None = self.options.study
        if path is None and self.options.machine is not None:
            return None
        if path is not None and path.is_dir():
            path = path / "mtu.yaml"
        if path is None:
            path = find_study(Path())
        if path is None:
            return None
        study = load_study(path)
        self.sources.append(study.source)
        return study

    def files(self, role: str) -> tuple[Path, ...]:
        """The files of a role: the option's where it is given, else the study's."""
        given = self.options.values.get(role)
        if given:
            return tuple(given) if isinstance(given, list) else (given,)
        return self.study.files.get(role, ()) if self.study else ()

    def only(self, role: str, option: str) -> Path:
        """The one file of a role that the command cannot do without."""
        found = self.files(role)
        if not found:
            raise error(
                "no-input",
                role=f"{role} file",
                expected=f"{option} FILE, or a study that names one ({self.without(role)})",
            )
        return found[0]

    def without(self, *roles: str) -> str:
        """Why no study names a file of these roles."""
        if self.study:
            return f"{self.study.source.shown} has no {' or '.join(map(repr, roles))}"
        if self.options.machine is None:
            return "no study"
        return "with -m and no STUDY none is looked for"

    @property
    def names(self) -> list[str]:
        """What the files of the call call themselves: machine, part, study; at least one."""
        read = self.__dict__
        found = [read[kind].machine.name for kind in ("machine",) if kind in read]
        found += [read[kind].part.name for kind in ("part",) if kind in read]
        found += [self.study.source.shown] if self.study else []
        return found or [source.shown for source in self.sources]

    @property
    def made_here(self) -> bool:
        """Whether part and points are those of the machine, beyond whose travels they cannot be."""
        return self.options.command not in OF_ANY_MACHINE

    @cached_property
    def machine(self) -> LoadedMachine:
        """The machine file."""
        from mtu_cli.files.machine import load_machine

        return self.taken("machine", load_machine(self.only("machine", "-m")))

    @cached_property
    def part(self) -> LoadedPart:
        """The part file."""
        from mtu_cli.files.part import load_part

        return self.taken("part", load_part(self.only("part", "-p")))

    @cached_property
    def reports(self) -> ModelReports:
        """The reports of -c, at most one of each kind."""
        from mtu_cli.files.reports_read import read_reports

        return self.taken("reports", read_reports(self.files("components")))

    @property
    def components(self) -> ComponentsReport | None:
        """The fit-components report, if one is given."""
        return self.reports.components

    @property
    def thermal(self) -> ThermalReport | None:
        """The thermal-fit report, if one is given."""
        return self.reports.thermal

    @cached_property
    def readings(self) -> Readings | None:
        """The ball-bar and laser readings, checked for a fit; None where there are none."""
        files = [(path, role) for role in ("lbb", "laser") for path in self.files(role)]
        if not files:
            return None
        from mtu_cli.files.readings import read_readings

        components = self.machine.machine.components
        return self.taken("readings", read_readings(files, components, for_fit=True))

    @cached_property
    def drift(self) -> Readings:
        """The drift readings."""
        from mtu_cli.files.readings import read_readings

        files = [(path, "drift") for path in self.files("drift")]
        components = self.machine.machine.components if self.files("machine") else None
        return self.taken("drift", read_readings(files, components, for_fit=False))

    def taken(self, name: Kind, item: T) -> T:
        """The `item` of one kind of input, read by now, with its files and what the checks warn of.

        Raises InputError for what makes a result meaningless.
        """
        self.__dict__[name] = item
        known: Any = item
        self.sources.extend(known.sources if hasattr(known, "sources") else (known.source,))
        if name == "reports":
            return item
        from mtu_cli import checks

        machine = self.machine.machine if self.files("machine") and self.made_here else None
        travels = machine.travels if machine else {}
        data: Data
        match name:
            case "machine" | "part":
                data = checks.DocumentData(known, travels)
            case "points":
                part = self.part if self.files("part") else None
                data = checks.PointsData(known, part, travels, self.datum)
            case _:
                data = checks.ReadingsData(known, machine.components if machine else {}, travels)
        self.suspicions += checks.warnings_of(name, data)
        return item

    @property
    def datum(self) -> Datum:
        """The datum of the call: the option over the study over none.

        Raises InputError for a datum that is not known.
        """
        study = self.study.study.settings if self.study else None
        datum = self.options.values.get("datum") or (study.datum if study else None) or "none"
        if datum not in DATUMS:
            raise error("unknown-name", what="datum", value=datum, **suggestion(datum, DATUMS))
        return cast("Datum", datum)

    @cached_property
    def points(self) -> Points:
        """The measured points; nominals from the part file if there is one, else their own."""
        from mtu_cli.files.points import read_points

        files = self.files("cmm")
        if not files:
            self.only("cmm", "--cmm")
        places = self.part.part.places() if self.files("part") else None
        return self.taken("points", read_points([(path, "cmm") for path in files], places))

    @cached_property
    def at(self) -> dict[str, float]:
        """The covariates given with --at."""
        found: dict[str, float] = {}
        problems: list[Finding] = []
        for text in self.options.at or ():
            name, equals, value = (part.strip() for part in text.partition("="))
            if not (equals and name and name.isprintable() and value):
                expected = "--at T_02_degC=23.5, say"
                form = "NAME=VALUE"
                problems.append(
                    finding("option-form", path="--at", form=form, value=text, expected=expected)
                )
                continue
            if name.startswith("dir_") and (sign := direction_sign(value)) is not None:
                value = str(sign)
            if bad := no_number(f"--at {name}", value):
                problems.append(bad)
                continue
            if name in found:
                problems.append(finding("appears-twice", what=f"--at {name}", value=text))
            problems += unlike_cells(name, float(value))
            found[name] = float(value)
        if problems:
            raise InputError(problems)
        return found


def unlike_cells(name: str, value: float) -> list[Finding]:
    """The finding, if there is one, of a value that no cell of its column may have: a direction
    that is neither forth nor back, or a broken count.
    """
    place = {"path": f"--at {name}", "value": cell_text(value)}
    if name in DIRECTIONS and abs(value) != 1.0:
        return [finding("out-of-range", **place, expected="-1 or +1")]
    if name == "sequence" and isfinite(value) and value != int(value):
        return [finding("not-a-whole-number", **place)]
    return []
