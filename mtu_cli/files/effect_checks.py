"""What the effects of a machine file must fulfil beyond their shape, and what is odd about them."""

from __future__ import annotations

from collections.abc import Iterator

from mtu_cli.errors import did_you_mean
from mtu_cli.files.contracts import Findings, Notice
from mtu_cli.files.covariates import (
    COLDEST_K,
    HOTTEST_K,
    KELVIN,
    is_temperature,
    looks_like_temperature,
)
from mtu_cli.files.machine_contract import Effect, Machine
from mtu_cli.files.yaml_file import YamlDocument, YamlPath
from mtu_cli.language import Node, names, parse
from mtu_cli.language.tree import Binary, Name, Number, walk


def check_effect_used(effect: Effect, index: int, findings: Findings) -> None:
    """Ranges of what its equations, which can be read, do not hold."""
    path: YamlPath = ("effects", index)
    used = _used(effect)
    for name, (low, high) in effect.seen.items():
        here = (*path, "seen", name)
        if name not in used or name in effect.parameters:
            hint = did_you_mean(name, sorted(used - set(effect.parameters)))
            findings.add(here, "no column of its equations", value=name, expected=hint)
        elif low > high:
            expected = "the lower end first"
            findings.add(here, "wrong value", value=[low, high], expected=expected)


def _used(effect: Effect) -> set[str]:
    return {name for text in effect.equations.values() for name in names(parse(text))}


def effect_notices(machine: Machine, document: YamlDocument) -> Iterator[Notice]:
    """Of parameters that nothing holds or that count as exactly known, and of kelvin set against
    degC.
    """
    for index, effect in enumerate(machine.effects):
        shown = f"{document.source.shown}:{document.line_of('effects', index)}: effects[{index}]"
        used = _used(effect)
        for name in [name for name in effect.parameters if name not in used]:
            message = f"{shown}.parameters.{name}: in no equation"
            yield Notice(code="unused-parameter", message=message)
        without = [n for n, p in effect.parameters.items() if "u" not in p.model_fields_set]
        if effect.covariance is None and without:
            text = f"{shown} ({effect.name}): no u of {', '.join(without)} is given"
            count = "it counts" if len(without) == 1 else "they count"
            message = f"{text}, {count} as exactly known"
            yield Notice(code="no-uncertainty", message=message)
        for key, equation in effect.equations.items():
            for column, value in _kelvin(parse(equation), effect):
                message = (
                    f"{shown}.equations.{key}: {column} is in degC, {value:g} taken off it seems "
                    f"to be in kelvin: in degC it would be {value - KELVIN:.4g}"
                )
                yield Notice(code="kelvin", message=message)


def _kelvin(tree: Node, effect: Effect) -> Iterator[tuple[str, float]]:
    """Temperatures by column from which a number is taken off that no shop has in degC."""
    for node in walk(tree):
        match node:
            case Binary("-", Name(column), Number(value)):
                pass
            case Binary("-", Number(value), Name(column)):
                pass
            case _:
                continue
        if COLDEST_K < value < HOTTEST_K and _in_degc(column, effect):
            yield column, value


def _in_degc(column: str, effect: Effect) -> bool:
    """A column of a user's own may be in kelvin: it is not where it was seen lower."""
    own = looks_like_temperature(column) and column in effect.seen
    return is_temperature(column) or (own and effect.seen[column][1] < COLDEST_K)
