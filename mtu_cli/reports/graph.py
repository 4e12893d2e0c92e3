"""The reports of graph check, simulate and sweep, in mm, rad or 1; tables in um and urad."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from functools import partial
from typing import Any

from mtu_cli.analyses.graph import GraphSimulation, SimulatedCoordinate, Sweep
from mtu_cli.findings import listed
from mtu_cli.model.graph.net import MeasurementGraph
from mtu_cli.model.graph.transitions import Step
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import COMMON, Field, Fields, declare, record
from mtu_cli.reports.graph_drawing import drawing, net_of, shares_text, small_unit
from mtu_cli.reports.monte_carlo_figures import simulation, sweep_curves
from mtu_cli.reports.numbers import fixed, significant

MOST = 12
"""Places named in one cell."""
DIGITS = 6
"""Of a nominal."""

STEP = declare(
    """
    - | 0 | round in which the transition fires, from 1 | round, count, csv=round
    do | 1.do | what the transition does | do, text
    in | 1.inputs | places that it takes | -
    out | 1.outputs | places that it makes | -
    - | in() | | in, text
    - | out() | | out, text
    """,
    **{
        side: lambda pair, side=side: listed(getattr(pair[1], f"{side}puts"), MOST)
        for side in ("in", "out")
    },
)


def _rounds(result: MeasurementGraph) -> list[list[tuple[int, Step]]]:
    """The transitions of every round, each with the number of the round."""
    return [[(i, step) for step in steps] for i, steps in enumerate(result.rounds, 1)]


CHECK = declare(
    """
    name | graph.name | name of the graph
    places | kinds() | number of places by kind
    transitions | count() | number of transitions
    probings | probings() | probings of one cycle
    reported | | places that are reported
    firing_order[][] | numbered() | *step
    """,
    count=lambda result: sum(map(len, result.rounds)),
    kinds=lambda result: dict(Counter(place.kind for place in result.graph.places.values())),
    probings=lambda result: sum(
        item.repeats or result.graph.repeats
        for item in result.graph.transitions
        if item.do == "meas"
    ),
    numbered=_rounds,
    step=STEP,
)


def check(result: MeasurementGraph) -> Document:
    """One row a transition, in the order in which they fire."""
    items = [item for group in _rounds(result) for item in group]
    title, footer = f"Graph: {result.graph.name}", f"reported: {listed(result.reported, MOST)}"
    order = Table(title, STEP, items, footer)
    counts = record(CHECK, result)
    kinds = ", ".join(f"{count} {kind}" for kind, count in counts["places"].items())
    places = f"{len(result.graph.places)} places ({kinds})"
    steps = f"{counts['transitions']} transitions, {counts['probings']} probings"
    verdict = f"The graph is sound: {places}, {steps}."
    figure = partial(drawing, net_of(result))
    return Document(result.graph.name, (CHECK, result), [order], figure, verdict)


MOMENTS = """
    mean | | mean of the trials
    u | | standard uncertainty, by the trials
"""
STANDARD_ERRORS = """
    monte_carlo.se_mean | se_mean | standard error of the mean | -, csv=se_mean
    monte_carlo.se_u | se_u | standard error of u | -, csv=se_u
"""
COORDINATE = """
    - | output.place | name of the place | -, csv=place
    - | output.coordinate | coordinate of the place | -, csv=coordinate
    unit | output.unit | unit of its figures: mm, rad or 1
    nominal | | value without any deviation
    *moments
    U | | expanded uncertainty k u
    k | | coverage factor | -, json
    interval95 | interval | 95 % interval of the trials | -, interval
    shortest95 | shortest | shortest 95 % interval | -, interval
    first_order_u | | standard uncertainty of first order
    - | place() | | place, text
    - | . | | nominal, nominal()
    - | deviation | | mean less / nominal, u=u, size=size()
    - | u | | u, size=size()
    - | U | | U, u=U, size=size()
    - | deviations() | | 95 % interval / less nominal, interval, u=u, size=size()
    - | unit() | | unit, text
    - | shares() | | variance from / % of u^2, text
    - | first_order_u | | first- / order u, size=size(), detail
    *validation
    trials | | number of trials; 0: the place is fixed
    converged | | whether they reached the digits asked for
    *errors
