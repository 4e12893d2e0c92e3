"""What the effects of a machine file must fulfil beyond their shape, and what is odd about them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from mtu_cli.errors import Notice, did_you_mean
from mtu_cli.files.column_dimensions import columns_of, own_columns
from mtu_cli.files.contracts import Findings
from mtu_cli.files.covariates import (
    COLDEST_K,
    KELVIN,
    is_temperature,
    like_kelvin,
    looks_like_temperature,
)
from mtu_cli.files.machine_contract import Effect, Machine
from mtu_cli.files.yaml_file import YamlDocument, YamlPath
from mtu_cli.findings import Finding
from mtu_cli.language import EquationError, Node, linear_form, names, parse
from mtu_cli.language.dimensions import base_scales, exponent
from mtu_cli.language.term_dimensions import units_per
from mtu_cli.language.tree import Binary, Name, Number, walk
from mtu_cli.units import MINUTE, PARAMETER_UNITS, Unit

FOUND_BY = "mtu close-loop"
TIME = "time_min"


def parameter_units(effect: Effect) -> dict[str, Unit]:
    """Units of its parameters; those that close-loop once wrote as um, where the time makes them
    um/min, are per minute.
    """
    units = {name: PARAMETER_UNITS[item.unit] for name, item in effect.parameters.items()}
    by = effect.found.get("by")
    if effect.covariate != TIME or not (isinstance(by, str) and by.startswith(FOUND_BY)):
        return units
    try:
        timed = _beside_the_time(effect)
    except EquationError:
        # The equations' own check tells it.
        return units
    per = {name: replace(units[name], per=MINUTE) for name in timed if units[name].per is None}
    return units | per


def _beside_the_time(effect: Effect) -> set[str]:
    """Parameters whose every lever is a time.

    Raises EquationError for equations that mean nothing.
    """
    found: dict[str, list[bool]] = {}
    for text in effect.equations.values():
        tree = parse(text)
        known = columns_of(own_columns(names(tree), effect.parameters), {})
        scale = base_scales(known.per)[MINUTE]
        for name, lever in linear_form(tree, effect.parameters).coefficients.items():
            found.setdefault(name, []).append(exponent(lever, scale) == 1)
    return {name for name, timed in found.items() if all(timed)}


LOWER_FIRST = "the lower end first"


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
            findings.add(here, "wrong value", value=[low, high], expected=LOWER_FIRST)
    for name, (low, high) in effect.within.items():
        here = (*path, "within", name)
        if name in used:
            expected = "the range of a column of its equations under `seen`"
            findings.add(here, "a name of its equations", value=name, expected=expected)
        elif not is_temperature(name):
            expected = "the column of a sensor: T_<name>_degC"
            findings.add(here, "no temperature", value=name, expected=expected)
        elif low > high:
            findings.add(here, "wrong value", value=[low, high], expected=LOWER_FIRST)


def _used(effect: Effect) -> set[str]:
    return {name for text in effect.equations.values() for name in names(parse(text))}


def effect_notices(machine: Machine, document: YamlDocument) -> Iterator[Finding]:
    """Of parameters that nothing holds, that count as exactly known or whose unit is not as it was
    written, and of kelvin set against degC.
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
        for name, unit in parameter_units(effect).items():
            if unit != PARAMETER_UNITS[unit.name]:
                right = next(iter(units_per(MINUTE, PARAMETER_UNITS[unit.name])), "per minute")
                message = f"{shown}.parameters.{name}: {unit.name} beside a time is read as {right}"
                yield Notice(code="unit-per-minute", message=message)
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
        if like_kelvin(value) and _in_degc(column, effect):
            yield column, value


def _in_degc(column: str, effect: Effect) -> bool:
    """A column of a user's own may be in kelvin: it is not where it was seen lower."""
    own = looks_like_temperature(column) and column in effect.seen
    return is_temperature(column) or (own and effect.seen[column][1] < COLDEST_K)
