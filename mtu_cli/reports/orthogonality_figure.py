"""The picture of orthogonality: trials, interval and first-order curve of every angle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mtu_cli.analyses.orthogonality import Orthogonality, OrthogonalityResult
from mtu_cli.reports import figures
from mtu_cli.reports.figures import Spread
from mtu_cli.reports.labels import cut
from mtu_cli.reports.numbers import interval, significant, with_u
from mtu_cli.units import ARCSEC

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ANGLES = 6
"""Angles drawn on one sheet."""
LETTERS = 100
"""Of a title across the sheet."""


@figures.styled
def figure(result: OrthogonalityResult) -> Figure:
    """Histogram of the trials of every angle, its interval, and the first-order curve."""
    shown = result.angles[:ANGLES]
    columns = figures.columns_of(len(shown), 2)
    rows = math.ceil(len(shown) / columns)
    page = figures.blank(8.0 if columns == 1 else 11.0, 1.0 + 3.2 * rows)
    for panel, item in zip(figures.panels_of(page, len(shown), columns), shown, strict=False):
        low, high = item.run.low[0] / ARCSEC, item.run.high[0] / ARCSEC
        first = item.first_order
        start, end = first.interval95
        figures.histogram(
            panel,
            Spread(
                samples=item.run.samples[0] / ARCSEC, interval=(low, high),
                first=(first.mean / ARCSEC, first.u / ARCSEC, first.dof),
                first_interval=(start / ARCSEC, end / ARCSEC),
            ),
        )  # fmt: skip
        panel.set_title(_of_angle(item, LETTERS // columns))
        panel.set_xlabel("angle minus 90 degrees, arcsec")
    figures.legend(page)
    return page


def _of_angle(item: Orthogonality, letters: int) -> str:
    run, scale = item.run, item.scale / ARCSEC
    ends = interval(run.low[0] / ARCSEC, run.high[0] / ARCSEC, scale)
    mean, _ = with_u(run.mean[0] / ARCSEC, scale)
    text = f"mean {mean}, u {significant(run.u[0] / ARCSEC)} arcsec, 95 % {ends}"
    long = len(item.id) + len(text) > letters
    return f"{cut(item.id, letters)}:{chr(10) if long else ' '}{text}"