"""


def _nominal(item: SimulatedCoordinate, u: None, digits: int) -> str:
    text = significant(item.nominal, DIGITS)
    return text if item.output.unit == "1" else f"{text} {item.output.unit}"


def coordinate(sources: tuple[str, ...] = ()) -> Fields:
    """The figures of one coordinate; in CSV with the shares of all sources of variance."""
    fields = declare(
        COORDINATE,
        moments=declare(MOMENTS),
        place=lambda item: str(item.output),
        nominal=_nominal,
        size=lambda item: 1.0 / small_unit(item.output.unit)[0],
        deviations=lambda item: None if item.fixed else item.deviations,
        unit=lambda item: small_unit(item.output.unit)[1],
        shares=lambda item: shares_text(item.shares),
        validation=COMMON["validation"].replace("_UNIT", ""),
        errors=declare(STANDARD_ERRORS),
    )
    for source in sources:
        # A name may have dots, which a path would take for steps.
        share = partial(lambda name, item: item.shares.get(name), source)
        fields.append(Field("", share, f"share of {source} in u^2", csv=f"share_{source}"))
    return fields


PLACES = declare(
    """
    places{}{} | | *coordinate
    trials | | number of trials
    budget | budget() | shares of the first-order variance of each coordinate by source; null \
        where it is 0
    """,
    coordinate=coordinate(),
    budget=lambda result: {
        place: {name: item.shares for name, item in known.items()}
        for place, known in result.places.items()
    },
)
CONVERGED = declare("converged | | whether all trials reached the digits asked for")
SIMULATION: Fields = (*PLACES, *CONVERGED)
COORDINATE_ROW = coordinate(("<source>",))


def simulate(result: GraphSimulation, digits: int = 2) -> Document:
    """One row a coordinate."""
    name = result.graph.graph.name
    title, footer = f"Graph: {name}", f"U = k u; {result.trials} Monte Carlo trials"
    fields = coordinate(result.sources)
    places, figure = Table(title, fields, result.coordinates, footer), partial(simulation, result)
    valid = {x.output: x.validation.passed for x in result.coordinates if x.validation}
    verdict = "First order is valid (JCGM 101, clause 8)." if valid else ""
    if failures := listed(output for output, passed in valid.items() if passed is False):
        verdict = (
            f"First order is not valid (JCGM 101, clause 8) for {failures}: see the intervals."
        )
    elif None in valid.values():
        verdict = "Too few trials to validate first order."
    return Document(name, (SIMULATION, result), [places], figure, verdict, digits)


GRID_POINT = """
    *varied
    - | unit() | unit of mean and u | -, csv=unit
    *moments
    interval95 | interval | 95 % interval of the trials | -, interval
    first_order_u | | standard uncertainty of first order
    formula_u | | standard uncertainty by the formula
    error_percent | | formula less Monte Carlo, of u
    *shown
    *errors
    trials | | number of trials | trials, count
    converged | | whether they reached the digits asked for
"""
DEVIATION = """
    - | deviation | | mean less nominal / UNIT, u=u, size=size()
    - | u | | u / UNIT, sig4, size=size()
    - | first_order_u | | first-order u / UNIT, sig4, size=size()
    - | formula_u | | formula / UNIT, sig4, size=size()
    - | error_percent | | error / %, fix1
"""


def grid_point(names: Iterable[str], result: Sweep | None = None) -> Fields:
    """The figures of one setting; with a `result` those of its table, too."""
    at = "NAME | at.NAME | NAME of this point | HEAD, plain, names, size=as_stated()"
    texts = (at.replace("NAME", x).replace("HEAD", x.removesuffix("_um")) for x in names)
    unit, deviations = "", []
    if result is not None:
        unit = result.output.unit
        factor, small = small_unit(unit)
        deviations = declare(DEVIATION.replace("UNIT", small), size=lambda item: 1.0 / factor)
    return declare(
        GRID_POINT,
        varied=[field for each in texts for field in declare(each)],
        unit=lambda item: unit,
        moments=declare(MOMENTS),
        shown=deviations,
        errors=declare(STANDARD_ERRORS),
    )


def grid(fields: Fields) -> Fields:
    """The figures of a grid, of points with these."""
    text = """
        of | output() | the output
        unit | output.unit | unit of means and u
        varied | | values of what is varied
        grid[] | | *point
        formula.
            form | | u as a function of what is varied; in um for a length
            coefficients | | its coefficients by name
            max_error_percent | | largest difference from the Monte Carlo, of u
            monte_carlo.standard_error_percent | monte_carlo_percent | relative standard error of \
                a u of the Monte Carlo
    """
    return declare(text, output=lambda result: str(result.output), point=fields)


ALL_CONVERGED = declare(
    "converged | all() | whether all trials reached the digits asked for",
    all=lambda both: both[0].converged and all(point.converged for point in both[1].grid),
)
GRID_ROW = grid_point(("axis_um", "probe_um", "perpendicular_um", "repeats"))
SWEEP: Fields = (*PLACES, *grid(GRID_ROW), *ALL_CONVERGED)


def sweep(base: GraphSimulation, result: Sweep, digits: int = 2) -> Document:
    """One row a point of the grid; `base` is the output as the file has it."""
    fields, formula = grid_point(result.varied, result), result.formula
    title, footer = f"u of {result.output}", ""
    verdict = f"No formula: {result.no_formula}."
    if formula is not None:
        pairs = formula.coefficients.items()
        values = ", ".join(f"{name} = {significant(value, 4)}" for name, value in pairs)
        footer = f"{formula.form}; {values}"
        most = fixed(formula.max_error_percent, 1)
        verdict = f"Formula and Monte Carlo differ by {most} % at most."
        if len(result.grid) == len(formula.coefficients):
            verdict = "The formula has as many terms as the grid has points: nothing checks it."
    table = Table(title, fields, result.grid, footer)
    extra: list[Any] = [(grid(fields), result), (ALL_CONVERGED, (base, result))]
    figure = partial(sweep_curves, result)
    return Document(title, (PLACES, base), [table], figure, verdict, digits, extra)
