"""What a call is to write, refused where it cannot be or where it would destroy an input."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.option_values import OUTPUTS, WRITES, option_name
from mtu_cli.cli.options import Options
from mtu_cli.findings import Finding, InputError, finding

if TYPE_CHECKING:
    from mtu_cli.files.study import LoadedStudy

STANDARD_OUTPUT = Path("-")
REPORTS = (".html", ".htm", ".pdf")

ROLES = ("machine", "part", "components", "lbb", "laser", "cmm", "drift", "effects", "file")
MADE = {"write_lbb": ("lbb", "laser"), "write_cmm": ("cmm",), "write_drift": ("drift",)}
"""Roles of a study's files that an option of `simulate` makes anew."""
MADE_FIRST = {"write_machine": ("machine",), "write_components": ("components",)}
"""Roles of those that an option makes where they are not there yet."""
KINDS = {
    "out": "JSON",
    "csv": "CSV",
    "report": "HTML or PDF",
    "write_components": "JSON",
    "write_machine": "YAML",
    **dict.fromkeys(("write_lbb", "write_cmm", "write_drift"), "CSV"),
}
ENDINGS = {
    ".json": "JSON",
    ".csv": "CSV",
    ".yaml": "YAML",
    ".yml": "YAML",
    ".gz": "gzip",
    ".html": "HTML",
    ".htm": "HTML",
    **dict.fromkeys((".png", ".svg", ".pdf"), "a picture"),
}


def check_outputs(inputs: Inputs) -> None:
    """Refuses outputs that cannot be made or would overwrite an input, all at once, before
    anything is calculated.
    """
    options = inputs.options
    written = written_files(options)
    named = {name: options.values.get(name) for name in OUTPUTS} | written
    given = {name: path for name, path in named.items() if path is not None}
    if not given:
        return
    files = {name: path for name, path in given.items() if path != STANDARD_OUTPUT}
    problems = [*_pictures(options.plot), *_streams(options, written)]
    problems += _lost(inputs, files)
    from mtu_cli.files.write import check_targets

    try:
        check_targets(list(files.values()))
    except InputError as error:
        problems += error.findings
    told = {problem.file for problem in problems}
    problems += [problem for problem in _endings(files) if problem.file not in told]
    if problems:
        raise InputError(problems)


def check_overwritten(targets: Iterable[Path], mark: str) -> None:
    """Raises InputError for files with anything in them that do not begin with a `mark`: they are
    not written over.
    """
    from mtu_cli.files.source import begins_with, given_path

    problems = [
        finding(
            "data-overwritten",
            mark=mark,
            file=given_path(path),
            expected="another name, or the file moved away",
        )
        for path in targets
        if not begins_with(path, mark)
    ]
    if problems:
        raise InputError(problems)


def written_files(options: Options) -> dict[str, Path]:
    """What a command writes beside report, table and picture: path by name of the option."""
    return {
        name: path
        for name, path in options.values.items()
        if name.startswith(WRITES) and path is not None
    }


def _pictures(plot: Path | None) -> Iterator[Finding]:
    from mtu_cli.reports.figures import ENDINGS, SUFFIXES

    if plot is not None and plot.suffix.lower().lstrip(".") not in SUFFIXES:
        yield finding(
            "wrong-ending", option="--plot", kind="a picture", value=str(plot), expected=ENDINGS
        )


def _streams(options: Options, written: Mapping[str, Path]) -> Iterator[Finding]:
    if options.out == options.csv == STANDARD_OUTPUT:
        yield finding("standard-output", option="--csv beside -o", expected="a file for one")
    for name, path in written.items():
        if path == STANDARD_OUTPUT:
            yield finding("standard-output", option=option_name(name), expected="a file")


def _endings(files: Mapping[str, Path]) -> Iterator[Finding]:
    """A file that other programs would take for what it is not, perhaps over one that is."""
    from mtu_cli.files.source import given_path

    for name, path in files.items():
        kind = KINDS.get(name)
        other = ENDINGS.get(path.suffix.lower())
        if name == "report":
            wrong, ending = path.suffix.lower() not in REPORTS, ".html or .pdf"
        else:
            wrong = kind is not None and other is not None and kind != other
            ending = next((key for key, value in ENDINGS.items() if value == kind), "")
        if wrong:
            option = "-o" if name == "out" else option_name(name)
            yield finding(
                "wrong-ending",
                option=option,
                kind=kind,
                file=given_path(path),
                expected=f"a name that ends in {ending}",
            )


def _lost(inputs: Inputs, files: Mapping[str, Path]) -> Iterator[Finding]:
    """Outputs over a file that the call or its study names, whether this command reads it or not.

    What a command is there to make may be made anew: the data of a study by `simulate`, its
    components by a fit.
    """
    from mtu_cli.files.source import given_path
    from mtu_cli.files.write import overwrites

    options = inputs.options
    called = [path for role in ROLES for path in _listed(options.values.get(role))]
    of_call = _named_by(inputs.study)
    # What the call names instead is not read from the study.
    instead = {role for role in ROLES if _listed(options.values.get(role))}
    read = [
        (role, path) for role, path in of_call if role in options.values and role not in instead
    ]
    named = [*of_call, *_named_by(_nearby())]
    for name, target in files.items():
        makes = _makes(options.command, name, target)
        mine, roles = (
            [role for role, path in some if role not in makes and overwrites(target, path)]
            for some in (read, named)
        )
        own = mine or any(overwrites(target, path) for path in called)
        if own or roles:
            yield finding(
                "input-overwritten",
                owner="this run" if own else "the study",
                file=given_path(target),
                expected="another name",
            )


def _named_by(study: LoadedStudy | None) -> list[tuple[str, Path]]:
    """A study and its files, with their roles."""
    if study is None:
        return []
    files = [(role, path) for role, paths in study.files.items() for path in paths]
    return [("study", study.source.path), *files]


def _nearby() -> LoadedStudy | None:
    """The study of this folder or one above, even where the call does without or has another: its
    files are its own all the same, made or not. One that cannot be read names none.
    """
    from mtu_cli.files.study import find_study, load_study

    path = find_study(Path())
    try:
        return None if path is None else load_study(path, there=False)
    except InputError:
        return None


def _listed(value: object) -> list[Path]:
    found = value if isinstance(value, list) else [value]
    return [item for item in found if isinstance(item, Path)]


def _makes(command: str, name: str, target: Path) -> tuple[str, ...]:
    """Roles of a study whose files an option of a command may make, or make anew."""
    if name in MADE_FIRST and not target.exists():
        return MADE_FIRST[name]
    if command == "simulate":
        return MADE.get(name, ())
    if command in ("fit-components", "thermal-fit") and name == "out":
        return ("components",)
    return ()
