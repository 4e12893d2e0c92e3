"""The report of orthogonality: row-to-column angles by Monte Carlo and first order.

`u_arcsec` and what follows from it are null where a source has two degrees of freedom or
fewer: the trials' distribution then has no standard deviation, and the interval says it all.
`first_order.shares` (of u^2) are null under the papers' independence and where u is 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.analyses.orthogonality import (
    Orthogonality,
    OrthogonalityResult,
    first_order_interval,
)
from mtu_cli.findings import Finding, finding
from mtu_cli.reports import figures, validations
from mtu_cli.reports.document import arcsec, finite
from mtu_cli.reports.labels import cut
from mtu_cli.reports.numbers import interval, significant, with_u
from mtu_cli.reports.outside import components_beyond, mark_notes, marked
from mtu_cli.reports.shares import shares_fields, shares_sheets
from mtu_cli.reports.tables import Column, Sheet
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult
from mtu_cli.units import ARCSEC

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = 6
"""Angles drawn on one sheet."""
LETTERS = 100
"""Of a title across the sheet."""


def document(result: OrthogonalityResult, coverage_factor: float) -> dict[str, Any]:
    """`results` of the report."""
    return {"orthogonality": [_angle(item, coverage_factor) for item in result.angles]}


def _angle(item: Orthogonality, k: float) -> dict[str, Any]:
    run = item.run
    u = float(run.u[0])
    mean, first_u, dof = item.first_order
    return {
        "id": item.id,
        "row": list(item.row),
        "column": list(item.column),
        "mean_arcsec": arcsec(run.mean[0]),
        "u_arcsec": arcsec(u),
        "U_arcsec": arcsec(k * u),
        "k": finite(k),
        # Gilsinn & Ling 2004, eq. (28): the uncertainty of one more trial about the mean of M.
        "u_eq28_arcsec": arcsec(u * math.sqrt(1.0 + 1.0 / run.trials)),
        "interval95_arcsec": [arcsec(run.low[0]), arcsec(run.high[0])],
        "shortest95_arcsec": [arcsec(run.shortest_low[0]), arcsec(run.shortest_high[0])],
        "trials": run.trials,
        "converged": run.converged,
        "first_order": {
            "mean_arcsec": arcsec(mean),
            "u_arcsec": arcsec(first_u),
            "shares": shares_fields(item.shares),
            "dof_effective": finite(dof),
            "interval95_arcsec": [arcsec(end) for end in first_order_interval(item)],
        },
        "validation": validations.validation_fields(item.validation, "arcsec", ARCSEC),
        "independent": {
            "mean_arcsec": arcsec(item.independent.mean[0]),
            "u_arcsec": arcsec(item.independent.u[0]),
            "interval95_arcsec": [
                arcsec(item.independent.low[0]),
                arcsec(item.independent.high[0]),
            ],
            "trials": item.independent.trials,
            "first_order_u_arcsec": arcsec(item.independent_first_order[1]),
        },
        "monte_carlo": _own_uncertainty(run),
    }


def _own_uncertainty(run: MonteCarloResult) -> dict[str, Any]:
    return {
        "se_mean_arcsec": arcsec(run.se_mean[0]),
        "se_u_arcsec": arcsec(run.se_u[0]),
        "se_low_arcsec": arcsec(run.se_low[0]),
        "se_high_arcsec": arcsec(run.se_high[0]),
        "gain": {name: finite(values[0]) for name, values in run.gain._asdict().items()},
    }


def warnings(result: OrthogonalityResult) -> list[Finding]:
    """The result's warnings, and what clause 8 and the trials have to say."""
    names = [item.id for item in result.angles]
    found = [item.validation for item in result.angles]
    without_u = [item.id for item in result.angles if not np.isfinite(item.run.u[0])]
    noted = [*result.warnings]
    if without_u:
        noted.append(finding("no-standard-uncertainty", names=without_u))
    noted += validations.validation_warnings(names, found, "arcsec", ARCSEC)
    for item in result.angles:
        noted += validations.convergence_warnings(item.run.trials, item.run.converged)
    return list(dict.fromkeys(noted))


def table(result: OrthogonalityResult, coverage_factor: float, digits: int = 2) -> list[Sheet]:
    """One row an angle; arcsec. Then what u consists of."""
    names = ("mean", "u", "U", "95 % interval", "first order u", "u indep.")
    columns = [
        Column(title="angle\n", text=True, folds=True),
        *(Column(title=f"{name}\narcsec") for name in names),
        Column(title="trials\n"),
        Column(title="first order\nvalid"),
    ]
    verdict = {True: "yes", False: "no*", None: "not told"}
    rows = []
    for item in result.angles:
        mean, u = item.run.mean[0] / ARCSEC, item.run.u[0] / ARCSEC
        scale = u if math.isfinite(u) else item.first_order[1] / ARCSEC
        rows.append(
            [
                marked(item.id, item.prediction.ids, components_beyond(item.prediction)),
                with_u(mean, scale, digits)[0],
                significant(u, digits),
                with_u(coverage_factor * u, u, digits)[0],
                interval(item.run.low[0] / ARCSEC, item.run.high[0] / ARCSEC, scale, digits),
                significant(item.first_order[1] / ARCSEC, digits),
                significant(item.independent.u[0] / ARCSEC, digits),
                str(item.run.trials),
                verdict[item.validation.passed],
            ]
        )
    notes = [
        f"U = {coverage_factor:g} u; angle from the row's +x to the column's +y in the xy plane, "
        "less its nominal; u indep.: all holes independent (Gilsinn & Ling 2004)",
        "first order valid: its 95 % interval agrees with the Monte Carlo (JCGM 101, clause 8); "
        "no*: it does not, use the Monte Carlo's",
        *mark_notes(*(item.prediction for item in result.angles)),
    ]
    sheet = Sheet(title="Orthogonality", columns=columns, rows=rows, notes=notes)
    return [sheet, *_shares(result, digits)]


