"""Machine files (``mtu/machine/1``): read, checked, and their equations as linear forms."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from mtu_cli.errors import Notice
from mtu_cli.files.contracts import Findings, check_contract, present
from mtu_cli.files.effect_checks import check_effect_used, effect_notices
from mtu_cli.files.machine_axes import tell_axes_once
from mtu_cli.files.machine_checks import (
    check_components,
    check_effect_axis,
    check_effect_covariance,
    check_names,
    check_reference,
)
from mtu_cli.files.machine_contract import (
    Axis,
    Component,
    Constant,
    Effect,
    Machine,
    Parameter,
)
from mtu_cli.files.machine_equations import Vocabulary, check_equations
from mtu_cli.files.machine_sizes import large_coefficients, large_constants
from mtu_cli.files.source import Source
from mtu_cli.files.thermal_contract import missed_gradient
from mtu_cli.files.yaml_file import YamlDocument, read_yaml
from mtu_cli.findings import Finding
from mtu_cli.language import LinearForm

__all__ = [
    "Axis",
    "Component",
    "Constant",
    "Effect",
    "LoadedMachine",
    "Machine",
    "Parameter",
    "load_machine",
    "machine_from",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedMachine:
    """A checked machine with its equations written as linear forms in the components.

    `forms` by equation (``Ex``); `effect_forms` one such mapping an effect, linear in the
    effect's parameters and in the components.
    """

    source: Source
    machine: Machine
    forms: dict[str, LinearForm]
    effect_forms: tuple[dict[str, LinearForm], ...]
    warnings: tuple[Finding, ...]
    document: YamlDocument

    def line_of(self, *path: str | int) -> int | None:
        """The line of a value of the file: ``line_of("components", "dx_x")``."""
        return self.document.line_of(*path)

    @property
    def used(self) -> set[str]:
        """The components that stand in an equation."""
        return _used(self.forms, self.effect_forms)


def _used(
    forms: Mapping[str, LinearForm], effect_forms: Iterable[Mapping[str, LinearForm]]
) -> set[str]:
    return {
        name
        for group in (forms, *effect_forms)
        for form in group.values()
        for name in form.coefficients
    }


def load_machine(path: Path, role: str = "machine") -> LoadedMachine:
    """Reads and checks a machine file.

    Raises InputError with all problems of the file, each with its line.
    """
    return machine_from(read_yaml(path, role))


def machine_from(document: YamlDocument) -> LoadedMachine:
    """Checks a machine that was read already.

    Raises InputError with all problems of the document.
    """
    forms: dict[str, LinearForm] = {}
    effect_forms: list[dict[str, LinearForm]] = []

    def check(machine: Machine, findings: Findings) -> None:
        axes = tell_axes_once(findings)
        check_names(machine, findings)
        check_reference(machine, findings)
        check_components(machine, findings)
        if not findings.keys("components"):
            # That is told; so every name of every equation would be unknown.
            return
        vocabulary = Vocabulary.of(machine, findings, axes)
        forms.update(check_equations(machine.equations, vocabulary, findings, ("equations",)))
        for index, effect in present(machine.effects):
            check_effect_axis(effect, index, findings)
            check_effect_covariance(effect, index, findings)
            path = ("effects", index, "equations")
            own = vocabulary.with_parameters(effect)
            found = check_equations(effect.equations, own, findings, path)
            if len(found) == len(effect.equations):
                check_effect_used(effect, index, findings)
            effect_forms.append(found)

    machine = check_contract(document, Machine, "machine", check)
    return LoadedMachine(
        source=document.source,
        machine=machine,
        forms=forms,
        effect_forms=tuple(effect_forms),
        warnings=_warnings(machine, forms, effect_forms, document),
        document=document,
    )


_NEEDS_COEFFICIENTS = ("covariance", "s_repeat", "pass_covariance", "u_future")


def _warnings(
    machine: Machine,
    forms: dict[str, LinearForm],
    effect_forms: list[dict[str, LinearForm]],
    document: YamlDocument,
) -> tuple[Finding, ...]:
    notices = []
    used = _used(forms, effect_forms)
    shown = document.source.shown
    for name, component in machine.components.items():
        place = f"{shown}:{document.line_of('components', name)}: components.{name}"
        if name not in used:
            notices.append(Notice(code="unused-component", message=f"{place}: in no equation"))
        sure = component.coefficients is not None and all(
            getattr(component, key) is None for key in _NEEDS_COEFFICIENTS
        )
        if sure and name in used:
            message = f"{place}: no uncertainty is given, it counts as exactly known"
            notices.append(Notice(code="no-uncertainty", message=message, coefficients_of=name))
        if name in used and (large := large_coefficients(component, machine.travels)):
            message = f"{place}: {large}"
            notices.append(Notice(code="coefficients-large", message=message, coefficients_of=name))
        idle = [key for key in _NEEDS_COEFFICIENTS if getattr(component, key) is not None]
        if component.coefficients is None and idle:
            message = f"{place}: {', '.join(idle)} without coefficients: not used"
            notices.append(Notice(code="incomplete-component", message=message))
        notices += _thermal_notices(component, place)
    notices += large_constants(machine, forms, effect_forms, document)
    return (*notices, *effect_notices(machine, document))


def _thermal_notices(component: Component, place: str) -> list[Finding]:
    missed = None if component.thermal is None else missed_gradient(component.thermal)
    if component.thermal is None or missed is None:
        return []
    sensor, position, away = missed
    message = (
        f"{place}.thermal: a polynomial of degree {component.thermal.degree} does not pass through "
        f"the given gradients: that of {sensor} at {position:g} mm is off by {away:.3g} "
        f"{component.unit} per degC"
    )
    return [Notice(code="thermal-degree", message=message)]
