"""`mtu anova`."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from mtu_cli.analyses.anova import METHODS, AnovaResult, Method, analyse_variance
from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.gates import read_gates
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.options import Options
from mtu_cli.findings import error, listed, suggestion
from mtu_cli.model.settings import Settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


GATE = "unusual"


def run(options: Options) -> None:
    """Splits the scatter of measured parts."""
    execute(options, analyse)


def analyse(inputs: Inputs, settings: Settings) -> Outcome:
    from mtu_cli.reports import anova as report

    gates = read_gates(inputs.options.fail_if, GATE.__eq__, GATE)
    method = inputs.options.method
    if method not in METHODS:
        raise error("unknown-name", what="method", value=method, **suggestion(method, METHODS))
    points = inputs.points
    part = inputs.part if inputs.files("part") else None
    datum = inputs.datum
    result = analyse_variance(points, part, cast(Method, method), settings, datum)
    return Outcome(
        results=lambda: report.document(result),
        tables=lambda: _tables(result, settings.digits),
        rows=lambda: report.csv_rows(result),
        figure=lambda: _figure(result),
        warnings=result.warnings,
        gate=_met(result) if gates else None,
    )


def _tables(result: AnovaResult, digits: int) -> list[object]:
    from mtu_cli.reports.anova_table import table

    return table(result, digits)


def _figure(result: AnovaResult) -> Figure:
    from mtu_cli.reports.anova_figure import figure

    return figure(result)


def _met(result: AnovaResult) -> str | None:
    if result.unusual is None:
        raise error("gate-undefined", gate=GATE, expected="four or more measured parts")
    if not result.unusual:
        return None
    return f"outliers among the parts: {listed(item.part for item in result.unusual)}"
