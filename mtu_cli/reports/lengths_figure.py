"""The picture of lengths: errors with U, by either covariance, and tolerance limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.lengths import Length, LengthsResult
from mtu_cli.reports import figures
from mtu_cli.reports.figures import Intervals
from mtu_cli.reports.numbers import with_u
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@figures.styled
def figure(result: LengthsResult, digits: int = 2) -> Figure:
    """A row a length, the numbers beside it to the places of the table; many, as of a step gauge,
    over the nominal length.
    """
    items = result.lengths
    error = np.array([item.error for item in items]) / UM
    U = np.array([item.U for item in items]) / UM
    apart = np.array([item.independent_U for item in items]) / UM
    names = ("with shared covariance", "independent ends and components")
    bars = [
        Intervals(label=names[0], colour=figures.BLUE, value=error, half=U),
        Intervals(
            label=names[1], colour=figures.ORANGE, value=error, half=apart, shift=0.28, width=1.0
        ),
    ]
    limits = [None if x.conformance is None else x.conformance.tolerance / UM for x in items]
    label = "actual minus nominal length, um"
    if len(items) > figures.FEW_ROWS:
        page = figures.blank(8.0, 5.0)
        panel = page.subplots()
        at = np.array([item.nominal for item in items])
        figures.over_length(panel, bars[::-1], at, label)
        reach = 0.006 * (np.ptp(at) or 1.0)
        for x, limit in zip(at, limits, strict=True):
            if limit is not None:
                panel.hlines(
                    [-limit, limit], x - reach, x + reach, color=figures.RED, label="tolerance"
                )
    else:
        page = figures.blank(8.0, figures.rows_height(len(items)) + 0.8)
        panel = page.subplots()
        beside = [_with_expanded(item, digits) for item in items]
        figures.intervals(panel, [f"{x.id}, {x.nominal:.2f} mm" for x in items], bars, beside)
        for row, limit in enumerate(limits):
            if limit is not None:
                ends = row - 0.3, row + 0.4
                panel.vlines([-limit, limit], *ends, color=figures.RED, lw=2.0, label="tolerance")
        panel.set_xlabel(label)
    figures.title(page, f"Predicted errors of the lengths ± {items[0].k:g} u")
    figures.legend(page)
    return page


def _with_expanded(item: Length, digits: int) -> str:
    """Such as "-3.5 ± 14.0 um": error and k u, to the last place of u."""
    u = item.u / UM
    shown, expanded = (with_u(value / UM, u, digits)[0] for value in (item.error, item.U))
    return f"{shown} ± {expanded} um"
