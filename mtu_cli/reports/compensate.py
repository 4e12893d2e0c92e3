"""The report of compensate: the table, the figures before and after, the moves that prove it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.analyses.compensate import CompensateResult
from mtu_cli.formats.control.errors import Controller, ErrorTable
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import declare
from mtu_cli.reports.figures import BLUE, ORANGE, blank, styled
from mtu_cli.reports.numbers import significant
from mtu_cli.units import ARCSEC

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class _Sized:
    """An item with the unit of its component's errors."""

    def __init__(self, item: Any, unit: str, size: float, quantum: float) -> None:
        self.item, self.unit, self.size, self.quantum = item, unit, size, quantum

    def __getattr__(self, name: str) -> Any:
        return getattr(self.item, name)


def _points(result: CompensateResult) -> list[_Sized]:
    own = (result.unit, result.size, result.quantum)
    return [_Sized(point, *own) for point in result.points]


def _figures(name: str) -> Any:
    def found(result: CompensateResult) -> Any:
        each = getattr(result, name)
        return None if each is None else _Sized(each, result.unit, result.size, 0.0)

    return found


def _median(values: Any) -> float:
    return float(np.median(values))


def _interval(values: Any) -> list[float]:
    return [float(x) for x in np.quantile(values, (0.025, 0.975))]


MEANS = {
    "E": "systematic deviation, both directions: largest less smallest mean error",
    "B": "largest |forward - reverse| at a target; null of one direction",
    "M": "range of the mean of both directions",
    "rms": "root mean square of the mean errors",
}
BEFORE = declare(
    "\n".join(f"{name} | {name} | {text} | -, size=size" for name, text in MEANS.items())
)
AFTER = declare(
    "\n".join(
        f"{name}.median | median({name}) | of a new test with the table: {text} | -, size=size\n"
        f"{name}.interval95 | interval({name}) | interval of 95 of 100 such tests "
        f"| -, interval, size=size"
        for name, text in MEANS.items()
    ),
    median=_median,
    interval=_interval,
)
POINT = declare(
    """
    position_mm | position | machine position | position, mm
    unit | unit | unit of errors | -
    forward | forward | error asked for, forward | forward, u=quantum, unit=, size=size
    reverse | reverse | error asked for, reverse | reverse, u=quantum, unit=, size=size
    held_forward | held_forward | as read back from the file, forward \
        | forward held, u=quantum, unit=, size=size
    held_reverse | held_reverse | as read back from the file, reverse \
        | reverse held, u=quantum, unit=, size=size
    """
)
MOVE = declare(
    """
    command_mm | command | position to move to, as the readings count it | command, mm
    direction | direction | from which side | direction, text
    expect_without_um | without | error expected without the table | without, u=u
    expect_with_um | with_table | error expected with it | with, u=u
    expect_wrong_sign_um | wrong_sign | error expected with the wrong sign | wrong sign, u=u
    u_um | u | standard uncertainty of one such reading | u, u=u
    """
)
RESULTS = declare(
    """
    component | | what is compensated
    controller | controller.name | format of the table
    sign | controller.sign | what its values are: error, correction or position
    listing | controller.listing | whether it is for entry by hand
    direction | | both, mean or forward
    unit | unit | unit of errors, E, B, M, rms and quantum
    quantum | quantum | last place of the table's values | -, size=size
    reference_mm | reference | machine position at which the table is 0; null: not zeroed
    backlash_um | backlash() | mean of forward - reverse; null of one direction
    points[] | points() | *point
    before. | figures_before() | *before
    predicted_after. | figures_after() | *after
    backlash_varies. | errors.varies
        F | F | mean squares of forward - reverse over targets
        p | p | that chance makes it so large
    backlash_range_um | range() | range of forward - reverse over targets; null of one direction
    verification.moves[] | moves | *move
    verification.verdict | verified.verdict | worked, no-effect, wrong-sign, partly, \
        too-small-to-tell; null without --verify
    verification.k | verified.k | slope of the readings on the applied table: 0 worked, 1 no \
        effect, 2 wrong sign
    verification.u | verified.u | standard uncertainty of k
    verification.interval95 | verified.interval95 | 95 % interval of k
    verification.p | verified.p | of the nearest of 0, 1 and 2
    """,
    points=_points,
    point=POINT,
    figures_before=_figures("before"),
    figures_after=_figures("after"),
    before=BEFORE,
    after=AFTER,
    move=MOVE,
    backlash=lambda result: _of_backlash(result, np.mean),
    range=lambda result: _of_backlash(result, np.ptp),
)
ROW = POINT


def _of_backlash(result: CompensateResult, figure: Any) -> float | None:
    B = None if result.errors is None or result.errors.angle else result.errors.backlash
    return None if B is None else float(figure(B))


