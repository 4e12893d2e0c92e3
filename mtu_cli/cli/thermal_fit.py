"""`mtu thermal-fit`."""

from __future__ import annotations

from mtu_cli.analyses.thermal_fit import METHODS, Check, thermal_fit
from mtu_cli.analyses.thermal_fit.result import ThermalFit
from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.options import Options
from mtu_cli.errors import Warned, fault
from mtu_cli.model.settings import Settings
from mtu_cli.stats.threads import one_blas_thread

REFERENCE_WITHOUT_MACHINE = 20.0
"""ISO 1."""


def run(options: Options) -> None:
    """Reads drift readings, fits and reports thermal models."""
    execute(options, analyse)


def analyse(inputs: Inputs, settings: Settings) -> Outcome:
    from mtu_cli.reports import thermal_fit as report

    method = inputs.options.model
    if method not in METHODS:
        raise fault("unknown model", value=method, expected=", ".join(METHODS))
    if not inputs.files("drift"):
        inputs.only("drift", "--drift")
    fit = fitted(inputs, method)
    warnings = inputs.machine.warnings if inputs.files("machine") else ()
    return Outcome(
        results=lambda: report.document(fit),
        tables=lambda: report.tables(fit),
        rows=lambda: report.rows(fit),
        figure=lambda: report.figure(fit),
        warnings=[
            *(Warned(code=item.code, message=item.message) for item in warnings),
            *fit.warnings,
        ],
    )


def fitted(inputs: Inputs, method: str, check: Check | None = None) -> ThermalFit:
    """The thermal models of a call's drift readings; `check` as for `thermal_fit`."""
    machine = inputs.machine.machine if inputs.files("machine") else None
    with one_blas_thread():
        return thermal_fit(
            inputs.drift,
            None
            if machine is None
            else {name: (item.of, item.unit) for name, item in machine.components.items()},
            reference=(
                REFERENCE_WITHOUT_MACHINE if machine is None else machine.reference_temperature_degC
            ),
            method=method,
            check=check,
        )
