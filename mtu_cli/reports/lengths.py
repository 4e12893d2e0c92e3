"""The report of lengths: feature-to-feature lengths with uncertainty and conformance.

`conformance` is null where no tolerance is given, `joint_conformance` where fewer than two
lengths have one, `between_components.pair` where no two components that were read in passes
of their own contribute, `shares` (of u^2) under the papers' independence and where u is 0.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from mtu_cli.analyses.lengths import Length, LengthsResult
from mtu_cli.findings import Finding, listed
from mtu_cli.reports import figures, validations
from mtu_cli.reports.document import finite, root, um, um2
from mtu_cli.reports.labels import folded
from mtu_cli.reports.numbers import chance, interval, percent, significant, with_u
from mtu_cli.reports.outside import components_beyond, mark_notes, marked
from mtu_cli.reports.shares import shares_fields, shares_sheets
from mtu_cli.reports.tables import Column, Sheet
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = 60
"""Lengths drawn on one sheet."""


def document(result: LengthsResult) -> dict[str, Any]:
    """`results` of the report."""
    joint = result.joint_conformance
    toleranced = [length.id for length in result.lengths if length.conformance]
    return {
        "lengths": [_length(item) for item in result.lengths],
        "joint_conformance": None
        if joint is None
        else {"lengths": toleranced, "probability": finite(joint[0]), "se": finite(joint[1])},
        "monte_carlo": {"trials": result.run.trials, "converged": result.run.converged},
    }


def _length(item: Length) -> dict[str, Any]:
    u_apart = root(item.independent_variance)
    expanded = item.k * item.u
    return {
        "id": item.id,
        "from": item.start,
        "to": item.end,
        "nominal_mm": finite(item.nominal),
        "estimated_mm": finite(item.nominal + item.error),
        "error_um": um(item.error),
        "variance_um2": um2(item.variance),
        "u_um": um(item.u),
        "shares": shares_fields(item.shares),
        "U_um": um(expanded),
        "k": finite(item.k),
        "dof_effective": finite(item.dof),
        "interval_um": [um(item.error - expanded), um(item.error + expanded)],
        "interval95_um": [um(end) for end in item.interval95],
        "independent": {
            "variance_um2": um2(item.independent_variance),
            "u_um": um(u_apart),
            "U_um": um(item.k * u_apart),
        },
        "between_components": {
            "u_uncorrelated_um": um(root(item.variance_uncorrelated)),
            "u_bounds_um": [um(end) for end in item.u_bounds],
            "pair": None if item.pair is None else list(item.pair),
        },
        "conformance": None
        if item.conformance is None
        else {
            "tolerance_um": um(item.conformance.tolerance),
            "probability": finite(item.conformance.probability),
        },
        "validation": validations.validation_fields(item.validation, "um", UM),
    }


def warnings(result: LengthsResult) -> list[Finding]:
    """The result's warnings, and what clause 8 and the trials have to say."""
    names = [item.id for item in result.lengths]
    found = [item.validation for item in result.lengths]
    return [
        *result.warnings,
        *validations.validation_warnings(names, found, "um", UM),
        *validations.convergence_warnings(result.run.trials, result.run.converged),
    ]


def table(result: LengthsResult, digits: int = 2) -> list[Sheet]:
    """One row a length; um beside the nominal length. Then what u consists of."""
    toleranced = any(item.conformance for item in result.lengths)
    columns = [
        Column(title="length\n", text=True, folds=True),
        Column(title="nominal\nmm"),
        *(Column(title=f"{name}\num") for name in ("error", "u", "U", "95 % interval")),
        Column(title="u indep.\num"),
    ]
    if toleranced:
        columns += [Column(title="tolerance\num"), Column(title="conforming\n%")]
    beyond = components_beyond(result.prediction)
    rows = [
        [marked(item.id, [item.start, item.end], beyond), *_row(item, toleranced, digits)]
        for item in result.lengths
    ]
    k = result.lengths[0].k
    notes = [
        f"U = {k:g} u of one future part: repeatability, drift, coefficients; error = actual minus "
        "nominal; u indep.: ends and components independent (Gilsinn & Ling 2004, eq. (22))"
    ]
    invalid = [x.id for x in result.lengths if x.validation.passed is not True]
    notes.append(
        "first order valid for all lengths (Monte Carlo, JCGM 101, clause 8)"
        if not invalid
        else f"first order not shown to be valid for {listed(invalid)} (JCGM 101, clause 8)"
    )
    if result.joint_conformance is not None:
        conforming = chance(*result.joint_conformance)
        notes.append(f"all toleranced lengths of one part conform: {conforming} %")
    notes += mark_notes(result.prediction)
    sheet = Sheet(title="Lengths", columns=columns, rows=rows, notes=notes)
    return [sheet, *_shares(result, digits)]


