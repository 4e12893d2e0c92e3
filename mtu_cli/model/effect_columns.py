"""Columns that no equation needs, but tell where a declared effect holds."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mtu_cli.findings import Finding
from mtu_cli.model.covariates import Columns, Values, number, used_columns
from mtu_cli.model.effect_ranges import effect_warnings_at
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.temperatures import temperature_warnings
from mtu_cli.stats.least_squares import FloatArray


def with_effect_columns(
    model: MachineModel, values: Values, columns: Columns, at: Mapping[str, float]
) -> Values:
    """The `values` that equations need (`needed_covariates`), and others by name of which declared
    effects have a range that they were found in; nan in cells that are no number.
    """
    found: Values = {}
    for name in used_columns(model):
        if name in columns:
            column = columns[name]
            own = map(number, column.tolist()) if column.dtype == object else column
            found[name] = np.array(list(own), np.float64)
        elif name in at:
            found[name] = at[name]
    return {**found, **values}


def guess_warnings(
    model: MachineModel,
    places: FloatArray,
    values: Values,
    columns: Columns,
    at: Mapping[str, float],
) -> list[Finding]:
    """Temperatures of points at `places` (n, 3) mm, and what declared effects were found in,
    beyond what is known.
    """
    return [
        *temperature_warnings(model, places, values),
        *effect_warnings_at(model, places, with_effect_columns(model, values, columns, at)),
    ]
