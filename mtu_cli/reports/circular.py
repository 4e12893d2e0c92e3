"""The report of a circular test: traces, causes, and the polar diagram."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from mtu_cli.analyses.circular import MEANING, Cause, CircularResult, about_circle
from mtu_cli.reports import figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import declare
from mtu_cli.reports.numbers import plus_minus, significant
from mtu_cli.units import ARCSEC, UM

ROW = declare(
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
    G_lsc | | um: circular deviation, about the trace's least-squares circle \
        | G (LSC), sig3, unit=um
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
RESULTS = declare(
    """
    plane | traces.plane | XY, YZ or ZX, first axis to second counter-clockwise; null: not stated
    radius_mm | traces.radius | nominal radius
    traces[] | figures | *trace
    G_bidirectional | | um: circular deviation of both directions, about one least-squares circle; \
        null of one direction | -, unit=um
    D | | um: mean bidirectional radial deviation; null of one direction | -, unit=um
    diagnosis[] | causes | *row
    remainder.rms_um | remainder_rms | of what the joint fit leaves, without 5 degrees after each \
        reversal
    remainder.range_um | remainder_range | its range
    """,
    trace=TRACE,
    row=ROW,
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


def document(result: CircularResult, digits: int = 2) -> Document:
    """One row a cause; the traces below."""
    footer = (
        f"one joint fit of all traces; remainder {significant(result.remainder_rms / UM)} um rms; "
        "u allows for the correlation of neighbouring samples"
    )
    causes = sorted(result.causes, key=lambda x: -x.share if x.share == x.share else 1.0)
    tables = [
        Table(f"Causes, {_setup(result)}", ROW, result.causes, footer, selection=causes),
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
    figure_ = partial(figure, result)
    return Document("Circular test", (RESULTS, result), tables, figure_, verdict, digits)


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


def figure(result: CircularResult) -> figures.Figure:
    """Deviations about each trace's circle over the angle, and the joint fit."""
    from matplotlib.ticker import MaxNLocator

    page = figures.blank(6.5, 6.5)
    figures.title(page, f"Circular test, {_setup(result)}")
    panel: Any = page.add_subplot(projection="polar")
    colours, reach = {"ccw": figures.BLUE, "cw": figures.ORANGE}, 0.0
    for trace, fit in zip(result.traces.traces, result.fitted, strict=True):
        order = np.argsort(np.mod(trace.angle, 2 * math.pi), kind="stable")
        rest, model = (
            about_circle(trace.angle, values)[order] / UM for values in (trace.deviation, fit)
        )
        angle = trace.angle[order]
        panel.plot(angle, rest, color=colours[trace.direction], lw=1.0, label=trace.direction)
        panel.plot(angle, model, color=figures.INK, lw=0.6, ls="--", label="joint fit")
        reach = max(reach, float(np.abs(rest).max()))
    reach = reach or 1.0
    panel.set_rlim(-1.1 * reach, 1.1 * reach)
    panel.set_rorigin(-3.5 * reach)
    panel.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    panel.set_title("deviation from the least-squares circle, um", pad=16, fontweight="normal")
    figures.legend(page)
    return page
