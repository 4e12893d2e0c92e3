"""Mean errors of close-loop before and after: features in the plane, or level by level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.result import TableResult
from mtu_cli.close_loop_sealed.reports.close_loop_shown import unit_of
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Maps, Side, cut_of
from mtu_cli.stats.least_squares import FloatArray

SIDES = (("before", figures.ORANGE), ("after", figures.BLUE))
OPERATIONS = 5
"""Operations drawn."""


def maps_of(item: TableResult) -> Maps | None:
    """Errors before and after, those of several operations at the same features in groups of
    their own, and in one plane before beside after; None where there is no plane.
    """
    table = item.table
    places, ids = table.places.mean(axis=0), short_names(item)
    if not in_plane(item):
        return None
    rows = {name: i for i, name in reversed(list(enumerate(ids)))}
    names = tuple(sorted(rows, key=rows.__getitem__))
    at = [AXES.index(axis) for axis in table.axes]
    before_after = mean_errors(item) if item.effects else mean_errors(item)[:1]
    apart = len(names) < len(ids)
    groups = []
    for number, operation in enumerate(table.operations[:OPERATIONS] if apart else ("",)):
        own = np.flatnonzero(table.operation == number) if apart else np.arange(len(ids))
        to = [names.index(ids[i]) for i in own]
        sides = []
        for (name, colour), mean in zip(SIDES, before_after, strict=False):
            errors = np.full((len(names), 3), np.nan)
            errors[np.ix_(to, at)] = mean[own]
            sides.append(Side(name=name if item.effects else "", colour=colour, errors=errors))
        groups.append((operation, tuple(sides)))
    drawn = places[[rows[name] for name in names]]
    if len(groups) == 1 and "z" not in table.axes and len(cut_of(drawn, table.axes).levels) == 1:
        groups = [(side.name, (replace(side, name=""),)) for side in groups[0][1]]
    return Maps(ids=names, places=drawn, axes=table.axes, groups=tuple(groups))


def counted(features: int) -> str:
    """How many features, in words."""
    return "1 feature" if features == 1 else f"{features} features"


def mean_errors(item: TableResult) -> tuple[FloatArray, FloatArray]:
    """Mean errors (H, A) of the columns before and after, in the unit shown."""
    there = item.table.there[:, :, None]
    count = np.maximum(there.sum(axis=0), 1)
    scale = unit_of(item).to_internal

    def mean(values: FloatArray) -> FloatArray:
        found: FloatArray = np.where(there, values, 0.0).sum(axis=0) / count / scale
        return found

    return mean(item.table.errors), mean(item.table.errors - item.explained)


def in_plane(item: TableResult) -> bool:
    """Whether errors in x and y of points can be drawn as arrows."""
    return item.table.component is None and {"x", "y"} <= set(item.table.axes)


def short_names(item: TableResult) -> tuple[str, ...]:
    """Names of the features without those of their operations."""
    table = item.table
    of = [table.operations[i] for i in table.operation]
    return tuple(
        name.removeprefix(f"{operation} ")
        for name, operation in zip(table.features, of, strict=True)
    )
