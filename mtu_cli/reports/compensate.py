"""The report of compensate: the table, the figures before and after, the verification moves."""

from __future__ import annotations

from typing import Any

import numpy as np

from mtu_cli.analyses.compensate import CompensateResult
from mtu_cli.reports import figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import declare
from mtu_cli.reports.numbers import significant
from mtu_cli.units import ARCSEC

MEANS = {
    "E": "systematic deviation, both directions: largest less smallest mean error",
    "B": "largest |forward - reverse| at a target; null of one direction",
    "M": "range of the mean of both directions",
    "rms": "root mean square of the mean errors",
}


def _entries(result: CompensateResult, places: Any, items: Any) -> list[dict[str, Any]]:
    """Points or moves of a result with their places: mm, of a rotary axis deg; each under the unit
    of its errors, too.
    """
    key = "deg" if result.asked.rotary else "mm"
    return [
        {"of": result, "item": item, key: at, result.unit.name: item}
        for at, item in zip(places, items, strict=True)
    ]


def _points(result: CompensateResult) -> list[dict[str, Any]]:
    """Points of the table: errors requested and read back, forward and reverse."""
    errors = np.vstack([result.asked.errors, result.held.errors]).T
    return _entries(result, result.asked.at, errors)


def _moves(result: CompensateResult) -> list[dict[str, Any]]:
    return _entries(result, [move.command for move in result.moves], result.moves)


def _figures(result: CompensateResult) -> dict[str, dict[str, Any]] | None:
    """Each figure before and after by name, in the unit of the errors."""
    items, size = dict[str, dict[str, Any]](), result.unit.to_internal
    for name, before in (result.before or {}).items():
        items[name] = {"name": name, "before": float(before) / size}
        if result.after is not None:
            draws = result.after[name] / size
            items[name]["median"], items[name]["u"] = float(np.median(draws)), float(np.std(draws))
            items[name]["interval95"] = np.quantile(draws, (0.025, 0.975)).tolist()
    return items or None


PLACE = """
    {name}_mm | mm | {what}; null of a rotary axis | {name} / mm, mm
    {name}_deg | deg | the same of a rotary axis | {name} / deg, mm
"""
SHARED = "u=of.quantum, unit=, size=of.unit.to_internal"
ROW = declare(
    PLACE.format(name="position", what="machine position")
    + f"""
    unit | of.unit.name | unit of errors | -
    forward | item.0 | error asked for, forward | forward, {SHARED}
    reverse | item.1 | error asked for, reverse | reverse, {SHARED}
    held_forward | item.2 | as read back from the file, forward | forward held, {SHARED}
    held_reverse | item.3 | as read back from the file, reverse | reverse held, {SHARED}
    """
)
MOVE = declare(
    PLACE.format(name="command", what="position to move to, as the readings count it")
    + "    direction | item.direction | from which side | direction, text\n"
    + "".join(
        f"""
    expect_without_{unit} | {unit}.without | error expected without the table | without, u={unit}.u
    expect_with_{unit} | {unit}.with_table | error expected with it | with, u={unit}.u
    expect_wrong_sign_{unit} | {unit}.wrong_sign | error expected with the wrong sign \
        | wrong sign, u={unit}.u
    u_{unit} | {unit}.u | standard uncertainty of one such reading | u, u={unit}.u
    measured_{unit} | {unit}.measured | mean of the readings of --verify | measured, u={unit}.u
    """
        for unit in ("um", "arcsec")
    )
)
RESULTS = declare(
    """
    component | | what is compensated
    controller | controller.name | format of the table
    sign | controller.sign | what its values are: error, correction or position
    listing | controller.listing | whether it is for entry by hand
    direction | | both, mean or forward
    unit | unit.name | unit of errors, E, B, M, rms and quantum
    quantum | quantum | last place of the table's values | -, size=unit.to_internal
    reference_mm | reference | machine position at which the table is 0; null: not zeroed
    backlash_um | backlash() | mean of forward - reverse; null of one direction
    points[] | points() | *point
    before. | figures() | *before
    predicted_after. | predicted() | *after
    backlash_varies.F | errors.varies.F | mean squares of forward - reverse over targets
    backlash_varies.p | errors.varies.p | that chance makes it so large
    backlash_varies.range_um | range() | range of forward - reverse over targets; null of one \
        direction
    verification.moves[] | moves() | *move
    verification.verdict | verified.verdict | worked, no-effect, wrong-sign, partly, \
        too-small-to-tell; null without --verify
    verification.k | verified.k | slope of the readings on the applied table: 0 worked, 1 no \
        effect, 2 wrong sign
    verification.u | verified.u | standard uncertainty of k
    verification.interval95 | verified.interval95 | 95 % interval of k
    verification.p | verified.p | of the nearest of 0, 1 and 2
    verification.misfit. | verified.misfit
        F | F | chi2/dof of the readings about the first test less k tables, by its scatter; null \
            where that shows none
        p | p | upper bound of the probability that chance makes F so large
    """,
    points=_points,
    point=ROW,
    before="\n".join(f"{x} | {x}.before | {text} | -" for x, text in MEANS.items()),
    after="\n".join(
        f"{x}.median | {x}.median | of a new test with the table: {text} | -\n"
        f"{x}.interval95 | {x}.interval95 | interval of 95 of 100 such tests | -, interval"
        for x, text in MEANS.items()
    ),
    figures=_figures,
    predicted=lambda result: _figures(result) if result.after else None,
    moves=_moves,
    move=MOVE,
    backlash=lambda result: _of_backlash(result, np.mean),
    range=lambda result: _of_backlash(result, np.ptp),
)
SUMMARY = declare(
    """
    name | | the figure | figure, text
    before | | of the readings | before, sig3
    median | | of a new test | after (median), sig3
    interval95 | | of 95 of 100 new tests | 95 % interval, interval, u=u
    """
)


