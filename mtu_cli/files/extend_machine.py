"""A machine file with effects added to it, the rest of it as its user wrote it.

The new effects are a block appended to the user's own list, or to the end of the file. Whatever is
written is read again: where the layout of a file is beyond such a change, all its values are
written anew, with a warning that comments are lost.
"""

from __future__ import annotations

import codecs
import hashlib
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import yaml

from mtu_cli.files.covariates import COVARIATES, POSITIONS, is_covariate
from mtu_cli.files.machine import LoadedMachine, machine_from
from mtu_cli.files.yaml_file import composed, parse_yaml, plain_scalar
from mtu_cli.findings import Finding, InputError, error, finding
from mtu_cli.language import names, parse
from mtu_cli.language.functions import MACHINE_FUNCTIONS

Figure = tuple[float, float, str]
"""Value and standard uncertainty, both in the unit that follows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenEffect:
    """An effect for the `effects` of a machine file; the order of its fields is that of its keys.

    `parameters` by name, `components` its own, in plain data; `covariance` (k, k) over them in
    their order and units; `equations` by their name (Ex), linear in the parameters, evaluated in
    mm, rad, degC, min; `alike` holds other values of what was searched that fit as well, `seen` the
    lowest and highest value of the columns of the equations, `within` of columns that these do not
    have, `found` says where the effect was found, in plain data.
    """

    name: str
    family: str | None = None
    axis: str | None = None
    covariate: str | None = None
    says: str | None = None
    parameters: Mapping[str, Figure]
    components: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    covariance: Sequence[Sequence[float]] | None = None
    equations: Mapping[str, str]
    alike: Mapping[str, Sequence[float]] = field(default_factory=dict)
    seen: Mapping[str, Sequence[float]] = field(default_factory=dict)
    within: Mapping[str, Sequence[float]] = field(default_factory=dict)
    found: Mapping[str, Any] = field(default_factory=dict)

    def entry(self) -> dict[str, Any]:
        """The effect as the contract has it; what it lacks is left out."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        values["parameters"] = {
            name: {"value": value, "u": u, "unit": unit}
            for name, (value, u, unit) in self.parameters.items()
        }
        must = ("parameters", "equations")
        return {
            key: _plain(value)
            for key, value in values.items()
            if key in must or not (value is None or (isinstance(value, Mapping) and not value))
        }


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
    """The machine file with `effects` behind its own.

    A name that the machine has already gets a number: a second `backlash-x` is `backlash-x-2`,
    a parameter that is named as a component is becomes `drift_2`, also in its equations.
    Covariates that the equations need beside the known ones are added to `covariates`.

    Raises InputError for effects that no machine file can hold.
    """
    covariates = _needed_covariates(machine, effects)
    named = _named(machine, effects, covariates)
    additions: dict[str, list[Any]] = {"effects": [effect.entry() for effect in named]}
    additions["covariates"] = covariates
    old = machine.document.data
    data = dict(old) | {
        key: [*(old.get(key) or []), *items] for key, items in additions.items() if items
    }
    mark = codecs.BOM_UTF8 if machine.document.content.startswith(codecs.BOM_UTF8) else b""
    text = _appended(machine, additions)
    warnings: tuple[Finding, ...] = ()
    if text is None or not _says(text, data, machine):
        effects_last = {key: value for key, value in data.items() if key != "effects"}
        text = "".join(_lines(effects_last | {"effects": data.get("effects", [])}, "\n"))
        warnings = (finding("machine-written-anew", file=machine.source.shown),)
    content = mark + text.encode()
    return ExtendedMachine(
        content=content,
        machine=_read_again(machine, content, data),
        parameters=tuple(f"{effect.name}.{name}" for effect in named for name in effect.parameters),
        warnings=warnings,
    )


