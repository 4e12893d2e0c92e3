"""Exact derivatives of equations to the third order, carried up the tree.

Every node has its value and all its derivatives. Nothing is approximated by differences and no
expression grows, as it does where a tree is differentiated into another tree. The third order is
what JCGM 100:2008, 5.1.2, note, needs beside the second.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.findings import Finding, finding
from mtu_cli.language.functions import FUNCTIONS, Slopes, apply_scalar, given, power_slopes
from mtu_cli.language.tree import Call, Name, Node, Number

FloatArray = NDArray[np.float64]
NONE = np.zeros(())
"""Derivatives of an order that are all 0."""


class Derivatives(NamedTuple):
    """An equation, or a node of it, at a point: `value`, `first` (n,), `second` (n, n) and `third`
    (n, n, n), `NONE` within where all of an order are 0.

    nan where a derivative does not exist; `faults` then says at which functions, with their
    columns. So it does of a function without a finite value; a sum or product that overflows leaves
    a `value` that is not finite without a fault. `varies` (n,): whether it holds a name, be it that
    its derivatives vanish: x**4 has none at 0, and yet sqrt(x**4) is x**2.
    """

    value: float
    first: FloatArray
    second: FloatArray
    third: FloatArray
    varies: NDArray[np.bool_]
    faults: tuple[Finding, ...] = ()


def derivatives(node: Node, values: Mapping[str, float], names: Sequence[str]) -> Derivatives:
    """The derivatives of an equation with respect to `names` (n), those that it has, at `values`.

    Raises InputError for a name without a value.
    """
    n, expansion = len(names), _Expansion(values, names)
    with np.errstate(all="ignore"):
        jet = expansion.of(node)
    return jet._replace(
        value=float(jet.value),
        second=np.broadcast_to(jet.second, (n, n)),
        third=np.broadcast_to(jet.third, (n, n, n)),
        faults=tuple(expansion.faults),
    )


def _symmetric(g: FloatArray, H: FloatArray) -> FloatArray:
    """g_i H_jk + g_j H_ik + g_k H_ij."""
    if not np.any(H):
        return NONE
    whole = np.multiply.outer(g, H)
    return whole + whole.transpose(1, 0, 2) + whole.transpose(1, 2, 0)


def _product(a: Derivatives, b: Derivatives) -> Derivatives:
    mixed = np.outer(a.first, b.first)
    return Derivatives(
        a.value * b.value,
        a.value * b.first + b.value * a.first,
        a.value * b.second + b.value * a.second + mixed + mixed.T,
        a.value * b.third
        + b.value * a.third
        + _symmetric(a.first, b.second)
        + _symmetric(b.first, a.second),
        a.varies | b.varies,
    )


def _alone(value: float, varies: NDArray[np.bool_]) -> Derivatives:
    """A value without derivatives by what it varies with."""
    lost = np.where(varies, math.nan, 0.0)
    second = np.add.outer(lost, lost)
    return Derivatives(value, lost, second, np.add.outer(second, lost), varies)


def _times(slope: float, inner: FloatArray) -> FloatArray:
    """An infinite derivative touches only what is not 0."""
    return np.where(inner != 0.0, slope * inner, 0.0)


@dataclass(slots=True)
class _Expansion:
    values: Mapping[str, float]
    names: Sequence[str]
    faults: list[Finding] = field(default_factory=list)

    def of(self, node: Node) -> Derivatives:
        match node:
            case Number(value):
                return self.constant(value)
            case Name(name, column):
                own = np.array([name == each for each in self.names], bool)
                value = given(name, self.values, column)
                return Derivatives(value, own.astype(np.float64), NONE, NONE, own)
            case Call(function, arguments, column):
                return self.call(function, [self.of(item) for item in arguments], column)

    def call(self, function: str, jets: list[Derivatives], column: int) -> Derivatives:
        match function, jets:
            case "/", [left, right]:
                return _product(left, self.power(right, -1.0, "'/'", column))
            case "**", [base, exponent]:
                return self.raised(base, exponent, column)
            case "atan2", [y, x]:
                return self.atan2(y, x, column)
            case "*", [left, right]:
                return _product(left, right)
            case "+" | "-" | "neg", [first, *_]:
                parts = [*map(FUNCTIONS[function].scalar, *(jet[:4] for jet in jets))]
                return Derivatives._make([*parts, first.varies | jets[-1].varies, ()])
        value, slopes = apply_scalar(function, (jets[0].value,)), FUNCTIONS[function].slopes
        return self.chained(f"{function}()", value, slopes, jets[0], column)

    def constant(self, value: float) -> Derivatives:
        n = len(self.names)
        return Derivatives(value, np.zeros(n), NONE, NONE, np.zeros(n, bool))

    def power(self, base: Derivatives, exponent: float, what: str, column: int) -> Derivatives:
        """base ** exponent for a constant exponent, negative bases and 0 included."""
        value = apply_scalar("**", (base.value, exponent))
        return self.chained(what, value, partial(power_slopes, exponent=exponent), base, column)

    def raised(self, base: Derivatives, exponent: Derivatives, column: int) -> Derivatives:
        if not any(map(np.any, exponent[1:4])):
            return self.power(base, exponent.value, "'**'", column)
        value = apply_scalar("**", (base.value, exponent.value))
        if value is None or base.value <= 0.0:
            what = "'**' with an uncertain exponent"
            return self.chained(what, None, FUNCTIONS["exp"].slopes, base, column)
        return self.call("exp", [_product(exponent, self.call("log", [base], column))], column)

    def atan2(self, y: Derivatives, x: Derivatives, column: int) -> Derivatives:
        angle = math.atan2(y.value, x.value)
        if y.value == 0.0 and x.value <= 0.0:
            # The angle jumps by 2 pi there, or is any angle at the origin: it has a value alone.
            varies, what = y.varies | x.varies, "atan2(y, x) with y = 0"
            return self.without_slopes(angle, varies, what, x.value, column)
        # The larger one divides; the derivatives of both forms are those of the angle.
        over, under, sign = (y, x, 1.0) if abs(x.value) >= abs(y.value) else (x, y, -1.0)
        ratio = _product(over, self.power(under, -1.0, "'/'", column))
        jet = _product(self.constant(sign), self.call("atan", [ratio], column))
        return jet._replace(value=angle)

    def chained(
        self, what: str, value: float | None, slopes: Slopes | None, inner: Derivatives, column: int
    ) -> Derivatives:
        """f(u): f' u_i, f' u_ij + f'' u_i u_j, and so on."""
        if value is None or slopes is None:
            self.fault(what, inner.value, column)
            return _alone(math.nan, inner.varies)
        one, two, three = slopes(inner.value)
        if not math.isfinite(one):
            return self.without_slopes(value, inner.varies, what, inner.value, column)
        g, H = inner.first, inner.second
        square = np.outer(g, g)
        third = _times(one, inner.third) + _times(two, _symmetric(g, H))
        return Derivatives(
            value,
            _times(one, g),
            _times(one, H) + _times(two, square),
            third + _times(three, np.multiply.outer(square, g)),
            inner.varies,
        )

    def without_slopes(
        self, value: float, varies: NDArray[np.bool_], what: str, at: float, column: int
    ) -> Derivatives:
        """A value that has no derivatives where it varies, which is a fault then."""
        if varies.any():
            self.fault(f"the derivative of {what}", at, column)
        return _alone(value, varies)

    def fault(self, what: str, at: float, column: int) -> None:
        where = f" at {at:.6g}"
        self.faults.append(finding("no-finite-value", what=what, where=where, column=column))
