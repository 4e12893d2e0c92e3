"""The equations of a machine file: known names, linear in the components, in mm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mtu_cli.errors import did_you_mean
from mtu_cli.files.column_dimensions import POSITIONS, columns_of, own_columns
from mtu_cli.files.contract_errors import path_text
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


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """The names that equations may use; `linear` are those they must be linear in.

    `dimensions` are exponents of length, None where a name may stand for anything. `parameters`
    are those of an effect, with their units; `constants` are no columns, whatever their names, and
    `values` those of them that have a sound value.
    """

    linear: frozenset[str]
    dimensions: Mapping[str, int | None]
    constants: frozenset[str] = frozenset()
    values: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, Unit] = field(default_factory=dict)

    @classmethod
    def of(cls, machine: Machine, findings: Findings) -> Vocabulary:
        """The names of a machine; those whose own entry is faulty count as known."""
        components = findings.keys("components")
        dimensions: dict[str, int | None] = dict.fromkeys(components)
        dimensions |= dict.fromkeys(findings.keys("constants"))
        dimensions |= dict.fromkeys(COVARIATES)
        dimensions |= dict.fromkeys(name for name in machine.covariates or () if name is not None)
        dimensions |= dict.fromkeys(POSITIONS, LENGTH)
        for name, component in (machine.components or {}).items():
            dimensions[name] = UNITS[component.unit].dimension
        values = {name: item.value for name, item in (machine.constants or {}).items()}
        constants = frozenset(findings.keys("constants"))
        return cls(frozenset(components), dimensions, constants, values)

    def with_parameters(self, effect: Effect) -> Vocabulary:
        """These names and the parameters of one effect."""
        units = parameter_units(effect)
        own = {name: unit.dimension for name, unit in units.items()}
        known = {**own, **self.dimensions, **own}
        return Vocabulary(self.linear | set(own), known, self.constants, self.values, units)


def check_equations(
    equations: Mapping[Any, str] | None, vocabulary: Vocabulary, findings: Findings, path: YamlPath
) -> dict[str, LinearForm]:
    """Each sound equation as a linear form; the faults of the others go to `findings`."""
    forms = {}
    for name, text in (equations or {}).items():
        try:
            node = parse_equation(text)
        except EquationError as error:
            _add(findings, (*path, name), error)
            continue
        if _names_are_known(node, vocabulary, findings, (*path, name)):
            form = _linear(node, vocabulary, findings, (*path, name))
            if form is not None:
                forms[name] = form
    return forms


def _names_are_known(
    node: Node, vocabulary: Vocabulary, findings: Findings, path: YamlPath
) -> bool:
    unknown = [
        (name, column)
        for name, column in names(node).items()
        if name not in vocabulary.dimensions and not is_covariate(name)
    ]
    for name, column in unknown:
        hint = did_you_mean(name, vocabulary.dimensions)
        _add(findings, path, EquationError(f"unknown name {name!r}", column, hint))
    return not unknown


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
