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


STATED = "what is stated, without the scatter of a test,"
"""Of errors that the machine file states."""
PLACE = """
    NAME_mm | mm() | WHAT; null of a rotary axis | NAME / mm, mm
    NAME_deg | deg() | the same of a rotary axis | NAME / deg, mm
"""
DEFINITIONS: dict[str, Any] = {
    "place": PLACE,
    "mm": lambda x: None if x["of"].asked.rotary else x["place"],
    "deg": lambda x: x["place"] if x["of"].asked.rotary else None,
    "units": ("um", "arcsec"),
    "um": lambda x: x["item"] if x["of"].unit.name == "um" else None,
    "arcsec": lambda x: x["item"] if x["of"].unit.name == "arcsec" else None,
    "mean": np.mean,
    "range": np.ptp,
    "median": np.median,
    "std": np.std,
    "interval95": lambda draws: np.quantile(draws, (0.025, 0.975)),
}
"""Of points and moves: the result, their place, errors or move."""
ROW = declare(
    """
    *place
    unit | of.unit.name | unit of errors | -
    forward | item.0 | error asked for, forward | forward, SHARED
    reverse | item.1 | error asked for, reverse | reverse, SHARED
    held_forward | item.2 | as read back from the file, forward | forward held, SHARED
    held_reverse | item.3 | as read back from the file, reverse | reverse held, SHARED
    """,
    NAME="position",
    WHAT="machine position",
    SHARED="u=of.quantum, unit=, size=of.unit.to_internal",
    **DEFINITIONS,
)
MOVE = declare(
    """
    *place
    direction | item.direction | from which side | direction, text
    for UNIT in units
        -. | UNIT()
            expect_without_UNIT | without | error expected without the table | without, u=u
            expect_with_UNIT | with_table | error expected with it | with, u=u
            expect_wrong_sign_UNIT | wrong_sign | the same with the wrong sign | wrong sign, u=u
            u_UNIT | u | standard uncertainty of one such reading | u, u=u
            measured_UNIT | measured | mean of the readings of --verify | measured, u=u
    """,
    NAME="command",
    WHAT="position to move to, as the readings count it",
    **DEFINITIONS,
)


def _points(result: CompensateResult) -> list[dict[str, Any]]:
    """Points of the table: errors requested and read back, forward and reverse."""
    errors = np.vstack([result.asked.errors, result.held.errors]).T
    pairs = zip(result.asked.at, errors, strict=True)
    return [{"of": result, "place": place, "item": item} for place, item in pairs]


def _moves(result: CompensateResult) -> list[dict[str, Any]]:
    return [{"of": result, "place": move.command, "item": move} for move in result.moves]


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
    backlash_um | mean(backlash) | mean of forward - reverse; null of one direction
    points[] | points() | *point
    before. | tested()
        for NAME TEXT in figures
            NAME | before.NAME | TEXT | -, size=unit.to_internal
    predicted_after. | predicted()
        for NAME TEXT in figures
            NAME.median | median(after.NAME) | of a new test with the table: TEXT \
                | -, size=unit.to_internal
            NAME.interval95 | interval95(after.NAME) | interval of 95 of 100 such tests \
                | -, interval, size=unit.to_internal
    backlash_varies.F | errors.varies.F | mean squares of forward - reverse over targets
    backlash_varies.p | errors.varies.p | that chance makes it so large
    backlash_varies.range_um | range(backlash) | range of forward - reverse; null of one direction
    verification.moves[] | moves() | *move
    verification.verdict | verified.verdict | worked, no-effect, wrong-sign, partly, \
        too-small-to-tell; null without --verify
    verification.k | verified.k | slope on the applied table: 0 worked, 1 no effect, 2 wrong sign
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
    figures=MEANS.items(),
    tested=lambda result: None if result.before is None else result,
    predicted=lambda result: None if result.after is None else result,
    moves=_moves,
    move=MOVE,
    **DEFINITIONS,
)
SUMMARY = declare(
    """
    name | | the figure | figure, text
    before | | of the readings | before, sig3, size=size
    median | median(after) | of a new test | after (median), sig3, size=size
    interval95 | interval95(after) | of 95 of 100 new tests \
        | 95 % interval, interval, u=std(after), size=size
    """,
    **DEFINITIONS,
)


def document(result: CompensateResult, digits: int = 2) -> Document:
    """The points of the table, the figures before and after, and the moves."""
    control, unit, component = result.controller, result.unit.name, result.component
    footer = f"errors (actual minus nominal) in {unit}; held: as read back; the file's values are "
    footer += f"{control.sign}s{'; FOR HAND ENTRY, no file to load' * control.listing}"
    if result.reference is not None:
        footer += f"; zero at {result.reference:g} {'deg' if result.asked.rotary else 'mm'}"
    test = "a new test of as many runs" if result.errors is None or result.errors.read else STATED
    meaning = f"E, B, M: ISO 230-2; after: {test} at the same targets"
    moves = f"errors in {unit}, places as the readings count them; wrong sign: with the other sign"
    before, after, size = result.before or {}, result.after or {}, result.unit.to_internal
    rows = [
        {"name": name, "before": value, "after": after.get(name), "size": size}
        for name, value in before.items()
        if np.isfinite(value)
    ]
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
        verdict = f"E of {component} is {significant(float(before['E']) / size, 3)} {unit}; "
        if not after:
            verdict += "what the table will leave is not estimable."
        else:
            draws = (np.quantile(after["E"], (0.5, 0.025, 0.975)) / size).tolist()
            median, least, most = (significant(x, 3) for x in draws)
            test = "a new test gives" if result.errors and result.errors.read else f"{STATED} is"
            verdict += f"with the table {test} {median} {unit} "
            verdict += f"(95 % interval {least} to {most})."
            if result.backlash is not None and not result.asked.both:
                mean = f"{significant(float(result.backlash.mean()) / size, 3)} {unit}"
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
