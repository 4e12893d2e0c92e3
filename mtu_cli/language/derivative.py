"""Exact derivatives of equations to the third order: Taylor polynomials carried up the tree.

Every node is expanded in two small numbers s and t along given directions and cut beyond the
third order. Nothing is approximated by differences and no expression grows, as it does where
a tree is differentiated into another tree. The third order is what JCGM 100:2008, 5.1.2, note,
needs beside the second.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mtu_cli.findings import Finding, finding
from mtu_cli.language.functions import (
    FUNCTIONS,
    ORDER,
    Slopes,
    apply_scalar,
    given,
    power_slopes,
)
from mtu_cli.language.tree import Call, Name, Node, Number
from mtu_cli.language.tree import names as names_in

FloatArray = NDArray[np.float64]
Directions = Callable[[str], FloatArray | None]
"""The two directions (2, pairs) of each pair along a name; None where they do not move it."""

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
    n, used = len(names), names_in(node)
    rows = np.array([k for k, name in enumerate(names) if name in used], dtype=np.intp)
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
        jet = expansion.of(node)
    return jet.series, expansion.faults


@dataclass(frozen=True, slots=True)
class _Jet:
    """A truncated polynomial: its coefficients `series` (10, pairs).

    `varies` (pairs,): whether the directions move a name that it holds, be it that the
    coefficients to the third order vanish: x**4 does at 0, and yet sqrt(x**4) is x**2.
    """

    series: FloatArray
    varies: NDArray[np.bool_]

    def __mul__(self, other: _Jet) -> _Jet:
        return _Jet(_product(self.series, other.series), self.varies | other.varies)

    @property
    def value(self) -> float:
        """The value of the node itself."""
        return float(self.series[0, 0])


def _product(left: FloatArray, right: FloatArray) -> FloatArray:
    series = np.zeros_like(left)
    for i, j, k in _PRODUCTS:
        series[k] += left[i] * right[j]
    return series


@dataclass(slots=True)
class _Expansion:
    values: Mapping[str, float]
    along: Directions
    pairs: int
    faults: list[Finding] = field(default_factory=list)

    def of(self, node: Node) -> _Jet:
        match node:
            case Number(value):
                return self.constant(value)
            case Name(name, column):
                jet = self.constant(given(name, self.values, column))
                if (directions := self.along(name)) is None:
                    return jet
                jet.series[[PLACE[1, 0], PLACE[0, 1]]] = directions
                return _Jet(jet.series, np.any(directions != 0.0, axis=0))
            case Call(function, arguments, column):
                return self.call(function, [self.of(item) for item in arguments], column)

    def call(self, function: str, jets: list[_Jet], column: int) -> _Jet:
        match function, jets:
            case "/", [left, right]:
                return left * self.power(right, -1.0, "'/'", column)
            case "**", [base, exponent]:
                return self.raised(base, exponent, column)
            case "atan2", [y, x]:
                return self.atan2(y, x, column)
            case "*", [left, right]:
                return left * right
            case "+" | "-" | "neg", [first, *_]:
                parts, last = [jet.series for jet in jets], jets[-1]
                return _Jet(FUNCTIONS[function].scalar(*parts), first.varies | last.varies)
        value, slopes = apply_scalar(function, (jets[0].value,)), FUNCTIONS[function].slopes
        return self.chained(f"{function}()", value, slopes, jets[0], column)

    def constant(self, value: float, varies: NDArray[np.bool_] | None = None) -> _Jet:
        series = np.zeros((len(TERMS), self.pairs))
        series[0] = value
        return _Jet(series, np.zeros(self.pairs, bool) if varies is None else varies)

    def power(self, base: _Jet, exponent: float, what: str, column: int) -> _Jet:
        """base ** exponent for a constant exponent, negative bases and 0 included."""
        value = apply_scalar("**", (base.value, exponent))
        return self.chained(what, value, partial(power_slopes, exponent=exponent), base, column)

    def raised(self, base: _Jet, exponent: _Jet, column: int) -> _Jet:
        if not np.any(exponent.series[1:]):
            return self.power(base, exponent.value, "'**'", column)
        value = apply_scalar("**", (base.value, exponent.value))
        if value is None or base.value <= 0.0:
            what = "'**' with an uncertain exponent"
            return self.chained(what, None, FUNCTIONS["exp"].slopes, base, column)
        return self.call("exp", [exponent * self.call("log", [base], column)], column)

    def atan2(self, y: _Jet, x: _Jet, column: int) -> _Jet:
        angle = math.atan2(y.value, x.value)
        if y.value == 0.0 and x.value <= 0.0:
            # The angle jumps by 2 pi there, or is any angle at the origin: it has a value alone.
            alone = self.constant(angle, y.varies | x.varies)
            return self.without_slopes(alone, "atan2(y, x) with y = 0", x.value, column)
        # The larger one divides; the derivatives of both forms are those of the angle.
        over, under, sign = (y, x, 1.0) if abs(x.value) >= abs(y.value) else (x, y, -1.0)
        ratio = over * self.power(under, -1.0, "'/'", column)
        jet = self.call("atan", [ratio], column)
        jet.series[:] *= sign
        jet.series[0] = angle
        return jet

    def chained(
        self, what: str, value: float | None, slopes: Slopes | None, inner: _Jet, column: int
    ) -> _Jet:
        """f(u) = f(u0) + f' h + f'' h^2/2 + f''' h^3/6 with h = u - u0."""
        if value is None or slopes is None:
            self.fault(what, inner.value, column)
            return _Jet(np.full_like(inner.series, math.nan), inner.varies)
        jet = self.constant(value, inner.varies)
        found = slopes(inner.value)
        if not math.isfinite(found[0]):
            return self.without_slopes(jet, what, inner.value, column)
        h = inner.series.copy()
        h[0] = 0.0
        rising = h
        for k, slope in enumerate(found, start=1):
            # An infinite derivative touches only the orders that its power of h reaches.
            step = np.where(rising != 0.0, slope / math.factorial(k) * rising, 0.0)
            jet.series[:] += step
            rising = _product(rising, h)
        return jet

    def without_slopes(self, jet: _Jet, what: str, at: float, column: int) -> _Jet:
        """A value that has no derivatives where it varies, which is a fault then."""
        if np.any(jet.varies):
            self.fault(f"the derivative of {what}", at, column)
            jet.series[1:, jet.varies] = math.nan
        return jet

    def fault(self, what: str, at: float, column: int) -> None:
        where = f" at {at:.6g}"
        self.faults.append(finding("no-finite-value", what=what, where=where, column=column))
