"""Units of equations: lengths must not be added to angles, nor a sine be taken of a length.

One algebra serves machines, effects, budgets and graphs; the rule of every operation stands in the
table of functions. A name without a known unit (a constant, say) may stand for anything. In a sum a
literal has the unit of the other side; beside a ratio that is neither in deg, arcmin, arcsec or %
nor in the unit of a name that stands there alone (um/m of um/m/K times K) it is a plain number. As
a factor it has what the `Algebra` says; in the argument of a function, as in ``exp(-t/30 + 1)``, it
may have any, so that its dimension is not judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.language.functions import FUNCTIONS
from mtu_cli.language.tree import (
    Call,
    Name,
    Node,
    Number,
    first_column,
    has_literal,
    literal_value,
    names,
    short_text,
    terms,
)
from mtu_cli.units import ANY, PLAIN, Powers, Unit, parameter_units_of, unit_powers

NO_LENGTH = Powers((0.0, *ANY.exponents[1:]))
"""Of a literal factor that is no length, but may be a number of kelvin or minutes."""
ANGLES = ("deg", "arcmin", "arcsec")
"""Units of angles in which numbers are written."""
KEEPING = ("**", "sqrt", "abs")
"""Functions of which one or two together keep a unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Algebra:
    """The units of terms by the `units` of names; what does not agree goes to `faults`.

    `factor`: the unit of a literal factor, ``0.004*dir_x``. `empirical`: a function of what holds
    literals, as exp(34 - 6292/T), may have any unit; elsewhere a broken exponent is not known, as
    ``2*sqrt(x)`` has a 2 in some unit. `names` of units for messages.
    """

    units: Mapping[str, Powers]
    factor: Powers = ANY
    empirical: bool = False
    names: Mapping[str, Powers] = field(default_factory=dict)
    faults: list[Finding] = field(default_factory=list)

    def of(self, node: Node) -> Powers:
        """The unit of a term, `ANY` where it is not known or its parts disagree."""
        match node:
            case Number():
                return ANY
            case Name(name):
                return self.units.get(name, ANY)
        first, last = node.arguments[0], node.arguments[-1]
        match FUNCTIONS[node.function].unit:
            case "product":
                return self._of_factor(first) * self._of_factor(last)
            case "quotient":
                return self._of_factor(first) / self._of_factor(last)
            case "power" | "root" as rule:
                exponent = 0.5 if rule == "root" else literal_value(last)
                if exponent is None:
                    self._check_number(last, "an exponent")
                    return self.of(first) * ANY
                result = self.of(first) ** exponent
                return result if self.empirical else result.whole
            case "same" if first is last:
                return self.of(first)
            case "same":
                return self._alike(first, last, node.column, "added")
            case "alike":
                self._alike(first, last, node.column, "compared")
            case "number":
                self._check_number(first, f"the argument of {node.function}")
                if self.empirical and has_literal(first):
                    return ANY
            case "any":
                self.of(first)
        return PLAIN

    def _of_factor(self, node: Node) -> Powers:
        return self.of(node) if literal_value(node) is None else self.factor

    def _alike(self, left: Node, right: Node, column: int, verb: str) -> Powers:
        one, other = self.of(left), self.of(right)
        for side, rest, unit in ((left, right, other), (right, left, one)):
            if (value := literal_value(side)) is None:
                continue
            if _has_literal_factor(rest):  # in 1 + x/500 the 500 may be mm
                return unit * ANY
            # The 90 of phi - 90 is in deg, the 1 of 1 + alpha*dT is no number of um/m.
            units = [self.units.get(name, ANY) for name in _names_alone(rest)]
            units += map(unit_powers, ("1", "%", *ANGLES))
            in_unit = not unit.alike(PLAIN) or any(map(unit.agrees, units))
            if value and verb == "added" and not in_unit:
                expected = times(unit, PLAIN, short_text(rest)) or "a plain number"
                of = f"what is added to {short_text(side)}"
                self.add(of, unit, PLAIN, expected, column=column)
                return ANY
            return unit
        if one.agrees(other):
            return one | other
        expected = "terms of one unit" + times(other, one, f": {short_text(right)}")
        self.add(f"what is {verb}", other, one, expected, column=column)
        return ANY

    def _check_number(self, node: Node, what: str) -> None:
        powers = self.of(node)
        # Empirical equations take logarithms of numbers: log(t + 273.15); none takes degrees.
        angle = any(map(powers.agrees, map(unit_powers, ANGLES)))
        if powers.agrees(PLAIN) or (has_literal(node) and not angle):
            return
        expected = "a plain number, or an angle in rad" + times(powers, PLAIN, ": the argument")
        self.add(what, powers, PLAIN, expected, column=first_column(node), value=short_text(node))

    def add(self, of: str, unit: Powers, target: Powers, expected: str, **place: Any) -> None:
        """A fault: what is of a `unit` that is not the `target`."""
        facts = {"unit": unit.text(self.names), "wanted": target.text(self.names)}
        self.faults.append(finding("wrong-unit", of=of, **facts, expected=expected, **place))


