"""The reports of graph check, simulate and sweep, in mm, rad or 1; tables in um and urad."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from functools import partial

import numpy as np

from mtu_cli.analyses.graph import GraphSimulation, GridPoint, Sweep
from mtu_cli.findings import listed
from mtu_cli.model.graph.net import MeasurementGraph
from mtu_cli.model.graph.transitions import Step
from mtu_cli.reports import figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import COMMON, Field, Fields, declare, record
from mtu_cli.reports.graph_drawing import LEAST_SHARE, drawing, net_of, share_percent
from mtu_cli.reports.numbers import cut, fixed, significant, spread
from mtu_cli.units import UM

MOST = 12
"""Places named in one cell."""
SOURCES = {"u1_axis": "axis", "u2_probe": "probe", "u3_perpendicular": "perpendicularity"}
"""Sources for people; others are places."""
NAME = 24
"""Characters of a name in a picture."""


def small_unit(unit: str) -> tuple[float, str]:
    """The unit in which deviations of an output are shown, and how many of it make one."""
    return {"mm": (1.0 / UM, "um"), "rad": (1e6, "urad"), "1": (1e6, "1e-6")}.get(unit, (1.0, unit))


def shares_text(shares: Mapping[str, float]) -> str:
    """ "probe 50, axis 49": percents of the sources of variance, the largest first."""
    pairs = [pair for pair in shares.items() if LEAST_SHARE <= abs(pair[1]) < math.inf]
    pairs.sort(key=lambda pair: -abs(pair[1]))
    texts = (f"{SOURCES.get(name, name)} {share_percent(share, 0)}" for name, share in pairs[:3])
    return ", ".join(texts) or "-"


STEP = declare(
    """
    - | 0 | round in which the transition fires, from 1 | round, count, csv=round
    do | 1.do | what the transition does | do, text
    in | 1.inputs | places that it takes | -
    out | 1.outputs | places that it makes | -
    - | names(1.inputs) | | in, text
    - | names(1.outputs) | | out, text
    """,
    names=partial(listed, most=MOST),
)


def _rounds(result: MeasurementGraph) -> list[list[tuple[int, Step]]]:
    """The transitions of every round, each with the number of the round."""
    return [[(i, step) for step in steps] for i, steps in enumerate(result.rounds, 1)]


CHECK = declare(
    """
    name | graph.name | name of the graph
    places | kinds() | number of places by kind
    probings | probings() | probings of one cycle
    reported | | places that are reported
    firing_order[][] | numbered() | *step
    """,
    kinds=lambda result: dict(Counter(place.kind for place in result.graph.places.values())),
    probings=lambda result: sum(
        item.repeats or result.graph.repeats
        for item in result.graph.transitions
        if item.do == "meas"
    ),
    numbered=_rounds,
    step=STEP,
)


def check(result: MeasurementGraph, digits: int = 2) -> Document:
    """One row a transition, in the order in which they fire."""
    items = [item for group in _rounds(result) for item in group]
    title, footer = f"Graph: {result.graph.name}", f"reported: {listed(result.reported, MOST)}"
    order = Table(title, STEP, items, footer)
    counts = record(CHECK, result)
    kinds = ", ".join(f"{count} {kind}" for kind, count in counts["places"].items())
    places = f"{len(result.graph.places)} places ({kinds})"
    steps = f"{len(items)} transitions, {counts['probings']} probings"
    verdict = f"The graph is sound: {places}, {steps}."
    source = CHECK, result
    return Document("Measurement graph", source, [order], lambda x: drawing(net_of(x)), verdict)


COORDINATE = """
    - | output.place | name of the place | -, csv=place
    - | output.coordinate | coordinate of the place | -, csv=coordinate
    unit | output.unit | unit of its figures: mm, rad or 1
    nominal | | value without any deviation
    mean | | mean of the trials
    u | | standard uncertainty, by the trials
    U | | expanded uncertainty k u
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
    monte_carlo.se_mean | se_mean | standard error of the mean | -, csv=se_mean
    monte_carlo.se_u | se_u | standard error of u | -, csv=se_u
