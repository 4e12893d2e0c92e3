"""Pictures of a machine's components: readings with the fit, and their drift with temperature."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.reports import figures
from mtu_cli.reports.labels import cut, spread
from mtu_cli.reports.numbers import significant

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mtu_cli.analyses.thermal_fit.result import ComponentDrift, ThermalFit
    from mtu_cli.model.estimates import ComponentEstimate, Estimates
    from mtu_cli.model.estimation import InstrumentFit
    from mtu_cli.model.fit import MachineFit

TITLE, NAME = 36, 26
"""Characters of a line above a panel, and of a component's name in it."""
MARKS = {1: (">", "forward"), -1: ("<", "reverse"), 0: ("o", "reading")}
"""Markers and words by direction."""
COMPONENTS, POSITIONS = 6, 6
"""Drifting components drawn, and positions of each."""


@figures.styled
def components(
    fit: MachineFit,
    estimates: Estimates,
    coverage_factor: float,
    *,
    says: Mapping[str, str] | None = None,
) -> Figure:
    """All components on one sheet (Gilsinn & Ling 2004, Fig. 3): readings by pass and direction,
    the fitted line, and the band of a future part.

    The band is k times the root of x'(C + D)x + s_repeat^2 about the line.
    """
    shown, k = estimates.components, coverage_factor
    columns = max(1, min(len(shown), 3))
    page = figures.blank(3.4 * max(columns, 2), 2.15 * -(-len(shown) // columns) + 0.6)
    figures.title(page, f"Components: readings (first pass dark, last one light), fit, ± {k:g} u")
    instruments = [item for x in fit.components.values() for item in x.instruments]
    numbers = sorted({1, *(key[1] for item in instruments for key in item.keys_read)})
    colours = dict(zip(numbers, figures.shades(len(numbers)), strict=True))
    panels = figures.panels_of(page, len(shown), columns)
    for panel, (name, estimate) in zip(panels, shown.items(), strict=False):
        found = fit.components.get(name)
        for item in found.instruments if found else ():
            _readings(panel, item, estimate, colours)
        if estimate.of is None:
            ends = 0.5, numbers[-1] + 0.5
            panel.locator_params(axis="x", integer=True)
        else:
            # Where a component states no range, that of another along the axis stands in.
            alike = (x.position_range for x in (estimate, *shown.values()) if x.of == estimate.of)
            ends = next(filter(None, alike), (0.0, 100.0))
        _band(panel, estimate, ends, k)
        text = f"{name}  {(says or {}).get(name, '')}".rstrip() + " (machine file)" * (not found)
        panel.set_title(cut(text, TITLE))
        panel.set_xlabel("pass" if estimate.of is None else f"{estimate.of}, mm")
        panel.set_ylabel(estimate.unit.name)
    figures.legend(page)
    return page


def _readings(
    panel: Axes, item: InstrumentFit, estimate: ComponentEstimate, colours: dict[int, Any]
) -> None:
    """A line a pass and direction; of a constant the passes side by side."""
    group = np.zeros(len(item.error), np.int64) if item.group is None else item.group
    for g, (number, sign) in enumerate([key[1:] for key in item.keys_read] or [(1, 0)]):
        inside = np.flatnonzero(group == g)
        inside = inside[np.argsort(item.position[inside], kind="stable")]
        place = item.position[inside] if estimate.of else np.full(len(inside), float(number))
        marker, word = MARKS[sign]
        panel.plot(
            place, item.error[inside] / estimate.unit.to_internal, marker=marker,
            linestyle="-" if estimate.of else "none", linewidth=0.4, color=colours[number],
            markersize=4.2, markeredgewidth=0.0, alpha=0.8, zorder=3, label=word,
        )  # fmt: skip


def _band(panel: Axes, estimate: ComponentEstimate, ends: tuple[float, float], k: float) -> None:
    """The fitted line between the `ends` and what is to be expected about it."""
    f, (low, high) = estimate.unit.to_internal, ends
    place = np.linspace(low, high, 101) if high > low else np.array([low - 1.0, high + 1.0])
    X = estimate.shape.columns(place)
    line = X @ estimate.coefficients / f
    C = estimate.covariance + estimate.pass_covariance
    variance = np.einsum("ni,ij,nj->n", X, C, X) + estimate.s_repeat**2
    half = k * np.sqrt(np.clip(variance, 0.0, None)) / f
    panel.fill_between(
        place, line - half, line + half, color=figures.PALE, alpha=0.6, linewidth=0, zorder=1,
        label=f"one future reading, ± {k:g} u",
    )  # fmt: skip
    panel.plot(place, line, color=figures.INK, zorder=4, label="fit")


@figures.styled
def drift(fit: ThermalFit) -> Figure:
    """Measured and modelled drift, a panel a component, its cycles one after the other; where the
    drift differs along an axis a colour a position.
    """
    shown = list(fit.components.values())[:COMPONENTS]
    page = figures.blank(9.0, 0.9 + 2.75 * max(1, len(shown)))
    for panel, item in zip(figures.panels_of(page, len(shown), 1), shown, strict=True):
        _curves(panel, item)
    some = f" of {len(shown)} of {len(fit.components)} components"
    some = some if len(shown) < len(fit.components) else ""
    figures.title(page, f"Drift with temperature{some}: measured (dots), modelled (lines)")
    return page


def _curves(panel: Axes, item: ComponentDrift) -> None:
    every = list(dict.fromkeys(curve.position for curve in item.curves))
    drawn = [every[i] for i in spread(len(every), POSITIONS)]
    along, start = item.estimate.degree > 0 and len(drawn) > 1, 0.0
    shades = figures.shades(len(drawn)) if along else [figures.BLUE] * len(drawn)
    colours = dict(zip(drawn, shades, strict=True))
    for cycle in dict.fromkeys(curve.cycle for curve in item.curves):
        curves = [curve for curve in item.curves if curve.cycle == cycle and len(curve.time)]
        panel.axvline(start, color=figures.GREY, linewidth=0.7, linestyle="--")
        for curve in (curve for curve in curves if curve.position in colours):
            time, colour = curve.time - curve.time.min() + start, colours[curve.position]
            measured, modelled = curve.measured / item.rms_size, curve.modelled / item.rms_size
            panel.plot(time, measured, "o", ms=3.0, color=colour, alpha=0.35, mew=0)
            at = "" if curve.position is None else f"{curve.position:g} mm"
            panel.plot(time, modelled, color=colour, linewidth=1.0, label=at)
        start += max((float(np.ptp(curve.time)) for curve in curves), default=0.0)
    panel.set_xlabel("min, and the cycles one after the other")
    panel.set_ylabel(f"drift, {item.rms_unit}")
    held = item.held_out
    kind = "rms of held-out cycles" if held else "rms of the fit (nothing held out)"
    rms = (held.before, held.after) if held else (item.rms_before, item.rms_after)
    change = " → ".join(significant(x / item.rms_size, 3) for x in rms)
    panel.set_title(f"{cut(item.name, NAME)}: {kind} {change} {item.rms_unit}")
    if along:
        figures.key(panel, [panel], loc="center left", bbox_to_anchor=(1.0, 0.5))
