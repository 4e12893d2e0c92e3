"""Pictures of thermal-fit: drift over time, what each sensor does, drift along the axis."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.analyses.thermal_fit.result import ComponentDrift, ThermalFit
from mtu_cli.findings import listed
from mtu_cli.model.simulate_drift import STEPS, DriftProfile, drift_profile
from mtu_cli.reports import figures
from mtu_cli.reports.labels import cut, spread
from mtu_cli.reports.numbers import significant, span

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DETAILED, SENSORS, POSITIONS, CYCLES = 6, 8, 6, 12
"""Components, sensors and positions drawn, and cycles named, each in its own panel."""
NAME = 26
"""Characters of a sensor's name beside its bar."""
DOTS = (5.0, 2.5)
"""Sizes of the dots of the first position and the last, which are seen upon those."""
STATES = (figures.BLUE, figures.GREY, figures.RED)


@figures.styled
def figure(fit: ThermalFit) -> Figure:
    """A row a component: measured and modelled drift, the sensors' parts, drift by position."""
    shown = list(fit.components.values())[:DETAILED]
    page = figures.blank(13.0, 1.1 + 2.75 * max(1, len(shown)))
    panels = page.subplots(max(1, len(shown)), 3, squeeze=False, width_ratios=[2.3, 1.0, 1.15])
    for row, item in zip(panels, shown, strict=False):
        _curves(row[0], item)
        _shares(row[1], item)
        _along(row[2], item)
    rest = list(fit.components)[DETAILED:]
    some = f" of {len(shown)} of {len(fit.components)} components" if rest else ""
    without = f" (not drawn: {listed(rest, 12)})" if rest else ""
    figures.title(page, f"Drift with temperature{some}: measured (dots), modelled (lines){without}")
    return page


def _curves(panel: Axes, item: ComponentDrift) -> None:
    """Cycles one after the other, whatever lies between them, a colour a position."""
    unit, size = item.rms_unit, item.rms_size
    cycles = _cycles(item)
    colours = _colours(item)
    sizes = dict(zip(colours, np.linspace(*DOTS, max(len(colours) - 1, 2)), strict=False))
    sizes[None] = DOTS[0]
    for curve in item.curves:
        if curve.position not in colours or not len(curve.time):
            continue
        time = curve.time - curve.time.min() + cycles[curve.cycle][0]
        colour, ms = colours[curve.position], sizes[curve.position]
        panel.plot(time, curve.measured / size, "o", ms=ms, color=colour, alpha=0.4, mew=0)
        panel.plot(time, curve.modelled / size, color=colour, linewidth=1.0)
    panel.set_ylabel(f"drift, {unit}")
    _time_axis(panel, cycles)
    found = item.held_out
    before, after = (
        (item.rms_before, item.rms_after) if found is None else (found.before, found.after)
    )
    kind = "rms of the fit (nothing held out)" if found is None else "rms of held-out cycles"
    change = f"{significant(before / size, 3)} → {significant(after / size, 3)} {unit}"
    panel.set_title(f"{cut(item.name, NAME)}: {kind} {change}")
    named = [position for position in colours if position is not None]
    total = len({x.position for x in item.curves} - {None})
    if named:
        some = f"{len(named)} of {total}\npositions" if len(named) < total else ""
        _beside(panel, [(colours[x], f"{x:g} mm") for x in reversed(named)], some)


def _cycles(item: ComponentDrift) -> dict[str, tuple[float, float]]:
    """Where each cycle starts and ends on the panel, one after the other, min."""
    lengths: dict[str, float] = {}
    for curve in item.curves:
        length = float(np.ptp(curve.time)) if len(curve.time) else 0.0
        lengths[curve.cycle] = max(lengths.get(curve.cycle, 0.0), length)
    ends = np.cumsum(list(lengths.values())).tolist()
    return dict(zip(lengths, pairwise([0.0, *ends]), strict=True))


def _time_axis(panel: Axes, cycles: dict[str, tuple[float, float]]) -> None:
    """Lines between cycles and their names, numbers of many."""
    for start, _ in list(cycles.values())[1:]:
        panel.axvline(start, color=figures.GREY, linewidth=0.7, linestyle="--")
    names = list(cycles)
    kept = spread(len(names), CYCLES)
    fits = sum(len(name) + 2 for name in names) <= 62
    panel.set_xticks(
        [sum(cycles[names[i]]) / 2 for i in kept],
        [names[i] if fits else str(i + 1) for i in kept], minor=True,
    )  # fmt: skip
    panel.tick_params(axis="x", which="minor", length=0, pad=17, labelsize=8.0)
    panel.set_xlabel("min, and the cycles one after the other")
    panel.grid(axis="x", visible=False)
    panel.margins(x=0.01)


