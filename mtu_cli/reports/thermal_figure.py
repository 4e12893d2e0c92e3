"""Pictures of thermal-fit: drift over time, what each sensor does, drift along the axis."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.analyses.thermal_fit.result import ComponentDrift, Curve, ThermalFit
from mtu_cli.findings import listed
from mtu_cli.model.simulate_drift import STEPS, DriftProfile, drift_profile
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import nice
from mtu_cli.reports.labels import cut, spread
from mtu_cli.reports.numbers import significant, span
from mtu_cli.reports.thermal_shown import DETAILED, by_share, change, shown_in, twins
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SENSORS = 8
POSITIONS = 6
NAME_LENGTH = 26
"""Characters of a sensor's name beside its bar."""
CYCLE_NAMES = 62
"""Characters of cycles' names that fit below one panel."""
TICKS = 5
"""Steps that all minutes make, at least."""
CHARACTERS = 75
"""Of labels of minutes that fit below one panel, side by side."""
CYCLES_WITH_MINUTES = 8
STATES = (figures.BLUE, figures.GREY, figures.RED)


@figures.styled
def figure(fit: ThermalFit) -> Figure:
    """A row a component: measured and modelled drift, the sensors' parts, drift by position."""
    shown = list(fit.components.values())[:DETAILED]
    page = figures.blank(13.0, 0.9 + 2.75 * max(1, len(shown)))
    panels = page.subplots(
        max(1, len(shown)), 3, squeeze=False, gridspec_kw={"width_ratios": [2.3, 1.0, 1.15]}
    )
    for row, item in zip(panels, shown, strict=False):
        _curves(row[0], item)
        _shares(row[1], item)
        _along(row[2], item)
    left_out = [item.name for item in fit.components.values()][DETAILED:]
    if left_out:
        page.suptitle(
            f"{len(shown)} of {len(fit.components)} components; not drawn: {listed(left_out, 12)}",
            x=0.01, ha="left", fontsize=9.0,
        )  # fmt: skip
    page.legend(handles=_legend(), loc="outside lower center", ncols=2)
    return page


def _legend() -> list[Any]:
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], marker="o", linestyle="", color=figures.INK, alpha=0.45, label="measured"),
        Line2D([], [], color=figures.INK, label="modelled"),
    ]


def _curves(panel: Axes, item: ComponentDrift) -> None:
    """Cycles side by side, whatever lies between them, a colour a position."""
    unit, size = shown_in(item.unit)
    starts, ends = _cycle_places(item.curves)
    colours = _colours(item)
    for curve in item.curves:
        if curve.position not in colours:
            continue
        time = curve.time - curve.time.min() + starts[curve.cycle] if len(curve.time) else []
        colour = colours[curve.position]
        panel.plot(
            time, curve.measured / size, marker="o", markersize=3.6, linestyle="", color=colour,
            alpha=0.4, markeredgewidth=0,
        )  # fmt: skip
        panel.plot(time, curve.modelled / size, color=colour, linewidth=1.0)
    _mark_cycles(panel, starts, ends)
    panel.set_ylabel(f"drift, {unit}")
    panel.set_title(_gain(item, size, unit))
    _position_legend(panel, item, colours)


def _gain(item: ComponentDrift, size: float, unit: str) -> str:
    found = item.held_out
    if found is None:
        rms = change(item.rms_before, item.rms_after, size)
        return f"{item.name}: fitted rms {rms} {unit}, nothing held out"
    return f"{item.name}, the fit; held-out rms {change(found.before, found.after, size)} {unit}"


def _cycle_places(curves: Sequence[Curve]) -> tuple[dict[str, float], dict[str, float]]:
    """Where each cycle starts and ends on the panel, in min, with a gap between."""
    lengths: dict[str, float] = {}
    for curve in curves:
        length = float(np.ptp(curve.time)) if len(curve.time) else 0.0
        lengths[curve.cycle] = max(lengths.get(curve.cycle, 0.0), length)
    gap = 0.03 * sum(lengths.values()) / max(len(lengths), 1) or 1.0
    starts, ends, at = {}, {}, 0.0
    for cycle, length in lengths.items():
        starts[cycle], ends[cycle] = at, at + length
        at += length + 2 * gap
    return starts, ends


