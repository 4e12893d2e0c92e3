"""The reports of the tests of ISO 230: of positioning figures with uncertainties, targets and the
diagram; of circles traces, causes and the polar diagram.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mtu_cli.analyses import iso230 as analysis
from mtu_cli.analyses.circular import MEANING, Cause, CircularResult, about_circle
from mtu_cli.findings import listed
from mtu_cli.reports import figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import declare
from mtu_cli.reports.figures import BLUE, GREY, INK, ORANGE
from mtu_cli.reports.numbers import plus_minus, significant, with_u
from mtu_cli.units import ARCSEC, UM

MAIN = ("A", "E", "R", "M", "B", "B_mean")
SHOWN_AXES = 2
"""Of more the targets are shown with --detail, and the verdict names these alone."""

FIGURE = """
    value | | MEANING | value, u=scale(), size=size
    unit | | its unit | unit, text
    u | | u of these runs by the instrument; null without a budget | u, size=size, u=u
    U | | expanded uncertainty k u | U, size=size, u=u
    u_sampling | | standard deviation over repeated tests | u_sampling, size=size
    limit | | largest value allowed | limit, size=size, exact
    verdict | | conforming, not proven or nonconforming (ISO 14253-1) | verdict, text
    before | before.value | earlier test | before, u=before.u_sampling, size=size
    difference | | now minus earlier | change, u=before.u_sampling, size=size
    differs | | whether the tests differ beyond 2 sqrt(2) u_sampling | differs, yes_no
"""
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
        | R / unit, u=s.0, size=of.size
"""


def at_target(axis: analysis.Axis) -> list[dict[str, Any]]:
    """What ISO 230-2 has of every target (mm, of a rotary axis deg); B = forward - reverse."""
    count, mean, s = axis.of_runs
    B, R_way, R = analysis.reversal_and_repeatability(mean, s)
    names = ("deg" if axis.rotary else "mm", "n", "means", "mean", "B", "s", "R_way", "R")
    columns = axis.targets, count.astype(int).T, mean.T, mean.mean(axis=0), B, s.T, R_way.T, R
    rows = zip(*columns, strict=True)
    return [{"of": axis} | dict(zip(names, values, strict=True)) for values in rows]


def _scale(figure: analysis.Figure) -> float:
    """The uncertainty that a figure is rounded to."""
    return figure.u if figure.u > 0 else figure.u_sampling


DEFINITIONS: dict[str, Any] = {"figure": FIGURE, "scale": _scale, "at_targets": AT_TARGET}
POSITIONING = declare(
    """
    axes{}.
        unit | | unit of all figures
        targets_mm | targets_mm() | target positions; null of a rotary axis
        targets_deg | targets_deg() | target positions of a rotary axis; null of others
        runs.forward | forward() | runs forward, at the target with most
        runs.reverse | reverse() | runs in reverse, at the target with most
        at_target[] | at_target() | *at_targets
        for NAME MEANING in iso
            NAME. | figures.NAME | *figure
        for NAME MEANING in vdi
            vdi3441.NAME | figures.NAME.value | MEANING (VDI/DGQ 3441) | -, size=size
    plan. | plan
        length_mm | length | travel
        pitch_mm | pitch | pitch that no target is a multiple of
        targets_mm | targets | proposed targets
    """,
    iso=analysis.ISO.items(),
    vdi=analysis.VDI.items(),
    targets_mm=lambda x: None if x.rotary else x.targets,
    targets_deg=lambda x: x.targets if x.rotary else None,
    forward=lambda x: int(x.of_runs[0][0].max()),
    reverse=lambda x: int(x.of_runs[0][1].max()),
    at_target=at_target,
    **DEFINITIONS,
)
FIGURE_ROW = declare(
    """
    component | 0.name | name of the component | axis, text, names
    figure | 1.name | symbol of the figure | figure, text
    -. | 1 | *figure
    meaning | meaning(1.name) | what it is | -
    """,
    MEANING="the figure, in the unit",
    meaning=analysis.MEANINGS.get,
    **DEFINITIONS,
)
TARGETS = declare("- | of.name | | axis, text, names\n*at_targets", **DEFINITIONS)


