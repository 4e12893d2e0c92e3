"""The picture of lengths: errors with U, by either covariance, and tolerance limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.lengths import LengthsResult
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
    k, error, nominal = result.coverage_factor, result.error / UM, result.nominal
    u, apart = np.sqrt(result.variance) / UM, k * np.sqrt(result.independent_variance) / UM
    U = k * u
    labels = ("with shared covariance", "independent ends and components")
    bars = [
        Intervals(label=labels[0], colour=figures.BLUE, value=error, half=U),
        Intervals(
            label=labels[1], colour=figures.ORANGE, value=error, half=apart, shift=0.28, width=1.0
        ),
    ]
    limits = [None if each is None else each.tolerance / UM for each in result.conformance]
    label = "actual minus nominal length, um"
    if len(error) > figures.FEW_ROWS:
        page = figures.blank(8.0, 5.0)
        panel = page.subplots()
        figures.over_length(panel, bars[::-1], nominal, label)
        reach = 0.006 * (np.ptp(nominal) or 1.0)
        for x, limit in zip(nominal, limits, strict=True):
            if limit is not None:
                panel.hlines(
                    [-limit, limit], x - reach, x + reach, color=figures.RED, label="tolerance"
                )
    else:
        page = figures.blank(8.0, figures.rows_height(len(error)) + 0.8)
        panel = page.subplots()
        rows = zip(error, U, u, strict=True)
        beside = [_with_expanded(*row, digits) for row in rows]
        names = [f"{x}, {at:.2f} mm" for x, at in zip(result.ids, nominal, strict=True)]
        figures.intervals(panel, names, bars, beside)
        for row, limit in enumerate(limits):
            if limit is not None:
                ends = row - 0.3, row + 0.4
                panel.vlines([-limit, limit], *ends, color=figures.RED, lw=2.0, label="tolerance")
        panel.set_xlabel(label)
    figures.title(page, f"Predicted errors of the lengths ± {k:g} u")
    figures.legend(page)
    return page


def _with_expanded(error: float, U: float, u: float, digits: int) -> str:
    """Such as "-3.5 ± 14.0 um": error and k u, to the last place of u."""
    shown, expanded = (with_u(value, u, digits)[0] for value in (error, U))
    return f"{shown} ± {expanded} um"
