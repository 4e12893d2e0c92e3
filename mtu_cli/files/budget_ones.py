"""The 1 of ``L*(1 + alpha*dT)`` in a budget: a plain number, whatever unit the ratio beside it has.

A literal that is added has the unit of what it is added to: of a sum that is a result (rh - 1, both
in %), or that has the 1 behind it ((s - 1)*L), nobody knows better. A 1 that a share is added to,
for a factor of something, is 100 %; so is one of an equation that else gives another unit than
stated.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations

from mtu_cli.files.budget_units import ANGLES, BudgetUnits, sizes_differ, times
from mtu_cli.files.unit_text import SIZE, unit_exponents
from mtu_cli.language import EquationError, Node
from mtu_cli.language.dimensions import first_column, literal_value, shown
from mtu_cli.language.tree import Binary, Call, Negative, walk

PRODUCT = frozenset("*/^ ")
"""What a unit has that is no single angle."""


def beside_ones(units: BudgetUnits, tree: Node, stated: str | None) -> Iterator[EquationError]:
    """Where a ratio in a unit of its own (um/m, %) is added to 1, of which it is a share, in an
    equation that is to give the `stated` unit. Beside an angle a 1 may be 1 deg.
    """
    wrong = units.result_fault(tree, stated) is not None or any(units.faults(tree))
    results, wanted = [*_results(tree)], unit_exponents(stated, units.gram)
    for node in walk(tree):
        if not isinstance(node, Binary) or node.operator not in "+-":
            continue
        for one, other in permutations((node.left, node.right)):
            if literal_value(one) not in (1.0, -1.0):
                continue
            found = units.of(other, sure=False)
            if found is None or not sizes_differ(found, {SIZE: 0.0}):
                continue
            if node in results:
                if wanted is None or not sizes_differ(found, wanted):
                    continue
            elif not wrong and one is not node.left:
                continue
            text = units.text(found)
            if not text.endswith(ANGLES) or not PRODUCT.isdisjoint(text):
                hint = f"plain numbers: what is in {text} {times(found[SIZE])}"
                what = f"the plain number 1 and {text} are added"
                yield EquationError(what, first_column(other), hint, shown(other))


def _results(node: Node) -> Iterator[Node]:
    """The sums that make an equation, also behind a sign or as a size."""
    match node:
        case Binary("+" | "-", left, right):
            yield node
            yield from _results(left)
            yield from _results(right)
        case Negative(inner) | Call("abs", (inner,)):
            yield from _results(inner)
