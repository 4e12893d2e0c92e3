"""Budgets from YAML text, evaluated as the command does."""

import textwrap
from pathlib import Path

import pytest

from mtu_cli.analyses.budget import BudgetResult, OutputBudget, evaluate_budget
from mtu_cli.files.budget import LoadedBudget, load_budget
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import parse_yaml
from mtu_cli.model.settings import Settings
from mtu_cli.stats.monte_carlo import MonteCarloResult

HEAD = "schema: mtu/budget/1\nname: example\n"
SOURCE = Source(role="budget", path=Path("b.yaml"), shown="b.yaml", sha256="0" * 64)


CORRELATED = """
    equation: a + 2*b
    inputs:
      a: {value: 0, u: 0.6, contributions: [{u: 0.8}]}
      b: {value: 0, u: 0.3, contributions: [{U: 0.8, k: 2}]}
    correlations: [[a, b, 0.7]]
"""


def loaded(text: str) -> LoadedBudget:
    """A budget without its two first lines, checked."""
    return load_budget(parse_yaml(HEAD + textwrap.dedent(text), SOURCE))


def evaluated(
    text: str, *, seed: int = 1, trials: int | None = None, digits: int = 2
) -> BudgetResult:
    """A budget without its two first lines, evaluated."""
    settings = Settings(seed=seed, trials=trials, digits=digits)
    return evaluate_budget(loaded(text), settings, None)


def single(result: BudgetResult) -> OutputBudget:
    (output,) = result.outputs
    return output


def codes(result: BudgetResult) -> set[str]:
    return {item.code for item in result.warnings}


def agrees(output: OutputBudget, **printed: tuple[float, float]) -> None:
    """That figures of an output are as printed, (figure, what it may be off)."""
    for name, (value, digit) in printed.items():
        assert getattr(output, name) == pytest.approx(value, abs=digit), name


def drawn(run: MonteCarloResult, **printed: tuple[float, float]) -> None:
    """The same of trials of a single output, with three standard errors of theirs."""
    for name, (value, digit) in printed.items():
        error = 3 * getattr(run, f"se_{name}")[0]
        assert getattr(run, name)[0] == pytest.approx(value, abs=digit + error), name
