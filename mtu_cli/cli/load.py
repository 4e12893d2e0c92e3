"""The inputs of a call, of the command line or its study: read once, checked once, when needed."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import ValidationError

from mtu_cli.cli.options import MADE, ROLES, Options
from mtu_cli.cli.values import assignments, number_of
from mtu_cli.files.contract import expectation
from mtu_cli.files.covariates import DIRECTIONS, SENSOR_DEGC, direction_sign, is_temperature
from mtu_cli.files.headers import cell_text
from mtu_cli.files.source import given_path, resolved, same, shown_path
from mtu_cli.files.study import STUDY_NAME, Instrument, LoadedStudy, find_study, load_study
from mtu_cli.files.study import Settings as StudySettings
from mtu_cli.findings import Finding, InputError, error, finding
from mtu_cli.model.settings import Settings

if TYPE_CHECKING:
    from mtu_cli.checks import Data
    from mtu_cli.files.machine import LoadedMachine
    from mtu_cli.files.part import LoadedPart
    from mtu_cli.files.readings import Points, Readings
    from mtu_cli.files.reports_read import ModelReports
    from mtu_cli.files.source import Source
    from mtu_cli.formats.base import Ask

T = TypeVar("T")
KINDS = {
    "machine": ("machine",),
    "part": ("part",),
    "reports": ("components",),
    "readings": ("lbb", "laser"),
    "drift": ("drift",),
    "before": ("before",),
    "verify": ("verify",),
    "points": ("cmm",),
}
"""What is read, by attributes of `Inputs`, and the roles of its files."""
JUDGED_AS: dict[str, Any] = {"before": "readings", "verify": "readings"}
"""Kinds of data that the checks treat as another kind."""
MEASURED = ("lbb", "laser", "drift", "cmm", "before", "verify")
"""Roles whose files may be an instrument's own."""
OPTION_OF = {"coverage_factor": "k"}
"""Options that are not called as the setting of a study."""
OF_ANY_MACHINE = ("anova", "iso230")
"""Commands that look at parts or readings alone: of whatever machine, unless the call names it."""


