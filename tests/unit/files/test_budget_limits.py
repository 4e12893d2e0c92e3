"""Budget files: what has no uncertainty, no name or no bounds, and limits stated in two places."""

from __future__ import annotations

from typing import get_args

import pytest
from budget_examples import loaded

from mtu_cli.errors import InputError
from mtu_cli.files import budget_contract
from mtu_cli.files.budget_checks import SHAPED
from mtu_cli.stats import monte_carlo
from mtu_cli.stats.distributions import Distribution, Kind

SUM = "equation: a + b\ninputs:\n  b: {value: 1, u: 0.1}\n"


def faults(text: str) -> list[str]:
    with pytest.raises(InputError) as raised:
        loaded(text)
    return [str(problem) for problem in raised.value.findings]


@pytest.mark.parametrize(
    "entry",
    [
        "1",
        "{value: 1}",
        "{value: 1, u: 0}",
        "{value: 1, half_width: 0, distribution: arcsine}",
        "{readings: [1, 1, 1]}",
        "{value: 1, contributions: [{u: 0}]}",
    ],
)
def test_nothing_is_correlated_with_an_exact_input(entry: str) -> None:
    (found,) = faults(SUM + f"  a: {entry}\ncorrelations: [[b, a, 0.9]]\n")
    assert found.startswith("b.yaml:7: correlations[0]: correlated, but it has no uncertainty: 'a'")


@pytest.mark.parametrize(
    "entry",
    [
        "{value: 1, u: 1}",
        "{low: 0, high: 1, distribution: rectangular}",
        "{readings: [1, 2]}",
        "{value: 1, contributions: [{u: 0}, {U: 1, k: 2}]}",
    ],
)
def test_an_input_with_any_width_may_be_correlated(entry: str) -> None:
    loaded(SUM + f"  a: {entry}\ncorrelations: [[b, a, 0.1]]\n")


@pytest.mark.parametrize("name", ["''", "' '"])
def test_every_output_has_a_name(name: str) -> None:
    (found,) = faults(f"equations: {{{name}: a}}\ninputs: {{a: {{value: 1, u: 1}}}}\n")
    assert "an output without a name" in found


def test_one_rule_for_coverage_factors() -> None:
    """A file may state what --k may: above 0 and below 100."""
    budget = loaded(SUM.replace("a + b", "b") + "coverage: {k: 4}\n")
    assert budget.budget.coverage.k == 4.0
    for k in ("0", "100", "-1"):
        (found,) = faults(SUM.replace("a + b", "b") + f"coverage: {{k: {k}}}\n")
        assert "coverage.k" in found


def test_limits_that_two_floors_state_are_the_same() -> None:
    assert budget_contract.LARGEST_PROBABILITY == monte_carlo.LARGEST_PROBABILITY
    for kind in get_args(Kind):
        assert (kind in SHAPED) == Distribution(kind=kind, u=1.0, half_width=1.0).bounded
    assert get_args(budget_contract.DistributionName) == get_args(Kind)
