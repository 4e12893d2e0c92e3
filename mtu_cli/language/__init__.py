"""The equation language of machines, effects, budgets and graphs.

``+ - * / **``, parentheses, numbers, ``pi``, functions and names; never `eval`. Faults are
InputErrors of findings whose `column` is a character of the equation, counted from 1; who knows
the file adds it with `Finding.at`.
"""

from mtu_cli.language.functions import evaluate
from mtu_cli.language.parser import parse
from mtu_cli.language.tree import LinearForm, Node, check_known, linear_form, names, to_text
from mtu_cli.language.unit_algebra import check_dimension

__all__ = [
    "LinearForm",
    "Node",
    "check_dimension",
    "check_known",
    "evaluate",
    "linear_form",
    "names",
    "parse",
    "to_text",
]
