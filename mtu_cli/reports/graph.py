"""The reports of graph check, simulate and sweep.

Values are in the unit of each coordinate: mm, rad or 1; tables show deviations in um, urad or
millionths, chances in percent.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any

from mtu_cli.analyses.graph.check import GraphCheck
from mtu_cli.analyses.graph.simulate import GraphSimulation, SimulatedCoordinate
from mtu_cli.analyses.graph.surface import Formula
from mtu_cli.analyses.graph.sweep import Sweep
from mtu_cli.findings import listed
from mtu_cli.model.graph.transitions import Step
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Field, Fields, Group, validation
from mtu_cli.reports.graph_drawing import shares_text, small_unit
from mtu_cli.reports.numbers import chance, plus_minus, significant, with_u

MOST = 12
"""Places named in one cell."""
DIGITS = 6
"""Of a nominal."""
EXACT_PERCENT = 1e-9
"""Of doubles that went through a fit: a smaller error of the formula is none."""
Fired = Sequence[tuple[int, Step]]


def _fires(fired: Fired) -> str:
    counts = Counter(step.do for _, step in fired)
    return ", ".join(f"{count} x {do}" if count > 1 else do for do, count in counts.items())


def _makes(fired: Fired) -> str:
    return listed((name for _, step in fired for name in step.outputs), MOST)


def _numbered(result: GraphCheck) -> list[Fired]:
    """The transitions of every round, each with the number of its round."""
    return [[(i, step) for step in fired] for i, fired in enumerate(result.rounds, 1)]


STEP: Fields = (
    Field("", "0", "round in which the transition fires, from 1", csv="round"),
    Field("do", "1.do", "what the transition does"),
    Field("in", "1.inputs", "places that it takes"),
    Field("out", "1.outputs", "places that it makes"),
)
ROUND: Fields = (
    Field("", "0.0", head="round", show="count"),
    Field("", _fires, head="fires", show="text"),
    Field("", _makes, head="makes", show="text"),
)
CHECK: Fields = (
    Field("name", meaning="name of the graph"),
    Field("places", "kinds", "number of places by kind"),
    Field("transitions", lambda x: sum(map(len, x.rounds)), "number of transitions"),
    Field("probings", meaning="probings of one cycle"),
    Field("reported", meaning="places that are reported"),
    Group("firing_order", STEP, _numbered, many=2),
)


def check(result: GraphCheck, figure: Callable[[], Any]) -> Document:
    """One row a round of transitions; in CSV one a transition."""
    kinds = ", ".join(f"{count} {kind}" for kind, count in result.kinds.items())
    rounds = _numbered(result)
    items = [item for fired in rounds for item in fired]
    order = Table(
        title=f"Graph: {result.name}",
        fields=STEP,
        items=items,
        shown=rounds,
        shown_fields=ROUND,
        footer=f"reported: {listed(result.reported, MOST)}",
    )
    return Document(
        title=result.name,
        results=(CHECK, result),
        tables=[order],
        figure=figure,
        verdict=f"The graph is sound: {sum(result.kinds.values())} places ({kinds}), "
        f"{len(items)} transitions, {result.probings} probings.",
    )


def chance_text(item: SimulatedCoordinate) -> str:
    """How likely a place is 1, in percent. About 1/(n + 2) is the standard deviation of a chance,
    all values being equally likely before, where none or all of n trials hit.
    """
    return chance(item.mean, max(item.se_mean, 1.0 / (item.trials + 2)))


def _as_it_is(text: str, u: None, digits: int) -> str:
    return text


def _size(item: SimulatedCoordinate) -> float:
    return 1.0 / small_unit(item.output.unit)[0]


def _nominal(item: SimulatedCoordinate, u: None, digits: int) -> str:
    text = "0" if item.at_zero else significant(item.nominal, DIGITS)
    return text if item.output.unit == "1" else f"{text} {item.output.unit}"


def _share(source: str, item: SimulatedCoordinate) -> float | None:
    return item.shares.get(source)


STANDARD_ERRORS: Fields = (
    Field("monte_carlo.se_mean", "se_mean", "standard error of the mean", csv="se_mean"),
    Field("monte_carlo.se_u", "se_u", "standard error of u", csv="se_u"),
)


def coordinate(sources: tuple[str, ...] = ()) -> Fields:
    """The figures of one coordinate; in CSV with the shares of all sources of variance."""
    return (
        Field("", "output.place", "name of the place", csv="place"),
        Field("", "output.coordinate", "coordinate of the place", csv="coordinate"),
        Field("unit", "output.unit", "unit of its figures: mm, rad or 1"),
        Field("nominal", meaning="value without any deviation"),
        Field("mean", meaning="mean of the trials; of a chance the share of 1"),
        Field("u", meaning="standard uncertainty, by the trials"),
        Field("U", meaning="expanded uncertainty k u"),
        Field("k", meaning="coverage factor", csv=""),
        Field("interval95", "interval", "95 % interval of the trials", show="interval"),
        Field("shortest95", "shortest", "shortest 95 % interval", show="interval"),
        Field("first_order_u", meaning="standard uncertainty of first order"),
        validation("", csv="validation_passed"),
        Field("chance", meaning="whether all trials are 0 or 1", csv=""),
        Field("trials", meaning="number of trials; 0: the place is fixed"),
        Field("converged", meaning="whether they reached the digits asked for"),
        *STANDARD_ERRORS,
        *(
            Field("", partial(_share, name), f"share of {name} in u^2", csv=f"share_{name}")
            for name in sources
        ),
    )


PLACE = Field("", lambda item: str(item.output), head="place", show="text")
COORDINATE: Fields = (
    PLACE,
    Field("", "", head="nominal", show=_nominal),
    Field("", "deviation", head="mean less\nnominal", size=_size, u="u"),
    Field("", "u", head="u", size=_size),
    Field("", "U", head="U", size=_size, u="U"),
    Field(
        "",
        lambda item: None if item.fixed else item.deviations,
        head="95 % interval\nless nominal",
        show="interval",
        size=_size,
        u="u",
    ),
    Field("", lambda item: small_unit(item.output.unit)[1], head="unit", show="text"),
    Field("", lambda x: shares_text(x.shares), head="variance from,\n% of u^2", show="text"),
    Field("", "first_order_u", head="first-\norder u", size=_size, detail=True),
    validation(""),
)
CHANCE: Fields = (
    PLACE,
    Field("", "nominal", head="at nominal", show="exact"),
    Field("", chance_text, head="chance of 1\n%", show=_as_it_is),
    Field("", "trials", head="trials", show="count"),
)
PLACES: Fields = (
    Group("places", coordinate(), many=2, named=True),
    Field("trials", meaning="number of trials"),
    Field(
        "budget",
        lambda result: {
            place: {name: item.shares for name, item in known.items()}
            for place, known in result.places.items()
        },
        "shares of the first-order variance of each coordinate by source; null where it is 0",
    ),
)
CONVERGED = Field("converged", meaning="whether all trials reached the digits asked for")
SIMULATION: Fields = (*PLACES, CONVERGED)
COORDINATE_ROW = coordinate(("<source>",))


def simulate(result: GraphSimulation, digits: int = 2) -> Document:
    """One row a coordinate that varies by degrees, and one a chance; in CSV all together."""
    from mtu_cli.reports.monte_carlo_figures import simulated

    places = Table(
        title=f"Graph: {result.graph.graph.name}",
        fields=coordinate(result.sources),
        items=result.coordinates,
        shown_fields=COORDINATE,
        shown=[item for item in result.coordinates if not item.chance],
        footer=f"U = k u; {result.trials} Monte Carlo trials",
        notes=[
            "first-order u: differences over one standard uncertainty to either side; first order "
            "valid: JCGM 101, clause 8; no*: use the interval of the Monte Carlo"
        ],
    )
    chances = [item for item in result.coordinates if item.chance]
    return Document(
        title=result.graph.graph.name,
        results=(SIMULATION, result),
        tables=[places, Table(title="Chances", fields=CHANCE, items=chances)],
        figure=lambda: simulated(result),
        verdict=_simulated(result, digits),
        digits=digits,
    )


def _simulated(result: GraphSimulation, digits: int) -> str:
    """The result of a single coordinate; of several, what clause 8 says of them."""
    if len(result.coordinates) == 1:
        (item,) = result.coordinates
        if item.chance:
            return f"The chance that {item.output} is 1 is {chance_text(item)} %."
        unit = "" if item.output.unit == "1" else f" {item.output.unit}"
        return f"{item.output} = {plus_minus(item.mean, item.U, digits)}{unit} (k = {item.k:g})."
    judged = [(x.output, x.validation.passed) for x in result.coordinates if x.validation]
    failed = [output for output, passed in judged if passed is False]
    if failed:
        return (
            f"First order is not valid (JCGM 101, clause 8) for {listed(failed)}: use the "
            "intervals of the Monte Carlo."
        )
    if any(passed is None for _, passed in judged):
        return "Too few trials to validate first order."
    return "First order is valid (JCGM 101, clause 8)." if judged else ""


def grid_point(varied: Iterable[str], unit: str = "", shown: Iterable[Field] = ()) -> Fields:
    """The figures of one setting of an output in `unit`; `shown` are those of the table alone."""
    return (
        *(
            Field(
                name,
                f"at.{name}",
                f"{name} of this point",
                head=name.removesuffix("_um"),
                show=lambda value, u, digits: f"{value:g}",
                size=lambda item: 1.0,
                names=True,
            )
            for name in varied
        ),
        Field("", lambda item: unit, "unit of mean and u", csv="unit"),
        Field("mean", meaning="mean of the trials; of a chance the share of 1"),
        Field("u", meaning="standard uncertainty, by the trials"),
        Field("interval95", "interval", "95 % interval of the trials", show="interval"),
        Field("first_order_u", meaning="standard uncertainty of first order"),
        Field("formula_u", meaning="standard uncertainty by the formula"),
        Field("error_percent", meaning="formula less Monte Carlo, of u"),
        *shown,
        *STANDARD_ERRORS,
        Field("trials", meaning="number of trials", head="trials", show="count"),
        Field("converged", meaning="whether they reached the digits asked for"),
    )


def _shown(result: Sweep) -> Iterator[Field]:
    """What the table has of a point: the chance; or deviations, in um for a length."""
    if result.chance:
        yield Field("", chance_text, head="chance of 1\n%", show=_as_it_is)
        return
    unit, size = ("um", 1e-3) if result.output.unit == "mm" else (result.output.unit, 1.0)
    given: dict[str, Any] = {"size": lambda item: size}
    yield Field("", "deviation", head=f"mean less nominal\n{unit}", u="u", **given)
    for name, title in (("u", "u"), ("first_order_u", "first-order u"), ("formula_u", "formula")):
        yield Field("", name, head=f"{title}\n{unit}", show=_four_digits, **given)
    scatter = math.nan if result.formula is None else result.formula.monte_carlo_percent
    yield Field("", "error_percent", head="error\n%", show=lambda x, u, d: _error(x, scatter))


def _four_digits(value: float, u: None, digits: int) -> str:
    return significant(value, 4)


def _error(error: float, scatter: float) -> str:
    """An error of the formula in percent, to the first digit of how well the Monte Carlo knows u
    (in percent of it): digits beyond are noise.
    """
    if scatter > EXACT_PERCENT:
        return with_u(error, scatter, 1)[0]
    return significant(0.0 if abs(error) < EXACT_PERCENT else error)


FORMULA: Fields = (
    Field("form", meaning="u as a function of what is varied; in um for a length"),
    Field("coefficients", meaning="its coefficients by name"),
    Field("max_error_percent", meaning="largest difference from the Monte Carlo, of u"),
    Field(
        "monte_carlo.standard_error_percent",
        "monte_carlo_percent",
        "relative standard error of a u of the Monte Carlo",
    ),
    Field(
        "monte_carlo.expected_max_error_percent",
        "expected_max_percent",
        "largest difference that these alone would make",
    ),
    Field("monte_carlo.p", "p", "p of the differences if the formula is true"),
)


def grid(fields: Fields) -> Fields:
    """The figures of a grid, of points with these."""
    return (
        Field("of", lambda found: str(found.output), "the output"),
        Field("unit", "output.unit", "unit of means and u"),
        Field("chance", meaning="whether the means are chances"),
        Field("varied", meaning="values of what is varied"),
        Field("unrelated", "without", "what is varied and has no effect"),
        Group("grid", fields, many=True),
        Group("formula", FORMULA),
    )


def _all(both: tuple[GraphSimulation, Sweep]) -> bool:
    return all(item.converged for item in both)


ALL_CONVERGED: Fields = (Field("converged", _all, CONVERGED.meaning),)
GRID_ROW = grid_point(("axis_um", "probe_um", "perpendicular_um", "repeats"))
SWEEP: Fields = (*PLACES, *grid(GRID_ROW), *ALL_CONVERGED)


def sweep(base: GraphSimulation, result: Sweep, digits: int = 2) -> Document:
    """One row a point of the grid; `base` is the output as the file has it."""
    from mtu_cli.reports.monte_carlo_figures import swept

    fields = grid_point(result.varied, result.output.unit, _shown(result))
    table = Table(
        title=f"{'chance' if result.chance else 'u'} of {result.output}",
        fields=fields,
        items=result.grid,
        footer=_formula_text(result.formula) if result.formula else "",
        notes=_notes(result),
    )
    return Document(
        title=table.title,
        results=(PLACES, base),
        also=[(grid(fields), result), (ALL_CONVERGED, (base, result))],
        tables=[table],
        figure=lambda: swept(result),
        verdict=_swept(result),
        digits=digits,
    )


def _formula_text(found: Formula) -> str:
    values = ", ".join(f"{name} = {significant(v, 4)}" for name, v in found.coefficients.items())
    return f"{found.form}; {values}"


def _notes(result: Sweep) -> list[str]:
    found = result.formula
    notes = [f"nominal {significant(result.nominal, DIGITS)} {result.output.unit}"]
    if found is not None and found.monte_carlo_percent > EXACT_PERCENT:
        notes.append(
            f"standard error of each u: {significant(found.monte_carlo_percent, 1)} %; by "
            f"chance alone the largest of {len(result.grid)} differences is about "
            f"{significant(found.expected_max_percent, 1)} %"
        )
    return notes


def _swept(result: Sweep) -> str:
    found = result.formula
    if result.chance:
        points = sorted(result.grid, key=lambda item: item.mean)
        least, most = chance_text(points[0]), chance_text(points[-1])
        return f"The chance that {result.output} is 1 goes from {least} % to {most} %."
    if found is None:
        return f"No formula: {result.no_formula}."
    if len(result.grid) == len(found.terms):
        return "The formula has as many terms as the grid has points: nothing checks it."
    error = _error(found.max_error_percent, found.monte_carlo_percent)
    return f"Formula and Monte Carlo differ by {error} % at most."
