"""The report of graph simulate: every coordinate, its interval, and where its variance is from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from mtu_cli.analyses.graph.simulate import GraphSimulation, SimulatedCoordinate
from mtu_cli.findings import Finding, listed
from mtu_cli.reports.document import finite
from mtu_cli.reports.graph_convergence import BOUNDS, chance_text, not_converged, one_sided
from mtu_cli.reports.graph_net import share_percent
from mtu_cli.reports.numbers import PLAIN_DIGITS, interval, plus_minus, significant, span, with_u
from mtu_cli.reports.tables import Column, Sheet
from mtu_cli.reports.validations import validation_warnings
from mtu_cli.units import UM

SHOWN_SHARES = 3
"""Sources named in the table."""
LEAST_SHARE = 0.005
"""A smaller share of the variance is not named in the table."""


def document(result: GraphSimulation, coverage_factor: float) -> dict[str, Any]:
    """`results` of the report: places and their coordinates in mm, rad or 1, and the shares of
    first-order variance by source.
    """
    places: dict[str, dict[str, Any]] = {}
    budget: dict[str, dict[str, Any]] = {}
    for item in result.coordinates:
        name, coordinate = item.output.place, item.output.coordinate
        places.setdefault(name, {})[coordinate] = _coordinate(item, coverage_factor)
        budget.setdefault(name, {})[coordinate] = {
            source: finite(share) for source, share in item.shares.items()
        }
    return {
        "places": places,
        "trials": result.trials,
        "converged": result.converged,
        "budget": budget,
    }


def _coordinate(item: SimulatedCoordinate, k: float) -> dict[str, Any]:
    return {
        "unit": item.output.unit,
        "nominal": finite(item.nominal),
        "mean": finite(item.mean),
        "u": finite(item.u),
        "U": finite(k * item.u),
        "k": k,
        "interval95": [finite(end) for end in item.interval],
        "shortest95": [finite(end) for end in item.shortest],
        "first_order_u": finite(item.first_order_u),
        "validation": _validation(item),
        "chance": _chance(item),
        "trials": item.trials,
        "converged": item.converged,
        "monte_carlo": {
            f"se_{name}": finite(getattr(item.errors, name))
            for name in ("mean", "u", "low", "high")
        },
    }


def _chance(item: SimulatedCoordinate) -> dict[str, Any] | None:
    """Of a place that is 0 or 1: how likely 1 is."""
    if not item.chance:
        return None
    return {"probability": finite(item.mean), "standard_error": finite(item.errors.mean)}


def _validation(item: SimulatedCoordinate) -> dict[str, Any] | None:
    found = item.validation
    if found is None:
        return None
    return {
        "passed": found.passed,
        "d_low": finite(found.d_low),
        "d_high": finite(found.d_high),
        "tolerance": finite(found.tolerance),
    }


def warnings(result: GraphSimulation) -> list[Finding]:
    """The result's warnings, and what clause 8 and the trials have to say."""
    noted = list(result.warnings)
    for unit, factor, name in (("mm", UM, "um"), ("rad", 1.0, "rad"), ("1", 1.0, "")):
        judged = [
            (str(item.output), item.validation)
            for item in result.coordinates
            if item.validation is not None and (item.output.unit == unit or unit == "1")
            if unit != "1" or item.output.unit not in ("mm", "rad")
        ]
        noted += validation_warnings(
            [text for text, _ in judged], [found for _, found in judged], name, factor
        )
    return list(dict.fromkeys(noted + _not_converged(result)))


def _not_converged(result: GraphSimulation) -> list[Finding]:
    """Outputs that ended, as asked or at their largest count, before they had their digits."""
    short = [item for item in result.coordinates if not item.converged]
    return [
        not_converged(
            count,
            result.digits,
            f"for {listed(_known_to(item) for item in short if item.trials == count)}",
        )
        for count in dict.fromkeys(item.trials for item in short)
    ]


def _known_to(item: SimulatedCoordinate) -> str:
    """What there is instead: ``d2 (u 0.785 ± 0.012 um, ends of the interval ± 0.05 um)``."""
    if item.chance:
        return f"{item.output} (chance {chance_text(item.mean, item.errors.mean, item.trials)})"
    if not math.isfinite(item.errors.u):
        return f"{item.output} (no trial made it jump, and none rules out that it may)"
    factor, unit = small_unit(item.output.unit)
    own = plus_minus(item.u * factor, item.errors.u * factor)
    ends = significant(max(item.errors.low, item.errors.high) * factor)
    return f"{item.output} (u {own} {unit}, ends of the interval ± {ends} {unit})"


def table(result: GraphSimulation, digits: int = 2) -> list[Sheet]:
    """One row a coordinate: its nominal, and what differs from it in um, urad or millionths; and
    one a chance.
    """
    plain = [item for item in result.coordinates if not item.chance]
    chances = [item for item in result.coordinates if item.chance]
    title = f"Graph: {result.graph.graph.name}"
    sheets = [_places(title, plain, digits)] if plain else []
    if chances:
        sheets.append(_chances(title if not plain else "Chances", chances))
    return sheets


