"""Coefficients of a machine file that give errors as no machine has them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from mtu_cli.errors import Notice
from mtu_cli.files.contract_errors import path_text
from mtu_cli.files.machine_contract import Component, Machine
from mtu_cli.files.yaml_file import YamlDocument, YamlPath
from mtu_cli.findings import Finding
from mtu_cli.language import LinearForm, Node, evaluate, names
from mtu_cli.language.dimensions import signed_terms
from mtu_cli.units import UNITS

if TYPE_CHECKING:
    from mtu_cli.files.reading_cells import Travels

PLACES = 101
"""Places along a travel at which a component is looked at."""


LARGE_MM = 0.1
"""A constant of an equation from which it is more than a machine is wrong by everywhere."""


def large_constants(
    machine: Machine,
    forms: Mapping[str, LinearForm],
    effect_forms: Sequence[Mapping[str, LinearForm]],
    document: YamlDocument,
) -> Iterator[Finding]:
    """Of equations whose terms without position, column and component add up to a length that is
    no error: 5 for 5 um. Tool lengths and arms stand beside an angle and are no such term.
    """
    known = {name: item.value for name, item in machine.constants.items()}
    places: list[tuple[YamlPath, LinearForm]]
    places = [(("equations", name), form) for name, form in forms.items()]
    for index, own in enumerate(effect_forms):
        places += [(("effects", index, "equations", name), form) for name, form in own.items()]
    for path, form in places:
        total = 0.0 if form.remainder is None else _constant(form.remainder, known)
        if abs(total) >= LARGE_MM:
            text = (
                f"{document.source.shown}:{document.line_of(*path)}: {path_text(path)}: its "
                f"constant terms make {total:g} mm, large for an error everywhere; equations are "
                f"in mm: is {total / 1000:g}, for {total:g} um, meant?"
            )
            yield Notice(code="constant-large", message=text)


def _constant(remainder: Node, known: Mapping[str, float]) -> float:
    """The sum, mm, of the terms that hold numbers and constants alone; 0 beside a term with a
    position or a column, which may take it off again: ``k*T - 20*k``, ``0.001*x - 0.2``.
    """
    total = 0.0
    for sign, term in signed_terms(remainder):
        others = set(names(term)) - set(known)
        if not others:
            total += sign * float(evaluate(term, known))
        elif not all(name.startswith("dir_") for name in others):
            return 0.0
    return total


def large_coefficients(component: Component, travels: Travels) -> str | None:
    """What to ask about a component whose polynomial is larger along its axis' travel than
    readings may be without a question; None for a sound one, and where no travel is stated.
    """
    import numpy as np

    from mtu_cli.files.reading_cells import largest_errors, look_large

    travel = None if component.of is None else travels.get(component.of)
    if component.coefficients is None or travel is None:
        return None
    unit = UNITS[component.unit]
    low, high = travel
    positions = np.linspace(low, high, PLACES)
    with np.errstate(over="ignore", invalid="ignore"):
        found = np.polynomial.polynomial.polyval(positions, np.array(component.coefficients))
        errors = np.abs(np.nan_to_num(found * unit.to_internal, nan=np.inf))
    most = largest_errors(unit.dimension, positions, travels)
    if not look_large(errors, most, unit.dimension):
        return None
    per_metre = ""
    if component.degree:
        slope = component.coefficients[1] * 1000
        per_metre = (
            f"; slopes are per mm of position, so that {component.coefficients[1]:g} is "
            f"{slope:g} {unit.name} per metre"
        )
    return (
        f"large errors for a machine: up to {errors.max() / unit.to_internal:.3g} {unit.name} over "
        f"the travel of {low:g} to {high:g} mm; are the coefficients in the unit they state"
        f"{per_metre}?"
    )
