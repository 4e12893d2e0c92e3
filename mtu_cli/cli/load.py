"""The inputs of a call, of the command line or its study: read once, checked once, when needed."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import ValidationError

from mtu_cli.checks import data_of, warnings_of
from mtu_cli.cli.options import MADE, ROLES, Options
from mtu_cli.cli.values import assignments, number_of
from mtu_cli.files.contract import expectation
from mtu_cli.files.covariates import direction_sign
from mtu_cli.files.machine import LoadedMachine, load_machine
from mtu_cli.files.part import LoadedPart, load_part
from mtu_cli.files.readings import Points, Readings, read_points, read_readings
from mtu_cli.files.reports_read import ModelReports, read_reports
from mtu_cli.files.source import Source, given_path, resolved, same, shown_path
from mtu_cli.files.study import STUDY_NAME, Instrument, LoadedStudy, find_study, load_study
from mtu_cli.files.study import Settings as StudySettings
from mtu_cli.findings import Finding, InputError, error, finding
from mtu_cli.model.covariates import check_cell
from mtu_cli.model.settings import Settings

if TYPE_CHECKING:
    from mtu_cli.formats.base import Ask, Import

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
NEEDED = {"machine": "-m", "part": "-p", "drift": "--drift", "points": "--cmm"}
"""Kinds that a command which asks for them cannot do without, and their options."""
MEASURED = ("lbb", "laser", "drift", "cmm", "before", "verify", "file")
"""Roles whose files may be an instrument's own."""
OPTION_OF = {"coverage_factor": "k"}
"""Options that are not called as the setting of a study."""
OF_ANY_MACHINE = ("anova", "iso230")
"""Commands that look at parts or readings alone: of whatever machine, unless the call names it."""