def _shares(result: LengthsResult, digits: int) -> list[Sheet]:
    items = [(x.id, x.u / UM, x.shares) for x in result.lengths]
    return shares_sheets("u", "um", items, digits)


def _row(item: Length, toleranced: bool, digits: int) -> list[str]:
    """The cells beside the length's name."""
    error, u = item.error / UM, item.u / UM
    low, high = (end / UM for end in item.interval95)
    row = [
        f"{item.nominal:.3f}",
        *with_u(error, u, digits),
        with_u(item.k * u, u, digits)[0],
        interval(low, high, u, digits),
        significant(root(item.independent_variance) / UM, digits),
    ]
    if toleranced:
        found = item.conformance
        row += (
            ["-", "-"]
            if found is None
            else [f"±{found.tolerance / UM:g}", percent(found.probability)]
        )
    return row


CSV_COLUMNS = [
    "id", "from", "to", "nominal_mm", "estimated_mm", "error_um", "variance_um2", "u_um", "U_um",
    "k", "dof_effective", "interval_low_um", "interval_high_um", "interval95_low_um",
    "interval95_high_um", "independent_variance_um2", "independent_u_um", "independent_U_um",
    "u_uncorrelated_um", "u_bound_low_um", "u_bound_high_um", "tolerance_um",
    "conformance_probability",
]  # fmt: skip


def csv_rows(result: LengthsResult) -> tuple[list[str], Iterable[list[object]]]:
    """One row a length, the fields of `results.lengths` side by side."""
    return CSV_COLUMNS, (_flat(_length(item)) for item in result.lengths)


def _flat(found: dict[str, Any]) -> list[object]:
    plain = CSV_COLUMNS[:11]
    between, conformance = found["between_components"], found["conformance"] or {}
    return [
        *(found[name] for name in plain),
        *found["interval_um"],
        *found["interval95_um"],
        *found["independent"].values(),
        between["u_uncorrelated_um"],
        *between["u_bounds_um"],
        conformance.get("tolerance_um"),
        conformance.get("probability"),
    ]


@figures.styled
def figure(result: LengthsResult, digits: int = 2) -> Figure:
    """The lengths' errors with U, independent below, and tolerance limits; figures beside them to
    the places of the table.
    """
    shown = result.lengths[:SHOWN]
    page = figures.blank(8.0, max(2.6, 1.7 + 0.52 * len(shown)))
    panel = page.subplots()
    panel.axvline(0.0, color=figures.GREY, linewidth=0.9)
    for row, item in enumerate(shown):
        _draw(panel, row, item, digits)
    more = f" (first {SHOWN} of {len(result.lengths)})" if len(result.lengths) > SHOWN else ""
    k = shown[0].k
    panel.set_title(f"Errors of the lengths, ± {k:g} u{more}")
    panel.set_yticks(
        range(len(shown)), [f"{folded(item.id)}\n{item.nominal:.2f} mm" for item in shown]
    )
    panel.set_ylim(len(shown) - 0.45, -0.55)
    panel.set_xlabel("actual minus nominal length, um")
    panel.grid(axis="y", visible=False)
    panel.margins(x=0.04)
    page.legend(loc="outside lower center", ncols=3)
    return page


def _beside(item: Length, u: float, digits: int) -> str:
    """Such as "-3.5 ± 14.0 um": error and k `u`, to the last place of the length's own u."""
    places = item.u / UM
    error, expanded = (with_u(x / UM, places, digits)[0] for x in (item.error, item.k * u))
    return f"{error} ± {expanded} um"


def _draw(panel: Axes, row: int, item: Length, digits: int) -> None:
    apart = root(item.independent_variance)
    bars = [
        (item.u, -0.13, figures.BLUE, 2.4, "with shared covariance"),
        (apart, 0.13, figures.ORANGE, 1.6, "independent ends and components"),
    ]
    for u, offset, colour, width, label in bars:
        panel.errorbar(
            item.error / UM,
            row + offset,
            xerr=item.k * u / UM,
            fmt="o",
            color=colour,
            elinewidth=width,
            capsize=3.5,
            markersize=4.5,
            label=label if row == 0 else None,
        )
        panel.text(
            1.01,
            row + offset,
            _beside(item, u, digits),
            transform=panel.get_yaxis_transform(),
            va="center",
            fontsize=7.5,
            color=colour,
        )
    if item.conformance is not None:
        limit = item.conformance.tolerance / UM
        labelled = not panel.get_legend_handles_labels()[1].count("tolerance")
        panel.vlines(
            [-limit, limit],
            row - 0.36,
            row + 0.36,
            color=figures.RED,
            linewidth=2.0,
            label="tolerance" if labelled else "_",
        )