def _read_again(machine: LoadedMachine, content: bytes, data: Mapping[str, Any]) -> LoadedMachine:
    source = replace(machine.source, sha256=hashlib.sha256(content).hexdigest())
    shown = machine.source.shown
    try:
        document = parse_yaml(content.decode("utf-8-sig"), source)
        if document.data != data:
            raise error("not-writable", file=shown, reason="YAML does not give its values back")
        return machine_from(replace(document, content=content))
    except InputError as fault:
        raise InputError(
            finding(
                "not-writable", file=shown, reason=own.text, path=own.path, column=own.column,
                value=own.value, expected=own.expected,
            )
            for own in fault.findings
        ) from None  # fmt: skip


def _says(text: str, data: Mapping[str, Any], machine: LoadedMachine) -> bool:
    """Whether a text is read as these data."""
    try:
        return bool(parse_yaml(text, machine.source).data == data)
    except InputError:
        return False


# Names of its own for every effect and parameter.


def _needed_covariates(machine: LoadedMachine, effects: Iterable[WrittenEffect]) -> list[str]:
    """Covariates that equations use and the machine does not know yet.

    Raises InputError for a covariate whose name means something else to the machine.
    """
    entry = machine.machine
    known = {"pi", *POSITIONS, *entry.constants, *entry.components}
    needed: dict[str, None] = {}
    taken = []
    for effect in effects:
        if effect.covariate in known:
            expected = "another name of the column or of the machine's constant"
            place = {"file": machine.source.shown, "value": effect.covariate, "expected": expected}
            taken.append(finding("name-taken", taken=f"no column for {effect.name!r}", **place))
        for text in effect.equations.values():
            try:
                used = names(parse(text))
            except InputError:
                # Read again as part of the file it is reported with its column.
                continue
            needed |= {
                name: None
                for name in used
                if not (name in effect.parameters or name in effect.components)
                and not (name in known or is_covariate(name))
                and name not in entry.covariates
            }
    if taken:
        raise InputError(taken)
    return list(needed)


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
        name = free_name(effect.name, taken, "-")
        taken.add(name)
        own = {*effect.parameters, *effect.components}
        new: dict[str, str] = {}
        for parameter in (*effect.parameters, *effect.components):
            new[parameter] = free_name(parameter, used | (own - {parameter}), "_")
            own.add(new[parameter])
        parameters = {new[key]: value for key, value in effect.parameters.items()}
        components = {new[key]: value for key, value in effect.components.items()}
        equations = {key: _renamed(text, new) for key, text in effect.equations.items()}
        named.append(
            replace(
                effect,
                name=name,
                parameters=parameters,
                components=components,
                equations=equations,
            )
        )
    return named


def free_name(name: str, taken: Collection[str], sign: str) -> str:
    """The name, or the first with a number behind it that is not taken."""
    free, number = name, 1
    while free in taken:
        number += 1
        free = f"{name}{sign}{number}"
    return free


def _renamed(equation: str, new: Mapping[str, str]) -> str:
    if all(old == own for old, own in new.items()):
        return equation
    return re.sub(r"(?<![\w.])[A-Za-z_]\w*", lambda word: new.get(word[0], word[0]), equation)


