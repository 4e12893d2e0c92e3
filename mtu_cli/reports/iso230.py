"""The report of a positioning test: figures with uncertainties, targets, and the diagram."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mtu_cli.analyses.iso230 import (
    FIGURES,
    VDI,
    Axis,
    Change,
    Decision,
    Figure,
    Iso230Result,
    Plan,
    reversal_and_repeatability,
)
from mtu_cli.findings import listed
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import declare
from mtu_cli.reports.figures import BLUE, GREY, INK, ORANGE, blank, legend, panels_of, styled
from mtu_cli.reports.numbers import significant, with_u

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Page

MAIN = ("A", "E", "R", "M", "B", "B_mean")
SHOWN_AXES = 2
"""Of more the targets are shown with --detail, and the verdict names these alone."""


class Row(NamedTuple):
    """A figure of an axis, with its limit and what it was before where there are such."""

    axis: Axis
    name: str
    figure: Figure
    decision: Decision | None
    change: Change | None


VALUE = """
        value | | {} | -, size=size
        u_sampling | | its standard deviation over repeated tests | -, size=size"""
FIGURE = (
    """
    {0}. | figures.{0}"""
    + VALUE.format("{1}")
    + """
        u | | its standard uncertainty by the instrument, of these runs; null without a budget \
            | -, size=size"""
)
CHANGE = (
    """
        {0}. | {0}"""
    + VALUE.replace("\n    ", "\n        ").format("earlier test: {1}")
    + """
            difference | | now minus earlier | -, size=size
            bound | | the tests differ beyond this | -, size=size
            differs | | whether they do"""
)
AT_TARGET = """
        target_mm | mm | target position; null of a rotary axis | target / mm, plain
        target_deg | deg | target position of a rotary axis | target / deg, plain
        n_forward | | runs forward
        n_reverse | | runs in reverse
        mean_forward | | mean of the runs forward | mean / forward, u=s_forward, size=size
        mean_reverse | | mean of the runs in reverse | mean / reverse, u=s_reverse, size=size
        mean | | mean of both | -, size=size
        B | | mean forward minus mean reverse | B / unit, u=s_forward, size=size
        s_forward | | standard deviation of the runs forward; null where the instrument was \
            zeroed in every run | s / forward, size=size
        s_reverse | | the same in reverse | s / reverse, size=size
        R_forward | | 4 s_forward | -, size=size
        R_reverse | | 4 s_reverse | -, size=size
        R | | largest of 2 s_forward + 2 s_reverse + |B| and R of each direction \
            | R / unit, u=s_forward, size=size"""
AXIS = (
    """
    unit | test.unit | unit of all figures
    targets_mm | targets_mm() | target positions; null of a rotary axis
    targets_deg | targets_deg() | target positions of a rotary axis; null of others
    runs.forward | forward() | runs forward, at the target with most
    runs.reverse | reverse() | runs in reverse, at the target with most
    at_target[] | at_target()"""
    + AT_TARGET
    + "".join(FIGURE.format(*each) for each in FIGURES.items())
    + "".join(
        f"\n    vdi3441.{name} | vdi.{name} | {meaning} (VDI/DGQ 3441) | -, size=test.size"
        for name, meaning in VDI.items()
    )
    + "\n    before. | before"
    + "".join(CHANGE.format(*each) for each in FIGURES.items())
)


def at_target(axis: Axis) -> list[SimpleNamespace]:
    """What ISO 230-2 has of every target (mm, of a rotary axis deg); B = forward - reverse."""
    test, (B, R_way, R) = axis.test, reversal_and_repeatability(axis.mean, axis.s)
    ways, columns = ("forward", "reverse"), {"mean": axis.mean.mean(axis=0), "B": B, "R": R}
    for name, both in (("mean", axis.mean), ("s", axis.s), ("R", R_way)):
        columns |= {f"{name}_{way}": values for way, values in zip(ways, both, strict=True)}
    place, other = ("deg", "mm") if test.rotary else ("mm", "deg")
    return [
        SimpleNamespace(
            name=axis.name,
            size=test.size,
            n_forward=int(axis.count[0][i]),
            n_reverse=int(axis.count[1][i]),
            **{place: at, other: None},
            **{name: float(values[i]) for name, values in columns.items()},
        )
        for i, at in enumerate(test.targets.tolist())
    ]


RESULTS = declare(
    """
    axes{} | | *axis
    conformity[] | decisions
        component | | name of the component
        figure | | symbol of the figure
        unit | | unit of limit, value and U
        limit | | largest value allowed | -, size=size
        value | | the figure, of a mean its absolute value | -, size=size
        U | | expanded uncertainty k u; null without a budget | -, size=size
        verdict | | conforming, not proven or nonconforming (ISO 14253-1)
    plan. | plan
        length_mm | length | travel
        pitch_mm | pitch | pitch that no target is a multiple of
        targets_mm | targets | proposed targets
    """,
    axis=declare(
        AXIS,
        targets_mm=lambda x: None if x.test.rotary else x.test.targets,
        targets_deg=lambda x: x.test.targets if x.test.rotary else None,
        forward=lambda x: int(x.count[0].max()),
        reverse=lambda x: int(x.count[1].max()),
        at_target=at_target,
    ),
)


def _scale(figure: Figure) -> float:
    """What a figure is rounded to."""
    return figure.u if figure.u > 0 else figure.u_sampling


ROW = declare(
    """
    component | axis.name | name of the component | axis, text, names
    figure | name | symbol of the figure | figure, text
    value | figure.value | the figure, in the unit | value, u=scale(figure), size=figure.size
    unit | axis.test.unit | its unit | unit, text
    u | figure.u | standard uncertainty by the instrument, of these runs | u, size=figure.size, \
        u=figure.u
    U | U() | expanded uncertainty k u | U, size=figure.size, u=figure.u
    u_sampling | figure.u_sampling | standard deviation over repeated tests | u_sampling, \
        size=figure.size
    limit | decision.limit | largest value allowed | limit, size=figure.size, exact
    verdict | decision.verdict | conforming, not proven or nonconforming | verdict, text
    before | change.value | earlier test | before, u=change.u_sampling, size=figure.size
    difference | change.difference | now minus earlier | change, u=change.u_sampling, \
        size=figure.size
    differs | change.differs | whether the tests differ beyond 2 sqrt(2) u_sampling | -
    - | differs() | | differs, text
    """,
    scale=_scale,
    U=lambda row: row.axis.k * row.figure.u,
    differs=lambda row: (
        None if row.change is None else {True: "yes", False: "no", None: "-"}[row.change.differs]
    ),
)
VDI_ROW = declare("""
    component | axis.name | name of the component | axis, text, names
    figure | name | symbol of the figure | figure, text
    value | | the figure, in the unit | value, sig4, size=axis.test.size
    unit | axis.test.unit | its unit | unit, text
    meaning | | what it is | meaning, text
