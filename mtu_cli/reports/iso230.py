"""The report of a positioning test: figures with uncertainties, targets, and the diagram."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from mtu_cli.analyses import iso230 as analysis
from mtu_cli.findings import listed
from mtu_cli.reports import figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import declare
from mtu_cli.reports.figures import BLUE, GREY, INK, ORANGE, RED
from mtu_cli.reports.numbers import with_u

MAIN = ("A", "E", "R", "M", "B", "B_mean")
SHOWN_AXES = 2
"""Of more the targets are shown with --detail, and the verdict names these alone."""


FIGURE = """
    {0}. | figures.{0}
        value | | {1} | -, size=size
        u_sampling | | its standard deviation over repeated tests | -, size=size
        u | | its standard uncertainty by the instrument, of these runs; null without a budget \
            | -, size=size"""
CHANGE = """
        {0}. | {0}
            value | before.value | earlier test: {1} | -, size=size
            u_sampling | before.u_sampling | its standard deviation over repeated tests \
                | -, size=size
            difference | | now minus earlier | -, size=size
            differs | | whether they differ beyond 2 sqrt(2) u_sampling"""
AT_TARGET = """
        target_mm | mm | target position; null of a rotary axis | target / mm, plain
        target_deg | deg | target position of a rotary axis | target / deg, plain
        n_forward | n.0 | runs forward
        n_reverse | n.1 | runs in reverse
        mean_forward | means.0 | mean of the runs forward | mean / forward, u=s.0, size=of.size
        mean_reverse | means.1 | mean of the runs in reverse | mean / reverse, u=s.1, size=of.size
        mean | | mean of both | -, size=of.size
        B | | mean forward minus mean reverse | B / unit, u=s.0, size=of.size
        s_forward | s.0 | standard deviation of the runs forward; null where the instrument was \
            zeroed in every run | s / forward, size=of.size
        s_reverse | s.1 | the same in reverse | s / reverse, size=of.size
        R_forward | R_way.0 | 4 s_forward | -, size=of.size
        R_reverse | R_way.1 | 4 s_reverse | -, size=of.size
        R | | largest of 2 s_forward + 2 s_reverse + |B| and R of each direction \
            | R / unit, u=s.0, size=of.size"""
AXIS = (
    """
    unit | | unit of all figures
    targets_mm | targets_mm() | target positions; null of a rotary axis
    targets_deg | targets_deg() | target positions of a rotary axis; null of others
    runs.forward | forward() | runs forward, at the target with most
    runs.reverse | reverse() | runs in reverse, at the target with most
    at_target[] | at_target()"""
    + AT_TARGET
    + "".join(FIGURE.format(*each) for each in analysis.ISO.items())
    + "".join(
        f"\n    vdi3441.{name} | figures.{name}.value | {meaning} (VDI/DGQ 3441) | -, size=size"
        for name, meaning in analysis.VDI.items()
    )
    + "\n    before. | earlier()"
    + "".join(CHANGE.format(*each) for each in analysis.ISO.items())
)


def at_target(axis: analysis.Axis) -> list[dict[str, Any]]:
    """What ISO 230-2 has of every target (mm, of a rotary axis deg); B = forward - reverse."""
    count, mean, s = axis.of_runs
    B, R_way, R = analysis.reversal_and_repeatability(mean, s)
    names = ("deg" if axis.rotary else "mm", "n", "means", "mean", "B", "s", "R_way", "R")
    columns = axis.targets, count.astype(int).T, mean.T, mean.mean(axis=0), B, s.T, R_way.T, R
    rows = zip(*columns, strict=True)
    return [{"of": axis} | dict(zip(names, values, strict=True)) for values in rows]


RESULTS = declare(
    """
    axes{} | | *axis
    conformity[] | decisions
        component | 0.name | name of the component
        figure | 1.name | symbol of the figure
        unit | 1.unit | unit of limit, value and U
        limit | 1.limit | largest value allowed | -, size=1.size
        value | absolute(1.value) | the figure, of a mean its absolute value | -, size=1.size
        U | 1.U | expanded uncertainty k u; null without a budget | -, size=1.size
        verdict | 1.verdict | conforming, not proven or nonconforming (ISO 14253-1)
    plan. | plan
        targets_mm | targets | proposed targets
    """,
    absolute=abs,
    axis=declare(
        AXIS,
        targets_mm=lambda x: None if x.rotary else x.targets,
        targets_deg=lambda x: x.targets if x.rotary else None,
        forward=lambda x: int(x.of_runs[0][0].max()),
        reverse=lambda x: int(x.of_runs[0][1].max()),
        at_target=at_target,
        earlier=lambda x: x.figures if x.figures["A"].before else None,
    ),
)


def _scale(figure: analysis.Figure) -> float:
    """The uncertainty that a figure is rounded to."""
    return figure.u if figure.u > 0 else figure.u_sampling


ROW = declare(
    """
    component | 0.name | name of the component | axis, text, names
    figure | 1.name | symbol of the figure | figure, text
    value | 1.value | the figure, in the unit | value, u=scale(1), size=1.size
    unit | 1.unit | its unit | unit, text
    u | 1.u | standard uncertainty by the instrument, of these runs | u, size=1.size, u=1.u
    U | 1.U | expanded uncertainty k u | U, size=1.size, u=1.u
    u_sampling | 1.u_sampling | standard deviation over repeated tests | u_sampling, size=1.size
    limit | 1.limit | largest value allowed | limit, size=1.size, exact
    verdict | 1.verdict | conforming, not proven or nonconforming | verdict, text
    before | 1.before.value | earlier test | before, u=1.before.u_sampling, size=1.size
    difference | 1.difference | now minus earlier | change, u=1.before.u_sampling, size=1.size
    differs | 1.differs | whether the tests differ beyond 2 sqrt(2) u_sampling | differs, yes_no
    meaning | meaning(1.name) | what it is | -
    """,
    scale=_scale,
    meaning=analysis.MEANINGS.get,
)
TARGETS = [*declare("- | of.name | | axis, text, names"), *declare(AT_TARGET)]
PLAN_ROW = declare("""
    number | | number of the target | target, count
    position_mm | at | proposed position | position, mm
    phase | | share of a pitch beyond its last multiple | phase, fix4
