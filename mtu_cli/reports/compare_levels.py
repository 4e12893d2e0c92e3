"""Predicted and measured errors of compare along three axes, an operation a group."""

from __future__ import annotations

import numpy as np

from mtu_cli.analyses.compare import CompareResult
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.level_maps import Maps, Side
from mtu_cli.reports.levels import flat
from mtu_cli.units import UM


def maps_of(result: CompareResult, most: int) -> Maps | None:
    """The first operations, predicted below measured; None where one plane shows everything, and
    without errors in x and y.
    """
    found = result.features
    operations = list(dict.fromkeys(label[0] for label in found.labels))[:most]
    axes = tuple(axis for axis in AXES if any(label[2] == axis for label in found.labels))
    if not {"x", "y"} <= set(axes) or flat(result.places, axes):
        return None
    index = {name: i for i, name in enumerate(result.ids)}
    shape = (len(operations), 2, len(result.ids), 3)
    errors = np.full(shape, np.nan)
    for i, (operation, name, axis) in enumerate(found.labels):
        if operation in operations:
            at = operations.index(operation), slice(None), index[name], AXES.index(axis)
            errors[at] = found.predicted.mean[i] / UM, found.measured.mean[i] / UM
    sides = (("predicted", figures.BLUE), ("measured", figures.ORANGE))
    groups = tuple(
        (
            operation,
            tuple(
                Side(name=name, colour=colour, errors=own[s])
                for s, (name, colour) in enumerate(sides)
            ),
        )
        for operation, own in zip(operations, errors, strict=True)
    )
    return Maps(ids=result.ids, places=result.places, axes=axes, groups=groups)
