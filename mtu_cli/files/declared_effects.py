"""Effects that a machine file declares: units of their parameters, and where they were found."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from mtu_cli.files.column_dimensions import own_columns
from mtu_cli.files.contract import Faults
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.machine_contract import Effect, Machine
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, path_text
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.language import linear_form, names, parse
from mtu_cli.language.unit_algebra import Algebra
from mtu_cli.units import MINUTE, PARAMETER_UNITS, Unit, internal, parameter_units_of

FOUND_BY = "mtu close-loop"
TIME = "time_min"
LOWER_FIRST = "the lower end first"


def parameter_units(effect: Effect) -> dict[str, Unit]:
    """Units of its parameters; those that close-loop once wrote as um, where the time makes them
    um/min, are per minute.
    """
    units = {name: PARAMETER_UNITS[item.unit] for name, item in effect.parameters.items()}
    by = effect.found.get("by")
    if effect.covariate != TIME or not (isinstance(by, str) and by.startswith(FOUND_BY)):
        return units
    timed: dict[str, list[bool]] = {}
    try:
        for text in effect.equations.values():
            tree = parse(text)
            algebra = Algebra(units=own_columns(names(tree), effect.parameters), whole=True)
            for name, lever in linear_form(tree, effect.parameters).coefficients.items():
                timed.setdefault(name, []).append(algebra.of(lever).minute == 1)
    except InputError:
        # The equations' own check reports it.
        return units
    per = [name for name, own in timed.items() if all(own) and units[name].per is None]
    return units | {name: replace(units[name], per=MINUTE) for name in per}


def units_per_minute(unit: Unit) -> list[str]:
    """Units per time that are per minute what `unit` is."""
    return parameter_units_of(unit.powers / internal(minute=1), unit.name)


def check_ranges(effect: Effect, index: int, faults: Faults) -> None:
    """Ranges that an effect was found in, against the names of its equations, which are sound."""
    used = _used(effect)
    columns = used - set(effect.parameters)
    for key, ranges in (("seen", effect.seen), ("within", effect.within)):
        for name, (low, high) in ranges.items():
            here = ("effects", index, key, name)
            if key == "seen" and name not in columns:
                faults.unknown(here, name, sorted(columns), "column")
            elif key == "within" and name in used:
                where = "`seen`: its equations hold it"
                faults.add(here, "key-elsewhere", key=name, where=where)
            elif key == "within" and not is_temperature(name):
                expected = "the column of a sensor: T_<name>_degC"
                faults.add(here, "not-a-temperature", value=name, expected=expected)
            elif low > high:
                faults.add(here, "wrong-value", value=[low, high], expected=LOWER_FIRST)


def _used(effect: Effect) -> set[str]:
    return {name for text in effect.equations.values() for name in names(parse(text))}


def effect_warnings(machine: Machine, document: YamlDocument) -> Iterator[Finding]:
    """Parameters that no equation holds, that count as exactly known, or whose unit is not the
    one that is written.
    """
    for index, effect in enumerate(machine.effects):
        path: YamlPath = ("effects", index)
        place = {"file": document.source.shown, "line": document.line_of(*path)}
        used = _used(effect)
        for name in [name for name in effect.parameters if name not in used]:
            own = path_text((*path, "parameters", name))
            yield finding("unused-parameter", parameter=name, path=own, **place)
        without = [n for n, p in effect.parameters.items() if "u" not in p.model_fields_set]
        if effect.covariance is None and without:
            yield finding("no-uncertainty", names=without, path=path_text(path), **place)
        for name, unit in parameter_units(effect).items():
            if unit != PARAMETER_UNITS[unit.name]:
                own = path_text((*path, "parameters", name))
                yield finding("unit-per-minute", unit=unit.name, path=own, **place)
