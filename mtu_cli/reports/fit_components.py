"""The report of fit-components: all that the prediction commands need, and the tests.

Per component everything is in its own `unit` and mm; of several instruments the tests stand in
`instruments`.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from mtu_cli.analyses.fit_components import Component, FitResult, Line
from mtu_cli.findings import listed
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.estimation import TESTS, InstrumentFit
from mtu_cli.reports import figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Fields, declare
from mtu_cli.reports.numbers import cut
from mtu_cli.stats.coverage import FAMILY_RATE
from mtu_cli.units import SMALL


def _size(item: Any, power: int = 0) -> float:
    """Of the unit of a component per m^power, in mm or rad."""
    return item.unit.to_internal / 1000.0**power


SIZES: dict[str, Any] = {
    "size": _size,
    "size2": lambda item: _size(item) ** 2,
    # um^2, or arcsec^2 of an angle.
    "square": lambda item: float(SMALL[item.unit.dimension].to_internal ** 2),
    "star": lambda test: "*" if test.significant else "",
}
TESTED = declare(
    """
    drift. | tests.drift
        F | made.F | variance ratio
        p | made.p | p that passes differ by no more than repeatability | drift / p, p, mark=star()
        df | made.df | its degrees of freedom | -, json
    trend. | tests.trend
        per_pass | made.value | steady change from pass to pass | -, size=size()
        u | made.u | its standard uncertainty | -, size=size()
        p | made.p | p that there is none | trend / p, p, mark=star()
        dof | made.dof | its degrees of freedom | -, json
    lack_of_fit. | tests.lack_of_fit
        F | made.F | variance ratio
        p | made.p | p that the polynomial fits | misfit / p, p, mark=star()
        df | made.df | its degrees of freedom | -, json
    reversal. | tests.reversal
        mean | made.value | forward minus reverse \
            | reversal / unit, plus-minus, u=made.u, size=size(), mark=star()
        u | made.u | its standard uncertainty | -, size=size()
        p | made.p | p that there is none
        dof | made.dof | its degrees of freedom | -, json
    r2 | | share of the variance of the readings that the polynomial explains
    """,
    **SIZES,
)
COMPONENT = """
    - | label | name | component, text, csv=component
    of | | its axis; null: a constant | of, text
    unit | unit.name | of its figures | unit, text
    says | | its meaning in words, of the machine file | -, json
    source | | readings or machine file | from, text, detail
    -. | polynomial()
        for POWER HEAD in powers
            - | coefficients.POWER | | HEAD, plus-minus, u=root(covariance.POWER.POWER), \
                size=per_mPOWER()
    degree | estimate.degree | degree of the polynomial; null of a table
    shape | shape() | polynomial or table
    at_mm | estimate.table.at | positions of the values of a table | -, json
    roughness_um2_per_mm3 | estimate.table.roughness | of a table: variance of the integrated \
        Wiener process between its positions (arcsec2 of an angle) | -, json, size=square()
    between_um2 | estimate.table.between | of a table: variance added off its positions \
        | -, json, size=square()
    own_um2_per_mm3 | estimate.table.own | of a table: the same of the bend of a run, of future \
        readings | -, json, size=square()
    own_dof | estimate.table.own_dof | degrees of freedom of it; null: infinite | -, json
    *line
    covariance_independent | estimate.independent_covariance | s^2 (X'X)^-1, all readings as \
        repeats (Gilsinn & Ling 2004) | -, json, size=size2()
    - | scatter.0 | | s_repeat / unit, size=size()
    pass_covariance | | of level at pass_center_mm and slope, between passes | -, json, size=size2()
    pass_covariance_moment | | the same before a negative part was set to zero, for predictions \
        | -, json, size=size2()
    half_difference_mean_square | half_differences | part of the mean square between passes that \
        is of runs there and back; null: none | -, json, size=size2()
    run_covariance | | of the two passes of a run, of several instruments | -, json, size=size2()
    s_pass | root(pass_covariance.0.0) | standard deviation from pass to pass at pass_center_mm \
        | -, size=size()
    - | scatter.1 | | s_pass / unit, size=size()
    pass_center_mm | pass_center | mean position of the readings
    pass_dof | estimate.pass_dof | of pass_covariance; null: infinite
    repeat_dof | estimate.repeat_dof | of s_repeat; null: infinite
    position_range_mm | estimate.position_range | range of the readings | -, json
    *tested
    instruments[]
        role | | lbb or laser
        *line
        *tested
    agreement_p | | p that the instruments agree; null: one instrument | agree / p, p, json
    -. | polynomial()
        for POWER HEAD in powers
            - | coefficients.POWER | coefficient of mm^POWER | -, csv=coefficient_POWER, size=size()
            - | root(covariance.POWER.POWER) | standard uncertainty of the coefficient of mm^POWER \
                | -, csv=u_coefficient_POWER, size=size()
"""
LINE = """
    n | | number of readings
    n_passes | | passes in the mean square between passes
    passes_read | | passes of the readings | passes / read, count, detail
    coefficients | | ascending powers of mm; of a table its values at at_mm | -, json, size=size()
    covariance | | of the coefficients | -, json, size=size2()
    s | | residual standard deviation, all readings as repeats | -, size=size()
    dof | | its degrees of freedom
    s_repeat | | repeatability of one visit | -, size=size()
"""
"""Of a component, and of each of its instruments."""


def component(powers: int) -> Fields:
    """The figures of a component; in tables and CSV those of `powers` coefficients."""
    heads = ["at 0 / unit", "slope / unit/m", *(f"x^{n} / unit/m^{n}" for n in range(2, powers))]
    return declare(
        COMPONENT,
        **SIZES,
        line=LINE,
        tested=TESTED,
        polynomial=_polynomial,
        powers=[(str(n), head) for n, head in enumerate(heads[:powers])],
        **{f"per_m{n}": partial(_size, power=n) for n in range(powers)},
        shape=lambda x: "polynomial" if x.estimate.table is None else "table",
    )


def _polynomial(item: Line) -> Line | None:
    """The item, where its coefficients are those of powers."""
    return None if isinstance(item, Component) and item.estimate.table else item


ROW = component(2)
RESULTS = declare(
    """
    machine | | name of the machine
    components{} | | *component
    joint_pass_covariance[] | joint
        components | group.components | components read in the same passes
        widths | group.widths | number of coefficients of each
        coefficient_covariance | group.covariance | of all coefficients | -, size=units
        pass_covariance | group.pass_covariance | of all between passes | -, size=units
        half_difference_mean_square | group.half_differences | part of it of runs there and \
            back | -, size=units
        pass_dof | group.pass_dof | degrees of freedom between passes
        n_passes | group.n_passes | number of passes
    observability[]
        component | | component, or those of a group
        not_determined | | what the readings leave open
        because | | why
        reading_that_would | | readings that would determine it
    """,
    component=ROW,
)
KNOT = declare("""
    - | of.label | | component, text, names
    - | of.unit.name | | unit, text
    - | at | | at / mm, mm
    - | value | | value / unit, plus-minus, u=u, size=of.unit.to_internal
""")


def document(result: FitResult, digits: int = 2) -> Document:
    """One row a component, and one for each of several instruments that read it."""
    components = list(result.components.values())
    powers = [len(x.coefficients) for x in filter(_polynomial, components)]
    fields = component(max(powers, default=0))
    rate = f"{100 * FAMILY_RATE:g} % (Bonferroni)"
    footer = f"± u; reversal: forward minus reverse; * significant at {rate}"
    if missing := listed(result.fit.missing, 12):
        footer += f"; not fitted, without readings: {missing}"
    lines = [each for x in components for each in (x, *x.instruments * (len(x.instruments) > 1))]
    table = Table(f"Components of {result.machine}", fields, components, footer, selection=lines)
    knots = [
        {"of": x, "at": at, "value": value, "u": math.sqrt(u2)}
        for x in components
        if (of := x.estimate.table)
        for at, value, u2 in zip(of.at, x.coefficients, np.diag(x.covariance), strict=True)
    ]
    footer = "natural cubic interpolation between the positions; ± one standard uncertainty"
    tables = [table, Table("Values of the tables", KNOT, knots, footer)]
    pairs = [(x.label, instrument.tests) for x in components for instrument in x.instruments]
    findings = []
    for name, words in TESTS.items():
        labels = [label for label, tests in pairs if name in tests and tests[name].significant]
        if labels:
            findings.append(f"{words} of {listed(labels)}")
    verdict = f"Significant: {'; '.join(findings)}." if findings else "No test is significant."
    return Document("Components", (RESULTS, result), tables, figure, verdict, digits)


def figure(result: FitResult) -> figures.Figure:
    """All components (Gilsinn & Ling 2004, Fig. 3): readings by pass and direction, the line, and
    the band of a future part, k times the root of x'(C + D)x + s_repeat^2 about the line.
    """
    estimates, k = result.estimates.components, result.coverage_factor
    columns = max(1, min(len(estimates), 3))
    page = figures.blank(3.4 * max(columns, 2), 2.15 * -(-len(estimates) // columns) + 0.6)
    figures.title(page, f"Components: readings (first pass dark, last one light), fit, ± {k:g} u")
    fits = result.fit.components
    instruments = [item for x in fits.values() for item in x.instruments]
    numbers = sorted({1, *(key[1] for item in instruments for key in item.keys_read)})
    colours = dict(zip(numbers, figures.shades(len(numbers)), strict=True))
    panels = figures.panels_of(page, len(estimates), columns)
    for panel, (name, estimate) in zip(panels, estimates.items(), strict=False):
        for item in fits[name].instruments if name in fits else ():
            _readings(panel, item, estimate, colours)
        low, high = estimate.position_range or (0.0, 100.0)
        if estimate.of is None:
            low, high = 0.5, numbers[-1] + 0.5
            panel.locator_params(axis="x", integer=True)
        f, place = estimate.unit.to_internal, np.linspace(low, high, 101)
        X = estimate.shape.columns(place)
        line, C = X @ estimate.coefficients / f, estimate.covariance + estimate.pass_covariance
        variance = np.einsum("ni,ij,nj->n", X, C, X) + estimate.s_repeat**2
        half = k * np.sqrt(np.clip(variance, 0.0, None)) / f
        panel.fill_between(
            place, line - half, line + half, color=figures.PALE, alpha=0.6, linewidth=0, zorder=1,
            label=f"one future reading, ± {k:g} u",
        )  # fmt: skip
        panel.plot(place, line, color=figures.INK, zorder=4, label="fit")
        says = result.components[name].says or ""
        panel.set_title(cut(f"{name}  {says}".rstrip(), 36))
        panel.set_xlabel("pass" if estimate.of is None else f"{estimate.of}, mm")
        panel.set_ylabel(estimate.unit.name)
    figures.legend(page)
    return page


def _readings(
    panel: figures.Axes, item: InstrumentFit, estimate: ComponentEstimate, colours: dict[int, Any]
) -> None:
    """A line a pass and direction; of a constant the passes side by side."""
    group = np.zeros(len(item.error), np.int64) if item.group is None else item.group
    for g, (number, sign) in enumerate([key[1:] for key in item.keys_read] or [(1, 0)]):
        rows = np.flatnonzero(group == g)
        rows = rows[np.argsort(item.position[rows], kind="stable")]
        place = item.position[rows] if estimate.of else np.full(len(rows), float(number))
        marker, word = {1: (">", "forward"), -1: ("<", "reverse"), 0: ("o", "reading")}[sign]
        panel.plot(
            place, item.error[rows] / estimate.unit.to_internal, marker=marker,
            linestyle="-" if estimate.of else "none", linewidth=0.4, color=colours[number],
            markersize=4.2, markeredgewidth=0.0, alpha=0.8, zorder=3, label=word,
        )  # fmt: skip