def _colours(item: ComponentDrift) -> dict[float | None, Any]:
    """A colour a position that is drawn, from one end of the axis to the other."""
    from matplotlib import colormaps

    positions = sorted({x.position for x in item.curves if x.position is not None})
    drawn = [positions[i] for i in spread(len(positions), POSITIONS)]
    last = max(len(drawn) - 1, 1)
    colours: dict[float | None, Any] = {
        position: colormaps["viridis"](0.02 + 0.8 * i / last) for i, position in enumerate(drawn)
    }
    return colours | {None: figures.BLUE}


def _beside(panel: Axes, entries: list[tuple[Any, str]], title: str = "") -> None:
    """A legend to the right of the panel, where it hides nothing."""
    from matplotlib.lines import Line2D

    panel.legend(
        handles=[Line2D([], [], color=c, linewidth=2.2, label=label) for c, label in entries],
        loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7.5, handlelength=1.0,
        borderaxespad=0.4, labelspacing=0.8, title=title, title_fontsize=7.5, alignment="left",
    )  # fmt: skip


def _shares(panel: Axes, item: ComponentDrift) -> None:
    unit, size = item.rms_unit, item.rms_size
    names = [share.sensor for share in item.by_share]
    drawn = names[:SENSORS]
    parts = [item.shares.get(name, 0.0) / size for name in drawn]
    alike = [f"\nand {len(item.twins(name))} alike" * bool(item.twins(name)) for name in drawn]
    labels = [cut(name, NAME) + more for name, more in zip(drawn, alike, strict=True)]
    figures.bars(panel, labels, parts, [significant(part, 3) for part in parts])
    if not drawn:
        panel.text(0.5, 0.5, "no sensor", transform=panel.transAxes, ha="center")
    panel.set_xlim(left=0.0)
    panel.set_xlabel(f"rms contribution, {unit}")
    panel.set_title("sensors" + (f" ({SENSORS} of {len(names)})" if len(names) > SENSORS else ""))


def _along(panel: Axes, item: ComponentDrift) -> None:
    """The modelled drift with all sensors cold, half-way and warm, where it was observed."""
    unit, size = item.rms_unit, item.rms_size
    profile = drift_profile(item.estimate, item.positions)
    words = _words(profile, item.estimate.reference)
    panel.set_ylabel(f"modelled drift, {unit}")
    if len(profile.places) == 1:
        values = profile.drift[:, 0] / size
        bars = panel.bar(range(3), values, color=STATES, width=0.5)
        panel.bar_label(bars, [significant(value, 3) for value in values], padding=2, fontsize=7.5)
        panel.axhline(0.0, color=figures.GREY, linewidth=0.9)
        panel.set_xticks(range(3), [word.replace(" to ", " to\n") for word in words])
        panel.set_xlim(-0.6, 2.6)
        panel.use_sticky_edges = False
        panel.margins(y=0.18)
        panel.grid(axis="x", visible=False)
        panel.set_title("the same at all positions")
        return
    states = zip(profile.drift / size, profile.at_observed / size, STATES, strict=True)
    for drift, at_observed, colour in states:
        panel.plot(profile.places, drift, color=colour)
        panel.plot(item.positions, at_observed, "o", color=colour, markersize=3.5)
    panel.set_xlabel(f"{item.estimate.of}, mm (dots: observed positions)")
    panel.set_title(f"along {item.estimate.of}")
    _beside(panel, list(zip(STATES, words, strict=True))[::-1])


def _words(profile: DriftProfile, reference: float) -> list[str]:
    """What to call the three states."""
    if not profile.ranged:
        return [f"all sensors\nat {reference + step:g} °C" for step in STEPS]
    names = ("coldest", "half-way", "warmest")
    return [
        f"{name}\n{span(f'{T.min():.1f}', f'{T.max():.1f}')} °C"
        for name, T in zip(names, profile.temperatures, strict=True)
    ]
