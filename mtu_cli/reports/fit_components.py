"""The report of fit-components: all that the prediction commands need, and what people ask.

Per component everything is in the component's own `unit` and mm: `coefficients` in unit, unit/mm,
..., covariances in products of these. Of several instruments the tests stand in `instruments`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from mtu_cli.analyses.fit_components import TESTS, Component, FitResult
from mtu_cli.analyses.observability import NotDetermined
from mtu_cli.findings import listed
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Field, Fields, Group
from mtu_cli.stats.family import FAMILY_RATE
from mtu_cli.units import ARCSEC, LENGTH, UM, Unit

MM_PER_M = 1000.0
SHOWN = 12
"""Names in a note."""
SIZE = "unit.to_internal"
"""Of the unit of a component, in mm or rad."""


def SIZE2(item: Any) -> float:
    """Its square."""
    size: float = item.unit.to_internal
    return size**2


def _star(test: Any) -> str:
    return "*" if test.significant else ""


def _f_test(name: str, title: str, meaning: str, *, begins: bool = False) -> Group:
    return Group(
        name,
        (
            Field("F", "value", "variance ratio"),
            Field("p", meaning=meaning, head=f"{title}\np", show="p", mark=_star, begins=begins),
            Field("df", "dof", "its degrees of freedom", csv=""),
        ),
        f"tests.{name}",
    )


TREND = Group(
    "trend",
    (
        Field("per_pass", "value", "steady change from pass to pass", size=SIZE),
        Field("u", meaning="its standard uncertainty", size=SIZE),
        Field("p", meaning="p that there is none", head="trend\np", show="p", mark=_star),
        Field("dof", meaning="its degrees of freedom", csv=""),
    ),
    "tests.trend",
)
REVERSAL = Group(
    "reversal",
    (
        Field(
            "mean",
            "value",
            "forward minus reverse",
            size=SIZE,
            head="reversal\nunit",
            show="plus-minus",
            u="u",
            mark=_star,
        ),
        Field("u", meaning="its standard uncertainty", size=SIZE),
        Field("p", meaning="p that there is none"),
        Field("dof", meaning="its degrees of freedom", csv=""),
    ),
    "tests.reversal",
)
TESTED: Fields = (
    _f_test("drift", "drift", "p that passes differ by no more than repeatability", begins=True),
    TREND,
    _f_test("lack_of_fit", "misfit", "p that the polynomial fits"),
    REVERSAL,
    Field("r2", meaning="share of the variance of the readings that the polynomial explains"),
)
INSTRUMENT: Fields = (
    Field("role", meaning="lbb or laser"),
    Field("n", meaning="number of readings"),
    Field("n_passes", meaning="passes in the mean square between passes"),
    Field("passes_read", meaning="passes of the readings"),
    Field("coefficients", meaning="as of the component", size=SIZE),
    Field("covariance", meaning="their covariance", size=SIZE2),
    Field("s", meaning="residual standard deviation, all readings as repeats", size=SIZE),
    Field("dof", meaning="its degrees of freedom"),
    Field("s_repeat", meaning="repeatability of one visit", size=SIZE),
    *TESTED,
)
RUN: Fields = (
    Field("role", meaning="lbb or laser"),
    Group(
        "passes",
        (
            Field("file", "0", "number of the file among those of readings, from 1"),
            Field("pass", "1", "number of the pass in the file"),
            Field("direction", "2", "1 forward, -1 reverse, 0 not stated"),
        ),
        many=True,
    ),
)


OF_TABLES = (
    (
        "roughness_um2_per_mm3",
        "roughness",
        "of a table: variance of the integrated Wiener process between its positions (arcsec2 of "
        "an angle)",
    ),
    ("between_um2", "between", "of a table: variance added off its positions"),
    ("own_um2_per_mm3", "own", "of a table: the same of the bend of a run, of future readings"),
)


def component(powers: int) -> Fields:
    """The figures of a component; in tables and CSV those of `powers` coefficients."""
    scatter = "standard deviation from pass to pass at pass_center_mm"
    return (
        Field("", "label", "name", csv="component", head="component", show="text"),
        Field("of", meaning="its axis; null: a constant", head="of", show="text"),
        Field("unit", "unit.name", "of its figures", head="unit", show="text"),
        Field("says", meaning="its meaning in words, of the machine file", csv=""),
        Field(
            "source",
            meaning="readings or machine file",
            head="from",
            show="text",
            detail=True,
        ),
        *(_coefficient(power) for power in range(powers)),
        Field("degree", "estimate.degree", "degree of the polynomial; null of a table"),
        Field("shape", lambda x: _shape_name(x.estimate), "polynomial or table"),
        Field("at_mm", "estimate.table.at", "positions of the values of a table", csv=""),
        *(
            Field(name, f"estimate.table.{key}", meaning, size=_square, csv="")
            for name, key, meaning in OF_TABLES
        ),
        Field(
            "own_dof", "estimate.table.own_dof", "degrees of freedom of it; null: infinite", csv=""
        ),
        Field("n", meaning="number of readings"),
        Field("n_passes", "estimate.n_passes", "passes in the mean square between passes"),
        Field(
            "passes_read",
            meaning="passes of the readings",
            head="passes\nread",
            show="count",
            detail=True,
        ),
        Field("", "runs_read", "runs", head="runs\nread", show="count", detail=True),
        Group("runs", RUN, many=True),
        Field(
            "coefficients",
            meaning="ascending powers of mm; of a table its values at at_mm",
            size=SIZE,
            csv="",
        ),
        Field("covariance", meaning="of the coefficients", size=SIZE2, csv=""),
        Field(
            "covariance_independent",
            "estimate.independent_covariance",
            "s^2 (X'X)^-1, all readings as repeats (Gilsinn & Ling 2004)",
            size=SIZE2,
            csv="",
        ),
        Field("s", "estimate.independent_s", "residual standard deviation of that", size=SIZE),
        Field("dof", meaning="its degrees of freedom"),
        Field("s_repeat", meaning="repeatability of one visit", size=SIZE),
        Field("", "scatter.0", head="s_repeat\nunit", size=SIZE),
        Field(
            "pass_covariance",
            meaning="of intercept at pass_center_mm and slope, between passes",
            size=SIZE2,
            csv="",
        ),
        Field(
            "pass_covariance_moment",
            meaning="the same before a negative part was set to zero, for predictions",
            size=SIZE2,
            csv="",
        ),
        Field(
            "half_difference_mean_square",
            "half_differences",
            "part of the mean square between passes that is of runs there and back; null: none",
            size=SIZE2,
            csv="",
        ),
        Field(
            "run_covariance",
            meaning="covariance of the two passes of a run, of several instruments",
            size=SIZE2,
            csv="",
        ),
        # To the last bit the root of pass_covariance as the report states it.
        Field("s_pass", lambda x: math.sqrt(x.pass_covariance[0, 0] / SIZE2(x)), scatter),
        Field("", "scatter.1", head="s_pass\nunit", size=SIZE),
        Field("pass_center_mm", "pass_center", "mean position of the readings"),
        Field("pass_dof", "estimate.pass_dof", "of pass_covariance; null: infinite"),
        Field("repeat_dof", "estimate.repeat_dof", "of s_repeat; null: infinite"),
        Field("position_range_mm", "estimate.position_range", "range of the readings", csv=""),
        *TESTED,
        Group("instruments", INSTRUMENT, many=True),
        Field(
            "agreement_p",
            meaning="p that the instruments agree; null: one instrument",
            head="agree\np",
            show="p",
            csv="",
        ),
        *(field for power in range(powers) for field in _in_csv(power)),
    )


def _shape_name(estimate: Any) -> str:
    return "polynomial" if estimate.table is None else "table"


def _square(item: Any) -> float:
    """um^2, or arcsec^2 of an angle."""
    return float((UM if item.unit.dimension == LENGTH else ARCSEC) ** 2)


def _value(power: int, scale: float = 1.0) -> Callable[[Any], float | None]:
    """A coefficient, per mm^power times `scale`; None beyond the degree, and of a table."""

    def value(item: Any) -> float | None:
        return item.coefficients[power] * scale if power < _powers(item) else None

    return value


def _u(power: int, scale: float = 1.0) -> Callable[[Any], float | None]:
    """Its standard uncertainty, 0 where the machine file states none."""

    def value(item: Any) -> float | None:
        known = power < min(_powers(item), len(item.covariance))
        return float(np.sqrt(item.covariance[power, power])) * scale if known else None

    return value


def _coefficient(power: int) -> Field:
    """As people read it, per m^power."""
    scale = MM_PER_M**power
    title = ("at 0\nunit", "slope\nunit/m")[power] if power < 2 else f"x^{power}\nunit/m^{power}"
    u = _u(power, scale)
    return Field(
        "",
        _value(power, scale),
        head=title,
        size=SIZE,
        u=lambda item: u(item) or None,
        show="plus-minus",
        begins=power > 1,
    )


def _in_csv(power: int) -> Iterator[Field]:
    meaning = f"coefficient of mm^{power}"
    yield Field("", _value(power), meaning, csv=f"coefficient_{power}", size=SIZE)
    meaning = f"standard uncertainty of the {meaning}"
    yield Field("", _u(power), meaning, csv=f"u_coefficient_{power}", size=SIZE)


JOINT: Fields = (
    Field("components", "group.components", "components read in the same passes"),
    Field("widths", "group.widths", "number of coefficients of each"),
    Field("coefficient_covariance", "group.covariance", "of all coefficients", size="units"),
    Field("pass_covariance", "group.pass_covariance", "of all between passes", size="units"),
    Field(
        "half_difference_mean_square",
        "group.half_differences",
        "part of it of runs there and back",
        size="units",
    ),
    Field("correlation_of", meaning="rows of the correlation"),
    Field("correlation", meaning="of levels and slopes of the passes, repeatability included"),
    Field("pass_dof", "group.pass_dof", "degrees of freedom between passes"),
    Field("n_passes", "group.n_passes", "number of passes"),
)
NOT_DETERMINED: Fields = (
    Field("component", meaning="component, or those of a group"),
    Field("not_determined", meaning="what the readings leave open"),
    Field("because", meaning="why"),
    Field("reading_that_would", meaning="readings that would determine it"),
)


def results(fields: Fields) -> Fields:
    """The figures of the report, of components with these."""
    return (
        Field("machine", meaning="name of the machine"),
        Group("components", fields, many=True, named=True),
        Group("joint_pass_covariance", JOINT, "joint", many=True),
        Group("observability", NOT_DETERMINED, many=True),
    )


ROW = component(2)
RESULTS = results(ROW)
"""Of components of degree 1."""


def document(result: FitResult, digits: int = 2) -> Document:
    """One row a component, and one for each of several instruments that read it."""
    from mtu_cli.reports import machine_figures

    components = list(result.components.values())
    says = {name: x.says for name, x in result.components.items() if x.says}
    fields = component(max(map(_powers, components), default=0))
    table = Table(
        title=f"Components of {result.machine}",
        fields=fields,
        items=components,
        shown=[each for x in components for each in (x, *x.instruments * (len(x.instruments) > 1))],
        footer="± one standard uncertainty; reversal: forward minus reverse; * significant at "
        f"{100 * FAMILY_RATE:g} % (Bonferroni){_not_fitted(result)}",
        notes=[
            "drift: passes differ by more than repeatability; trend: steady from pass to pass; "
            "misfit: the polynomial does not fit",
            *_open(result),
        ],
    )
    return Document(
        title="Components",
        results=(results(fields), result),
        tables=[table, *_tables(components)],
        figure=lambda: machine_figures.components(
            result.fit, result.estimates, result.coverage_factor, says=says
        ),
        verdict=_verdict(result),
        digits=digits,
    )


def _not_fitted(result: FitResult) -> str:
    missing = result.fit.missing
    return f"; not fitted, without readings: {listed(missing, SHOWN)}" if missing else ""


def _powers(item: Any) -> int:
    """Coefficients of powers that a line of the table states."""
    return 0 if isinstance(item, Component) and item.estimate.table else len(item.coefficients)


class Knot(NamedTuple):
    """A value of a table with its standard uncertainty, in `unit`."""

    component: str
    unit: Unit
    at: float
    value: float
    u: float


KNOT: Fields = (
    Field("", "component", head="component", show="text", names=True),
    Field("", "unit.name", head="unit", show="text"),
    Field("", "at", head="at\nmm", show="mm"),
    Field("", "value", head="value\nunit", size=SIZE, u="u", show="plus-minus"),
)


def _tables(components: Iterable[Component]) -> Iterator[Table]:
    knots = [
        Knot(x.label, x.unit, *map(float, row))
        for x in components
        if x.estimate.table is not None
        for row in zip(
            x.estimate.table.at, x.coefficients, np.sqrt(np.diag(x.covariance)), strict=True
        )
    ]
    if knots:
        footer = "natural cubic interpolation between the positions; ± one standard uncertainty"
        yield Table(title="Values of the tables", fields=KNOT, items=knots, footer=footer)


def _verdict(result: FitResult) -> str:
    words = {"lack_of_fit": "misfit of the polynomial", "drift": "drift between passes"}
    found = []
    for name in TESTS:
        keys = {
            x.label: None
            for x in result.components.values()
            for y in x.instruments
            if name in y.tests and y.tests[name].significant
        }
        if keys:
            found.append(f"{words.get(name, name)} of {listed(keys)}")
    if not found:
        return "No drift, trend, misfit or reversal is significant."
    return f"Significant: {'; '.join(found)}."


def _open(result: FitResult) -> Iterator[str]:
    """What is not determined, a line for all components that lack the same."""
    grouped: dict[tuple[str, str, str], list[NotDetermined]] = {}
    for item in result.observability:
        if item.component in result.fit.components or "," in item.component:
            key = (item.not_determined, item.because, item.reading_that_would)
            grouped.setdefault(key, []).append(item)
    for (_, because, would), items in grouped.items():
        names = listed([item.shown for item in items], SHOWN)
        yield f"not determined: {items[0].of(names)}. Why: {because}. Remedy: {would}"
