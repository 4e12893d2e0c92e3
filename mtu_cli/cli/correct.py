"""`mtu correct`."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from mtu_cli.analyses.correct import correct
from mtu_cli.analyses.correct.warmth import unused_warmth
from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.modelling import modelled
from mtu_cli.cli.options import Options
from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import InputError
from mtu_cli.model.residual_covariates import missing_sensor, point_columns
from mtu_cli.model.settings import Settings


def run(options: Options) -> None:
    """Takes the modelled error off measured points."""
    execute(options, analyse)


def analyse(inputs: Inputs, settings: Settings) -> Outcome:
    from mtu_cli.reports import correct as report

    found = modelled(inputs, lambda name, sensors: _check_sensors(inputs, name, sensors))
    part = inputs.part if inputs.files("part") else None
    result = correct(found.model, part, inputs.points, settings, inputs.at)
    used = _ring_temperatures(part)
    reference = inputs.machine.machine.reference_temperature_degC
    return Outcome(
        results=lambda: report.document(result),
        tables=lambda: report.table(result, settings.digits),
        rows=lambda: report.csv_rows(result),
        figure=lambda: report.figure(result),
        warnings=[
            *(
                item
                for item in found.warnings
                if item.code != "covariate-not-needed" or item.facts["name"] not in used
            ),
            *unused_warmth(found.model, inputs.points, reference),
            *result.warnings,
            *report.warnings(result),
        ],
    )


def _check_sensors(inputs: Inputs, name: str, sensors: Sequence[str]) -> None:
    """Raises InputError for sensors of the drift of `name`, a component of the equations, that no
    column of the points and no --at has: the points lack them whatever else is fitted.
    """
    machine = inputs.machine
    if not any(name in form.coefficients for form in machine.forms.values()):
        return
    known = point_columns(inputs.points)
    problems = [
        missing_sensor(inputs.points, sensor, [name], list(known))
        for sensor in sensors
        if sensor not in known and not any(fnmatchcase(sensor, at) for at in inputs.at)
    ]
    if problems:
        raise InputError(problems)


def _ring_temperatures(part: LoadedPart | None) -> set[str]:
    """Covariates that no equation needs, but a calibrated diameter may."""
    if part is None:
        return set()
    rounds = (*part.part.circles, *part.part.spheres)
    return {item.temperature for item in rounds if item.temperature is not None}
