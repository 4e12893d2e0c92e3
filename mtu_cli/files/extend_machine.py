"""A machine file with effects added to it, the rest of it as its user wrote it.

The lists `effects` and `covariates` are written anew at the end of the file, and what is written is
read again. Where the layout of a file is beyond that, as of one in braces, all of it is written
anew. What comments are lost is warned of.
"""

from __future__ import annotations

import codecs
import hashlib
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import yaml

from mtu_cli.files.covariates import COVARIATES, POSITIONS, is_covariate
from mtu_cli.files.machine import LoadedMachine, machine_from
from mtu_cli.files.yaml_file import composed, parse_yaml, plain_scalar
from mtu_cli.findings import Finding, InputError, error, finding
from mtu_cli.language import names, parse, to_text
from mtu_cli.language.functions import MACHINE_FUNCTIONS
from mtu_cli.language.tree import Number

WORD = re.compile(r"((?<![\w.])[A-Za-z_]\w*)")
Entry = Mapping[str, Any]
"""An effect as the contract has it, in plain data; what is None or {} is left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtendedMachine:
    """The bytes of an extended machine file, and the same as the reader understands it.

    `parameters` are the names of the new effects' parameters, ``effect.parameter``, in order.
    """

    content: bytes
    machine: LoadedMachine
    parameters: tuple[str, ...]
    warnings: tuple[Finding, ...]


def extended_machine(machine: LoadedMachine, effects: Sequence[Entry]) -> ExtendedMachine:
    """The machine file with `effects` behind those that it has.

    A name that the machine has already gets a number: a second `backlash-x` is `backlash-x-2`,
    a parameter that is named as a component is becomes `drift_2`, also in its equations.
    Further covariates that the equations need are added to `covariates`.

    Raises InputError for effects that no machine file can hold.
    """
    covariates, new_effects = _named(machine, effects)
    old, file = machine.document.data, machine.source.shown
    entries: list[Any] = [
        {key: x for key, x in effect.items() if key == "parameters" or x not in (None, {})}
        for effect in new_effects
    ]
    additions = {"covariates": covariates, "effects": entries}
    lists = {key: [*(old.get(key) or []), *items] for key, items in additions.items() if items}
    content, lossless = machine.document.content, True
    if lists:
        mark = codecs.BOM_UTF8 if content.startswith(codecs.BOM_UTF8) else b""
        text, lossless = _with_lists(machine, lists)
        content = mark + text.encode()
    source = replace(machine.source, sha256=hashlib.sha256(content).hexdigest())
    try:
        document = parse_yaml(content.decode("utf-8-sig"), source)
        if document.data != {**old, **lists}:
            raise error("not-writable", file=file, reason="YAML does not give its values back")
        new_machine = machine_from(replace(document, content=content))
    except InputError as fault:
        raise InputError(
            replace(item, code="not-writable", facts={"reason": item.text}, file=file, line=None)
            for item in fault.findings
        ) from None
    return ExtendedMachine(
        content=content,
        machine=new_machine,
        parameters=tuple(f"{x['name']}.{name}" for x in new_effects for name in x["parameters"]),
        warnings=() if lossless else (finding("machine-written-anew", file=file),),
    )


def by_lever_arms(
    machine: LoadedMachine, component: str | None, equations: Mapping[str, str]
) -> dict[str, str]:
    """The equations of an effect as terms of a machine's; of one of a component's readings by the
    component's lever arms: with E the equation and c the component, c + f adds (dE/dc) f.
    """
    if component is None:
        return dict(equations)
    (text,) = equations.values()
    forms = machine.forms.items()
    levers = {key: x.coefficients[component] for key, x in forms if component in x.coefficients}
    return {
        key: text if lever == Number(1.0, lever.column) else f"({to_text(lever)})*({text})"
        for key, lever in levers.items()
    }


# A unique name for every effect and parameter.


def _named(
    machine: LoadedMachine, effects: Sequence[Entry]
) -> tuple[list[str], list[dict[str, Any]]]:
    """Covariates that equations use and the machine does not know yet, and the effects with names
    that it does not use yet.

    Raises InputError for a covariate whose name means something else to the machine.
    """
    entry = machine.machine
    symbols = {"pi", *POSITIONS, *entry.constants, *entry.components}
    covariates: dict[str, None] = {}
    for effect in effects:
        if (column := effect.get("covariate")) in symbols:
            expected = "another name of the column or of the machine's constant"
            facts = {"taken": f"no column for {effect['name']!r}", "value": column}
            raise error("name-taken", **facts, file=machine.source.shown, expected=expected)
        scope = {*symbols, *entry.covariates, *effect["parameters"], *effect.get("components", ())}
        used = [name for text in effect["equations"].values() for name in names(parse(text))]
        covariates |= {name: None for name in used if not (name in scope or is_covariate(name))}
    symbols |= {*MACHINE_FUNCTIONS, *COVARIATES, *entry.covariates, *covariates}
    effect_names, result = {effect.name for effect in entry.effects}, []
    for effect in effects:
        name = free_name(effect["name"], effect_names, "-")
        effect_names.add(name)
        keys = [key for key in ("parameters", "components") if key in effect]
        own, new = dict.fromkeys(item for key in keys for item in effect[key]), dict[str, str]()
        for old in own:
            new[old] = free_name(old, symbols | (own.keys() - {old}) | {*new.values()}, "_")
        equations = {
            axis: "".join(new.get(word, word) for word in WORD.split(text))
            for axis, text in effect["equations"].items()
        }
        entries = {key: {new[old]: x for old, x in effect[key].items()} for key in keys}
        result.append({**effect, "name": name, **entries, "equations": equations})
    return list(covariates), result


def free_name(name: str, names: Collection[str], sign: str) -> str:
    """The name, or the first with a number behind it that is not among `names`."""
    result, number = name, 1
    while result in names:
        number += 1
        result = f"{name}{sign}{number}"
    return result


# Plain data as YAML text, and where it goes.


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    # The library quotes what YAML 1.1 takes for a number; the reader knows others: 1e-6, 0o17.
    style = '"' if plain_scalar(text) != text else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _represent_text)


def _lines(data: Mapping[str, Any]) -> list[str]:
    """Lines of YAML; what holds no lists or mappings stands on one."""
    text: str = yaml.dump(
        data, Dumper=_Dumper, default_flow_style=None, sort_keys=False, width=1 << 30,
        allow_unicode=True,
    )  # fmt: skip
    return text.splitlines()


def _with_lists(machine: LoadedMachine, lists: Mapping[str, Sequence[Any]]) -> tuple[str, bool]:
    """The text of a file that has these `lists` at its end and no more where they were, and
    whether all of its comments are still there.
    """
    document = machine.document
    data, text = {**document.data, **lists}, document.content.decode("utf-8-sig")
    match = re.search("\r\n|\r|\n", text)
    newline = "\n" if match is None else match[0]
    root = composed(text, machine.source)
    if isinstance(root, yaml.MappingNode) and not root.flow_style:
        lines, indent = text.splitlines(), " " * root.start_mark.column
        end, cut = _end(root), ""
        new = [indent + line for line in _lines(lists)]
        body = [*lines[:end], *new, *lines[end:]]
        for key, value in reversed(root.value):
            if key.value in lists:
                first, after = key.start_mark.line, _end(value)
                cut += "\n".join(body[first:after])
                del body[first:after]
        output = newline.join(body) + newline
        try:
            if parse_yaml(output, machine.source).data == data:
                return output, re.search(r"(^|\s)#", cut, re.MULTILINE) is None
        except InputError:
            pass
    return newline.join(_lines(data)) + newline, False


def _end(node: yaml.Node) -> int:
    """The line below a value; the end of a block itself is where the next token begins."""
    while node.value and isinstance(node, yaml.CollectionNode) and not node.flow_style:
        node = node.value[-1] if isinstance(node, yaml.SequenceNode) else node.value[-1][1]
    mark = node.end_mark
    return int(mark.line) + (mark.column > 0)
