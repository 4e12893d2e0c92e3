"""Equations that jump so far out that no trial of the budget need have met it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from budget_examples import codes, evaluated, loaded
from scipy.stats import norm

from mtu_cli.analyses.budget.rare_jumps import rare_jumps

NORMAL = "{value: 0, u: 1}"
RECTANGLE = "{value: 0, half_width: 1, distribution: rectangular}"
TRIANGLE = "{value: 0, half_width: 1, distribution: triangular}"


def told(equation: str, x: str) -> list[Mapping[str, Any]]:
    text = f"equation: {equation}\ninputs:\n  x: {x}\n  w: {{value: 0, u: 0.01}}\n"
    return [item.facts for item in evaluated(text).warnings if item.code == "rare-jump"]


@pytest.mark.parametrize("unit", [1.0, 1e-160, 1e160])
def test_a_jump_of_a_normal_input_is_told_with_its_chance(unit: float) -> None:
    """Var(x + J [x > r]) is 1 + J^2 Q (1 - Q) at least."""
    (facts,) = told(f"{unit!r}*(x + w + 1000*step(x - 5))", NORMAL)
    Q = float(norm.sf(5.0))
    assert (facts["radius"], facts["along"]) == (5.0, "x")
    assert facts["change"] == pytest.approx(1000, rel=1e-3)
    assert facts["one_in"] == float(f"{1 / Q:.1e}")
    assert facts["times"] == pytest.approx(math.sqrt(1 + 1e6 * Q), rel=1e-3)


@pytest.mark.parametrize(
    ("x", "place"),
    [
        # P(X > place) is a little more than the chance to be 5.5 standard deviations out.
        (RECTANGLE, 1 - 2.1 * float(norm.sf(5.5))),
        (TRIANGLE, 1 - 1.02 * math.sqrt(2 * float(norm.sf(5.5)))),
    ],
)
@pytest.mark.parametrize("sign", ["", "-"])
def test_a_jump_near_the_end_of_a_bounded_input_is_told(x: str, place: float, sign: str) -> None:
    (facts,) = told(f"x + w + 10000*step({sign}x - {place!r})", x)
    assert facts["radius"] == 5.5


SMOOTH = ["x + w", "(x + 2)**3 + w", "exp(x/2) + w", "sqrt(x + 1.1) + w", "1/(x + 3) + w"]


@pytest.mark.parametrize("equation", [*SMOOTH, "abs(x) + w", "x + w + step(x - 0.3)"])
@pytest.mark.parametrize("x", [RECTANGLE, TRIANGLE])
def test_nothing_is_told_of_what_trials_have_seen(equation: str, x: str) -> None:
    assert told(equation, x) == []


@pytest.mark.parametrize(
    ("x", "more", "count"),
    [
        (NORMAL, "", 1),
        ("{value: 0, u: 1, dof: 9}", "", 0),
        (NORMAL, "correlations: [[x, w, 0.5]]\n", 0),
    ],
)
def test_sources_whose_chances_are_not_those_of_a_normal_are_left_out(
    x: str, more: str, count: int
) -> None:
    text = f"equation: x + w + 1000*step(x - 5)\ninputs:\n  x: {x}\n  w: {{value: 0, u: 0.01}}\n"
    result = evaluated(text + more, trials=2000)
    assert codes(result) >= {"not-converged"}
    assert "rare-jump" not in codes(result)
    first = [item.first for item in result.outputs]
    trees = loaded(text + more).trees
    found = rare_jumps(trees, result.inputs, result.sources, first, np.ones(1), 40_960, 2)
    assert len(found) == count