""")


def document(result: analysis.Iso230Result, digits: int = 2) -> Document:
    """One row a figure of the standard; targets below."""
    if result.plan is not None:
        return _plan_document(result, result.plan, digits)
    axes, names = list(result.axes.values()), analysis.STANDARDS[result.standard]
    pairs = [(axis, axis.figures[name]) for axis in axes for name in names]
    rows = [(axis, each) for axis, each in pairs if not math.isnan(each.value)]
    footer = "u_sampling: of a repeated test"
    if any(math.isfinite(each.u) for _, each in rows):
        footer = f"U = {rows[0][1].k:g} u by the instrument, of these runs; {footer}"
    if result.decisions:
        footer += "; limits by ISO 14253-1"
    title = "Positioning, ISO 230-2"
    if names is analysis.VDI:
        title = "Positioning, VDI/DGQ 3441"
        footer = f"six standard deviations: not comparable with ISO 230-2; {footer}"
    one_way = [axis.name for axis in axes if math.isnan(axis.figures["E"].value)]
    main = {*MAIN, *analysis.VDI}
    selection = [(axis, x) for axis, x in rows if x.name in main or axis.name in one_way or x.limit]
    targets = [row for axis in axes for row in at_target(axis)]
    of = f"deviations in {listed(dict.fromkeys(axis.unit for axis in axes))}"
    target_footer = f"{of}; B = mean forward - mean reverse"
    tables = [
        Table(title, ROW, rows, footer, selection=selection),
        Table("At the targets", TARGETS, targets, target_footer, detail=len(axes) > SHOWN_AXES),
    ]
    texts = [
        f"{axis.name}: {_figure_text(axis, digits, result.standard)} {axis.unit}."
        for axis in axes[:SHOWN_AXES]
    ]
    texts += [f"And {len(axes) - SHOWN_AXES} more axes."] * (len(axes) > SHOWN_AXES)
    for verdict in ("nonconforming", "not proven"):
        failures = [
            f"{x.name} of {axis.name}" for axis, x in result.decisions if x.verdict == verdict
        ]
        texts += [f"{verdict.capitalize()}: {listed(failures)}."] if failures else []
    if any(x.before for _, x in rows):
        differ = listed(f"{x.name} of {axis.name}" for axis, x in rows if x.differs)
        texts.append(f"Changed since the earlier test: {differ or 'no figure'}.")
    figure_, verdict = partial(figure, result), " ".join(texts)
    return Document("Positioning", (RESULTS, result), tables, figure_, verdict, digits)


def _figure_text(axis: analysis.Axis, digits: int, standard: str = "iso230-2") -> str:
    """The main figures that exist, for one direction those of it, with their names."""
    names = ["P", "Pa", "Ps_max", "U_max"] if standard == "vdi3441" else [*MAIN[:5]]
    if standard != "vdi3441" and math.isnan(axis.figures["E"].value):
        way = "forward" if axis.of_runs[0][0].any() else "reverse"
        names = [f"{name}_{way}" for name in "AER"]
    values = [axis.figures[name] for name in names]
    return ", ".join(
        f"{x.name} {with_u(x.value / x.size, _scale(x) / x.size, digits)[0]}"
        for x in values
        if not math.isnan(x.value)
    )


def _plan_document(result: analysis.Iso230Result, plan: analysis.Plan, digits: int) -> Document:
    rows = [
        {"number": i, "at": at, "phase": at / plan.pitch % 1.0}
        for i, at in enumerate(plan.targets.tolist(), 1)
    ]
    footer = "five runs in each direction; phase: share of the pitch beyond its last multiple"
    table = Table("Target positions", PLAN_ROW, rows, footer)
    verdict = (
        f"{len(rows)} targets over {plan.length:g} mm; none is a multiple of the pitch of "
        f"{plan.pitch:g} mm."
    )
    return Document("Target positions", (RESULTS, result), [table], None, verdict, digits)


def figure(result: analysis.Iso230Result) -> figures.Figure:
    """The diagram of ISO 230-2: means of each direction with 2 s, the mean of both, readings, and
    limits as long as the range that their figure may have.
    """
    axes = list(result.axes.values())
    columns = 1 if len(axes) == 1 else 2
    lines = math.ceil(len(axes) / columns)
    page = figures.blank(8.0 if columns == 1 else 11.0, 4.4 if lines == 1 else 3.4 * lines + 0.6)
    for panel, axis in zip(figures.panels_of(page, len(axes), columns), axes, strict=False):
        count, means, s = axis.of_runs
        means, s = means / axis.size, s / axis.size
        panel.axhline(0.0, color=GREY, linewidth=0.8)
        for i, (colour, side, marker) in enumerate(((BLUE, -1, "^"), (ORANGE, 1, "v"))):
            if not count[i].any():
                continue
            for run in axis.readings[i].T / axis.size:
                at = axis.targets + side * 0.006 * axis.travel
                panel.plot(at, run, ".", color=colour, alpha=0.35, ms=3.5)
            panel.errorbar(
                axis.targets, means[i], yerr=2 * np.nan_to_num(s[i]), color=colour, marker=marker,
                ms=5, capsize=3, elinewidth=1.0, label=f"mean {analysis.WAYS[i]}, 2 s",
            )  # fmt: skip
        mean = means.mean(axis=0)
        if np.isfinite(mean).any():
            panel.plot(axis.targets, mean, color=INK, ls="--", lw=1.0, label="mean of both")
        middle = (np.nanmax(means) + np.nanmin(means)) / 2
        limits = {x.name: x.limit / x.size for x in axis.figures.values() if x.limit is not None}
        for i, (name, limit) in enumerate(limits.items(), 1):
            place = axis.targets.max() + 0.05 * i * axis.travel
            panel.errorbar(
                place, middle, limit / 2, color=RED, capsize=4, elinewidth=2.0, label="limit"
            )
            panel.annotate(name, (place, middle), (4, 0), textcoords="offset points", color=RED)
        title = f"{axis.name}: {_figure_text(axis, 2)} {axis.unit}"
        xlabel = f"target, {'deg' if axis.rotary else 'mm'}"
        panel.set(title=title, xlabel=xlabel, ylabel=f"deviation, {axis.unit}")
    figures.legend(page)
    return page