def _names_alone(node: Node) -> Iterator[str]:
    """The names in a term whose unit may be the term's: not those of products, but those in sums
    and in what keeps a unit, as sqrt(a**2 + b**2).
    """
    for term in terms(node):
        match term:
            case Name(name):
                yield name
            case Call(function, arguments) if function in KEEPING:
                yield from _names_alone(arguments[0])


def _has_literal_factor(node: Node) -> bool:
    match node:
        case Call("*" | "/" | "neg", factors):
            return any(literal_value(f) is not None or _has_literal_factor(f) for f in factors)
    return False


def times(powers: Powers, target: Powers, what: str) -> str:
    """By what a quantity is to be multiplied for another unit; nothing if no factor does it."""
    off = powers.size - target.size
    if not powers.alike(target) or math.isnan(off):
        return ""
    return f"{what} times {10.0**off:.6g}"


def check_dimension(
    node: Node,
    target: Powers,
    units: Mapping[str, Powers],
    parameters: Mapping[str, Unit],
    columns: Mapping[str, Powers],
) -> None:
    """Checks an equation of a machine, whose terms all have the unit `target`, in internal units.

    `units` of names hold in every term, those of the `columns` of the data only in terms with
    `parameters`, whose unit the file states: without them ``0.004*dir_x`` is 0.004 mm and right.

    Raises InputError with all that does not agree: terms of another unit, sums of two, functions
    of plain numbers of what is none.
    """
    all_units = {**units, **columns, **{name: unit.powers for name, unit in parameters.items()}}
    faults: list[Finding] = []
    for term in terms(node):
        symbol = next((name for name in names(term) if name in parameters), None)
        algebra = Algebra(units=units if symbol is None else all_units, factor=NO_LENGTH)
        powers, expected = algebra.of(term), f"a term that is {target.text()}"
        faults += algebra.faults
        if powers.agrees(target) or algebra.faults:
            continue
        if powers.exponents[0] < target.exponents[0]:
            expected = "its lever arm as a factor (a position or a named constant)"
        if symbol is not None:
            unit, ratio = parameters[symbol], (powers / target).exponents
            plain = not any(unit.powers.exponents[1:-1]) and ratio[0] == 0
            if meant := parameter_units_of(unit.powers * target / powers, unit.name):
                expected = f"{symbol} in {' or '.join(meant)}"
            elif plain and any(power > 1 for power in ratio):
                # In no unit is it right, as beside a temperature squared.
                continue
        column, text = first_column(term), short_text(term)
        algebra.add("this term", powers, target, expected, column=column, value=text)
        faults += algebra.faults
    if faults:
        raise InputError(faults)


def check_consistent(
    node: Node, units: Mapping[str, Powers], target: Powers, names: Mapping[str, Powers]
) -> tuple[list[Finding], Finding | None]:
    """Checks an equation of numbers that are calculated with as they stand, as a budget's are; a
    literal factor may have any unit. Returns the faults within the equation, and if there is none
    that of its result, which should be in the unit `target`.

    >>> from mtu_cli.language.parser import parse
    >>> from mtu_cli.units import unit_powers
    >>> named = {unit: unit_powers(unit) for unit in ("mm", "um")}
    >>> (fault,), _ = check_consistent(
    ...     parse("a + b"), {"a": named["mm"], "b": named["um"]}, named["mm"], named)
    >>> print(fault)
    what is added is um, not mm at column 3; expected terms of one unit: b times 0.001
    """
    algebra = Algebra(units=units, empirical=True, names=names)
    powers = algebra.of(node)
    if algebra.faults or powers.agrees(target):
        return algebra.faults, None
    how = times(powers, target, "the equation") or "an equation that gives this unit"
    algebra.add("the result", powers, target, how)
    return [], algebra.faults[0]