def _places(title: str, coordinates: Sequence[SimulatedCoordinate], digits: int) -> Sheet:
    columns = [
        Column(title="place\n", text=True, folds=True),
        Column(title="nominal\n"),
        Column(title="mean less\nnominal"),
        Column(title="u\n"),
        Column(title="95 % interval\nless nominal"),
        Column(title="first-\norder u"),
        Column(title="\nunit", text=True),
        Column(title="variance from,\n%", text=True, folds=True),
        Column(title="first order\nvalid"),
    ]
    notes = [
        f"{_counts(coordinates)} Monte Carlo trials; first-order u: differences over one standard "
        "uncertainty to either side; variance from: shares of its square",
        _verdicts_explained({_verdict(item) for item in coordinates}),
    ]
    rows = [_row(item, digits) for item in coordinates]
    return Sheet(title=title, columns=columns, rows=rows, notes=notes)


def _chances(title: str, coordinates: Sequence[SimulatedCoordinate]) -> Sheet:
    columns = [
        Column(title="place", text=True, folds=True),
        Column(title="at nominal"),
        Column(title="chance of 1"),
        Column(title="trials"),
    ]
    rows = [
        [
            str(item.output),
            significant(item.nominal, PLAIN_DIGITS),
            chance_text(item.mean, item.errors.mean, item.trials),
            str(item.trials),
        ]
        for item in coordinates
    ]
    notes = ["chance of 1: the share of the trials in which the place is 1, ± its standard error"]
    if any(one_sided(item.mean, item.errors.mean) for item in coordinates):
        notes.append(BOUNDS)
    return Sheet(title=title, columns=columns, rows=rows, notes=notes)


def _counts(coordinates: Sequence[SimulatedCoordinate]) -> str:
    counts = {item.trials for item in coordinates if not item.fixed} or {0}
    return span(str(min(counts)), str(max(counts)))


def _row(item: SimulatedCoordinate, digits: int) -> list[str]:
    factor, unit = small_unit(item.output.unit)
    u = item.u * factor
    low, high = ((end - item.nominal) * factor for end in item.interval)
    nominal = "0" if item.at_zero else significant(item.nominal, PLAIN_DIGITS)
    return [
        str(item.output),
        nominal if item.output.unit == "1" else f"{nominal} {item.output.unit}",
        with_u((item.mean - item.nominal) * factor, u, digits)[0],
        significant(u, digits),
        "fixed" if item.fixed else interval(low, high, u, digits),
        significant(item.first_order_u * factor, digits),
        unit,
        shares_text(item.shares),
        _verdict(item),
    ]


VERDICTS = {
    "yes": "it does",
    "no*": "it does not, use the Monte Carlo's",
    "not told": "too few trials to tell",
    "-": "nothing to compare, the place is fixed or its first-order u is 0",
}


def _verdict(item: SimulatedCoordinate) -> str:
    names = {True: "yes", False: "no*", None: "not told"}
    return "-" if item.validation is None else names[item.validation.passed]


def _verdicts_explained(shown: set[str]) -> str:
    """The footnote to the last column: what each verdict in it means."""
    meant = "; ".join(f"{name}: {text}" for name, text in VERDICTS.items() if name in shown)
    return (
        "first order valid: does its 95 % interval agree with the Monte Carlo's (JCGM 101, "
        f"clause 8)? {meant}"
    )


def small_unit(unit: str) -> tuple[float, str]:
    """The unit in which deviations of an output are shown, and how many of it make one."""
    return {"mm": (1.0 / UM, "um"), "rad": (1e6, "urad"), "1": (1e6, "1e-6")}.get(unit, (1.0, unit))


def shares_text(shares: dict[str, float]) -> str:
    """ "probe 50, axis 49": percents, the largest first."""
    known = [(name, share) for name, share in shares.items() if abs(share) >= LEAST_SHARE]
    known.sort(key=lambda pair: -abs(pair[1]))
    shown = [
        f"{source_name(name)} {share_percent(share, 0)}"
        for name, share in known[:SHOWN_SHARES]
        if math.isfinite(share)
    ]
    return ", ".join(shown) or "-"


def source_name(source: str) -> str:
    """A source for people: the place, or what of probing it is."""
    return {"u1_axis": "axis", "u2_probe": "probe", "u3_perpendicular": "perpendicularity"}.get(
        source, source
    )


CSV_COLUMNS = [
    "place", "coordinate", "unit", "nominal", "mean", "u", "U", "interval95_low",
    "interval95_high", "shortest95_low", "shortest95_high", "first_order_u",
    "validation_passed", "trials", "converged", "se_mean", "se_u",
]  # fmt: skip


def csv_rows(
    result: GraphSimulation, coverage_factor: float
) -> tuple[list[str], Iterable[Sequence[object]]]:
    """One row a coordinate, with the shares by source at the end."""
    sources = list(dict.fromkeys(name for item in result.coordinates for name in item.shares))
    header = [*CSV_COLUMNS, *(f"share_{name}" for name in sources)]
    return header, [_csv_row(item, coverage_factor, sources) for item in result.coordinates]


def _csv_row(item: SimulatedCoordinate, k: float, sources: Sequence[str]) -> list[object]:
    found = _coordinate(item, k)
    return [
        item.output.place,
        item.output.coordinate,
        *(found[name] for name in ("unit", "nominal", "mean", "u", "U")),
        *found["interval95"],
        *found["shortest95"],
        found["first_order_u"],
        None if item.validation is None else item.validation.passed,
        item.trials,
        item.converged,
        finite(item.errors.mean),
        finite(item.errors.u),
        *(item.shares.get(name) for name in sources),
    ]