def _mark_cycles(panel: Axes, starts: dict[str, float], ends: dict[str, float]) -> None:
    """Lines between cycles, minutes counted from each start, names below."""
    if not starts:
        panel.text(0.5, 0.5, "no curves", transform=panel.transAxes, ha="center")
        return
    names = list(starts)
    width = 0.9 if len(names) <= CYCLES_WITH_MINUTES else 0.5
    for before, after in pairwise(names):
        middle = (ends[before] + starts[after]) / 2
        panel.axvline(middle, color=figures.GREY, linewidth=width, linestyle="--")
    ticks = _minutes(starts, ends)
    panel.set_xticks([at for at, _ in ticks], [f"{minute:g}" for _, minute in ticks])
    longest = max(ends[name] - starts[name] for name in names)
    panel.set_xlabel(
        "min from the start of the cycle (readings where no time is given)"
        if ticks
        else f"cycles one after the other, the longest of {longest:.4g} min (or readings)"
    )
    panel.set_xticks(
        [(starts[name] + ends[name]) / 2 for name in names], _fitting(names), minor=True
    )
    panel.tick_params(axis="x", which="minor", length=0, pad=17, labelsize=8.0)
    panel.grid(axis="x", visible=False)
    panel.margins(x=0.01)


def _minutes(starts: dict[str, float], ends: dict[str, float]) -> list[tuple[float, float]]:
    """Ticks: place on the panel, min from the cycle's start, as far from each other as their
    labels need. None where cycles are many.
    """
    lengths = {name: ends[name] - starts[name] for name in starts}
    longest, total = max(lengths.values()), sum(lengths.values())
    if len(lengths) > CYCLES_WITH_MINUTES or longest == 0:
        return []
    step = min(nice(longest), nice(total / TICKS))
    every = _apart(starts, lengths, step)
    # Where the step leaves a long cycle no tick but the start, half of it tells how long it is.
    long = [name for name, length in lengths.items() if 2 * length > longest]
    told = all(any(starts[n] < at <= ends[n] for at, _ in every) for n in long)
    return every if told else _apart(starts, lengths, step / 2)


def _apart(
    starts: dict[str, float], lengths: dict[str, float], step: float
) -> list[tuple[float, float]]:
    """Those of a step that do not run into the next cycle's zero."""
    names, digit = list(starts), max(starts[n] + lengths[n] for n in starts) / CHARACTERS
    found = []
    for name, after in zip(names, [*names[1:], None], strict=True):
        end = np.inf if after is None else starts[after]
        for minute in np.arange(0.0, lengths[name] * (1 + 1e-9), step).tolist():
            # Half of its own label, half of a zero and a space.
            room = (len(f"{minute:g}") / 2 + 1.5) * digit
            if starts[name] + minute + room <= end or minute == 0:
                found.append((starts[name] + minute, minute))
    return found


