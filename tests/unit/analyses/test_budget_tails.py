"""What a trial far out makes of the u of a Monte Carlo; oracles: plain draws, closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from budget_examples import evaluated
from scipy.stats import t

from mtu_cli.analyses.budget.first_order import Tail, unsettled

LENGTH = "{readings: [100.0003, 100.0001, 100.0005, 99.9998, 100.0002]}"


@pytest.mark.parametrize(
    ("text", "warned"),
    [
        (f"equation: L*a\ninputs: {{L: {LENGTH}, a: {{value: 1, u: 1e-6}}}}\n", False),
        (
            "equation: L*(1 - alpha*(T - 20)) + probe\n"
            f"inputs: {{L: {LENGTH}, alpha: {{value: 1.15e-5, u: 1e-6}}, "
            "T: {value: 20.5, u: 0.2}, probe: {value: 0, u: 1e-4}}\n",
            False,
        ),
        ("equation: L*a\ninputs: {L: {value: 1, u: 0.1, dof: 4}, a: {value: 1, u: 0.1}}\n", False),
        ("equation: L*a\ninputs: {L: {value: 1, u: 0.1, dof: 2.5}, a: {value: 1, u: 0.1}}\n", True),
        # The variance of a sum is known, whatever its trials.
        (
            "equation: L+a\ninputs: {L: {value: 1, u: 0.1, dof: 2.1}, a: {value: 1, u: 0.1}}\n",
            False,
        ),
        ("equation: L + a\ninputs: {L: {value: 1, u: 0.1, dof: 3}, a: 1}\n", False),
        (
            "equation: L + a\ninputs: {L: {value: 1, u: 0.03, dof: 3}, a: {value: 1, u: 0.1}}\n",
            False,
        ),
        # a makes nearly all of u: 1e-6 of its tolerance are the product's.
        (
            "equation: L*a\ninputs: {L: {value: 100, u: 0.01, dof: 4}, a: {value: 1, u: 0.1}}\n",
            False,
        ),
        ("equation: L**2\ninputs: {L: {value: 1, u: 0.01, dof: 3}}\n", True),
        ("equation: L**2\ninputs: {L: {value: 1, u: 0.01, dof: 4}}\n", False),
        ("equation: L**2\ninputs: {L: {value: 1, u: 0.1, dof: 4}}\n", True),
        ("equation: L**2\ninputs: {L: {value: 1, u: 0.1, dof: 5}}\n", False),
    ],
)
def test_u_may_not_settle_where_tails_are_long(text: str, warned: bool) -> None:
    """Not where a single trial far out changes no digit that is asked for."""
    result = evaluated(text)
    found = [item.facts for item in result.warnings if item.code == "heavy-tails"]
    assert bool(found) is warned
    assert all((each["outputs"], each["sources"]) == (["y"], ["L"]) for each in found)


@pytest.mark.parametrize(
    ("equation", "trials", "remedy"),
    [
        ("a + b", 5000, "take more trials"),
        ("a + b", 20_000, None),
        ("a*b", 5000, "use the interval"),
    ],
)
def test_of_a_linear_equation_more_trials_settle_u(
    equation: str, trials: int, remedy: str | None
) -> None:
    """From ten blocks on their control knows the variance that is drawn."""
    inputs = "{a: {value: 1, u: 0.3, dof: 3}, b: {value: 1, u: 0.3}}"
    text = f"equation: {equation}\ninputs: {inputs}\n"
    result = evaluated(text, trials=trials)
    found = [item.facts["remedy"] for item in result.warnings if item.code == "heavy-tails"]
    assert found == ([] if remedy is None else [remedy])


WRINGING = (
    "equation: c*s + t\ninputs:\n  s: {value: 1, u: SCALE}\n  t: {value: 0, u: 0.08}\n"
    "  c: {value: 0.35, contributions: [{u: 0.02}, {says: wringing, u: SMALL, dof: DOF}]}\n"
)


@pytest.mark.parametrize(
    ("small", "scale", "warned"),
    [("0.008", "0.01", False), ("0.2", "0.01", False), ("0.9", "0.3", True)],
)
def test_the_contribution_of_few_degrees_of_freedom_is_named(
    small: str, scale: str, warned: bool
) -> None:
    """c has hundreds of them; where what multiplies the one is small u is that of a plain
    simulation.
    """
    text = WRINGING.replace("SMALL", small).replace("SCALE", scale).replace("DOF", "3")
    result = evaluated(text)
    found = [item.facts["sources"] for item in result.warnings if item.code == "heavy-tails"]
    assert bool(found) is warned
    assert all(each == ["the contributions[1] 'wringing' of c"] for each in found)
    drawn = [0.02**2, 3 * float(small) ** 2]
    u = math.sqrt(0.08**2 + sum(drawn) * (1 + float(scale) ** 2) + (0.35 * float(scale)) ** 2)
    tolerance = result.outputs[0].validation.tolerance
    assert warned or result.run.u[0] == pytest.approx(u, abs=tolerance)


def test_a_contribution_without_u_is_named() -> None:
    text = WRINGING.replace("SMALL", "0.008").replace("SCALE", "0.01").replace("DOF", "2")
    result = evaluated(text)
    (found,) = (x.facts["names"] for x in result.warnings if x.code == "few-degrees-of-freedom")
    assert found == ["the contributions[1] 'wringing' of c"]


@pytest.mark.parametrize("dof", [2.5, 3.0, 4.0])
def test_one_trial_adds_to_u_what_is_foretold(dof: float) -> None:
    """In one run of twenty the furthest of 2000 trials of t + t^2/10 adds more; plain draws."""
    tail = Tail(source=0, dof=dof, linear=1.0, squared=0.1, crossed=0.0)
    far = np.abs(np.random.default_rng(3).standard_t(dof, (4000, 2000))).max(axis=1)
    added = ((far + 0.1 * far**2) ** 2 - far**2) / (2 * 2000)
    assert np.mean(added > tail.shift_of_u(2000)) == pytest.approx(0.05, abs=0.014)


@pytest.mark.parametrize("dof", [2.2, 2.9, 3.0, 8.0])
def test_the_u_of_a_sum_is_exact(dof: float) -> None:
    """Whether a t stands for such a form at the ends or none does: its own variance is known."""
    own = f"{{value: 1, u: 0.1, dof: {dof}}}"
    text = f"equation: L + a\ninputs: {{L: {own}, a: {{value: 1, u: 0.1}}}}\n"
    result = evaluated(text)
    assert result.run.u[0] == pytest.approx(0.1 * math.sqrt(1 + dof / (dof - 2)), rel=1e-12)
    assert "heavy-tails" not in [item.code for item in result.warnings]


def test_what_the_form_has_as_far_out_is_known() -> None:
    """A linear form leaves nothing to a trial, however far out; of a product what is beyond it."""
    tail = Tail(source=0, dof=3.0, linear=0.95, squared=0.0, crossed=0.0)
    assert tail.shift_of_u(10_000) == 0.0
    tail = Tail(source=0, dof=3.0, linear=0.6, squared=0.0, crossed=0.3)
    far = t.ppf(1 - 0.025 / 10_000, 3)
    expected = ((0.9 * far) ** 2 - (0.6 * far) ** 2) / 20_000
    assert tail.shift_of_u(10_000) == pytest.approx(expected)


@pytest.mark.parametrize(("trials", "warned"), [(5_000, True), (20_000, False)])
def test_too_few_trials_for_blocks_have_no_exact_u(trials: int, warned: bool) -> None:
    """Nothing controls a single block: its u is that of its trials, of a linear equation, too."""
    text = "equation: L+a\ninputs: {L: {value: 1, u: 0.1, dof: 3}, a: {value: 1, u: 0.1}}\n"
    runs = [evaluated(text, seed=seed, trials=trials) for seed in range(40)]
    off = [abs(result.run.u[0] - 0.2) for result in runs]
    assert bool(max(off) > runs[0].outputs[0].validation.tolerance) is warned
    for result in runs:
        assert ("heavy-tails" in [item.code for item in result.warnings]) is warned


def test_two_long_tails_share_what_u_may_be_off() -> None:
    tail = Tail(source=0, dof=3.0, linear=0.7, squared=0.0, crossed=0.2)
    tolerance = 1.5 * tail.shift_of_u(10_000)
    assert unsettled([tail], tolerance, 10_000) == ()
    assert unsettled([tail, tail], tolerance, 10_000) == (tail, tail)
