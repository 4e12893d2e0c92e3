"""The equations of a machine file: known names, linear in the components, in mm."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mtu_cli.errors import did_you_mean
from mtu_cli.files.column_dimensions import POSITIONS, columns_of, own_columns
from mtu_cli.files.contract_errors import path_text
from mtu_cli.files.contract_shapes import keys_at
from mtu_cli.files.contracts import Findings
from mtu_cli.files.covariates import COVARIATES, is_covariate
from mtu_cli.files.effect_checks import parameter_units
from mtu_cli.files.machine_contract import Effect, Machine
from mtu_cli.files.yaml_file import YamlPath
from mtu_cli.language import EquationError, LinearForm, Node, check_dimension, linear_form, names
from mtu_cli.language import parse as parse_equation
from mtu_cli.language.finite import check_finite
from mtu_cli.units import LENGTH, UNITS, Unit

__all__ = ["POSITIONS", "Vocabulary", "check_equations"]

OTHER_AXES = ("u", "v", "w")
POSITIONS_EXPECTED = "x, y and z for positions along the axes"


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """The names that equations may use; `linear` are those they must be linear in.

    `dimensions` are exponents of length, None where a name may stand for anything. `parameters`
    are those of an effect, with their units; `constants` are no columns, whatever their names, and
    `values` those of them that have a sound value; `axes` are names that stand for axes, and must
    not.
    """

    linear: frozenset[str]
    dimensions: Mapping[str, int | None]
    constants: frozenset[str] = frozenset()
    values: Mapping[str, float] = field(default_factory=dict)
    axes: frozenset[str] = frozenset()
    parameters: Mapping[str, Unit] = field(default_factory=dict)

    @classmethod
    def of(cls, machine: Machine, findings: Findings, axes: Iterable[str] = ()) -> Vocabulary:
        """The names of a machine; those whose own entry is faulty count as known, and so do `axes`
        by other names that are told.
        """
        components = findings.keys("components")
        dimensions: dict[str, int | None] = dict.fromkeys(axes, LENGTH)
        # Positions come first in a hint, then what is the machine's own.
        dimensions |= dict.fromkeys((*POSITIONS, *components))
        dimensions |= dict.fromkeys((*findings.keys("constants"), *_misplaced(findings)))
        dimensions |= dict.fromkeys(COVARIATES)
        dimensions |= dict.fromkeys(name for name in machine.covariates or () if name is not None)
        dimensions |= dict.fromkeys(POSITIONS, LENGTH)
        for name, component in (machine.components or {}).items():
            dimensions[name] = UNITS[component.unit].dimension
        values = {name: item.value for name, item in (machine.constants or {}).items()}
        constants = frozenset(findings.keys("constants"))
        return cls(frozenset(components), dimensions, constants, values, frozenset(axes))

    def with_parameters(self, effect: Effect) -> Vocabulary:
        """These names and the parameters of one effect."""
        units = parameter_units(effect)
        own = {name: unit.dimension for name, unit in units.items()}
        known = {**own, **self.dimensions, **own}
        return replace(self, linear=self.linear | set(own), dimensions=known, parameters=units)


def _misplaced(findings: Findings) -> Iterator[str]:
    """Names below a key that is unknown, `constant` for `constants`: that it is, is told."""
    for key, value in findings.document.data.items():
        if key not in keys_at(Machine, ()) and isinstance(value, (dict, list)):
            yield from (name for name in value if isinstance(name, str))


def check_equations(
    equations: Mapping[Any, str] | None, vocabulary: Vocabulary, findings: Findings, path: YamlPath
) -> dict[str, LinearForm]:
    """Each sound equation as a linear form; the faults of the others go to `findings`."""
    forms = {}
    unknown: dict[str, dict[str, int]] = {}
    for name, text in (equations or {}).items():
        try:
            node = parse_equation(text)
        except EquationError as error:
            _add(findings, (*path, name), error)
            continue
        own = _unknown(node, vocabulary)
        for other, column in own.items():
            unknown.setdefault(other, {})[name] = column
        form = None if own else _linear(node, vocabulary, findings, (*path, name))
        if form is not None:
            forms[name] = form
    axes = [name for name in unknown if name.casefold() in OTHER_AXES]
    told = [axes, *([name] for name in unknown if name not in axes)]
    if len(axes) < 2:
        told = [[name] for name in unknown]
    for own_names in told:
        _tell_unknown(own_names, unknown, vocabulary, findings, path)
    return forms


def _tell_unknown(
    told: Sequence[str],
    unknown: Mapping[str, Mapping[str, int]],
    vocabulary: Vocabulary,
    findings: Findings,
    path: YamlPath,
) -> None:
    """One fault of names that nothing knows, at the first of their equations and columns; several
    are the letters of other axes.
    """
    first, *others = dict.fromkeys(key for name in told for key in unknown[name])
    also = f" (also in {', '.join(others)})" if others else ""
    hint = POSITIONS_EXPECTED
    if len(told) == 1:
        known = [own for own in vocabulary.dimensions if own not in vocabulary.axes]
        hint = did_you_mean(told[0], known)
    what = f"unknown name{'s' * (len(told) > 1)} {', '.join(map(repr, told))}{also}"
    column = min(unknown[name][first] for name in told if first in unknown[name])
    _add(findings, (*path, first), EquationError(what, column, hint))


def _unknown(node: Node, vocabulary: Vocabulary) -> dict[str, int]:
    """The names that nothing knows, with their columns."""
    return {
        name: column
        for name, column in names(node).items()
        if name not in vocabulary.dimensions and not is_covariate(name)
    }


def _linear(
    node: Node, vocabulary: Vocabulary, findings: Findings, path: YamlPath
) -> LinearForm | None:
    try:
        check_finite(node, vocabulary.values)
        form = linear_form(node, vocabulary.linear, vocabulary.parameters)
        taken = vocabulary.linear | vocabulary.constants
        # A component has no unit per kelvin or step of a column: beside one anything may be meant.
        columns = columns_of(own_columns(names(node), taken), vocabulary.parameters)
        check_dimension(node, LENGTH, vocabulary.dimensions, columns)
    except EquationError as error:
        _add(findings, path, error)
        return None
    return form


def _add(findings: Findings, path: YamlPath, error: EquationError) -> None:
    document = findings.document
    line = document.line_of(*path)
    findings.problems.append(
        error.problem(file=document.source.shown, line=line, path=path_text(path))
    )
