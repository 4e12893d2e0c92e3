"""From a call's files to a machine with all components known."""

from __future__ import annotations

from dataclasses import dataclass

from mtu_cli.cli.inputs import Inputs
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.fit import MachineFit, estimates_from_fit, estimates_from_report, fit_machine
from mtu_cli.model.machine_model import MachineModel, build_model
from mtu_cli.model.settings import Warned


@dataclass(frozen=True, slots=True, kw_only=True)
class Modelled:
    """The model of a call, what it was made of, and what to warn of."""

    model: MachineModel
    estimates: Estimates
    fit: MachineFit | None
    warnings: tuple[Warned, ...]


def modelled(inputs: Inputs) -> Modelled:
    """A components report wins over readings, readings over the machine file."""
    machine = inputs.machine
    warnings = [Warned(code=item.code, message=item.message) for item in machine.warnings]
    report = inputs.components
    fit = None
    if report is not None:
        estimates = estimates_from_report(machine, report)
        if inputs.files("lbb") or inputs.files("laser"):
            warnings.append(
                Warned(
                    code="readings-not-used",
                    message=f"{report.source.shown} gives the components: "
                    "the readings are not read again",
                )
            )
    else:
        readings = inputs.readings
        fit = None if readings is None else fit_machine(machine, readings)
        estimates = estimates_from_fit(machine, fit)
    model = build_model(machine, estimates)
    unused = [name for name in inputs.at if name not in model.covariates()]
    warnings += [
        Warned(code="covariate-not-needed", message=f"no equation needs --at {name}")
        for name in unused
    ]
    warnings += [Warned(code=code, message=text) for code, text in estimates.warnings]
    return Modelled(model=model, estimates=estimates, fit=fit, warnings=tuple(warnings))