def _fitting(names: Sequence[str]) -> list[str]:
    """The cycles' names, their numbers where these do not fit, a few numbers of very many."""
    if len(names) * (max(map(len, names)) + 2) <= CYCLE_NAMES:
        return list(names)
    kept = set(spread(len(names), CYCLE_NAMES // 5))
    return [str(i + 1) if i in kept else "" for i in range(len(names))]


def _colours(item: ComponentDrift) -> dict[float | None, Any]:
    """A colour a position that is drawn, from one end of the axis to the other."""
    from matplotlib import colormaps

    positions = _positions(item)
    drawn = [positions[i] for i in spread(len(positions), POSITIONS)]
    last = max(len(drawn) - 1, 1)
    colours: dict[float | None, Any] = {
        position: colormaps["viridis"](0.02 + 0.8 * i / last) for i, position in enumerate(drawn)
    }
    return colours | {None: figures.BLUE}


def _positions(item: ComponentDrift) -> list[float]:
    return sorted({x.position for x in item.curves if x.position is not None})


def _position_legend(panel: Axes, item: ComponentDrift, colours: dict[float | None, Any]) -> None:
    from matplotlib.lines import Line2D

    named = [position for position in colours if position is not None]
    total = len(_positions(item))
    handles = [
        Line2D([], [], color=colours[place], linewidth=2.2, label=f"{place:g} mm")
        for place in reversed(named)
    ]
    if named:
        _beside(panel, handles, f"{len(named)} of {total}\npositions" if len(named) < total else "")


def _beside(panel: Axes, handles: list[Any], title: str = "") -> None:
    """A legend to the right of the panel, where it hides nothing."""
    panel.legend(
        handles=handles, loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7.5,
        handlelength=1.0, borderaxespad=0.4, labelspacing=0.8,
        title=title, title_fontsize=7.5, alignment="left",
    )  # fmt: skip


def _shares(panel: Axes, item: ComponentDrift) -> None:
    unit, size = shown_in(item.unit)
    names = by_share(item)
    drawn = names[:SENSORS]
    parts = [item.shares.get(name, 0.0) / size for name in drawn]
    panel.barh(range(len(drawn)), parts, color=figures.BLUE, height=0.62)
    for row, part in enumerate(parts):
        panel.annotate(
            significant(part, 3), (part, row), xytext=(3, 0), textcoords="offset points",
            va="center", fontsize=7.5,
        )  # fmt: skip
    if not drawn:
        panel.text(0.5, 0.5, "no sensor", transform=panel.transAxes, ha="center")
    panel.set_yticks(range(len(drawn)), [_sensor_name(item, name) for name in drawn])
    panel.set_ylim(max(len(drawn), 4) - 0.4, -0.6)
    panel.set_xlim(0.0, 1.2 * max([*parts, 0.0]) or 1.0)
    panel.grid(axis="y", visible=False)
    panel.set_xlabel(f"rms of its part of the drift, {unit}")
    more = f" ({SENSORS} of {len(names)})" if len(names) > SENSORS else ""
    panel.set_title(f"sensors{more}")


def _sensor_name(item: ComponentDrift, sensor: str) -> str:
    """With the number of those it stands for."""
    others = twins(item, sensor)
    name = cut(sensor, NAME_LENGTH)
    return f"{name}\nand {len(others)} alike" if others else name


def _along(panel: Axes, item: ComponentDrift) -> None:
    """The modelled drift with all sensors cold, half-way and warm, where it was observed."""
    unit, size = shown_in(item.unit)
    profile = drift_profile(item.estimate, item.positions)
    words = _words(profile, item.estimate.reference)
    panel.set_ylabel(f"drift, {unit}")
    if len(profile.places) == 1:
        _bars(panel, (profile.drift[:, 0] / size).tolist(), words)
        return
    lines: list[Any] = []
    states = zip(profile.drift / size, profile.at_observed / size, STATES, words, strict=True)
    for drift, at_observed, colour, name in states:
        lines += panel.plot(profile.places, drift, color=colour, label=name)
        panel.plot(item.positions, at_observed, "o", color=colour, markersize=3.5)
    panel.set_xlabel(f"{item.estimate.of}, mm (dots: observed positions)")
    panel.set_title(f"along {item.estimate.of}")
    _beside(panel, lines[::-1])


def _bars(panel: Axes, values: list[float], words: list[str]) -> None:
    """One bar a state of temperature, where the drift is the same at all positions."""
    panel.bar(range(3), values, color=STATES, width=0.5)
    for i, value in enumerate(values):
        panel.annotate(
            significant(value, 3), (i, value), xytext=(0, 3 if value >= 0 else -10),
            textcoords="offset points", ha="center", fontsize=7.5,
        )  # fmt: skip
    panel.axhline(0.0, color=figures.GREY, linewidth=0.9)
    panel.set_xticks(range(3), [word.replace(" to ", " to\n") for word in words])
    panel.set_xlim(-0.6, 2.6)
    panel.use_sticky_edges = False
    panel.margins(y=0.18)
    panel.grid(axis="x", visible=False)
    panel.set_title("taken as the same everywhere")


def _words(profile: DriftProfile, reference: float) -> list[str]:
    """What to call the three states."""
    if not profile.ranged:
        return [f"all sensors\nat {reference + step:g} °C" for step in STEPS]
    names = ("coldest", "half-way", "warmest")
    return [f"{n}\n{_temperatures(T)}" for n, T in zip(names, profile.temperatures, strict=True)]


def _temperatures(state: FloatArray) -> str:
    return f"{span(f'{state.min():.1f}', f'{state.max():.1f}')} °C"
