"""The 1 of ``1 + alpha*dT`` in a budget: a plain number, whatever unit the ratio beside it has."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations

from mtu_cli.files.budget_units import ANGLES, BudgetUnits, sizes_differ, times
from mtu_cli.files.unit_text import SIZE
from mtu_cli.language import EquationError, Node
from mtu_cli.language.dimensions import first_column, literal_value, shown
from mtu_cli.language.tree import Binary, walk


def beside_ones(units: BudgetUnits, tree: Node) -> Iterator[EquationError]:
    """Where a ratio in a unit of its own (um/m, %) is added to 1, of which it is a share: 1 is
    100 % then, and no 1 um/m. Beside an angle a 1 may be 1 deg.
    """
    for node in walk(tree):
        if not isinstance(node, Binary) or node.operator not in "+-":
            continue
        for one, other in permutations((node.left, node.right)):
            found = units.of(other, sure=False) if literal_value(one) in (1.0, -1.0) else None
            if found is None or not sizes_differ(found, {SIZE: 0.0}):
                continue
            text = units.text(found)
            if not text.endswith(ANGLES):
                hint = f"plain numbers: what is in {text} {times(found[SIZE])}"
                what = f"the plain number 1 and {text} are added"
                yield EquationError(what, first_column(other), hint, shown(other))
