"""The commands as functions of Python, on files or on objects read from them.

>>> import mtu_cli as mtu
>>> study = "configs/gilsinn-ling-simulated"
>>> machine = mtu.read_machine(f"{study}/machine.yaml")
>>> readings = mtu.read_readings(["data/gilsinn-ling-simulated/lbb.csv"], machine)
>>> fit = mtu.fit_components(machine, readings)
>>> round(fit.to_dict()["components"]["dx_x"]["s_repeat"], 3)
0.921
>>> found = mtu.lengths(machine, mtu.read_part(f"{study}/part.yaml"), fit, k=3)
>>> list(found.to_frame()["id"])
['3-9', '9-15', '3-15']

A study, or what was read, is given by position, options of the command by name (``seed=1``,
``datum="offset"``, ``at={"dir_x": 1}``). Nothing is written: of a `Result` `report` is what ``-o``
would write, `page` the report to hand on. Faults of the input raise InputError with all findings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from mtu_cli.cli.commands import COMMANDS, analysis_of
from mtu_cli.cli.load import KINDS, Inputs
from mtu_cli.cli.options import OPTIONS, REQUIRED, ROLES, WRITTEN, Options, options_of
from mtu_cli.cli.values import check_values
from mtu_cli.files.machine import LoadedMachine, load_machine
from mtu_cli.files.part import LoadedPart, load_part
from mtu_cli.files.readings import Points, Readings
from mtu_cli.files.reports_read import ModelReports, report_from
from mtu_cli.files.source import DRIFT, Source
from mtu_cli.files.study import LoadedStudy, load_study
from mtu_cli.findings import Finding
from mtu_cli.result import Result

FUNCTIONS = {
    name.replace("-", "_").replace(" ", "_"): name
    for name, command in COMMANDS.items()
    if command.chapter != "commands" and name not in ("graph draw", "import")
}
"""The functions of the commands that report or make something, by their names in Python."""
OF_READINGS = ("readings", "drift", "before")
"""Kinds of input that are readings."""
OUTPUTS = (*WRITTEN, "date", "detail", "quiet")
"""Options of what the command line writes and shows: a `Result` is asked for it."""
FilePath = str | Path


def read_machine(path: FilePath) -> LoadedMachine:
    """A machine file; raises InputError with all its faults."""
    return load_machine(Path(path))


def read_part(path: FilePath) -> LoadedPart:
    """A part file; raises InputError with all its faults."""
    return load_part(Path(path))


def read_study(path: FilePath) -> LoadedStudy:
    """A study file; raises InputError with all its faults."""
    return load_study(Path(path))


def read_readings(
    paths: Iterable[FilePath], machine: LoadedMachine | None = None, role: str = "lbb"
) -> Readings:
    """Readings of one `role`: ``lbb``, ``laser``, ``drift``, or ``before`` of an earlier test;
    raises InputError with all faults.

    `machine` names the components; without it any name is accepted. A file may be an instrument's
    own, ``NAME=FILE`` where it reads one component.
    """
    kind = next((name for name in OF_READINGS if role in KINDS[name]), None)
    if kind is None:
        raise ValueError(f"role: {role!r} is none of 'lbb', 'laser', 'drift', 'before'")
    return _read(kind, role, paths, machine=machine)


def read_points(paths: Iterable[FilePath], part: LoadedPart | None = None) -> Points:
    """Measured points with the nominal places of `part`, or their own; raises InputError."""
    return _read("points", "cmm", paths, part=part)


def _read(kind: str, role: str, paths: Iterable[FilePath], **objects: Any) -> Any:
    """One kind of input from these files and objects alone: no study is looked for."""
    given = {name: item for name, item in objects.items() if item is not None}
    values = {name: item.source.path for name, item in given.items()}
    values[role] = [Path(path) for path in ([paths] if isinstance(paths, (str, Path)) else paths)]
    if not values[role]:
        raise ValueError("no files to read")
    # Without a machine as of a command that takes readings of any.
    inputs = Inputs(Options("fit-components" if given else "iso230", values))
    inputs.__dict__ |= {"study": None, **given}
    return inputs.read(kind)


def check(*given: Any, **options: Any) -> list[Finding]:
    """What the input checks warn of; raises InputError for errors."""
    inputs = _inputs("compare", given, options)
    for kind, roles in KINDS.items():
        if any(inputs.files(role) for role in roles):
            getattr(inputs, kind)
    return list(inputs.suspicions)


def simulate(*given: Any, make: str = "cmm", **options: Any) -> Result:
    """Readings (`make`: ``lbb``), points (``cmm``) or drift readings (``drift``) of a virtual
    machine, as they would be written.

    >>> import mtu_cli as mtu
    >>> points = mtu.simulate("configs/undeclared", parts=2, effect="Ex: 0.004*dir_x", seed=1)
    >>> list(points.to_frame().columns[:5])
    ['part', 'feature', 'repeat', 'x_mm', 'y_mm']
    >>> len(points.to_dict()["cmm"]["x_mm"]) == 2 * 2 * 24
    True
    """
    option = f"write_{make}"
    if make not in ("lbb", "cmm", "drift"):
        raise ValueError(f"make: {make!r} is none of 'lbb', 'cmm', 'drift'")
    inputs = _inputs("simulate", given, options)
    inputs.options.values[option] = Path(f"{make}.csv")
    return analysis_of("simulate")(inputs)


def function_of(name: str) -> Callable[..., Result]:
    """The function of a command, by its name with underscores; raises AttributeError."""
    if name == "simulate":
        return simulate
    if name not in FUNCTIONS:
        raise AttributeError(name)
    command = FUNCTIONS[name]

    def call(*given: Any, **options: Any) -> Result:
        return analysis_of(command)(_inputs(command, given, options))

    call.__name__ = call.__qualname__ = name
    call.__doc__ = f"{COMMANDS[command].text}\n\n`mtu {command} --help` lists the options."
    return call


def _inputs(command: str, items: Iterable[Any], options: Mapping[str, Any]) -> Inputs:
    """The inputs of a call: an object read before takes the place of its file."""
    declarations = options_of(COMMANDS[command].options)
    values = {
        name: None if option.default is REQUIRED else option.default
        for name, option in declarations.items()
        if name not in OUTPUTS
    }
    entries = {role: OPTIONS[role] for role in ROLES if role in OPTIONS} | declarations
    if unknown := options.keys() - values.keys() - {*ROLES}:
        raise TypeError(f"{command} has no option {', '.join(sorted(unknown))}")
    for name, value in options.items():
        if isinstance(value, Result) or value is None:
            continue
        many = entries[name].many
        if name == "at" and isinstance(value, Mapping):
            value = [f"{key}={item}" for key, item in value.items()]
        elif many and isinstance(value, (str, Path, float, int)):
            value = [value]
        if entries[name].kind is Path:
            value = [Path(each) for each in value] if many else Path(value)
        values[name] = value
    check_values(entries, values)
    data: dict[str, Any] = {}
    for item in (*items, *(value for value in options.values() if isinstance(value, Result))):
        _place(item, command, values, data)
    inputs = Inputs(Options(command, values))
    for kind in KINDS:
        if kind in data:
            inputs.register(kind, data[kind])
    return inputs


def _place(item: Any, command: str, values: dict[str, Any], data: dict[str, Any]) -> None:
    match item:
        case LoadedMachine():
            values["machine"], data["machine"] = item.source.path, item
        case LoadedPart():
            values["part"], data["part"] = item.source.path, item
        case LoadedStudy():
            values["study"] = item.source.path
        case Readings() | Points():
            for source in item.sources:
                values[source.role] = [*(values.get(source.role) or ()), source.path]
            drift = isinstance(item, Readings) and item.sources[0].role == DRIFT
            data["points" if isinstance(item, Points) else "drift" if drift else "readings"] = item
        case Result():
            # As if it had been written and read.
            name = item.inputs.options.command.replace("-", "_").replace(" ", "_")
            source = Source(role="components", path=Path(name), shown=name, sha256="")
            report = report_from(source, item.report())
            data["reports"] = ModelReports(**{report.source.role: report})
        case str() | Path():
            if command == "circular":  # of several files
                values["file"] = [*(values["file"] or ()), Path(item)]
            else:
                values["file" if "file" in values else "study"] = Path(item)
        case _:
            raise TypeError(f"{command} takes no {type(item).__name__}")