def positioning(result: analysis.Iso230Result, digits: int = 2) -> Document:
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
        Table(title, FIGURE_ROW, rows, footer, selection=selection),
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
    source, verdict = (POSITIONING, result), " ".join(texts)
    return Document("Positioning test", source, tables, positioning_figure, verdict, digits)


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
    fields = declare(
        """
        number | 0 | number of the target | target, count
        position_mm | 1 | proposed position | position, mm
        phase | phase(1) | share of a pitch beyond its last multiple | phase, fix4
        """,
        phase=lambda at: at / plan.pitch % 1.0,
    )
    rows = list(enumerate(plan.targets.tolist(), 1))
    footer = "five runs in each direction; phase: share of the pitch beyond its last multiple"
    table = Table("Target positions", fields, rows, footer)
    verdict = (
        f"{len(rows)} targets over {plan.length:g} mm; none is a multiple of the pitch of "
        f"{plan.pitch:g} mm."
    )
    return Document("Target positions", (POSITIONING, result), [table], None, verdict, digits)


def positioning_figure(result: analysis.Iso230Result) -> figures.Figure:
    """The diagram of ISO 230-2: means of each direction with 2 s, mean of both, and readings."""
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
        title = f"{axis.name}: {_figure_text(axis, 2)} {axis.unit}"
        xlabel = f"target, {'deg' if axis.rotary else 'mm'}"
        panel.set(title=title, xlabel=xlabel, ylabel=f"deviation, {axis.unit}")
    figures.legend(page)
    return page


CAUSE = declare(
    """
    name | | cause | cause, text
    value | | its size in the unit; null where the traces do not separate it | value, u=u, size=size
    u | | its standard uncertainty | u, size=size
    unit | | um, um/m or ms | unit, text
    share_percent | share() | range of the term over the sum of all terms' ranges; null of the \
        set-up | share / %, whole
    meaning | meaning(name) | what it is | meaning, text
    """,
    meaning=MEANING.get,
    share=lambda item: None if math.isnan(item.share) else 100 * item.share,
)
TRACE = declare(
    """
    file | trace.file | file of the trace | file, text
    pass | trace.number | number of its pass; null: none is stated | pass, count
    direction | trace.direction | cw or ccw | direction, text
    feed | trace.feed | path speed, mm/min; null: not stated | feed / mm/min, plain
    samples | samples() | samples | samples, count
    G_lsc | | um: circular deviation about the trace's least-squares circle | G (LSC), sig3, unit=um
    F_max | | um: largest radial deviation from the nominal radius about the given centre \
        | F max, sig3, unit=um
    F_min | | um: smallest radial deviation | F min, sig3, unit=um
    """,
    samples=lambda item: len(item.trace.angle),
)
STATED = declare(
    """
    file | | file of the instrument | file, text
    feature | | its feature | feature, text
    value | | as the instrument states it, with its sign | stated, sig4
    unit | | its unit | unit, text
    """
)
CIRCULAR = declare(
    """
    plane | traces.plane | XY, YZ or ZX, first axis to second counter-clockwise; null: not stated
    radius_mm | traces.radius | nominal radius
    traces[] | figures | *trace
    G_bidirectional | | um: circular deviation of both directions, about one least-squares circle; \
        null of one direction | -, unit=um
    D | | um: mean bidirectional radial deviation; null of one direction | -, unit=um
    diagnosis[] | causes | *cause
    remainder.rms_um | remainder_rms | of what the fit leaves, without 5 degrees after each reversal
    remainder.range_um | remainder_range | its range
    """,
    trace=TRACE,
    cause=CAUSE,
)


def stated_document(contents: Mapping[str, Mapping[str, Any]], digits: int = 2) -> Document:
    """The features that ballbars state, of the `contents` by file."""
    rows = [
        {"file": file, "feature": name, **each}
        for file, content in contents.items()
        for name, each in content["features"].items()
    ]
    planes = [*dict.fromkeys(content.get("test_plane") for content in contents.values())]
    plane = planes[0] if len(planes) == 1 else None
    fields = declare(
        """
        plane | | plane that all files state, first axis to second; null: none, or several
        instrument[] | rows | *stated
        """,
        stated=STATED,
    )
    footer = "a, b: first and second axis of the plane; signs as the instrument has them"
    verdict = f"{len(rows)} features stated by the instrument ({plane or 'plane not stated'})."
    source = fields, {"rows": rows, "plane": plane}
    tables = [Table("Stated by the instrument", STATED, rows, footer)]
    return Document("Circular test", source, tables, None, verdict, digits)


