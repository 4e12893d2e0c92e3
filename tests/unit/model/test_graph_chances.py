"""Which places are 0 or 1: their mean is a chance."""

from __future__ import annotations

import pytest

from mtu_cli.files.graph import Step
from mtu_cli.language import parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.parser import DOTTED
from mtu_cli.model.graph.chances import chance_places, may_jump


def step(formula: str, out: str) -> Step:
    return Step(
        index=0,
        do="compute",
        variant="",
        inputs=(),
        outputs=(out,),
        formula=parse(formula, BUDGET_FUNCTIONS, DOTTED),
    )


@pytest.mark.parametrize(
    ("formula", "chance"),
    [
        ("step(x)", True),
        ("step(H1.x - 2)*step(y)", True),
        ("1 - step(x)", True),
        ("step(x) + step(y) - step(x)*step(y)", True),
        ("step(step(x) + step(y) + step(z) - 2)", True),
        ("abs(step(x) - step(y))", True),
        ("step(x)**2", True),
        ("step(x) + step(y)", False),
        ("-step(x)", False),
        ("0.5*step(x)", False),
        ("x*step(x)", False),
        ("step(x) + s0", False),
        ("x", False),
        ("1 + 0", False),
        ("step(x)/step(y)", False),
    ],
)
def test_formulas(formula: str, chance: bool) -> None:
    assert (chance_places([step(formula, "a")]) == {"a"}) is chance


def test_of_other_chances() -> None:
    steps = [step("step(x)", "a"), step("step(y)", "b"), step("2*a", "twice")]
    steps += [step("a*b", "both"), step("1 - both", "not"), step("a*twice", "no")]
    assert chance_places(steps) == {"a", "b", "both", "not"}


def test_a_name_is_taken_for_no_switch() -> None:
    """A step is replaced by a name that no place has."""
    for name in ("s0", "a", "step0"):
        assert chance_places([step(f"step(x)*{name}", "c")]) == set()


def test_what_may_jump() -> None:
    assert may_jump([step("x", "a"), step("3 + 2*step(x)", "b")])
    assert not may_jump([step("x + abs(y)", "a")])
