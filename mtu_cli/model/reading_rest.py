"""Readings less what effects that the machine declares say of them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.findings import Finding
from mtu_cli.model.reading_columns import reading_columns, reading_places
from mtu_cli.model.reading_effects import effects_on_readings
from mtu_cli.model.reading_layout import reading_layout

if TYPE_CHECKING:
    from mtu_cli.files.machine import LoadedMachine
    from mtu_cli.files.readings import Readings


def without_effects(
    machine: LoadedMachine, readings: Readings
) -> tuple[Readings, tuple[Finding, ...]]:
    """What is left for the components: an effect that was found in readings of one is in its
    readings still, and would be counted again, as its coefficients or its scatter from pass to
    pass. Warns of effects whose columns the readings lack.
    """
    own = {effect.found.get("component") for effect in machine.machine.effects}
    if not own & set(readings.components):
        return readings, ()
    error = readings.error.copy()
    warned: list[Finding] = []
    for code, name in enumerate(readings.components):
        rows = np.flatnonzero(readings.code == code)
        if name not in own or not len(rows):
            continue
        of = machine.machine.components[name].of
        layout = reading_layout(readings, rows, of, name)
        columns = reading_columns(readings, rows, layout, of)
        places = reading_places(readings, rows, of)
        said, told = effects_on_readings(machine, name, places, columns)
        error[rows] -= said
        warned += told
    return replace(readings, error=error), tuple(warned)