def circular(result: CircularResult, digits: int = 2) -> Document:
    """One row a cause; the traces below."""
    rms = significant(result.remainder_rms / UM)
    footer = f"one joint fit of all traces, remainder {rms} um rms; u: of correlated samples"
    causes = sorted(result.causes, key=lambda x: -x.share if x.share == x.share else 1.0)
    tables = [
        Table(f"Causes, {_setup(result)}", CAUSE, result.causes, footer, selection=causes),
        Table("Traces", TRACE, result.figures, "about the least-squares circle (LSC)"),
    ]
    worst = max(result.figures, key=lambda x: x.G_lsc)
    verdict = f"G {significant(worst.G_lsc / UM, 3)} um ({worst.trace.direction})"
    if not math.isnan(result.G_bidirectional):
        verdict += f", of both directions {significant(result.G_bidirectional / UM, 3)} um"
    largest = ", ".join(
        f"{x.name} {_value(x, digits)}({100 * x.share:.0f} %)"
        for x in [x for x in causes if x.share == x.share and x.exceeds][:3]
    )
    verdict += f". Largest significant causes: {largest}." if largest else ". No cause exceeds 2 u."
    return Document("Circular test", (CIRCULAR, result), tables, circular_figure, verdict, digits)


def _value(cause: Cause, digits: int) -> str:
    """Value and u in the unit; nothing where the unit takes what is not stated (the feed)."""
    if math.isnan(cause.value):
        return ""
    return f"{plus_minus(cause.value / cause.size, cause.u / cause.size, digits)} {cause.unit} "


def _setup(result: CircularResult) -> str:
    plane = f"{result.traces.plane}, " if result.traces.plane else ""
    return f"{plane}radius {result.traces.radius:g} mm"


def components(result: CircularResult) -> dict[str, Any]:
    """`results` of a components report: squareness as the angle component of the plane, positive
    above 90 degrees, and lost motion as reversal = forward - reverse.
    """
    first, second = [*(result.traces.plane or "XY").lower()]
    lean = result.cause("squareness")
    entries: dict[str, Any] = {}
    if not math.isnan(lean.value):
        zero = [[0.0]]
        entries[f"a{''.join(sorted((first, second)))}"] = {
            "of": None, "unit": "arcsec", "degree": 0, "n_passes": len(result.figures),
            "coefficients": [-lean.value / ARCSEC], "covariance": [[(lean.u / ARCSEC) ** 2]],
            "covariance_independent": None, "s": None, "s_repeat": 0.0, "pass_covariance": zero,
            "pass_covariance_moment": zero, "pass_center_mm": 0.0, "pass_dof": None,
            "repeat_dof": None, "position_range_mm": None,
        }  # fmt: skip
    backlash = {first: result.cause("backlash-a"), second: result.cause("backlash-b")}
    return {
        "machine": "circular test",
        "components": entries,
        "joint_pass_covariance": [],
        "reversal": {
            axis: {"mean": -x.value / x.size, "u": x.u / x.size, "unit": x.unit}
            for axis, x in backlash.items()
            if not math.isnan(x.value)
        },
    }


def circular_figure(result: CircularResult) -> figures.Figure:
    """Deviations about each trace's circle over the angle, and the joint fit."""
    from matplotlib.ticker import MaxNLocator

    page = figures.blank(6.5, 6.5)
    figures.title(page, f"Circular test, {_setup(result)}")
    panel: Any = page.add_subplot(projection="polar")
    colours, reach = {"ccw": BLUE, "cw": ORANGE}, 0.0
    for trace, fit in zip(result.traces.traces, result.fitted, strict=True):
        order = np.argsort(np.mod(trace.angle, 2 * math.pi), kind="stable")
        rest, model = (
            about_circle(trace.angle, values)[order] / UM for values in (trace.deviation, fit)
        )
        angle = trace.angle[order]
        panel.plot(angle, rest, color=colours[trace.direction], lw=1.0, label=trace.direction)
        panel.plot(angle, model, color=INK, lw=0.6, ls="--", label="joint fit")
        reach = max(reach, float(np.abs(rest).max()))
    reach = reach or 1.0
    panel.set_rlim(-1.1 * reach, 1.1 * reach)
    panel.set_rorigin(-3.5 * reach)
    panel.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    panel.set_title("deviation from the least-squares circle, um", pad=16, fontweight="normal")
    figures.legend(page)
    return page