"""


def coordinate(sources: tuple[str, ...] = ()) -> Fields:
    """The figures of one coordinate; in CSV with the shares of all sources of variance."""
    fields = declare(
        COORDINATE,
        place=lambda item: str(item.output),
        nominal=lambda x, u, digits: (
            significant(x.nominal, 6) + f" {x.output.unit}" * (x.output.unit != "1")
        ),
        size=lambda item: 1.0 / small_unit(item.output.unit)[0],
        deviations=lambda item: None if item.fixed else item.deviations,
        unit=lambda item: small_unit(item.output.unit)[1],
        shares=lambda item: shares_text(item.shares),
        validation=COMMON["validation"].replace("_UNIT", ""),
    )
    for source in sources:
        # A name may have dots, which a path would take for steps.
        share = partial(lambda name, item: item.shares.get(name), source)
        fields.append(Field("", share, f"share of {source} in u^2", csv=f"share_{source}"))
    return fields


SIMULATION = declare(
    """
    places{}{} | | *coordinate
    trials | | number of trials
    budget | budget() | each source's share of the first-order variance; null where it is 0
    converged | | whether all trials reached the digits asked for
    """,
    coordinate=coordinate(),
    budget=lambda result: {
        place: {name: item.shares for name, item in known.items()}
        for place, known in result.places.items()
    },
)
COORDINATE_ROW = coordinate(("<source>",))


def simulate(result: GraphSimulation, digits: int = 2) -> Document:
    """One row a coordinate."""
    fields, footer = coordinate(result.sources), f"U = k u; {result.trials} Monte Carlo trials"
    places = Table(f"Graph: {result.graph.graph.name}", fields, result.coordinates, footer)
    valid = {x.output: x.validation.passed for x in result.coordinates if x.validation}
    verdict = "First order is valid (JCGM 101, clause 8)." if valid else ""
    if failures := listed(output for output, passed in valid.items() if passed is False):
        verdict = (
            f"First order is not valid (JCGM 101, clause 8) for {failures}: see the intervals."
        )
    elif None in valid.values():
        verdict = "Too few trials to validate first order."
    source = SIMULATION, result
    return Document("Measurement graph", source, [places], simulation_figure, verdict, digits)


GRID_POINT = """
    for NAME HEAD in names
        NAME | at.NAME | NAME of this point | HEAD, plain, names, size=as_stated()
    - | unit() | unit of mean and u | -, csv=unit
    mean | | mean of the trials
    u | | standard uncertainty, by the trials
    interval95 | interval | 95 % interval of the trials | -, interval
    first_order_u | | standard uncertainty of first order
    formula_u | | standard uncertainty by the formula
    - | deviation | | mean less nominal / UNIT, u=u, size=size()
    - | u | | u / UNIT, sig4, size=size()
    - | first_order_u | | first-order u / UNIT, sig4, size=size()
    - | formula_u | | formula / UNIT, sig4, size=size()
    error_percent | | formula less Monte Carlo, of u | error / %, fix1
    monte_carlo.se_mean | se_mean | standard error of the mean | -, csv=se_mean
    monte_carlo.se_u | se_u | standard error of u | -, csv=se_u
    trials | | number of trials | trials, count
    converged | | whether they reached the digits asked for
"""


def grid_point(names: Iterable[str], unit: str = "") -> Fields:
    """The figures of one setting, of an output in `unit`."""
    factor, small = small_unit(unit)
    return declare(
        GRID_POINT,
        names=[(name, name.removesuffix("_um")) for name in names],
        unit=lambda item: unit,
        UNIT=small,
        size=lambda item: 1.0 / factor,
    )


def grid(fields: Fields) -> Fields:
    """The figures of a grid, of points with these, and of the graph as the file has it."""
    text = """
        -. | base | *simulation
        of | output() | the output
        unit | output.unit | unit of means and u
        grid[] | | *point
        formula.
            form | | u as a function of what is varied; in um for a length
            coefficients | | its coefficients by name
            max_error_percent | | largest difference from the Monte Carlo, of u
            monte_carlo.standard_error_percent | monte_carlo_percent | relative standard error of \
                a u of the Monte Carlo
        converged | | whether all trials reached the digits asked for
    """
    # The grid says whether all converged.
    return declare(text, simulation=SIMULATION[:-1], output=lambda x: str(x.output), point=fields)


GRID_ROW = grid_point(("axis_um", "probe_um", "perpendicular_um", "repeats"))
SWEEP = grid(GRID_ROW)


def sweep(result: Sweep, digits: int = 2) -> Document:
    """One row a point of the grid."""
    fields, formula = grid_point(result.varied, result.output.unit), result.formula
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
    table, source = Table(title, fields, result.grid, footer), (grid(fields), result)
    return Document(title, source, [table], sweep_figure, verdict, digits)


def simulation_figure(result: GraphSimulation) -> figures.Figure:
    """Histogram of the trials of every coordinate about its nominal, interval, first order."""
    variables = [item for item in result.coordinates if not item.fixed]
    maxima = [max(y.u for y in variables if y.output.unit == x.output.unit) for x in variables]
    selection = [x for x, u in zip(variables, maxima, strict=True) if x.u >= 1e-3 * u][:9]
    trials = []
    for item in selection:
        factor, unit = small_unit(item.output.unit)
        ends, u = [end * factor for end in item.deviations], item.first_order_u * factor
        samples = (item.samples - item.nominal) * factor
        text = f"{cut(str(item.output), NAME)}: u {significant(item.u * factor)} {unit}"
        of = f"from nominal, {unit}\n{shares_text(item.shares)} % of u²"
        trials.append((text, of, samples, ends, (0.0, u, math.inf)))
    title = f"{cut(result.graph.graph.name, 50)}: scatter of the results"
    title += f" ({len(selection)} of {len(variables)})" * (len(selection) < len(variables))
    return figures.histograms(title, trials)


def sweep_figure(result: Sweep) -> figures.Figure:
    """u with two standard errors over what is varied first, a line a value of the others."""
    names = [name for name, values in result.varied.items() if len(values) > 1]
    first, *rest = names or list(result.varied)
    lines: dict[str, list[GridPoint]] = {}
    for item in result.grid:
        lines.setdefault(", ".join(f"{n} {item.at[n]:g}" for n in rest), []).append(item)
    page = figures.blank(6.4 + 1.6 * bool(rest), 4.4)
    panel, short = page.subplots(), cut(str(result.output), NAME)
    factor, unit = small_unit(result.output.unit)
    indices = spread(len(lines), 14)
    for i, ((label, points), colour) in enumerate(
        zip(lines.items(), figures.shades(len(lines)), strict=True)
    ):
        y, se = np.nan_to_num([(point.u, point.se_u) for point in points]).T * factor
        panel.errorbar(
            [item.at[first] for item in points], y, 2 * se, fmt="o-", ms=4, color=colour,
            label=label if i in indices else None,
        )  # fmt: skip
    panel.set(xlabel=first, ylabel=f"u of {short}, {unit}", ylim=(0, None))
    if result.formula is not None:
        panel.set_title(result.formula.form, fontweight="normal")
    figures.title(page, f"Uncertainty of {short} over {first}")
    if rest:
        panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), reverse=True)
    return page