def _plain(value: Any) -> Any:
    """Python's own types alone; a number that is not finite is null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return _plain(value.tolist()) if hasattr(value, "tolist") else value


# Plain data as YAML text, and where it goes.


class _Block(dict[str, Any]):
    """A mapping with an entry a line; all other collections stand on one line."""


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


_ESCAPED = re.compile("[\x00-\x1f\x7f-\xa0\u2028\u2029\ufeff]")


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    # The library quotes what YAML 1.1 takes for a number; the reader knows others: 1e-6, 0o17.
    style = '"' if _ESCAPED.search(text) or plain_scalar(text) != text else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


def _represent_block(dumper: yaml.SafeDumper, data: _Block) -> yaml.MappingNode:
    return dumper.represent_mapping("tag:yaml.org,2002:map", data.items(), flow_style=False)


_Dumper.add_representer(str, _represent_text)
_Dumper.add_multi_representer(float, yaml.SafeDumper.represent_float)
_Dumper.add_representer(_Block, _represent_block)


def _dumped(data: Any) -> str:
    found: str = yaml.dump(
        data, Dumper=_Dumper, default_flow_style=True, sort_keys=False, width=1 << 30,
        allow_unicode=True,
    )  # fmt: skip
    return found


def _blocks(data: Any, depth: int) -> Any:
    if not isinstance(data, Mapping) or not data or depth == 0:
        return data
    return _Block({key: _blocks(value, depth - 1) for key, value in data.items()})


def _lines(data: Mapping[str, Any], newline: str, indent: int = 0) -> list[str]:
    """Entries of the outermost mapping, an effect an item of a list, mappings of two levels an
    entry a line, all else on the line of its key.
    """
    lines: list[str] = []
    for key, value in data.items():
        if key == "effects" and value:
            lines += [_dumped(_Block({key: None})).rstrip("\n").removesuffix(" null")]
            lines += ["  " + line for item in value for line in _item_lines(item)]
        else:
            lines += _dumped(_Block({key: _blocks(value, 1)})).splitlines()
    return [" " * indent + line + newline for line in lines]


def _item_lines(item: Any) -> list[str]:
    """An item of a block list."""
    # In a list, since a lone scalar would end with a document mark.
    own = _dumped(_blocks(item, 2)) if isinstance(item, dict) else _dumped([item]).strip()[1:-1]
    return [("- " if i == 0 else "  ") + line for i, line in enumerate(own.splitlines())]


def _appended(machine: LoadedMachine, additions: Mapping[str, Sequence[Any]]) -> str | None:
    """The text with items appended to lists of its outermost mapping; None where its layout is
    another than: a missing list, an empty one, a block list, a list in brackets of plain items.
    """
    text = machine.document.content.decode("utf-8-sig")
    found = re.search("\r\n|\r|\n", text)
    newline = "\n" if found is None else found[0]
    root = composed(text, machine.source)
    if not isinstance(root, yaml.MappingNode) or root.flow_style:
        return None
    nodes = {str(key.value): value for key, value in root.value}
    column = root.start_mark.column
    splices: list[tuple[int, int, str]] = []
    for key, items in additions.items():
        node = nodes.get(key)
        if not items:
            continue
        if node is None:
            lines = _lines({key: items}, newline, column)
            at = _after(text, root)
            splices.append((at, at, "".join(lines)))
        elif not isinstance(node, yaml.SequenceNode):
            return None
        elif not node.flow_style:
            indent = " " * node.start_mark.column
            lines = [indent + line + newline for item in items for line in _item_lines(item)]
            at = _after(text, node)
            splices.append((at, at, "".join(lines)))
        elif not node.value and isinstance(items[0], dict):
            start, end = node.start_mark.index, node.end_mark.index
            indent = " " * (column + 2)
            lines = [indent + line + newline for item in items for line in _item_lines(item)]
            at = _line_end(text, end)
            blank = len(text[:start]) - len(text[:start].rstrip(" "))
            splices += [(start - blank, end, ""), (at, at, "".join(lines))]
        else:
            texts = [_dumped([item]).strip()[1:-1] for item in items]
            at = node.value[-1].end_mark.index if node.value else node.end_mark.index - 1
            splices.append((at, at, ", " * bool(node.value) + ", ".join(texts)))
    done, last = "", 0
    for start, end, own in sorted(splices, key=lambda splice: splice[0]):
        done += text[last:start]
        if own.endswith(newline) and done and not done.endswith(newline):
            done += newline
        done, last = done + own, end
    return done + text[last:]


def _after(text: str, node: yaml.Node) -> int:
    """The start of the line below the last value of a block."""
    return _line_end(text, _last(node).end_mark.index)


def _last(node: yaml.Node) -> yaml.Node:
    """The last value within a block; the end of a block itself is where the next token begins."""
    while node.value and isinstance(node, yaml.CollectionNode) and not node.flow_style:
        node = node.value[-1] if isinstance(node, yaml.SequenceNode) else node.value[-1][1]
    return node


def _line_end(text: str, index: int) -> int:
    """The end of the line in which a value ends; a block text ends where the next line starts."""
    if index > 0 and text[index - 1] in "\r\n":
        return index
    found = re.compile("[^\r\n]*(?:\r\n|\r|\n)?").match(text, index)
    return index if found is None else found.end()
