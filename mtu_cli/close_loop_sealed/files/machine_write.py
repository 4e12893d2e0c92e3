"""A machine file with effects added to it, the rest of it as its user wrote it."""

from __future__ import annotations

import codecs
import hashlib
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import yaml

from mtu_cli.close_loop_sealed.files.yaml_append import NotAppendable, with_appended
from mtu_cli.close_loop_sealed.files.yaml_dump import block_lines
from mtu_cli.errors import InputError, Notice, Problem
from mtu_cli.files.covariates import COVARIATES, is_covariate
from mtu_cli.files.machine import LoadedMachine, machine_from
from mtu_cli.files.machine_equations import POSITIONS
from mtu_cli.files.yaml_file import parse_yaml
from mtu_cli.findings import Finding
from mtu_cli.language import EquationError, names, parse
from mtu_cli.language.functions import MACHINE_FUNCTIONS

Figure = tuple[float, float, str]
"""Value and standard uncertainty, both in the unit that follows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenEffect:
    """An effect for the `effects` of a machine file.

    `parameters` by name; `covariance` (k, k) over them in their order and units; `equations`
    by their name (Ex), linear in the parameters, evaluated in mm, rad, degC, min; `alike` holds
    other values of what was searched that fit as well, `seen` the lowest and highest value of the
    columns of the equations, `within` of columns that these do not have, `found` says where the
    effect was found, in plain data.
    """

    name: str
    parameters: Mapping[str, Figure]
    equations: Mapping[str, str]
    family: str | None = None
    axis: str | None = None
    covariate: str | None = None
    says: str | None = None
    covariance: Sequence[Sequence[float]] | None = None
    alike: Mapping[str, Sequence[float]] = field(default_factory=dict)
    seen: Mapping[str, Sequence[float]] = field(default_factory=dict)
    within: Mapping[str, Sequence[float]] = field(default_factory=dict)
    found: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtendedMachine:
    """The bytes of an extended machine file, and the same as the reader understands it.

    `parameters` are the names of the new effects' parameters, ``effect.parameter``, in order.
    """

    content: bytes
    machine: LoadedMachine
    parameters: tuple[str, ...]
    warnings: tuple[Finding, ...]


def extended_machine(machine: LoadedMachine, effects: Sequence[WrittenEffect]) -> ExtendedMachine:
    """The machine file with `effects` behind its own, byte for byte the same elsewhere.

    A name that the machine has already gets a number: a second `backlash-x` is `backlash-x-2`,
    a parameter that is named as a component is becomes `drift_2`, also in its equations.
    Covariates that the equations need beside the known ones are added to `covariates`. What is
    returned was read again and holds what it should; where the layout of the file is beyond
    such a change, all values are written anew, with a warning that comments are lost.

    Raises InputError for effects that no machine file can hold.
    """
    covariates = _needed(machine, effects)
    named = _named(machine, effects, covariates)
    additions = {"effects": [_plain(_entry(effect)) for effect in named], "covariates": covariates}
    data = dict(machine.document.data)
    for key, items in additions.items():
        if items:
            data[key] = [*data.get(key, []), *items]
    content, warnings = _written(machine, additions, data)
    return ExtendedMachine(
        content=content,
        machine=_read_again(machine, content, data),
        parameters=tuple(f"{effect.name}.{name}" for effect in named for name in effect.parameters),
        warnings=warnings,
    )


def _written(
    machine: LoadedMachine, additions: Mapping[str, Sequence[Any]], data: Mapping[str, Any]
) -> tuple[bytes, tuple[Finding, ...]]:
    old = machine.document.content
    mark = codecs.BOM_UTF8 if old.startswith(codecs.BOM_UTF8) else b""
    try:
        text = with_appended(old.decode("utf-8-sig"), additions)
        if parse_yaml(text, machine.source).data == data:
            return mark + text.encode(), ()
    except (NotAppendable, InputError, yaml.YAMLError):
        pass
    message = (
        f"{machine.source.shown}: effects cannot be added to a file of this layout: all its values "
        "are written anew, its comments are not"
    )
    rest = {key: value for key, value in data.items() if key != "effects"}
    text = "".join(f"{line}\n" for line in block_lines(rest, depth=1))
    warning = Notice(code="machine-written-anew", message=message)
    return with_appended(text, {"effects": data.get("effects", [])}).encode(), (warning,)


def _read_again(machine: LoadedMachine, content: bytes, data: Mapping[str, Any]) -> LoadedMachine:
    digest = hashlib.sha256(content).hexdigest()
    source = replace(machine.source, sha256=digest)
    try:
        document = parse_yaml(content.decode("utf-8-sig"), source)
        if document.data != data:
            raise InputError(Problem(what="values that YAML text does not give back"))
        return machine_from(replace(document, content=content))
    except InputError as error:
        problems = [
            Problem(
                what=f"an effect cannot be written into {machine.source.shown}: {problem.text}",
                path=problem.path,
                column=problem.column,
                value=problem.value,
                expected=problem.expected,
            )
            for problem in error.findings
        ]
        raise InputError(problems) from None


def _entry(effect: WrittenEffect) -> dict[str, Any]:
    """The effect as the contract has it; what it lacks is left out."""
    head = {
        "name": effect.name,
        "family": effect.family,
        "axis": effect.axis,
        "covariate": effect.covariate,
        "says": effect.says,
    }
    entry: dict[str, Any] = {key: value for key, value in head.items() if value is not None}
    entry["parameters"] = {
        name: {"value": value, "u": u, "unit": unit}
        for name, (value, u, unit) in effect.parameters.items()
    }
    if effect.covariance is not None:
        entry["covariance"] = effect.covariance
    entry["equations"] = effect.equations
    if effect.alike:
        entry["alike"] = effect.alike
    if effect.seen:
        entry["seen"] = effect.seen
    if effect.within:
        entry["within"] = effect.within
    if effect.found:
        entry["found"] = effect.found
    return entry


def _plain(value: Any) -> Any:
    """Python's own types alone; a number that is not finite is null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return _plain(value.tolist()) if hasattr(value, "tolist") else value


