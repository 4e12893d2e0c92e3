"""Exact derivatives of equations to the third order: Taylor polynomials carried up the tree.

Every node is expanded in two small numbers s and t along given directions and cut beyond the
third order. Nothing is approximated by differences and no expression grows, as it does where
a tree is differentiated into another tree. The third order is what JCGM 100:2008, 5.1.2, note,
needs beside the second.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mtu_cli.findings import Finding, error, finding
from mtu_cli.language.functions import BUDGET_FUNCTIONS, ORDER, apply_scalar
from mtu_cli.language.tree import Binary, Call, Name, Negative, Node, Number
from mtu_cli.language.tree import names as names_in

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

SLAB = 2**20
"""Numbers that the directions of one slab of pairs may take, for either of the two."""
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


# What is too large is inf or nan, which who asked tells; numpy has no word on it.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def derivatives(node: Node, values: Mapping[str, float], names: Sequence[str]) -> Derivatives:
    """The derivatives of an equation with respect to `names` (n) at `values`.

    Raises InputError for a name without a value.
    """
    n = len(names)
    used = names_in(node)
    rows = np.array([k for k, name in enumerate(names) if name in used], dtype=np.intp)
    own = [names[k] for k in rows]
    value, first, third, second = math.nan, np.zeros(n), np.zeros(n), np.zeros((n, n))
    faults: dict[str, Finding] = {}
    for i, j in _slabs(len(own)):
        pairs = np.arange(len(i))
        along = np.zeros((2, len(own), len(i)))
        if own:
            along[0, i, pairs] = 1.0
            along[1, j, pairs] = 1.0
        found, slab_faults = taylor(node, values, own, along)
        faults |= {fault.message: fault for fault in slab_faults}
        value = float(found[0, 0])
        if own:
            same = i == j
            first[rows[i[same]]] = found[PLACE[1, 0], same]
            third[rows[i[same]]] = 6.0 * found[PLACE[3, 0], same]
            # The coefficient of s t is d2f/dxi dxj on the diagonal too, where both run along x_i.
            second[rows[i], rows[j]] = second[rows[j], rows[i]] = found[PLACE[1, 1]]
    return Derivatives(
        value=value, first=first, second=second, third=third, faults=tuple(faults.values())
    )


def _slabs(n: int) -> Iterator[tuple[IntArray, IntArray]]:
    """All pairs i <= j of `n` names, so many at a time that their directions stay small."""
    if n == 0:
        yield np.zeros(1, dtype=np.intp), np.zeros(1, dtype=np.intp)
        return
    i, j = np.triu_indices(n)
    step = max(1, SLAB // n)
    for start in range(0, len(i), step):
        yield i[start : start + step], j[start : start + step]


def taylor(
    node: Node, values: Mapping[str, float], names: Sequence[str], along: FloatArray
) -> tuple[FloatArray, list[Finding]]:
    """Taylor coefficients (10, pairs) of ``f(x + s along[0, :, p] + t along[1, :, p])``.

    `along` (2, n, pairs) holds the two directions of each pair, in the order of `names`.
    `TERMS` gives the order of the coefficients. Those that do not exist are nan; the second
    result says why.

    Raises InputError for a name without a value.
    """
    expansion = _Expansion(values, {name: k for k, name in enumerate(names)}, along)
    with np.errstate(all="ignore"):
        found = expansion.of(node)
    return found, expansion.faults


@dataclass(slots=True)
class _Expansion:
    values: Mapping[str, float]
    index: Mapping[str, int]
    along: FloatArray
    faults: list[Finding] = field(default_factory=list)

    def of(self, node: Node) -> FloatArray:
        match node:
            case Number(value):
                return self.constant(value)
            case Name(name, column):
                return self.variable(name, column)
            case Negative(operand):
                return -self.of(operand)
            case Binary("+", left, right):
                return self.of(left) + self.of(right)
            case Binary("-", left, right):
                return self.of(left) - self.of(right)
            case Binary("*", left, right):
                return product(self.of(left), self.of(right))
            case Binary("/", left, right, column):
                return product(self.of(left), self.power(self.of(right), -1.0, "/", column))
            case Binary("**", base, exponent, column):
                return self.raised(self.of(base), self.of(exponent), column, base)
            case Call("atan2", (y, x), column):
                return self.atan2(self.of(y), self.of(x), column)
            case Call(function, (argument,), column):
                return self.composed(function, self.of(argument), column, argument)
        raise AssertionError(node)

    def constant(self, value: float) -> FloatArray:
        series = np.zeros((len(TERMS), self.along.shape[2]))
        series[0] = value
        return series

    def variable(self, name: str, column: int) -> FloatArray:
        if name not in self.values:
            raise error("name-without-value", name=name, column=column)
        series = self.constant(self.values[name])
        if name in self.index:
            series[PLACE[1, 0]], series[PLACE[0, 1]] = self.along[:, self.index[name]]
        return series

    def composed(
        self, function: str, inner: FloatArray, column: int, argument: Node | None = None
    ) -> FloatArray:
        """f(u) = f(u0) + f' h + f'' h^2/2 + f''' h^3/6 with h = u - u0."""
        at = float(inner[0, 0])
        outer = apply_scalar(function, (at,))
        if outer is None:
            return self.undefined(f"{function}()", at, column)
        slopes = BUDGET_FUNCTIONS[function].slopes
        assert slopes is not None, function
        return self.chained(outer, slopes(at), inner, f"{function}()", column, argument)

    def power(
        self,
        base: FloatArray,
        exponent: float,
        sign: str,
        column: int,
        argument: Node | None = None,
    ) -> FloatArray:
        """base ** exponent for a constant exponent, negative bases and 0 included."""
        at = float(base[0, 0])
        outer = apply_scalar("**", (at, exponent))
        if outer is None:
            return self.undefined(f"{sign!r}", at, column)
        slopes, factor = [], 1.0
        for k in range(ORDER):
            factor *= exponent - k
            rest = apply_scalar("**", (at, exponent - k - 1)) if factor else 0.0
            slopes.append(math.nan if rest is None else factor * rest)
        return self.chained(outer, slopes, base, f"{sign!r}", column, argument)

    def raised(
        self, base: FloatArray, exponent: FloatArray, column: int, argument: Node
    ) -> FloatArray:
        if not np.any(exponent[1:]):
            return self.power(base, float(exponent[0, 0]), "**", column, argument)
        outer = apply_scalar("**", (float(base[0, 0]), float(exponent[0, 0])))
        if outer is None or base[0, 0] <= 0.0:
            return self.undefined("'**' with an uncertain exponent", float(base[0, 0]), column)
        logarithm = self.composed("log", base, column)
        return self.composed("exp", product(exponent, logarithm), column)

    def atan2(self, y: FloatArray, x: FloatArray, column: int) -> FloatArray:
        at = float(y[0, 0]), float(x[0, 0])
        outer = math.atan2(*at)
        if not (np.any(y[1:]) or np.any(x[1:])):
            return self.constant(outer)
        if at[0] == 0.0 and at[1] <= 0.0:
            # The angle jumps by 2 pi there, or is any angle at the origin: it has a value alone.
            self.fault("no-derivative", "atan2(y, x) with y = 0", at[1], column)
            series = self.constant(outer)
            series[1:, np.any(y[1:], axis=0) | np.any(x[1:], axis=0)] = math.nan
            return series
        # The larger one divides; the derivatives of both forms are those of the angle.
        if abs(at[1]) >= abs(at[0]):
            series = self.composed("atan", product(y, self.power(x, -1.0, "/", column)), column)
        else:
            series = -self.composed("atan", product(x, self.power(y, -1.0, "/", column)), column)
        series[0] = outer
        return series

    def chained(
        self,
        outer: float,
        slopes: Sequence[float],
        inner: FloatArray,
        what: str,
        column: int,
        argument: Node | None,
    ) -> FloatArray:
        series = self.constant(outer)
        h = inner.copy()
        h[0] = 0.0
        if not math.isfinite(slopes[0]):
            # x**4 vanishes to the third order at 0 and yet sqrt(x**4) is x**2.
            varies = np.any(h != 0.0, axis=0) | self.along_any(argument)
            if np.any(varies):
                self.fault("no-derivative", what, float(inner[0, 0]), column)
                series[1:, varies] = math.nan
            return series
        if not np.any(h):
            return series
        rising = h
        for k, slope in enumerate(slopes, start=1):
            # An infinite derivative touches only the orders that its power of h reaches.
            series += np.where(rising != 0.0, slope / math.factorial(k) * rising, 0.0)
            rising = product(rising, h)
        return series

    def along_any(self, argument: Node | None) -> BoolArray:
        """Whether a pair (pairs,) of directions moves a name of the `argument`."""
        held = {} if argument is None else names_in(argument)
        rows = [self.index[name] for name in held if name in self.index]
        return np.asarray(np.any(self.along[:, rows] != 0.0, axis=(0, 1)))

    def undefined(self, what: str, at: float, column: int) -> FloatArray:
        self.fault("no-value-here", what, at, column)
        return self.constant(math.nan) * math.nan

    def fault(self, code: str, what: str, at: float, column: int) -> None:
        self.faults.append(finding(code, operation=what, at=f"{at:.6g}", column=column))


def product(left: FloatArray, right: FloatArray) -> FloatArray:
    """The product of two polynomials, cut beyond the third order."""
    series = np.zeros_like(left)
    for i, j, k in _PRODUCTS:
        series[k] += left[i] * right[j]
    return series
