from __future__ import annotations

import pytest

from mtu_cli.language import Node, names, parse, to_text
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.tree import Call, Name, rewritten


@pytest.mark.parametrize(
    "text",
    [
        "-x**2",
        "(-x)**2",
        "x**y**2",
        "(x**y)**2",
        "a - b - c",
        "a - (b - c)",
        "a/b*c",
        "a/(b*c)",
        "-(x*y)",
        "-(x + y)*2",
        "x**(-y)",
        "(-2)**x",
        "-2**x",
        "x**-2",
        "x - -2",
        "-(-x)",
        "0.004*dir_x",
        "1e-06*step(x - 300)",
        "sin(2*pi*x/25)",
    ],
)
def test_text_and_back(text: str) -> None:
    node = parse(text)
    again = parse(to_text(node))
    assert to_text(again) == to_text(node)
    from mtu_cli.language import evaluate

    values = dict.fromkeys(names(node), 1.7) | {"x": 2.5, "y": 3.0, "b": 0.3}
    assert evaluate(again, values) == pytest.approx(evaluate(node, values), rel=1e-15, nan_ok=True)


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("a-b-c", "a - b - c"),
        ("((a))*(b)", "a*b"),
        ("(a*b)/c", "a*b/c"),
        ("(-2)**x", "(-2)**x"),
        ("+x", "x"),
        ("127*ey_x", "127*ey_x"),
        ("x*0.1", "x*0.1"),
        ("exp((-x)/30)", "exp(-x/30)"),
        ("(-x)*y", "-x*y"),
        ("x - (-y)/2", "x - (-y/2)"),
        ("x*(-y)", "x*(-y)"),
    ],
)
def test_no_more_parentheses_than_needed(text: str, canonical: str) -> None:
    assert to_text(parse(text)) == canonical


def test_names_with_the_column_of_their_first_use() -> None:
    assert names(parse("z*ey_x + sin(x)*z - pi")) == {"z": 1, "ey_x": 3, "x": 14}


def test_a_tree_is_rewritten_from_the_top_down() -> None:
    """What replaces a node is not looked into: the x of sin(x) is not asked after."""
    seen: list[str] = []

    def change(node: Node) -> Node:
        seen.append(to_text(node))
        sine = isinstance(node, Call) and node.function == "sin"
        return Name("x", node.column) if sine else node

    tree = parse("-(a + sin(x)) - 2**atan2(y, b)", BUDGET_FUNCTIONS)
    assert to_text(rewritten(tree, change)) == "-(a + x) - 2**atan2(y, b)"
    assert seen == [
        to_text(tree), "-(a + sin(x))", "a + sin(x)", "a", "sin(x)",
        "2**atan2(y, b)", "2", "atan2(y, b)", "y", "b",
    ]  # fmt: skip


def test_what_is_not_rewritten_is_the_same_tree() -> None:
    """Columns and all."""
    tree = parse("-(a + sin(x)) - 2**atan2(y, b)", BUDGET_FUNCTIONS)
    assert rewritten(tree, lambda node: node) == tree
