"""What other tools get wrong about budgets, each with the wrong figure: here they are right.

Oracles: closed forms by hand and the engine's own standard errors (four of them).
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from budget_examples import codes, evaluated, single

from mtu_cli.findings import InputError

SEVEN = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0])


def test_type_a_and_type_b_on_one_input_count_once() -> None:
    """Peers: suncal counts type B twice by Monte Carlo (1.434 for 1.030).

    s/sqrt(7) = 0.247 and u = 1: u = sqrt(1 + 0.247^2) = 1.030; drawn as t of 6 degrees of
    freedom the type A part is 0.3025, and u by Monte Carlo 1.0448.
    """
    readings = (SEVEN * 0.247 * math.sqrt(7) / SEVEN.std(ddof=1)).tolist()
    result = evaluated(f"equation: x\ninputs: {{x: {{readings: {readings}, u: 1}}}}\n", digits=3)
    output = single(result)
    assert output.first.u == pytest.approx(1.030, abs=0.0005)
    assert output.first.dof == pytest.approx(6 * (output.first.u / 0.247) ** 4)
    expected = math.sqrt(1 + 1.5 * 0.247**2)
    assert result.run.u[0] == pytest.approx(expected, abs=4 * result.run.se_u[0] + 1e-6)


@pytest.mark.parametrize(
    ("entry", "second", "mean"),
    [
        # Normal: x^2/u^2 is chi-squared: mean u^2, standard deviation sqrt(2) u^2.
        ("u: 0.2", math.sqrt(2) * 0.04, 0.04),
        # Rectangular, a^2 = 3 u^2: V = a^4 (1/5 - 1/9) = 4 a^4/45.
        ("u: 0.2, distribution: rectangular", math.sqrt(4 / 45) * 0.12, 0.04),
        # Arcsine, a^2 = 2 u^2: V = a^4 (3/8 - 1/4) = a^4/8.
        ("u: 0.2, distribution: arcsine", math.sqrt(1 / 8) * 0.08, 0.04),
    ],
)
def test_a_square_at_zero(entry: str, second: float, mean: float) -> None:
    """Peers: u = 0 for x^2 at 0 without a word (suncal, metrolopy, uncertainties issue 92)."""
    result = evaluated(f"equation: x**2\ninputs: {{x: {{value: 0, {entry}}}}}\n", trials=400_000)
    first = single(result).first
    assert first.u == 0.0
    assert first.second_u == pytest.approx(second)
    assert first.second_value == pytest.approx(mean)
    assert result.run.u[0] == pytest.approx(second, abs=4 * result.run.se_u[0])
    assert result.run.mean[0] == pytest.approx(mean, abs=4 * result.run.se_mean[0])
    assert "second-order" in codes(result)
    assert single(result).validation.passed is False


def test_samples_that_are_not_finite_are_an_error() -> None:
    """Peers drop such samples in silence (suncal); here they stop the command, counted."""
    with pytest.raises(InputError) as raised:
        evaluated("equation: log(x)\ninputs: {x: {value: 1, u: 0.6}}\n")
    (found,) = raised.value.findings
    assert (found.code, found.line, found.path) == ("no-finite-value", 3, "equation")


def test_a_correlation_matrix_that_cannot_be_is_never_altered() -> None:
    """Peers alter or never check it (uncertainties issues 101 and 95).

    r = -0.9 between all three: the smallest eigenvalue is 1 - 2 x 0.9 = -0.8.
    """
    inputs = "inputs: {a: {value: 0, u: 1}, b: {value: 0, u: 2}, c: {value: 0, u: 3}, d: 1}\n"
    pairs = "correlations: [[a, b, -0.9], [b, c, -0.9], [a, c, -0.9]]\n"
    with pytest.raises(InputError) as raised:
        evaluated("equation: a + b + c + d\n" + inputs + pairs)
    text = str(raised.value)
    assert text.startswith("b.yaml:5: correlations: ")
    assert "smallest eigenvalue of the correlation matrix is -0.8" in text
    for pair in ("a-b -0.9", "b-c -0.9", "a-c -0.9"):
        assert pair in text