def _needed(machine: LoadedMachine, effects: Iterable[WrittenEffect]) -> list[str]:
    """Covariates that equations use and the machine does not know yet.

    Raises InputError for a covariate whose name means something else to the machine.
    """
    entry = machine.machine
    known = {"pi", *POSITIONS, *entry.constants, *entry.components}
    found: dict[str, None] = {}
    problems = []
    for effect in effects:
        if effect.covariate in known:
            problems.append(
                Problem(
                    what=f"the effect {effect.name!r} needs a column of a name that is taken in "
                    f"{machine.source.shown}",
                    value=effect.covariate,
                    expected="another name of the column or of the machine's constant",
                )
            )
        for text in effect.equations.values():
            used = [name for name in _names(text) if name not in effect.parameters]
            new = [name for name in used if name not in known and not is_covariate(name)]
            found |= dict.fromkeys(name for name in new if name not in entry.covariates)
    if problems:
        raise InputError(problems)
    return list(found)


def _names(text: str) -> Iterable[str]:
    try:
        return names(parse(text))
    except EquationError:
        # Read again as part of the file it is told with its column.
        return ()


def _named(
    machine: LoadedMachine, effects: Iterable[WrittenEffect], covariates: Collection[str]
) -> list[WrittenEffect]:
    """The effects with names of their own."""
    entry = machine.machine
    taken = {effect.name for effect in entry.effects}
    used = {"pi", *MACHINE_FUNCTIONS, *POSITIONS, *COVARIATES, *entry.covariates, *covariates}
    used |= {*entry.constants, *entry.components}
    named = []
    for effect in effects:
        name = _free(effect.name, taken, "-")
        taken.add(name)
        own = set(effect.parameters)
        renamed: dict[str, str] = {}
        for parameter in effect.parameters:
            new = _free(parameter, used | (own - {parameter}), "_")
            renamed[parameter] = new
            own.add(new)
        named.append(
            replace(
                effect,
                name=name,
                parameters={renamed[key]: value for key, value in effect.parameters.items()},
                equations={
                    key: _substituted(text, renamed) for key, text in effect.equations.items()
                },
            )
        )
    return named


def _free(name: str, taken: Collection[str], sign: str) -> str:
    free, number = name, 1
    while free in taken:
        number += 1
        free = f"{name}{sign}{number}"
    return free


def _substituted(equation: str, renamed: Mapping[str, str]) -> str:
    if all(old == new for old, new in renamed.items()):
        return equation
    return re.sub(
        r"(?<![\w.])[A-Za-z_]\w*", lambda match: renamed.get(match[0], match[0]), equation
    )