def document(result: CompensateResult, digits: int = 2) -> Document:
    """The points of the table, the figures before and after, and the moves."""
    sign = result.controller.sign if result.controller else "error"
    held = "held: as read back from the file"
    footer = (
        f"errors (actual minus nominal) in {result.unit}; {held}; the file's values are {sign}s"
    )
    if result.controller is not None and result.controller.listing:
        footer += "; FOR HAND ENTRY, no file to load"
    tables = [Table(f"Table of {result.component}", ROW, _points(result), footer)]
    if result.before is not None:
        tables.append(_summary(result))
    if result.moves:
        what = "errors in um; wrong sign: what a table with the other sign would leave"
        tables.append(Table("Verification moves", MOVE, result.moves, what))
    figure = partial(draw, result)
    title = "Compensation"
    return Document(title, (RESULTS, result), tables, figure, _verdict(result), digits)


class _Row:
    """A figure before and after, in mm or rad."""

    def __init__(self, result: CompensateResult, name: str) -> None:
        self.name, self.means, self.size = name, MEANS[name], result.size
        self.before = float(getattr(result.before, name))
        drawn = None if result.after is None else getattr(result.after, name)
        self.median = None if drawn is None else _median(drawn)
        self.interval95 = None if drawn is None else _interval(drawn)
        self.u = None if drawn is None else float(np.std(drawn))


SUMMARY = declare(
    """
    name | name | the figure | figure, text
    before | before | of the readings | before, sig3, size=size
    median | median | of a new test | after (median), sig3, size=size
    interval95 | interval95 | of 95 of 100 new tests | 95 % interval, interval, u=u, size=size
    """
)


def _summary(result: CompensateResult) -> Table:
    names = [name for name in MEANS if np.isfinite(getattr(result.before, name))]
    rows = [_Row(result, name) for name in names]
    footer = (
        f"{result.unit}; E, B, M: ISO 230-2; after: a new test of as many runs at the same targets"
    )
    return Table("Before and after", SUMMARY, rows, footer)


def _verdict(result: CompensateResult) -> str:
    unit, size = result.unit, result.size
    if result.verified is not None:
        k, (low, high) = result.verified.k, result.verified.interval95
        words = f"k = {k:.2f}, 95 % interval [{low:.2f}, {high:.2f}]"
        slopes = "0 worked, 1 no effect, 2 wrong sign"
        return f"Verification: {result.verified.verdict} ({words}; {slopes})."
    if result.before is None:
        return f"{result.component} holds {len(result.asked.at)} points."
    E = significant(float(result.before.E) / size, 3)
    if result.after is None:
        return f"E of {result.component} is {E} {unit}; what the table will leave is not estimable."
    least, most = (significant(x / size, 3) for x in _interval(result.after.E))
    after = significant(_median(result.after.E) / size, 3)
    return (
        f"E of {result.component} is {E} {unit}; with the table a new test gives {after} {unit} "
        f"(95 % interval {least} to {most})."
    )


@styled
def draw(result: CompensateResult) -> Figure:
    """Errors asked for and held, by position."""
    figure = blank(7.0, 3.6)
    axes = figure.subplots()
    at, size = result.asked.at, result.size
    names = ("forward", "reverse") if result.asked.both else ("both directions",)
    for name, colour, asked, held in zip(
        names, (BLUE, ORANGE), result.asked.errors, result.held.errors, strict=False
    ):
        axes.plot(at, asked / size, "o", color=colour, label=f"{name}, asked for")
        axes.plot(at, held / size, "-", color=colour, label=f"{name}, held by the control")
    axes.set_xlabel("machine position, mm")
    axes.set_ylabel(f"error, {result.unit}")
    axes.set_title(f"Compensation of {result.component}")
    axes.legend(loc="best")
    return figure


def listing(control: Controller, table: ErrorTable, name: str) -> CompensateResult:
    """What a file says, as a result without figures."""
    return CompensateResult(
        component=name,
        controller=control,
        direction="both" if table.both else "mean",
        asked=table,
        held=table,
        text="",
        quantum=0.0,
        reference=None,
    )


def skew_document(name: str, angle: float, quantum: float) -> Document:
    """The angle that Klipper will take out."""
    fields = declare(
        """
        component | name | what is compensated
        controller | controller | format
        sign | sign | what its values are
        angle_arcsec | angle | angle between the axes minus 90 degrees | angle, u=quantum
        quantum_arcsec | quantum | last place of the angle | -
        """
    )
    item = _Skew(name, angle, quantum)
    verdict = (
        f"The axes are {significant(angle / ARCSEC, 4)} arcsec from a right angle; verify by the "
        "diagonals of a square."
    )
    figure = partial(_no_figure, name)
    return Document("Skew", (fields, item), [Table("Skew", fields, [item])], figure, verdict)


class _Skew:
    controller, sign = "klipper", "error"

    def __init__(self, name: str, angle: float, quantum: float) -> None:
        self.name, self.angle, self.quantum = name, angle, quantum


@styled
def _no_figure(name: str) -> Figure:
    figure = blank(4.0, 1.0)
    figure.text(0.1, 0.5, f"{name}: one angle, nothing to draw")
    return figure
