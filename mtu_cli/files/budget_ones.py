"""The 1 of ``L*(1 + alpha*dT)`` in a budget: a plain number, whatever unit the ratio beside it has.

A literal that is added has the unit of what it is added to: of a sum that is a result (rh - 1, both
in %), or that has the 1 behind it ((s - 1)*L), nobody knows better. A 1 that a share is added to,
for a factor of something, is 100 %; so is one without which nothing would be wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations, permutations

from mtu_cli.files.budget_unit_texts import ANGLES, sizes_differ, times
from mtu_cli.files.budget_units import BudgetUnits
from mtu_cli.files.unit_text import SIZE, unit_exponents
from mtu_cli.language import EquationError, Node
from mtu_cli.language.dimensions import first_column, literal_value, shown
from mtu_cli.language.tree import Binary, Call, Negative, rewritten, walk

MOST = 8
"""Ones of which some are tried together: of many there are ever more ways."""
PRODUCT = frozenset("*/^ ")
"""What a unit has that is no single angle."""


@dataclass(frozen=True, slots=True)
class _Beside:
    """A ratio beside a 1: the sum, the ratio, its unit, log10 of that, whether the 1 is a plain
    number for sure, and whether it is that here or at another place.
    """

    sum: Node
    ratio: Node
    unit: str
    size: float
    sure: bool
    one_of: bool = False

    @property
    def hint(self) -> str:
        return f"what is in {self.unit} {times(self.size)}"


def beside_ones(units: BudgetUnits, tree: Node, stated: str | None) -> Iterator[EquationError]:
    """Where a ratio in a unit of its own (um/m, %) is added to 1, of which it is a share, in an
    equation that is to give the `stated` unit. Beside an angle a 1 may be 1 deg.
    """
    every = [*_beside(units, tree, stated)]
    found = [own for own in every if own.sure]
    wrong = [own.sum for own in found]
    for own in found:
        # One of a product that holds another is that one's fault.
        if not any(inner in wrong for inner in walk(own.ratio)):
            hint = f"plain numbers: {own.hint}"
            what = f"the plain number 1 and {own.unit} are added"
            yield EquationError(what, first_column(own.ratio), hint, shown(own.ratio))
    either = [own for own in every if own.one_of]
    if either:
        first = either[0]
        names = " or ".join(dict.fromkeys(repr(shown(own.sum)) for own in either))
        hint = f"plain numbers in one of them: {first.hint}"
        what = f"the plain number 1 and {first.unit} are added in {names}"
        yield EquationError(what, first_column(first.ratio), hint)


def ones_in_units(units: BudgetUnits, tree: Node, stated: str | None) -> Iterator[tuple[str, str]]:
    """Sums in which a 1 is taken for 1 % (or 1 ppm), as nobody knows better: the sum, and the words
    for what the 1 is there and how it would be a plain number.
    """
    for own in _beside(units, tree, stated):
        if not own.sure:
            what = f"the 1 is taken for 1 {own.unit}; if a plain number is meant, {own.hint}"
            yield shown(own.sum), what


def _beside(units: BudgetUnits, tree: Node, stated: str | None) -> Iterator[_Beside]:
    results, wanted = [*_results(tree)], unit_exponents(stated, units.texts.gram)
    found: list[_Beside] = []
    unsure: dict[int, Node] = {}
    for node, one, other in _ones(tree):
        ratio = units.of(other, sure=False)
        if ratio is None or not sizes_differ(ratio, {SIZE: 0.0}):
            continue
        text = units.texts.text(ratio)
        angle = text.endswith(ANGLES) and PRODUCT.isdisjoint(text)
        sure = True
        if node in results:
            if angle:
                continue
            sure = wanted is not None and sizes_differ(ratio, wanted)
        elif angle or (one is not node.left and node.operator == "-"):
            unsure[id(node)] = Binary("/", other, other, node.column)
        found.append(_Beside(node, other, text, ratio[SIZE], sure))
    ways = _guilty(units, tree, stated, unsure)
    for own in found:
        key = id(own.sum)
        if key not in unsure:
            yield own
            continue
        guilty = any(key in way for way in ways)
        yield replace(own, sure=guilty and len(ways) == 1, one_of=guilty and len(ways) > 1)


def _guilty(
    units: BudgetUnits, tree: Node, stated: str | None, unsure: Mapping[int, Node]
) -> list[frozenset[int]]:
    """The fewest nodes (by id) that mend the equation, in all ways in which so many do."""
    if not unsure or not _wrong(units, tree, stated):
        return []
    for count in range(1, len(unsure) if len(unsure) <= MOST else 2):
        ways = [
            frozenset(some)
            for some in combinations(unsure, count)
            if _mended(units, tree, stated, {key: unsure[key] for key in some})
        ]
        if ways:
            return ways
    return [frozenset(unsure)] if _mended(units, tree, stated, unsure) else []


def _mended(units: BudgetUnits, tree: Node, stated: str | None, plain: Mapping[int, Node]) -> bool:
    """Whether nothing were wrong if these nodes (by id) were plain numbers."""
    other = rewritten(tree, lambda own: plain.get(id(own), own))
    return not _wrong(units, other, stated)


def _wrong(units: BudgetUnits, tree: Node, stated: str | None) -> bool:
    return units.result_fault(tree, stated) is not None or any(units.faults(tree))


def _ones(tree: Node) -> Iterator[tuple[Binary, Node, Node]]:
    """Sums of a 1 and something else."""
    for node in walk(tree):
        if isinstance(node, Binary) and node.operator in "+-":
            for one, other in permutations((node.left, node.right)):
                if literal_value(one) in (1.0, -1.0):
                    yield node, one, other


def _results(node: Node) -> Iterator[Node]:
    """The sums that make an equation, also behind a sign, as a size or times a number."""
    match node:
        case Binary("+" | "-", left, right):
            yield node
            yield from _results(left)
            yield from _results(right)
        case Binary("*" | "/", left, right) if literal_value(right) is not None:
            yield from _results(left)
        case Binary("*", left, right) if literal_value(left) is not None:
            yield from _results(right)
        case Negative(inner) | Call("abs", (inner,)):
            yield from _results(inner)