""")
TARGETS = [*declare("- | name | | axis, text, names"), *declare(AT_TARGET)]
PLAN_ROW = declare("""
    number | | number of the target | target, count
    position_mm | at | proposed position | position, mm
    phase | | share of a pitch beyond its last multiple | phase, fix4
""")


def rows_of(result: Iso230Result) -> Iterator[Row]:
    """Every figure of every axis that exists."""
    found = {(x.component, x.figure): x for x in result.decisions}
    for axis in result.axes.values():
        for name, figure in axis.figures.items():
            if not math.isnan(figure.value):
                change = (axis.before or {}).get(name)
                yield Row(axis, name, figure, found.get((axis.name, name)), change)


def document(result: Iso230Result, digits: int = 2) -> Document:
    """One row a figure; targets below."""
    if result.plan is not None:
        return _plan_document(result, result.plan, digits)
    axes, rows = list(result.axes.values()), list(rows_of(result))
    footer = "u_sampling: of a repeated test"
    if any(math.isfinite(row.figure.u) for row in rows):
        footer = f"U = {axes[0].k:g} u by the instrument, of these runs; {footer}"
    if result.decisions:
        footer += "; limits by ISO 14253-1"
    two_way = [axis for axis in axes if not math.isnan(axis.figures["E"].value)]
    shown = [x for x in rows if x.name in MAIN or x.axis not in two_way or x.decision]
    figures = Table("Positioning, ISO 230-2", ROW, rows, footer, shown=shown)
    if result.standard != "iso230-2":
        lines = [
            SimpleNamespace(axis=axis, name=name, value=value, meaning=VDI[name])
            for axis in axes
            for name, value in axis.vdi.items()
            if not math.isnan(value)
        ]
        footer = "six standard deviations: not comparable with the figures of ISO 230-2"
        figures = Table("Positioning, VDI/DGQ 3441", VDI_ROW, lines, footer)
    placed = [row for axis in axes for row in at_target(axis)]
    of = f"deviations in {listed(dict.fromkeys(axis.test.unit for axis in axes))}"
    footer = f"{of}; B = mean forward - mean reverse"
    many = len(axes) > SHOWN_AXES
    targets = Table("At the targets", TARGETS, placed, footer, detail=many)
    figure = partial(diagram, result)
    verdict = _verdict(result, digits)
    return Document("Positioning", (RESULTS, result), [figures, targets], figure, verdict, digits)


def _verdict(result: Iso230Result, digits: int) -> str:
    """The figures of the first axes, what fails, what changed."""
    axes, texts = list(result.axes.values()), []
    for axis in axes[:SHOWN_AXES]:
        shown = _stated(axis, digits)
        if result.standard != "iso230-2":
            vdi = {name: axis.vdi[name] / axis.test.size for name in ("P", "Pa", "Ps_max", "U_max")}
            shown = [f"{x} {significant(value, 4)}" for x, value in vdi.items() if value == value]
        texts.append(f"{axis.name}: {', '.join(shown)} {axis.test.unit}.")
    texts += [f"And {len(axes) - SHOWN_AXES} more axes."] * (len(axes) > SHOWN_AXES)
    for verdict in ("nonconforming", "not proven"):
        failed = [f"{x.figure} of {x.component}" for x in result.decisions if x.verdict == verdict]
        texts += [f"{verdict.capitalize()}: {listed(failed)}."] if failed else []
    if any(axis.before for axis in axes):
        pairs = ((axis, name, x) for axis in axes for name, x in (axis.before or {}).items())
        differ = listed(f"{name} of {axis.name}" for axis, name, x in pairs if x.differs)
        texts.append(f"Changed since the earlier test: {differ or 'no figure'}.")
    return " ".join(texts)


def _stated(axis: Axis, digits: int) -> list[str]:
    """The main figures that exist, of one direction its own, with their names."""
    own = axis.figures
    names: Sequence[str] = MAIN[:5]
    if math.isnan(own["E"].value):
        way = "forward" if axis.count[0].any() else "reverse"
        names = [f"{name}_{way}" for name in "AER"]
    size, result = axis.test.size, []
    for name in names:
        value, u = own[name].value / size, _scale(own[name]) / size
        if not math.isnan(value):
            text = significant(value, 4) if math.isnan(u) else with_u(value, u, digits)[0]
            result.append(f"{name} {text}")
    return result


def _plan_document(result: Iso230Result, plan: Plan, digits: int) -> Document:
    rows = [
        SimpleNamespace(number=i, at=at, phase=at / plan.pitch % 1.0)
        for i, at in enumerate(plan.targets.tolist(), 1)
    ]
    footer = "five runs in each direction; phase: share of the pitch beyond its last multiple"
    table = Table("Target positions", PLAN_ROW, rows, footer)
    verdict = (
        f"{len(rows)} targets over {plan.length:g} mm; none is a multiple of the pitch of "
        f"{plan.pitch:g} mm."
    )
    return Document("Target positions", (RESULTS, result), [table], None, verdict, digits)


@styled
def diagram(result: Iso230Result) -> Page:
    """The diagram of ISO 230-2: means of each direction with 2 s, the mean of both, readings."""
    axes = list(result.axes.values())
    columns = 1 if len(axes) == 1 else 2
    lines = math.ceil(len(axes) / columns)
    page = blank(8.0 if columns == 1 else 11.0, 4.4 if lines == 1 else 3.4 * lines + 0.6)
    for panel, axis in zip(panels_of(page, len(axes), columns), axes, strict=False):
        _panel(panel, axis)
    legend(page)
    return page


def _panel(panel: Axes, axis: Axis) -> None:
    test, size = axis.test, axis.test.size
    ways = (("forward", BLUE, -1, "^"), ("reverse", ORANGE, 1, "v"))
    shift = 0.006 * test.travel
    panel.axhline(0.0, color=GREY, linewidth=0.8)
    for i, (name, colour, side, marker) in enumerate(ways):
        if not axis.count[i].any():
            continue
        mean, band = axis.mean[i] / size, 2 * np.nan_to_num(axis.s[i]) / size
        for run in test.readings[i].T / size:
            panel.plot(test.targets + side * shift, run, ".", color=colour, alpha=0.35, ms=3.5)
        panel.errorbar(
            test.targets, mean, yerr=band, color=colour, marker=marker, ms=5, capsize=3,
            elinewidth=1.0, label=f"mean {name}, 2 s",
        )  # fmt: skip
    both = axis.mean.mean(axis=0) / size
    if np.isfinite(both).any():
        panel.plot(test.targets, both, color=INK, ls="--", lw=1.0, label="mean of both")
    panel.set_title(f"{axis.name}: {', '.join(_stated(axis, 2))} {test.unit}")
    panel.set_xlabel(f"target, {'deg' if test.rotary else 'mm'}")
    panel.set_ylabel(f"deviation, {test.unit}")
