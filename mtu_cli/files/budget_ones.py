"""The 1 of ``L*(1 + alpha*dT)`` in a budget: a plain number, whatever unit the ratio beside it has.

A literal that is added has the unit of what it is added to: of a sum that is a result (rh - 1, both
in %), or that has the 1 behind it ((s - 1)*L), nobody knows better. A 1 that a share is added to,
for a factor of something, is 100 %; so is one without which nothing would be wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import permutations

from mtu_cli.files.budget_units import ANGLES, BudgetUnits, sizes_differ, times
from mtu_cli.files.unit_text import SIZE, unit_exponents
from mtu_cli.language import EquationError, Node
from mtu_cli.language.dimensions import first_column, literal_value, shown
from mtu_cli.language.tree import Binary, Call, Negative, rewritten, walk

PRODUCT = frozenset("*/^ ")
"""What a unit has that is no single angle."""


def beside_ones(units: BudgetUnits, tree: Node, stated: str | None) -> Iterator[EquationError]:
    """Where a ratio in a unit of its own (um/m, %) is added to 1, of which it is a share, in an
    equation that is to give the `stated` unit. Beside an angle a 1 may be 1 deg.
    """
    results, wanted = [*_results(tree)], unit_exponents(stated, units.gram)
    found: list[tuple[Node, Node, str, float]] = []
    unsure: dict[int, Node] = {}
    for node, one, other in _ones(tree):
        ratio = units.of(other, sure=False)
        if ratio is None or not sizes_differ(ratio, {SIZE: 0.0}):
            continue
        if node in results:
            if wanted is None or not sizes_differ(ratio, wanted):
                continue
        elif one is not node.left and node.operator == "-":
            unsure[id(node)] = Binary("/", other, other, node.column)
        text = units.text(ratio)
        if not text.endswith(ANGLES) or not PRODUCT.isdisjoint(text):
            found.append((node, other, text, ratio[SIZE]))
    guilty = _guilty(units, tree, stated, unsure)
    found = [own for own in found if id(own[0]) not in unsure or id(own[0]) in guilty]
    wrong = [node for node, *_ in found]
    for _, other, text, size in found:
        # One of a product that holds another is that one's fault.
        if not any(inner in wrong for inner in walk(other)):
            hint = f"plain numbers: what is in {text} {times(size)}"
            what = f"the plain number 1 and {text} are added"
            yield EquationError(what, first_column(other), hint, shown(other))


def _guilty(
    units: BudgetUnits, tree: Node, stated: str | None, unsure: Mapping[int, Node]
) -> set[int]:
    """Those of the nodes (by id) that mend the equation, all together or else each alone."""
    if not unsure or not _wrong(units, tree, stated):
        return set()
    if _mended(units, tree, stated, unsure):
        return {*unsure}
    return {key for key, own in unsure.items() if _mended(units, tree, stated, {key: own})}


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
