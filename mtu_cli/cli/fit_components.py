"""`mtu fit-components`."""

from __future__ import annotations

from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.gates import read_gates
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.options import Options
from mtu_cli.findings import error
from mtu_cli.model.fit import MachineFit, estimates_from_fit, fit_machine, machine_warnings
from mtu_cli.model.fit_warnings import fit_warnings
from mtu_cli.model.settings import Settings
from mtu_cli.stats.family import significant

GATES = ("drift",)


def run(options: Options) -> None:
    """Reads, fits and reports the components of a machine."""
    execute(options, analyse)


def analyse(inputs: Inputs, settings: Settings) -> Outcome:
    from mtu_cli.reports import fit_components as report

    gates = read_gates(inputs.options.fail_if, GATES.__contains__, "drift")
    machine = inputs.machine
    readings = inputs.readings
    if readings is None:
        raise error(
            "no-input",
            role="lbb or laser file",
            expected="--lbb FILE or --laser FILE, or a study that names one "
            f"({inputs.without('lbb', 'laser')})",
        )
    fit = fit_machine(machine, readings)
    estimates = estimates_from_fit(machine, fit)
    warnings = [*machine_warnings(machine, estimates), *readings.notes]
    says = {name: item.says for name, item in machine.machine.components.items() if item.says}
    return Outcome(
        results=lambda: report.document(machine.machine.name, fit, estimates, says=says),
        tables=lambda: report.table(machine.machine.name, fit, estimates, settings.digits),
        rows=lambda: report.csv_rows(fit, estimates),
        figure=lambda: report.figure(fit, estimates, settings.coverage_factor, says=says),
        warnings=[
            *warnings,
            *fit_warnings(fit, inputs.suspicions),
            *report.warnings(fit, estimates),
        ],
        gate=_drift(fit) if gates else None,
    )


def _drift(fit: MachineFit) -> str | None:
    """Passes that drift in one direction, or differ by more than repeatability: what has a star
    in the table.
    """
    scatter: dict[str, float] = {}
    trend: dict[str, float] = {}
    for name, component in fit.components.items():
        for item in component.instruments:
            if item.scatter is not None:
                scatter[f"{name} (pass to pass)"] = item.scatter.p
            if item.trend is not None:
                trend[f"{name} (trend)"] = item.trend.p
    found = [*significant(scatter), *significant(trend)]
    return f"drift in {', '.join(found)}" if found else None
