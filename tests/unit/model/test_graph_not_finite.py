"""What in a formula has no finite value."""

from __future__ import annotations

import pytest

from mtu_cli.language import parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.model.graph.not_finite import not_finite


@pytest.mark.parametrize(
    ("formula", "told"),
    [
        ("b + a/(b - 2)", "division by zero: b - 2 is 0, at column 6 of the formula"),
        ("a*(b - 2)**-1", "division by zero: b - 2 is 0 in (b - 2)**-1, at column 10"),
        ("2*log(a - b)", "no finite log: a - b is -1, at column 3 of the formula"),
        ("(-b)**0.5", "no finite value of (-b)**0.5, at column 5 of the formula"),
    ],
)
def test_the_innermost_place_is_told(formula: str, told: str) -> None:
    found = not_finite(parse(formula, BUDGET_FUNCTIONS), {"a": 1.0, "b": 2.0})
    assert found.startswith(told)