def _shares(result: OrthogonalityResult, digits: int) -> list[Sheet]:
    items = [(x.id, x.first_order[1] / ARCSEC, x.shares) for x in result.angles]
    return shares_sheets("first order u", "arcsec", items, digits)


CSV_COLUMNS = [
    "id", "mean_arcsec", "u_arcsec", "U_arcsec", "u_eq28_arcsec", "trials", "converged",
    "interval95_low_arcsec", "interval95_high_arcsec", "shortest95_low_arcsec",
    "shortest95_high_arcsec", "first_order_mean_arcsec", "first_order_u_arcsec",
    "dof_effective", "validation_passed", "independent_mean_arcsec", "independent_u_arcsec",
]  # fmt: skip


def csv_rows(
    result: OrthogonalityResult, coverage_factor: float
) -> tuple[list[str], Iterable[list[object]]]:
    """One row an angle, the fields of `results.orthogonality` side by side."""
    return CSV_COLUMNS, (_flat(_angle(item, coverage_factor)) for item in result.angles)


def _flat(found: dict[str, Any]) -> list[object]:
    first, apart = found["first_order"], found["independent"]
    return [
        *(found[name] for name in CSV_COLUMNS[:7]),
        *found["interval95_arcsec"],
        *found["shortest95_arcsec"],
        *(first[name] for name in ("mean_arcsec", "u_arcsec", "dof_effective")),
        found["validation"]["passed"],
        apart["mean_arcsec"],
        apart["u_arcsec"],
    ]


@figures.styled
def figure(result: OrthogonalityResult) -> Figure:
    """Histogram of the trials of every angle, its interval, and the first-order curve."""
    shown = result.angles[:SHOWN]
    columns = 1 if len(shown) < 2 else 2
    rows = max(1, math.ceil(len(shown) / columns))
    page = figures.blank(8.0 if columns == 1 else 10.0, 0.8 + 3.6 * rows)
    panels = page.subplots(rows, columns, squeeze=False).ravel()
    for panel, item in zip(panels, shown, strict=False):
        _draw(panel, item, LETTERS // columns)
    for panel in panels[len(shown) :]:
        panel.set_visible(False)
    handles, names = panels[0].get_legend_handles_labels()
    page.legend(handles, names, loc="outside lower center", ncols=2)
    return page


def _draw(panel: Axes, item: Orthogonality, letters: int) -> None:
    """Of one angle; `letters` fit in a line above."""
    run = item.run
    values = run.samples[0] / ARCSEC
    low, high = run.low[0] / ARCSEC, run.high[0] / ARCSEC
    left, right = np.quantile(values, [0.0005, 0.9995])
    bins = np.linspace(left, right, 81)
    density = np.histogram(values, bins)[0] / (len(values) * np.diff(bins))
    panel.stairs(density, bins, fill=True, color=figures.PALE, label="Monte Carlo trials")
    grid = np.linspace(left, right, 400)
    panel.plot(grid, _first_order(item, grid), color=figures.INK, label="first order")
    panel.axvspan(low, high, ymax=0.03, color=figures.BLUE, label="95 % interval, Monte Carlo")
    for end in first_order_interval(item):
        panel.axvline(end / ARCSEC, color=figures.INK, linewidth=1.0, linestyle=(0, (4, 3)))
    panel.plot(
        [], [], color=figures.INK, linewidth=1.0, linestyle=(0, (4, 3)), label="95 %, first order"
    )
    panel.set_xlim(left, right)
    panel.set_ylim(0.0, None)
    panel.set_yticks([])
    panel.set_xlabel("angle minus 90 degrees, arcsec")
    u = run.u[0] / ARCSEC
    scale = u if math.isfinite(u) else item.first_order[1] / ARCSEC
    mean, _ = with_u(run.mean[0] / ARCSEC, scale)
    found = f"mean {mean}, u {significant(u)} arcsec, 95 % {interval(low, high, scale)}"
    long = len(item.id) + len(found) > letters
    panel.set_title(f"{cut(item.id, letters)}:{chr(10) if long else ' '}{found}")


def _first_order(item: Orthogonality, grid: FloatArray) -> FloatArray:
    """Density of the scaled and shifted t of the first-order result, normal without dof."""
    from scipy.special import gammaln

    mean, u, dof = item.first_order
    centre, scale = mean / ARCSEC, u / ARCSEC
    if scale == 0:
        return np.full_like(grid, np.nan)
    z = (grid - centre) / scale
    density: FloatArray
    if math.isinf(dof):
        density = np.exp(-(z**2) / 2) / (scale * math.sqrt(2 * math.pi))
    else:
        top = gammaln((dof + 1) / 2) - gammaln(dof / 2) - 0.5 * math.log(dof * math.pi)
        density = np.exp(top - (dof + 1) / 2 * np.log1p(z**2 / dof)) / scale
    return density
