"""Units of equations: lengths must not be added to angles, nor a sine be taken of a length.

One algebra serves machines, effects, budgets and graphs. A name without a known unit (a constant,
say) may stand for anything. In a sum a literal has the unit of the other side; as a factor it has
what the `Algebra` says; in the argument of a function, as in ``exp(-t/30 + 1)``, it may have any,
so that its dimension is not judged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.tree import (
    Binary,
    Call,
    Name,
    Negative,
    Node,
    Number,
    children,
    first_column,
    literal_value,
    names,
    shown,
    terms,
)
from mtu_cli.units import ANY, PLAIN, Powers, Unit, parameter_units_of

SIMPLE = 12
"""Numerator and denominator of the largest simple fraction."""


def any_unit(_: float) -> Powers:
    """A literal factor whose unit is not written: ``0.004*dir_x``."""
    return ANY


def no_length(_: float) -> Powers:
    """A literal factor that is no length, but may be a number of kelvin or minutes."""
    return Powers((0.0, *ANY.exponents[1:]))


def plain_number(_: float) -> Powers:
    """A literal factor without a unit."""
    return PLAIN


def simple_fraction(value: float) -> Powers:
    """A literal factor without a unit if it is a simple fraction, perhaps times a power of pi; any
    other may convert one unit into another (1000, 180/pi).
    """
    if abs(value) != 1.0 and math.log10(abs(value) or 1.0) % 1.0 == 0.0:
        return ANY
    for power in range(-2, 3):
        for q in range(1, SIMPLE + 1):
            p = abs(value) / math.pi**power * q
            if abs(p - round(p)) < 1e-9 and 1 <= round(p) <= SIMPLE:
                return PLAIN
    return ANY


@dataclass(frozen=True, slots=True, kw_only=True)
class Algebra:
    """The units of terms by the `units` of names; what does not agree goes to `faults`.

    `empirical`: a function of what holds literals, as exp(34 - 6292/T), may have any unit.
    `whole`: a broken exponent is not known, as ``2*sqrt(x)`` has a 2 in some unit. `sizes_only`:
    only units of one dimension and different sizes are at fault. `names` of units for messages.
    """

    units: Mapping[str, Powers]
    factor: Callable[[float], Powers] = any_unit
    empirical: bool = False
    whole: bool = False
    sizes_only: bool = False
    names: Mapping[str, Powers] = field(default_factory=dict)
    faults: list[Finding] = field(default_factory=list)

    def of(self, node: Node) -> Powers:
        """The unit of a term, `ANY` where it is not known or its parts disagree."""
        match node:
            case Number():
                return ANY
            case Name(name):
                return self.units.get(name, ANY)
            case Negative(operand):
                return self.of(operand)
            case Call(function, arguments, column):
                return self._of_call(function, arguments, column)
            case Binary("**", base, exponent):
                power = literal_value(exponent)
                if power is None:
                    self._check_number(exponent, "an exponent")
                    return self.of(base) * ANY
                return self._raised(self.of(base), power)
            case Binary("+" | "-", left, right, column):
                # In 1 + x/500 the 500 may be mm.
                for side, other in ((left, right), (right, left)):
                    if literal_value(side) is not None and _has_literal_factor(other):
                        return self.of(other) * ANY
                return self._alike(left, right, column, "added")
            case Binary(sign, left, right):
                factors = self._of_factor(left), self._of_factor(right)
                return factors[0] * factors[1] if sign == "*" else factors[0] / factors[1]
        raise AssertionError(node)

    def differ(self, one: Powers, other: Powers) -> bool:
        """Whether two units that should be one are not."""
        if self.sizes_only:
            return one.known and other.known and one.alike(other) and not one.agrees(other)
        return not one.agrees(other)

    def _of_factor(self, node: Node) -> Powers:
        value = literal_value(node)
        return self.of(node) if value is None else self.factor(value)

    def _of_call(self, function: str, arguments: tuple[Node, ...], column: int) -> Powers:
        match BUDGET_FUNCTIONS[function].unit:
            case "same":
                return self.of(arguments[0])
            case "root":
                return self._raised(self.of(arguments[0]), 0.5)
            case "alike":
                self._alike(arguments[0], arguments[1], column, "compared")
            case "number":
                self._check_number(arguments[0], function)
                if self.empirical and _has_literal(arguments[0]):
                    return ANY
            case _:
                self.of(arguments[0])
        return PLAIN

    def _raised(self, base: Powers, power: float) -> Powers:
        found = base**power
        if not self.whole:
            return found
        return Powers(tuple(own if own == round(own, 0) else math.nan for own in found.exponents))

    def _alike(self, left: Node, right: Node, column: int, verb: str) -> Powers:
        one, other = self.of(left), self.of(right)
        if one.agrees(other):
            return one | other
        if self.differ(one, other):
            texts = {"one": self.text(one), "other": self.text(other), "verb": verb}
            expected = "terms of one unit" + _times(other, one, "the latter")
            self.faults.append(finding("units-differ", column=column, expected=expected, **texts))
        return ANY

    def _check_number(self, argument: Node, function: str) -> None:
        found = self.of(argument)
        # Empirical equations take logarithms of numbers: log(t + 273.15).
        if (not self.sizes_only and _has_literal(argument)) or not self.differ(found, PLAIN):
            return
        expected = "a plain number, or an angle in rad" + _times(found, PLAIN, "the argument")
        self.faults.append(
            finding(
                "argument-unit",
                function=function,
                unit=self.text(found),
                column=first_column(argument),
                value=shown(argument),
                expected=expected,
            )
        )

    def text(self, powers: Powers) -> str:
        """A unit as messages name it."""
        return powers.text(self.names)


def _times(found: Powers, wanted: Powers, what: str) -> str:
    """By what a quantity is to be multiplied for another unit; nothing if no factor does it."""
    off = found.size - wanted.size
    if not found.alike(wanted) or math.isnan(off):
        return ""
    return f": {what} times {10.0**off:.6g}"


def _has_literal(node: Node) -> bool:
    if isinstance(node, Binary) and node.operator == "**":
        return _has_literal(node.left)
    return isinstance(node, Number) or any(map(_has_literal, children(node)))


def _has_literal_factor(node: Node) -> bool:
    match node:
        case Negative(operand):
            return _has_literal_factor(operand)
        case Binary("*" | "/", left, right):
            return any(
                literal_value(f) is not None or _has_literal_factor(f) for f in (left, right)
            )
    return False


def check_dimension(
    node: Node,
    wanted: Powers | None,
    units: Mapping[str, Powers],
    *,
    parameters: Mapping[str, Unit] | None = None,
    columns: Mapping[str, Powers] | None = None,
    free: bool = False,
) -> None:
    """Checks an equation of a machine, whose terms are all to be `wanted`, in internal units.

    `units` of names are known everywhere, those of the `columns` of the data only beside
    `parameters`, whose unit the file states: without them ``0.004*dir_x`` is 0.004 mm and right.
    `free`: any number may have a unit that is not written, and a plain number stands for anything.

    Raises InputError with all that does not agree: terms of another unit, sums of two, functions
    of plain numbers of what is none.
    """
    stated, beside = parameters or {}, {**units, **(columns or {})}
    beside |= {name: unit.powers for name, unit in stated.items()}
    faults: list[Finding] = []
    for term in terms(node):
        own = next((name for name in names(term) if name in stated), None)
        known = units if own is None else beside
        factor = any_unit if free else no_length
        algebra = Algebra(units=known, factor=factor, empirical=free, whole=True)
        found = algebra.of(term)
        faults += algebra.faults
        if algebra.faults or wanted is None or found.agrees(wanted):
            continue
        if free and (not found.known or found.alike(PLAIN)):
            continue
        unit = None if own is None else stated[own]
        meant = [] if unit is None else _units_for(unit, found, wanted)
        if unit is not None and not meant and _is_power(unit, found, wanted):
            continue
        expected = f"{own} in {' or '.join(meant)}" if meant else _factors(found, wanted, free)
        faults.append(
            finding(
                "wrong-unit",
                of="this term",
                unit=found.text(),
                wanted=wanted.text(),
                column=first_column(term),
                value=shown(term),
                expected=expected,
            )
        )
    if free and not faults:
        whole = Algebra(units=units, empirical=True, whole=True)
        whole.of(node)
        faults = whole.faults
    if faults:
        raise InputError(faults)


def _units_for(unit: Unit, found: Powers, wanted: Powers) -> list[str]:
    """Units of a parameter that would make its term right."""
    return parameter_units_of(unit.powers * wanted / found, unit.name)


def _is_power(unit: Unit, found: Powers, wanted: Powers) -> bool:
    """Whether a term has the square of a temperature or time alone, which no unit can be per."""
    over = [own for own in (found / wanted).exponents if own and not math.isnan(own)]
    length = found.exponents[0]
    return unit.per is None and length == wanted.exponents[0] and len(over) == 1 and over[0] > 1


def _factors(found: Powers, wanted: Powers, free: bool) -> str:
    if free:
        return "a number before it that has the unit of the rest, such as 0.004*"
    if found.exponents[0] < wanted.exponents[0]:
        return "its lever arm as a factor (a position or a named constant)"
    return f"a term that is {wanted.text()}"


def check_consistent(
    node: Node, units: Mapping[str, Powers], stated: Powers, names: Mapping[str, Powers]
) -> tuple[list[Finding], Finding | None]:
    """Checks an equation of numbers that are calculated with as they stand, as a budget's are.

    First no literal factor is taken for a plain number; then simple fractions are, and only units
    of one dimension and different sizes are at fault. Returns the faults within the equation, and
    if there is none that of its result, which should be `stated`.

    >>> from mtu_cli.language.parser import parse
    >>> from mtu_cli.units import unit_powers
    >>> named = {unit: unit_powers(unit) for unit in ("mm", "um")}
    >>> (fault,), _ = check_consistent(
    ...     parse("a + b"), {"a": named["mm"], "b": named["um"]}, named["mm"], named)
    >>> print(fault)
    mm and um are added at column 3; expected terms of one unit: the latter times 0.001
    """
    found = ANY
    for factor, sizes_only in ((any_unit, False), (simple_fraction, True)):
        algebra = Algebra(
            units=units,
            factor=factor,
            empirical=not sizes_only,
            sizes_only=sizes_only,
            names=names,
        )
        found = algebra.of(node)
        if algebra.faults:
            return algebra.faults, None
        if algebra.differ(found, stated):
            unit, wanted = algebra.text(found), algebra.text(stated)
            how = _times(found, stated, "the equation") or ": an equation that gives this unit"
            fault = finding(
                "wrong-unit", of="the result", unit=unit, wanted=wanted, expected=how[2:]
            )
            return [], fault
    return [], None
