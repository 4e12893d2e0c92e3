"""What the trials of a budget draw."""

from __future__ import annotations

import math

import numpy as np
import pytest
from budget_examples import codes, evaluated, loaded

from mtu_cli.analyses.budget.first_order import first_order
from mtu_cli.analyses.budget.inputs import inputs_of
from mtu_cli.analyses.budget.trials import BudgetTrials
from mtu_cli.stats.coverage import coverage_factor


def test_correlated_inputs_of_equal_degrees_of_freedom_are_a_multivariate_t() -> None:
    """The coefficient is as stated; a - b is a t of the same degrees of freedom, and each input.

    Scales of their own would leave 0.9 times the coefficient, and tails of a - b between t and
    normal.
    """
    text = (
        "equations: {a: x, b: y, d: x - y}\n"
        "inputs: {x: {value: 0, u: 1, dof: 6}, y: {value: 0, u: 2, dof: 6}}\n"
        "correlations: [[x, y, 0.7]]\n"
    )
    result = evaluated(text, trials=400_000)
    assert codes(result) == set()
    V = result.run.covariance
    # r of a sample of t with 6 degrees of freedom: (1 - r^2) sqrt((1 + kappa/3)/M), kappa = 3.
    error = (1 - 0.7**2) * math.sqrt(2 / 400_000)
    assert V[0, 1] / math.sqrt(V[0, 0] * V[1, 1]) == pytest.approx(0.7, abs=4 * error)
    for i, u in enumerate((1.0, 2.0, math.sqrt(1 + 4 - 2 * 0.7 * 2))):
        assert result.run.high[i] == pytest.approx(
            coverage_factor(0.95, 6.0) * u, abs=4 * result.run.se_high[i] + 1e-9
        )


def test_few_trials_leave_out_the_control_they_cannot_use() -> None:
    """The same random numbers and the same values, with the first-order form or without."""
    budget = loaded("equation: a*b\ninputs: {a: {value: 1, u: 0.3, dof: 5}, b: {value: 2, u: 1}}\n")
    inputs = inputs_of(budget)
    first = first_order(budget, inputs)
    drawn = [
        BudgetTrials(budget.trees, inputs, first, controlled).draw(np.random.default_rng(1), 1000)
        for controlled in (True, False)
    ]
    assert np.array_equal(drawn[0].values, drawn[1].values)
    assert drawn[0].linear is not None
    assert drawn[1].linear is None
