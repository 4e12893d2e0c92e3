"""The report of fit-components: all that the prediction commands need, and what people ask.

Per component everything is in its own `unit` and mm; of several instruments the tests stand in
`instruments`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from mtu_cli.analyses.fit_components import Component, FitResult
from mtu_cli.findings import listed
from mtu_cli.model.estimation import TESTS
from mtu_cli.reports import machine_figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Field, Fields, Group, declare
from mtu_cli.stats.family import FAMILY_RATE
from mtu_cli.units import ARCSEC, LENGTH, UM

MM_PER_M = 1000.0
SHOWN = 12
"""Names in a note."""


def _size(item: Any) -> float:
    """Of the unit of a component, in mm or rad."""
    size: float = item.unit.to_internal
    return size


SIZES: dict[str, Any] = {
    "size": _size,
    "size2": lambda item: _size(item) ** 2,
    # um^2, or arcsec^2 of an angle.
    "square": lambda item: float((UM if item.unit.dimension == LENGTH else ARCSEC) ** 2),
    "star": lambda test: "*" if test.significant else "",
}
TESTED = declare(
    """
    drift. | tests.drift
        F | made.F | variance ratio
        p | made.p | p that passes differ by no more than repeatability \
            | drift / p, p, mark=star()
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
    *in_tables
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
    n | | number of readings
    n_passes | estimate.n_passes | passes in the mean square between passes
    passes_read | | passes of the readings | passes / read, count, detail
    - | runs_read | runs | runs / read, count, detail
    coefficients | | ascending powers of mm; of a table its values at at_mm | -, json, size=size()
    covariance | | of the coefficients | -, json, size=size2()
    covariance_independent | estimate.independent_covariance | s^2 (X'X)^-1, all readings as \
        repeats (Gilsinn & Ling 2004) | -, json, size=size2()
    s | estimate.independent_s | residual standard deviation of that | -, size=size()
    dof | | its degrees of freedom
    s_repeat | | repeatability of one visit | -, size=size()
    - | scatter.0 | | s_repeat / unit, size=size()
    pass_covariance | | of intercept at pass_center_mm and slope, between passes \
        | -, json, size=size2()
    pass_covariance_moment | | the same before a negative part was set to zero, for predictions \
        | -, json, size=size2()
    half_difference_mean_square | half_differences | part of the mean square between passes that \
        is of runs there and back; null: none | -, json, size=size2()
    run_covariance | | covariance of the two passes of a run, of several instruments \
        | -, json, size=size2()
    s_pass | s_pass() | standard deviation from pass to pass at pass_center_mm
    - | scatter.1 | | s_pass / unit, size=size()
    pass_center_mm | pass_center | mean position of the readings
    pass_dof | estimate.pass_dof | of pass_covariance; null: infinite
    repeat_dof | estimate.repeat_dof | of s_repeat; null: infinite
    position_range_mm | estimate.position_range | range of the readings | -, json
    *tested
    instruments[]
        role | | lbb or laser
        n | | number of readings
        n_passes | | passes in the mean square between passes
        passes_read | | passes of the readings
        coefficients | | as of the component | -, size=size()
        covariance | | their covariance | -, size=size2()
        s | | residual standard deviation, all readings as repeats | -, size=size()
        dof | | its degrees of freedom
        s_repeat | | repeatability of one visit | -, size=size()
        *tested
    agreement_p | | p that the instruments agree; null: one instrument | agree / p, p, json
    *in_csv
"""


TERM = """
    - | value() | | HEAD, plus-minus, u=u(), size=size()
"""
"""As people read it, per m^N."""
TERM_IN_CSV = """
    - | value() | coefficient of mm^N | -, csv=coefficient_N, size=size()
    - | u() | standard uncertainty of the coefficient of mm^N | -, csv=u_coefficient_N, size=size()
"""


def component(powers: int) -> Fields:
    """The figures of a component; in tables and CSV those of `powers` coefficients."""
    return declare(
        COMPONENT,
        **SIZES,
        in_tables=[*_terms(powers, TERM, MM_PER_M)],
        in_csv=[*_terms(powers, TERM_IN_CSV, 1.0)],
        tested=TESTED,
        shape=lambda x: "polynomial" if x.estimate.table is None else "table",
        # To the last bit the root of pass_covariance as the report states it.
        s_pass=lambda x: math.sqrt(x.pass_covariance[0, 0] / _size(x) ** 2),
    )


def _terms(powers: int, text: str, scale: float) -> Iterator[Field | Group]:
    heads = ["at 0 / unit", "slope / unit/m"]
    heads += [f"x^{n} / unit/m^{n}" for n in range(2, powers)]
    for n, head in enumerate(heads[:powers]):
        value, u = (partial(each, n, scale**n) for each in (_value, _u))
        each = text.replace("N", str(n)).replace("HEAD", head)
        yield from declare(each, value=value, u=u, size=_size)


def _powers(item: Any) -> int:
    """Coefficients of powers that a line of the table states."""
    return 0 if isinstance(item, Component) and item.estimate.table else len(item.coefficients)


def _value(power: int, scale: float, item: Any) -> float | None:
    """A coefficient, per mm^power times `scale`; None beyond the degree, and of a table."""
    return item.coefficients[power] * scale if power < _powers(item) else None


def _u(power: int, scale: float, item: Any) -> float | None:
    """Its standard uncertainty, 0 where the machine file states none."""
    known = power < min(_powers(item), len(item.covariance))
    return float(np.sqrt(item.covariance[power, power])) * scale if known else None


JOINT = declare("""
    components | group.components | components read in the same passes
    widths | group.widths | number of coefficients of each
    coefficient_covariance | group.covariance | of all coefficients | -, size=units
    pass_covariance | group.pass_covariance | of all between passes | -, size=units
    half_difference_mean_square | group.half_differences | part of it of runs there and back \
        | -, size=units
    pass_dof | group.pass_dof | degrees of freedom between passes
    n_passes | group.n_passes | number of passes
""")


def results(fields: Fields) -> Fields:
    """The figures of the report, of components with these."""
    text = """
        machine | | name of the machine
        components{} | | *component
        joint_pass_covariance[] | joint | *joint
        observability[]
            component | | component, or those of a group
            not_determined | | what the readings leave open
            because | | why
            reading_that_would | | readings that would determine it
    """
    return declare(text, component=fields, joint=JOINT)


ROW = component(2)
RESULTS = results(ROW)
"""Of components of degree 1."""
KNOT = declare(
    """
    - | component | | component, text, names
    - | unit.name | | unit, text
    - | at | | at / mm, mm
    - | value | | value / unit, plus-minus, u=u, size=size()
    """,
    **SIZES,
)


def document(result: FitResult, digits: int = 2) -> Document:
    """One row a component, and one for each of several instruments that read it."""
    components = list(result.components.values())
    says = {name: x.says for name, x in result.components.items() if x.says}
    fields = component(max(map(_powers, components), default=0))
    footer = (
        "± one standard uncertainty; reversal: forward minus reverse; * significant at "
        f"{100 * FAMILY_RATE:g} % (Bonferroni)"
    )
    if missing := listed(result.fit.missing, SHOWN):
        footer += f"; not fitted, without readings: {missing}"
    shown = [each for x in components for each in (x, *x.instruments * (len(x.instruments) > 1))]
    table = Table(f"Components of {result.machine}", fields, components, footer, shown=shown)
    k, draw = result.coverage_factor, machine_figures.components
    figure = partial(draw, result.fit, result.estimates, k, says=says)
    tables, verdict = [table, *_tables(components)], _verdict(result)
    return Document("Components", (results(fields), result), tables, figure, verdict, digits)


def _tables(components: Iterable[Component]) -> Iterator[Table]:
    knots = [
        SimpleNamespace(component=x.label, unit=x.unit, at=at, value=value, u=math.sqrt(u2))
        for x in components
        if x.estimate.table is not None
        for at, value, u2 in zip(
            x.estimate.table.at, x.coefficients, np.diag(x.covariance), strict=True
        )
    ]
    if knots:
        footer = "natural cubic interpolation between the positions; ± one standard uncertainty"
        yield Table("Values of the tables", KNOT, knots, footer)


def _verdict(result: FitResult) -> str:
    """The tests that are significant, those that are not, and those that no readings allow."""
    tests = [(x.label, own.tests) for x in result.components.values() for own in x.instruments]
    found: list[str] = []
    quiet: list[str] = []
    missing: list[str] = []
    for name, words in TESTS.items():
        made = [(label, own[name].significant) for label, own in tests if name in own]
        if names := [label for label, sure in made if sure]:
            found.append(f"{words} of {listed(names)}")
        else:
            (quiet if made else missing).append(words)
    none = f"No {' or '.join(quiet)} is significant." if quiet else ""
    text = f"Significant: {'; '.join(found)}." if found else none
    untested = f"Not tested, as the readings do not allow it: {', '.join(missing)}."
    return " ".join(filter(None, [text, untested if missing else ""]))