def _of_backlash(result: CompensateResult, figure: Any) -> float | None:
    B = None if result.errors is None or result.errors.angle else result.errors.backlash
    return None if B is None else float(figure(B))


def document(result: CompensateResult, digits: int = 2) -> Document:
    """The points of the table, the figures before and after, and the moves."""
    control, unit, component = result.controller, result.unit.name, result.component
    footer = (
        f"errors (actual minus nominal) in {unit}; held: as read back from the file; the file's "
        f"values are {control.sign}s{'; FOR HAND ENTRY, no file to load' * control.listing}"
    )
    if result.reference is not None:
        footer += f"; zero at {result.reference:g} {'deg' if result.asked.rotary else 'mm'}"
    meaning = "E, B, M: ISO 230-2; after: a new test of as many runs at the same targets"
    moves = f"errors in {unit}; wrong sign: what a table with the other sign would leave"
    items = _figures(result) or {}
    rows = [each for each in items.values() if np.isfinite(each["before"])]
    tables = [
        Table(f"Table of {component}", ROW, _points(result), footer),
        Table("Before and after", SUMMARY, rows, f"{unit}; {meaning}"),
        Table("Verification moves", MOVE, _moves(result), moves),
    ]
    if result.verified is not None:
        k, (low, high) = result.verified.k, result.verified.interval95
        verdict = (
            f"Verification: {result.verified.verdict} (k = {k:.2f}, 95 % interval [{low:.2f}, "
            f"{high:.2f}]; 0 worked, 1 no effect, 2 wrong sign)."
        )
    elif result.before is None:
        verdict = f"{component} holds {len(result.asked.at)} points."
    else:
        E = items["E"]
        verdict = f"E of {component} is {significant(E['before'], 3)} {unit}; "
        if result.after is None:
            verdict += "what the table will leave is not estimable."
        else:
            after, least, most = (significant(x, 3) for x in (E["median"], *E["interval95"]))
            verdict += f"with the table a new test gives {after} {unit} "
            verdict += f"(95 % interval {least} to {most})."
            B = _of_backlash(result, np.mean)
            if B is not None and not result.asked.both:
                mean = f"{significant(B / result.unit.to_internal, 3)} {unit}"
                verdict += f" A reversal of {mean} (forward less reverse) is left to the control."
    return Document("Compensation", (RESULTS, result), tables, figure, verdict, digits)


def figure(result: CompensateResult) -> figures.Figure:
    """Errors requested and read back, by position."""
    page = figures.blank(7.0, 3.6)
    panel = page.subplots()
    at, size = result.asked.at, result.unit.to_internal
    names = ("forward", "reverse") if result.asked.both else ("both directions",)
    for name, colour, requested, readback in zip(
        names, (figures.BLUE, figures.ORANGE), result.asked.errors, result.held.errors, strict=False
    ):
        panel.plot(at, requested / size, "o", color=colour, label=f"{name}, asked for")
        panel.plot(at, readback / size, "-", color=colour, label=f"{name}, held by the control")
    xlabel = f"machine position, {'deg' if result.asked.rotary else 'mm'}"
    title = f"Compensation of {result.component}"
    panel.set(xlabel=xlabel, ylabel=f"error, {result.unit.name}", title=title)
    panel.legend(loc="best")
    return page


SKEW = declare(
    """
    component | | what is compensated
    controller | | format
    sign | | what its values are
    angle_arcsec | angle | angle between the axes minus 90 degrees | angle, u=quantum
    quantum_arcsec | quantum | last place of the angle | -
    """
)


def skew_document(component: str, angle: float, quantum: float) -> Document:
    """The `angle` between two axes less 90 degrees, rad, that Klipper will take out."""
    item = {"component": component, "angle": angle, "quantum": quantum}
    item |= {"controller": "klipper", "sign": "error"}
    verdict = (
        f"The axes are {significant(angle / ARCSEC, 4)} arcsec from a right angle; verify by the "
        "diagonals of a square."
    )
    return Document("Skew", (SKEW, item), [Table("Skew", SKEW, [item])], None, verdict)