@dataclass
class Inputs:
    """The files of one call, each read and checked once, when a command asks for it. Options
    override the study; the study of this folder or above is not read where -m or a file of
    another kind is given. `suspicions`: warnings of the checks on the files read so far.
    """

    options: Options
    sources: list[Source] = field(default_factory=list)
    suspicions: list[Finding] = field(default_factory=list)

    @cached_property
    def study(self) -> LoadedStudy | None:
        """The study of the call, if it has one."""
        options, path = self.options, self.study_file
        if path is None or (options.study is None and (options.machine or options.file)):
            return None
        study = load_study(path, absent=self._outputs())
        self.sources.append(study.source)
        return study

    @property
    def study_file(self) -> Path | None:
        """The study that the call names, or else that of this folder, which it may not read."""
        path: Path | None = self.options.study
        if path is None:
            return find_study(Path())
        return path / STUDY_NAME if path.is_dir() else path

    def _paths(self, role: str) -> tuple[Path, ...]:
        """The values of a role's option."""
        value = self.options.values.get(role) or ()
        return tuple(value) if isinstance(value, (list, tuple)) else (value,)

    def call_files(self, role: str) -> tuple[Path, ...]:
        """The files of a role that the options of the call name."""
        paths = self._paths(role)
        return tuple(named_file(path)[1] for path in paths) if role in MEASURED else paths

    def ask_of(self, path: Path, role: str) -> Ask:
        """How to read an instrument's file, by the call, its study and the machine."""
        from mtu_cli.formats.base import Ask
        from mtu_cli.formats.instruments import KIND_OF

        study = self.study
        instrument = (study and study.instruments.get(path)) or Instrument(file="-")
        names = {file: name for name, file in map(named_file, self._paths(role))}
        # Where neither names one, the component of --component.
        components = self.options.values.get("component") or (None,)
        component = names.get(path) or instrument.component or components[0]
        entries = self.machine.machine.components if self.files("machine") else {}
        return Ask(
            kind=KIND_OF[role],
            component=component,
            unit=instrument.unit,
            machine_units={name: entry.unit for name, entry in entries.items()},
            decimal=instrument.decimal,
            directions=instrument.directions,
            profile=study.source.path.parent / instrument.map if study and instrument.map else None,
        )

    def converter(self) -> Any:
        """Reads instruments' files as the contract's CSV; how they were understood is noted."""
        from mtu_cli.formats.base import Imported, RawFile
        from mtu_cli.formats.instruments import converter

        def note(file: RawFile, table: Imported) -> None:
            self.suspicions.append(file.finding("instrument-file", how=table.sentence))
            self.suspicions += [file.finding("instrument-doubt", doubt=x) for x in table.doubts]

        return converter(self.ask_of, note)

    def input_files(self) -> list[tuple[str, Path]]:
        """Role and path of all files that the call, its study or that of this folder names; of a
        faulty study its path alone.
        """
        result = [(role, path) for role in ROLES for path in self.call_files(role)]
        if study := self.study_file:
            result.append(("study", study))
            try:
                files = load_study(study).files
            except InputError:
                return result
            result += [(role, path) for role, paths in files.items() for path in paths]
        return result

    def files(self, role: str) -> tuple[Path, ...]:
        """The files of a role: those of the option, else those of the study except the ones that
        the call makes.
        """
        outputs, paths = self._outputs(role), self.study.files.get(role, ()) if self.study else ()
        rest = (path for path in paths if not any(same(path, each) for each in outputs))
        return self.call_files(role) or tuple(rest)

    def _outputs(self, role: str = "") -> list[Path]:
        """The files that the call makes, of all roles or of one."""
        makes = MADE.get(self.options.command, {})
        paths = [
            self.options.values.get(name) for name, roles in makes.items() if role in (*roles, "")
        ]
        return [path for path in paths if path]

    def _one(self, role: str, option: str) -> Path:
        """The first file of a role that the command cannot do without."""
        if not (result := self.files(role)):
            raise self.missing(f"{option} FILE", role)
        return result[0]

    def missing(self, options: str, *roles: str) -> InputError:
        """The error of missing files of all `roles`, with the reason why no study names one."""
        why = "with -m and no STUDY none is looked for" if self.options.machine else "no study"
        if self.study:
            why = f"{self.study.source.shown} has no {' or '.join(map(repr, roles))}"
        expected = f"{options}, or a study that names one ({why})"
        return error("missing-input", what=f"the {' or '.join(roles)} file", expected=expected)

    @property
    def names(self) -> list[str]:
        """The names in the files of the call: machine, part, study; at least one."""
        cache = self.__dict__
        result = [getattr(cache[kind], kind).name for kind in ("machine", "part") if kind in cache]
        result += [self.study.source.shown] if self.study else []
        return result or [source.shown for source in self.sources]

    @cached_property
    def machine(self) -> LoadedMachine:
        """The machine file."""
        from mtu_cli.files.machine import load_machine

        return self.register("machine", load_machine(self._one("machine", "-m")))

    @cached_property
    def part(self) -> LoadedPart:
        """The part file."""
        from mtu_cli.files.part import load_part

        return self.register("part", load_part(self._one("part", "-p")))

    @property
    def part_if_any(self) -> LoadedPart | None:
        """The part file of a command that does without one, too."""
        return self.part if self.files("part") else None

    @cached_property
    def reports(self) -> ModelReports:
        """The reports of -c, at most one of each kind."""
        from mtu_cli.files.reports_read import read_reports

        return self.register("reports", read_reports(self.files("components")))

    @cached_property
    def readings(self) -> Readings | None:
        """The ball-bar and laser readings, checked for a fit; None where there are none."""
        return self._readings("readings")

    @cached_property
    def drift(self) -> Readings:
        """The drift readings."""
        result = self._readings("drift")
        if result is None:
            raise self.missing("--drift FILE", "drift")
        return result

    @cached_property
    def before(self) -> Readings | None:
        """The readings of an earlier test; None where there are none."""
        return self._readings("before")

    @cached_property
    def verify(self) -> Readings | None:
        """The readings of the verification moves; None where there are none."""
        return self._readings("verify")

    def _readings(self, kind: str) -> Readings | None:
        files = [(path, role) for role in KINDS[kind] for path in self.files(role)]
        if not files:
            return None
        from mtu_cli.files.readings import read_readings

        of_any = self.options.command in OF_ANY_MACHINE
        for_fit = kind == "readings" and not of_any
        with_machine = for_fit or (self.options.machine if of_any else self.files("machine"))
        entries = self.machine.machine.components if with_machine else None
        convert = self.converter()
        return self.register(kind, read_readings(files, entries, for_fit=for_fit, convert=convert))

    @cached_property
    def points(self) -> Points:
        """The measured points; nominals from the part file, without one from the points."""
        from mtu_cli.files.readings import read_points

        self._one("cmm", "--cmm")
        places = self.part.part.places() if self.files("part") else None
        files = [(path, "cmm") for path in self.files("cmm")]
        return self.register("points", read_points(files, places, self.converter()))

    def register(self, kind: Any, item: T) -> T:
        """Enters the `item` of one kind of input, its files and what the checks warn of; the item.

        Raises InputError for what makes a result meaningless.
        """
        self.__dict__[kind] = item
        value: Any = item
        self.sources.extend(value.sources if hasattr(value, "sources") else (value.source,))
        if kind == "reports":
            return item
        from mtu_cli import checks

        made_here = self.options.command not in OF_ANY_MACHINE
        machine = self.machine.machine if self.files("machine") and made_here else None
        travels = machine.travels if machine else {}
        data: Data = checks.DocumentData(value, travels)
        of = JUDGED_AS.get(kind, kind)
        if kind == "points":
            data = checks.PointsData(value, self.part_if_any, travels, self.choices.datum or "none")
        elif of in ("readings", "drift"):
            data = checks.ReadingsData(value, machine.components if machine else {}, travels)
        self.suspicions += checks.warnings_of(of, data)
        return item

    @cached_property
    def choices(self) -> StudySettings:
        """The settings of the call: options over the study, by the contract of a study.

        Raises InputError for every option that is out of range, at once.
        """
        options = {name: OPTION_OF.get(name, name) for name in StudySettings.model_fields}
        given = self.options.values
        overrides = {x: given[name] for x, name in options.items() if given.get(name) is not None}
        values = self.study.study.settings.model_dump() if self.study else {}
        try:
            return StudySettings.model_validate({**values, **overrides})
        except ValidationError as fault:
            raise InputError(
                finding(
                    "out-of-range",
                    path=f"--{options[str(item['loc'][0])]}".replace("_", "-"),
                    value=str(item["input"]),
                    expected=item.get("ctx", {}).get("expected") or expectation(item, None),
                )
                for item in fault.errors()
            ) from None

    @cached_property
    def settings(self) -> Settings:
        """The settings of predictions."""
        names = StudySettings.model_fields.keys() & Settings.__dataclass_fields__.keys()
        return Settings(**self.choices.model_dump(include=names, exclude_none=True))

    @cached_property
    def at(self) -> dict[str, float]:
        """The covariates given with --at; raises InputError with all faults of them."""

        def value(name: str, text: str) -> float:
            sign = direction_sign(text) if name.startswith("dir_") else None
            result = number_of(f"--at {name}", text) if sign is None else float(sign)
            check_cell(name, result)
            return result

        example = "--at T_02_degC=23.5"
        return assignments("--at", self.options.at, "NAME=VALUE", example, value)

    def with_paths(self, findings: Iterable[Finding]) -> list[Finding]:
        """Findings with the whole paths of files that lie outside the working folder.

        Reports name such a file without its folder, so that they are the same wherever they are
        made; a message names its path. Two files of the same name keep their short names.
        """
        paths = {given_path(path): path for _, path in self.input_files()}
        count = Counter(path.name for path in paths.values())
        full_names = {
            path.name: text
            for text, path in paths.items()
            if count[path.name] == 1 == len({path.name, shown_path(path)})
            and resolved(path.parent) != resolved(Path())
        }
        return [replace(each, file=full_names.get(each.file or "", each.file)) for each in findings]


def named_file(path: Path) -> tuple[str | None, Path]:
    """Component and path of ``NAME=FILE``; no component of a plain path, or where that is a file.

    >>> named_file(Path("dx_x=laser/x.rtl"))
    ('dx_x', PosixPath('laser/x.rtl'))
    """
    match = re.match(r"([A-Za-z_]\w*)=(.+)", str(path))
    if match is None or path.exists():
        return None, path
    return match[1], Path(match[2])


def check_cell(name: str, value: float) -> None:
    """Raises InputError for a value that no cell of its column may have: a direction that is
    neither forth nor back, a temperature that no sensor reads, or a broken count.
    """
    place = {"path": f"--at {name}", "value": cell_text(value)}
    if name in DIRECTIONS and abs(value) != 1.0:
        raise error("out-of-range", **place, expected="-1 or +1")
    low, high = SENSOR_DEGC
    if is_temperature(name) and not low <= value <= high:
        raise error("out-of-range", **place, expected=f"degC, {low:g} to {high:g}")
    if name == "sequence" and isfinite(value) and value != int(value):
        raise error("wrong-type", **place, kind="a whole number")
