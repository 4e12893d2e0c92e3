"""Which places are 0 or 1 and nothing else, so that their mean is a chance."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable

import numpy as np

from mtu_cli.files.graph import Step
from mtu_cli.language import Node, evaluate, to_text
from mtu_cli.language.tree import Call, Name, rewritten, walk

MOST_SWITCHES = 10
"""Steps of one formula whose combinations are all tried."""


def may_jump(steps: Iterable[Step]) -> bool:
    """Whether a formula of `steps` has a step, so that few trials may see no change at all."""
    return any(
        _is_step(node) for step in steps if step.formula is not None for node in walk(step.formula)
    )


def chance_places(steps: Iterable[Step]) -> set[str]:
    """Places that hold 0 or 1 in every trial, of `steps` in firing order.

    Those are the formulas of `step()` alone and of other such places (a product is "and",
    a + b - a*b is "or", 1 - a is "not") that give 0 or 1 whichever of them are 0 or 1.
    """
    found: set[str] = set()
    for step in steps:
        if step.formula is not None and _is_chance(step.formula, found):
            found.update(step.outputs)
    return found


def _is_step(node: Node) -> bool:
    return isinstance(node, Call) and node.function == "step"


def _is_chance(formula: Node, chances: Collection[str]) -> bool:
    switches: dict[str, str] = {}

    def switched(node: Node) -> Node:
        known = isinstance(node, Name) and node.name in chances
        if not (known or _is_step(node)):
            return node
        name = switches.setdefault(to_text(node), f"?{len(switches)}")
        return Name(name, node.column)

    tree = rewritten(formula, switched)
    free = {node.name for node in walk(tree) if isinstance(node, Name)}
    if not switches or len(switches) > MOST_SWITCHES or not free.issubset(switches.values()):
        return False
    table = np.array(list(itertools.product((0.0, 1.0), repeat=len(switches)))).T
    values = np.asarray(evaluate(tree, dict(zip(switches.values(), table, strict=True))))
    return bool(np.all((values == 0.0) | (values == 1.0)))