class Inputs:
    """The files of one call, each kind read and checked once, when a command asks for it. Options
    override the study; the study of this folder or above is not read where -m or a file of
    another kind is given. `suspicions`: warnings of the checks on the files read so far. Readings
    are None where there are no files of them.
    """

    machine: LoadedMachine
    part: LoadedPart
    reports: ModelReports
    readings: Readings | None
    drift: Readings
    before: Readings | None
    verify: Readings | None
    points: Points

    def __init__(self, options: Options) -> None:
        self.options = options
        self.sources: list[Source] = []
        self.suspicions: list[Finding] = []

    if not TYPE_CHECKING:

        def __getattr__(self, kind: str) -> Any:
            """One of KINDS, when it is first asked for, checked."""
            if kind not in KINDS:
                raise AttributeError(kind)
            item = self.read(kind)
            return item if item is None else self.register(kind, item)

    def read(self, kind: str) -> Any:
        """One of KINDS from its files; raises InputError for their faults, and where one that is
        NEEDED has none.
        """
        files = [(path, role) for role in KINDS[kind] for path in self.files(role)]
        if not files and kind in NEEDED:
            raise self.missing(f"{NEEDED[kind]} FILE", *KINDS[kind])
        match kind:
            case "machine":
                return load_machine(files[0][0])
            case "part":
                return load_part(files[0][0])
            case "reports":
                return read_reports([path for path, _ in files])
        if not files:
            return None
        from mtu_cli.formats.instruments import converter

        # Instruments' files are read as the contract's CSV.
        convert = converter(self.ask, self.note)
        if kind == "points":
            # Nominals from the part file, without one from the points.
            places = part.part.places() if (part := self.part_if_any) else None
            return read_points(files, places, convert)
        of_any = self.options.command in OF_ANY_MACHINE
        for_fit = kind == "readings" and not of_any
        named = self.options.machine if of_any else self.files("machine")
        entries = self.machine.machine.components if for_fit or named else None
        return read_readings(files, entries, for_fit=for_fit, convert=convert)

    @cached_property
    def study(self) -> LoadedStudy | None:
        """The study of the call, if it has one."""
        options, path = self.options, self.study_file
        if path is None or (options.study is None and (options.machine or options.file)):
            return None
        return self.entered(load_study(path, absent=self.made()))

    @property
    def study_file(self) -> Path | None:
        """The study that the call names, or else that of this folder, which it may not read."""
        path: Path | None = self.options.study
        if path is None:
            return find_study(Path())
        return path / STUDY_NAME if path.is_dir() else path

    def named_files(self, role: str) -> list[tuple[str | None, Path]]:
        """The files of a role that the call names, with the component of NAME=FILE."""
        value = self.options.values.get(role) or ()
        paths = value if isinstance(value, (list, tuple)) else [value]
        return [named_file(path) if role in MEASURED else (None, path) for path in paths]

    def files(self, role: str) -> list[Path]:
        """The files of a role: those of the option, else those of the study except the ones that
        the call makes.
        """
        paths = self.study.files.get(role, ()) if self.study else ()
        rest = [path for path in paths if not any(same(path, each) for each in self.made())]
        return [path for _, path in self.named_files(role)] or rest

    def made(self) -> list[Path]:
        """The files that the command is there to make."""
        paths = (self.options.values.get(name) for name in MADE.get(self.options.command, ()))
        return [path for path in paths if path]

    def ask(self, path: Path, role: str) -> Ask:
        """What the call, its study and the machine say of an instrument's file."""
        from mtu_cli.formats.base import Ask

        options, study = self.options, self.study
        instrument = (study and study.instruments.get(path)) or Instrument(file="-")
        names = {file: name for name, file in self.named_files(role)}
        # Where neither names one, the (first) component of --component.
        of_call = options.component or None
        of_call = of_call[0] if isinstance(of_call, list) else of_call
        entries = self.machine.machine.components if self.files("machine") else {}
        folder = study.source.path.parent if study else Path()
        return Ask(
            kind=options.as_ or {"drift": "drift", "cmm": "points"}.get(role, "readings"),
            component=names.get(path) or instrument.component or of_call,
            unit=options.unit or instrument.unit,
            machine_units={name: entry.unit for name, entry in entries.items()},
            decimal=options.decimal or instrument.decimal,
            directions=options.directions or instrument.directions,
            profile=options.map or (folder / instrument.map if instrument.map else None),
        )

    def note(self, table: Import) -> None:
        """Enters how an instrument's file was understood among the warnings."""
        file = table.file
        self.suspicions.append(file.finding("instrument-file", how=table.sentence))
        self.suspicions += [file.finding("instrument-doubt", doubt=x) for x in table.doubts]

    def input_files(self) -> list[tuple[str, Path]]:
        """Role and path of all files that the call, its study or that of this folder names; of a
        faulty study its path alone.
        """
        result = [(role, path) for role in ROLES for _, path in self.named_files(role)]
        if study := self.study_file:
            result.append(("study", study))
            try:
                files = load_study(study).files
            except InputError:
                return result
            result += [(role, path) for role, paths in files.items() for path in paths]
        return result

    def missing(self, options: str, *roles: str) -> InputError:
        """The error of missing files of all `roles`, with the reason why no study names one."""
        why = "with -m and no STUDY none is looked for" if self.options.machine else "no study"
        if self.study:
            why = f"{self.study.source.shown} has no {' or '.join(map(repr, roles))}"
        expected = f"{options}, or a study that names one ({why})"
        return error("missing-input", what=f"the {' or '.join(roles)} file", expected=expected)

    @property
    def part_if_any(self) -> LoadedPart | None:
        """The part file of a command that does without one, too."""
        return self.part if self.files("part") else None

    def entered(self, item: T) -> T:
        """What was read, with its files entered among the inputs of the report."""
        value: Any = item
        self.sources += value.sources if hasattr(value, "sources") else [value.source]
        return item

    def register(self, kind: str, item: T) -> T:
        """Enters the `item` of one kind of input, its files and what the checks warn of; the item.

        Raises InputError for what makes a result meaningless.
        """
        self.__dict__[kind] = item
        value: Any = self.entered(item)
        of_machine = self.options.command not in OF_ANY_MACHINE and self.files("machine")
        machine = self.machine.machine if of_machine else None
        of_points = (self.part_if_any, self.choices.datum or "none") if kind == "points" else ()
        if kind != "reports":
            self.suspicions += warnings_of(*data_of(kind, value, machine, *of_points))
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
