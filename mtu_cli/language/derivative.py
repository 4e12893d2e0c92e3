"""Exact derivatives of equations to the third order, as Taylor polynomials carried up the tree.

Every node is expanded in two small numbers s and t along given directions and cut beyond the
third order. Nothing is approximated by differences and no expression grows, as it does where
a tree is differentiated into another tree. The third order is what JCGM 100:2008, 5.1.2, note,
needs beside the second.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mtu_cli.findings import Finding, finding
from mtu_cli.language.functions import BUDGET_FUNCTIONS, finite_value, numpy_function, value_of
from mtu_cli.language.parser import parse
from mtu_cli.language.tree import Call, Name, Node, Number
from mtu_cli.language.tree import names as names_in

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Directions = Callable[[str], FloatArray | None]
"""The two directions (2, pairs) of each pair along a name; None where they do not move it."""

KINKS = ("abs", "step")
"""Functions without a derivative at 0."""
ORDER = 3
TERMS = tuple((total - b, b) for total in range(ORDER + 1) for b in range(total + 1))
"""Exponents (a, b) of s^a t^b, in the order of the coefficients."""
PLACE = {term: i for i, term in enumerate(TERMS)}
_PRODUCTS = tuple(
    (i, j, PLACE[a + c, b + d])
    for i, (a, b) in enumerate(TERMS)
    for j, (c, d) in enumerate(TERMS)
    if a + b + c + d <= ORDER
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Derivatives:
    """An equation at a point: `value`, `first` (n,), `second` (n, n) and `third` (n,).

    `third` is d^3 f / d x_i^3. nan where a derivative does not exist; `faults` then says at
    which functions, with their columns. So it does of a function without a finite value; a sum
    or product that overflows leaves a `value` that is not finite without a fault.
    """

    value: float
    first: FloatArray
    second: FloatArray
    third: FloatArray
    faults: tuple[Finding, ...]


def derivatives(node: Node, values: Mapping[str, float], names: Sequence[str]) -> Derivatives:
    """The derivatives of an equation with respect to `names` (n) at `values`.

    Raises InputError for a name without a value.
    """
    n, symbols = len(names), names_in(node)
    rows = np.array([k for k, name in enumerate(names) if name in symbols], dtype=np.intp)
    # All pairs of the names that it has; without any there is its value.
    i, j = np.triu_indices(max(1, len(rows)))
    place = {names[row]: k for k, row in enumerate(rows)}

    def along(name: str) -> FloatArray | None:
        return np.array([i == place[name], j == place[name]], float) if name in place else None

    series, faults = taylor(node, values, along, len(i))
    first, third, second = np.zeros(n), np.zeros(n), np.zeros((n, n))
    if len(rows):
        same = i == j
        first[rows] = series[PLACE[1, 0], same]
        with np.errstate(over="ignore"):
            third[rows] = 6.0 * series[PLACE[3, 0], same]
        # The coefficient of s t is d2f/dxi dxj on the diagonal too, where both run along x_i.
        second[rows[i], rows[j]] = second[rows[j], rows[i]] = series[PLACE[1, 1]]
    return Derivatives(
        value=float(series[0, 0]), first=first, second=second, third=third, faults=tuple(faults)
    )


def taylor(
    node: Node, values: Mapping[str, float], along: Directions, pairs: int
) -> tuple[FloatArray, list[Finding]]:
    """Taylor coefficients (10, pairs) of ``f(x + s along(x)[0, p] + t along(x)[1, p])``.

    `TERMS` gives the order of the coefficients. Those that do not exist are nan; the second
    result says why. What is too large is inf or nan, without a warning of numpy's.

    Raises InputError for a name without a value.
    """
    expansion = _Expansion(values, along, pairs)
    with np.errstate(all="ignore"):
        return expansion.of(node), expansion.faults


def _product(left: FloatArray, right: FloatArray) -> FloatArray:
    series = np.zeros_like(left)
    for i, j, k in _PRODUCTS:
        series[k] += left[i] * right[j]
    return series


@dataclass(slots=True)
class _Expansion:
    """Polynomials of the nodes of a tree: arrays (10, pairs) of coefficients, which count up to
    `order`. What does not vary to the third order counts as a constant.
    """

    values: Mapping[str, float]
    along: Directions
    pairs: int
    order: int = ORDER
    faults: list[Finding] = field(default_factory=list)

    def of(self, node: Node) -> FloatArray:
        match node:
            case Number(value):
                return self.constant(value)
            case Name(name, column):
                series = self.constant(value_of(name, self.values, column))
                if (directions := self.along(name)) is not None:
                    series[[PLACE[1, 0], PLACE[0, 1]]] = directions
                return series
            case Call(function, arguments, column):
                return self.call(function, [self.of(item) for item in arguments], column)

    def call(self, function: str, parts: list[FloatArray], column: int) -> FloatArray:
        first, last = parts[0], parts[-1]
        match function:
            case "/":
                return _product(first, self.power(last, -1.0, "'/'", column))
            case "**":
                return self.raised(first, last, column)
            case "atan2":
                return self.atan2(first, last, column)
            case "*":
                return _product(first, last)
            case "+" | "-" | "neg":
                result: FloatArray = numpy_function(function)(*parts)
                return result
        at = float(first[0, 0])
        slopes = self.slopes(parse(BUDGET_FUNCTIONS[function].slope, BUDGET_FUNCTIONS), at)
        if function in KINKS and at == 0.0:
            slopes = [math.nan for _ in slopes]
        return self.chained(f"{function}()", finite_value(function, at), slopes, first, column)

    def constant(self, value: float) -> FloatArray:
        series = np.zeros((len(TERMS), self.pairs))
        series[0] = value
        return series

    def power(self, base: FloatArray, exponent: float, what: str, column: int) -> FloatArray:
        """base ** exponent for a constant exponent, negative bases and 0 included."""
        at, less = float(base[0, 0]), Number(exponent - 1.0, 0)
        first = Call("*", (Number(exponent, 0), Call("**", (Name("u", 0), less), 0)), 0)
        slopes = self.slopes(first, at) if exponent else [0.0]
        return self.chained(what, finite_value("**", at, exponent), slopes, base, column)

    def raised(self, base: FloatArray, exponent: FloatArray, column: int) -> FloatArray:
        if not np.any(exponent[1:]):
            return self.power(base, float(exponent[0, 0]), "'**'", column)
        value = finite_value("**", float(base[0, 0]), float(exponent[0, 0]))
        if value is None or base[0, 0] <= 0.0:
            return self.chained("'**' with an uncertain exponent", None, [], base, column)
        logarithm = self.call("log", [base], column)
        return self.call("exp", [_product(exponent, logarithm)], column)

    def atan2(self, y: FloatArray, x: FloatArray, column: int) -> FloatArray:
        angle = math.atan2(y[0, 0], x[0, 0])
        if y[0, 0] == 0.0 and x[0, 0] <= 0.0:
            # The angle jumps by 2 pi there, or is any angle at the origin: it has a value alone.
            varies = np.any(y[1:], axis=0) | np.any(x[1:], axis=0)
            what = "atan2(y, x) with y = 0"
            return self.without_slopes(self.constant(angle), varies, what, x, column)
        # The larger one divides; the derivatives of both forms are those of the angle.
        over, under, sign = (y, x, 1.0) if abs(x[0, 0]) >= abs(y[0, 0]) else (x, y, -1.0)
        ratio = _product(over, self.power(under, -1.0, "'/'", column))
        series = sign * self.call("atan", [ratio], column)
        series[0] = angle
        return series

    def slopes(self, first: Node, at: float) -> list[float]:
        """The derivatives of a function up to the order: the `first` is an equation in u, whose own
        are the others.
        """
        if self.order == 0:
            return []
        along = {"u": np.array([[1.0], [0.0]])}
        series = _Expansion({"u": at}, along.get, 1, self.order - 1).of(first)
        return [math.factorial(k) * float(series[PLACE[k, 0], 0]) for k in range(self.order)]

    def chained(
        self, what: str, value: float | None, slopes: list[float], inner: FloatArray, column: int
    ) -> FloatArray:
        """f(u) = f(u0) + f' h + f'' h^2/2 + f''' h^3/6 with h = u - u0."""
        if value is None:
            self.fault(what, float(inner[0, 0]), column)
            return np.full_like(inner, math.nan)
        series = self.constant(value)
        if slopes and not math.isfinite(slopes[0]):
            return self.without_slopes(series, np.any(inner[1:], axis=0), what, inner, column)
        h = inner.copy()
        h[0] = 0.0
        power = h
        for k, slope in enumerate(slopes, start=1):
            # An infinite derivative touches only the orders that its power of h reaches.
            series += np.where(power != 0.0, slope / math.factorial(k) * power, 0.0)
            power = _product(power, h)
        return series

    def without_slopes(
        self, series: FloatArray, varies: BoolArray, what: str, inner: FloatArray, column: int
    ) -> FloatArray:
        """A value that has no derivatives where it varies, which is a fault then."""
        if np.any(varies):
            self.fault(f"the derivative of {what}", float(inner[0, 0]), column)
            series[1:, varies] = math.nan
        return series

    def fault(self, what: str, at: float, column: int) -> None:
        where = f" at {at:.6g}"
        self.faults.append(finding("no-finite-value", what=what, where=where, column=column))
