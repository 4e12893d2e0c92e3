"""The equation language of machines, effects, budgets and graphs.

``+ - * / **``, parentheses, numbers, ``pi``, functions and names; never `eval`.
"""

from mtu_cli.language.errors import EquationError
from mtu_cli.language.evaluate import evaluate
from mtu_cli.language.linear import LinearForm, linear_form
from mtu_cli.language.parser import parse
from mtu_cli.language.term_dimensions import check_dimension
from mtu_cli.language.tree import Node, names, to_text

__all__ = [
    "EquationError",
    "LinearForm",
    "Node",
    "check_dimension",
    "evaluate",
    "linear_form",
    "names",
    "parse",
    "to_text",
]
