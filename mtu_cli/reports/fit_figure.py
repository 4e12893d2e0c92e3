"""All components on one sheet (Gilsinn & Ling 2004, Fig. 3): readings, line, band."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.model.estimates import ComponentEstimate, Estimates
from mtu_cli.model.estimation import ComponentFit, InstrumentFit
from mtu_cli.model.fit import MachineFit
from mtu_cli.reports import figures
from mtu_cli.reports.labels import cut
from mtu_cli.stats.least_squares import FloatArray, polynomial

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 3
NARROW = 4
"""Columns of the legend below fewer panels."""
TITLE = 36
"""Characters of a line above a panel."""
LINE = 0.16
"""Height of a second line of it, inches."""
MARKERS = ({1: ">", -1: "<", 0: "o"}, {1: "^", -1: "v", 0: "s"})
"""By instrument (the machine's first, others) and direction."""
WORDS = {1: "forward", -1: "reverse", 0: "reading"}


@figures.styled
def figure(
    fit: MachineFit,
    estimates: Estimates,
    coverage_factor: float,
    *,
    says: Mapping[str, str] | None = None,
) -> Figure:
    """Readings by pass and direction, the fitted line, and the band of a future part.

    The band is k times the root of x'(C + D)x + s_repeat^2 about the line.
    """
    components = estimates.components
    columns = min(COLUMNS, max(1, len(components)))
    rows = max(1, math.ceil(len(components) / columns))
    titles = [
        _title(name, (says or {}).get(name), stated=name not in fit.components)
        for name in components
    ]
    tall = any("\n" in title for title in titles)
    page = figures.blank(3.4 * max(columns, 2), (2.15 + LINE * tall) * rows + 0.6)
    panels = page.subplots(rows, columns, squeeze=False).ravel()
    ranges = _ranges(components)
    colours, markers = _colours(fit), _markers(fit)
    for panel, title, name in zip(panels, titles, components, strict=False):
        estimate = components[name]
        found = fit.components.get(name)
        for item in () if found is None else found.instruments:
            _readings(panel, item, estimate, markers[item.role], colours)
        _band(panel, estimate, found, ranges, coverage_factor)
        panel.set_title(title)
        _label(panel, estimate, stated=found is None)
    for panel in panels[len(components) :]:
        panel.set_axis_off()
    handles = _legend(fit, coverage_factor)
    page.legend(
        handles=handles, loc="outside lower center", ncols=8 if columns == COLUMNS else NARROW
    )
    return page


def _ranges(components: dict[str, ComponentEstimate]) -> dict[str, tuple[float, float]]:
    """Positions read along each axis, which stand in where a component states none."""
    found: dict[str, tuple[float, float]] = {}
    for item in components.values():
        if item.of is not None and item.position_range is not None:
            low, high = found.get(item.of, item.position_range)
            found[item.of] = (min(low, item.position_range[0]), max(high, item.position_range[1]))
    return found


def _colours(fit: MachineFit) -> dict[int, Any]:
    """A colour a pass number, early ones dark, late ones light: a drift shows as a gradient."""
    from matplotlib import colormaps

    numbers = sorted({1, *(number for item in _instruments(fit) for number in _pass_numbers(item))})
    last = max(len(numbers) - 1, 1)
    return {n: colormaps["viridis"](0.05 + 0.8 * i / last) for i, n in enumerate(numbers)}


def _instruments(fit: MachineFit) -> list[InstrumentFit]:
    return [item for found in fit.components.values() for item in found.instruments]


def _markers(fit: MachineFit) -> dict[str, dict[int, str]]:
    """By role, whatever components it read: one instrument has the same marks in every panel."""
    roles = dict.fromkeys(item.role for item in _instruments(fit))
    return {role: MARKERS[min(i, 1)] for i, role in enumerate(roles)}


def _pass_numbers(item: InstrumentFit) -> list[int]:
    return sorted({key[1] for key in item.keys_read})


def _readings(
    panel: Axes,
    item: InstrumentFit,
    estimate: ComponentEstimate,
    markers: dict[int, str],
    colours: dict[int, Any],
) -> None:
    group = np.zeros(len(item.error), np.int64) if item.group is None else item.group
    keys = [key[1:] for key in item.keys_read] or [(1, 0)]
    numbers = sorted({number for number, _ in keys})
    for g, (number, sign) in enumerate(keys):
        inside = group == g
        order = np.argsort(item.position[inside], kind="stable")
        place = item.position[inside][order]
        if estimate.of is None:
            place = np.full(len(order), float(numbers.index(number) + 1))
        panel.plot(
            place,
            item.error[inside][order] / estimate.unit.to_internal,
            marker=markers[sign],
            linestyle="-" if estimate.of else "none",
            linewidth=0.5,
            color=colours[number],
            markersize=4.2,
            markeredgewidth=0.0,
            alpha=0.8,
            zorder=3,
        )


def _band(
    panel: Axes,
    estimate: ComponentEstimate,
    found: ComponentFit | None,
    ranges: dict[str, tuple[float, float]],
    k: float,
) -> None:
    f = estimate.unit.to_internal
    if estimate.of is None:
        counts = [len(_pass_numbers(item)) for item in found.instruments] if found else []
        place, X = np.array([0.5, max([1, *counts]) + 0.5]), np.ones((2, 1))
    else:
        low, high = estimate.position_range or ranges.get(estimate.of, (0.0, 100.0))
        place = np.linspace(low, high, 101) if high > low else np.array([low - 1.0, high + 1.0])
        X = polynomial(place, estimate.degree)
    line = X @ estimate.coefficients / f
    half = k * np.sqrt(_future(estimate, X)) / f
    panel.fill_between(
        place, line - half, line + half, color=figures.PALE, alpha=0.6, linewidth=0, zorder=1
    )
    panel.plot(place, line, color=figures.INK, zorder=2)


def _future(estimate: ComponentEstimate, X: FloatArray) -> FloatArray:
    """x'(C + D)x + s_repeat^2 of every row of X."""
    S = estimate.covariance + estimate.pass_covariance
    variance: FloatArray = np.einsum("ni,ij,nj->n", X, S, X) + estimate.s_repeat**2
    return np.clip(variance, 0.0, None)


def _title(name: str, says: str | None, *, stated: bool) -> str:
    """A component with its meaning, on a line of its own where one line is too short for both."""
    words = "  ".join([*([says] if says else []), *(["(machine file)"] if stated else [])])
    title = f"{name}  {words}".rstrip()
    if len(title) <= TITLE or not words:
        return cut(title, TITLE)
    return f"{cut(name, TITLE)}\n{cut(words, TITLE)}"


def _label(panel: Axes, estimate: ComponentEstimate, *, stated: bool) -> None:
    from matplotlib.ticker import MaxNLocator

    panel.set_ylabel(estimate.unit.name)
    if estimate.of is None:
        panel.set_xlabel("" if stated else "pass")
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
        if stated:
            panel.set_xticks([])
    else:
        panel.set_xlabel(f"{estimate.of}, mm")


def _legend(fit: MachineFit, k: float) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    markers = _markers(fit)
    drawn = {
        (item.role, key[-1]) for item in _instruments(fit) for key in item.keys_read or ((0, 1, 0),)
    }
    handles: list[Any] = [
        Line2D(
            [], [], marker=marker, linestyle="", color=figures.GREY,
            label=WORDS[sign] if len(markers) == 1 else f"{role}, {WORDS[sign]}",
        )
        for role, own in markers.items()
        for sign, marker in own.items()
        if (role, sign) in drawn
    ]  # fmt: skip
    colours = _colours(fit)
    if len(colours) > 1:
        handles += [
            Line2D([], [], marker="o", linestyle="", color=colours[n], label=f"pass {n}")
            for n in (min(colours), max(colours))
        ]
    handles += [
        Line2D([], [], color=figures.INK, label="fit"),
        Patch(color=figures.PALE, label=f"one future reading, ± {k:g} u"),
    ]
    return handles
