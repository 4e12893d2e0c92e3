"""`mtu budget`."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from mtu_cli.analyses.budget import BudgetResult, evaluate_budget
from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.options import Options
from mtu_cli.files.budget import load_budget
from mtu_cli.model.settings import Settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def run(options: Options) -> None:
    """Evaluates an uncertainty budget."""
    # The file says all: with a machine named no study is looked for around it.
    execute(replace(options, values={**options.values, "machine": options.file}), analyse)


def analyse(inputs: Inputs, settings: Settings) -> Outcome:
    """The budget of the file, and how it is told."""
    from mtu_cli.reports import budget as report

    loaded = load_budget(inputs.options.file)
    inputs.sources.append(loaded.source)
    result = evaluate_budget(loaded, settings, inputs.options.k)
    return Outcome(
        results=lambda: report.document(result),
        tables=lambda: _tables(result, settings.digits),
        rows=lambda: report.csv_rows(result),
        figure=lambda: _figure(result),
        warnings=result.warnings,
        settings=_with_factor(settings, result),
    )


def _with_factor(settings: Settings, result: BudgetResult) -> Settings:
    """The settings with the factor that was used; none where each output has its own or has none.

    Those are with the outputs.
    """
    factors = {output.k for output in result.outputs}
    return replace(settings, coverage_factor=factors.pop() if len(factors) == 1 else math.nan)


def _tables(result: BudgetResult, digits: int) -> list[object]:
    from mtu_cli.reports.budget_table import table

    return [*table(result, digits)]


def _figure(result: BudgetResult) -> Figure:
    from mtu_cli.reports.budget_figure import figure

    return figure(result)
