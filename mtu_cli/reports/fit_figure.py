"""All components on one sheet (Gilsinn & Ling 2004, Fig. 3): readings, line, band."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.model.estimates import ComponentEstimate, Estimates
from mtu_cli.model.estimation import ComponentFit, InstrumentFit
from mtu_cli.model.fit import MachineFit
from mtu_cli.reports import figures
from mtu_cli.reports.labels import cut
from mtu_cli.stats.least_squares import polynomial

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TITLE = 36
"""Characters of a line above a panel."""
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
    columns = figures.columns_of(len(components))
    rows = -(-len(components) // columns)
    titles = [_title(name, (says or {}).get(name, "")) for name in components]
    tall = 0.16 * any("\n" in title for title in titles)
    page = figures.blank(3.4 * max(columns, 2), (2.15 + tall) * rows + 0.6)
    panels = figures.panels_of(page, len(components), columns)
    figures.title(page, f"Components: readings, fit and one future reading ± {coverage_factor:g} u")
    ranges = _ranges(components)
    colours, markers = _colours(fit), _markers(fit)
    for panel, title, (name, estimate) in zip(panels, titles, components.items(), strict=False):
        found = fit.components.get(name)
        for item in () if found is None else found.instruments:
            _readings(panel, item, estimate, markers[item.role], colours)
        _band(panel, estimate, found, ranges, coverage_factor)
        panel.set_title(title if found else f"{title} (machine file)")
        panel.set_ylabel(estimate.unit.name)
        panel.set_xlabel(f"{estimate.of}, mm" if estimate.of else "pass" if found else "")
        if estimate.of is None:
            numbers = range(1, 1 + max(map(len, map(_passes, found.instruments))) if found else 1)
            panel.set_xticks(numbers[:: max(1, len(numbers) // 8)])
    page.legend(
        handles=_legend(fit, markers, colours, coverage_factor), loc="outside lower center",
        ncols=8 if columns == 3 else 4,
    )  # fmt: skip
    return page


def _ranges(components: dict[str, ComponentEstimate]) -> dict[str, tuple[float, float]]:
    """Positions read along each axis, which stand in where a component states none."""
    found: dict[str, tuple[float, float]] = {}
    for item in components.values():
        if item.of is not None and item.position_range is not None:
            low, high = found.get(item.of, item.position_range)
            found[item.of] = (min(low, item.position_range[0]), max(high, item.position_range[1]))
    return found


def _instruments(fit: MachineFit) -> list[InstrumentFit]:
    return [item for found in fit.components.values() for item in found.instruments]


def _passes(item: InstrumentFit) -> list[int]:
    return sorted({key[1] for key in item.keys_read}) or [1]


def _colours(fit: MachineFit) -> dict[int, Any]:
    """A colour a pass number, early ones dark, late ones light: a drift shows as a gradient."""
    from matplotlib import colormaps

    numbers = sorted({1, *(number for item in _instruments(fit) for number in _passes(item))})
    last = max(len(numbers) - 1, 1)
    return {n: colormaps["viridis"](0.05 + 0.8 * i / last) for i, n in enumerate(numbers)}


def _markers(fit: MachineFit) -> dict[str, dict[int, str]]:
    """By role, whatever components it read: one instrument has the same marks in every panel."""
    roles = dict.fromkeys(item.role for item in _instruments(fit))
    return {role: MARKERS[min(i, 1)] for i, role in enumerate(roles)}


def _readings(
    panel: Axes,
    item: InstrumentFit,
    estimate: ComponentEstimate,
    markers: dict[int, str],
    colours: dict[int, Any],
) -> None:
    group = np.zeros(len(item.error), np.int64) if item.group is None else item.group
    numbers = _passes(item)
    for g, (number, sign) in enumerate([key[1:] for key in item.keys_read] or [(1, 0)]):
        inside = np.flatnonzero(group == g)
        inside = inside[np.argsort(item.position[inside], kind="stable")]
        place = item.position[inside]
        if estimate.of is None:
            place = np.full(len(inside), float(numbers.index(number) + 1))
        panel.plot(
            place, item.error[inside] / estimate.unit.to_internal, marker=markers[sign],
            linestyle="-" if estimate.of else "none", linewidth=0.4, color=colours[number],
            markersize=4.2, markeredgewidth=0.0, alpha=0.8, zorder=3,
        )  # fmt: skip


def _band(
    panel: Axes,
    estimate: ComponentEstimate,
    found: ComponentFit | None,
    ranges: dict[str, tuple[float, float]],
    k: float,
) -> None:
    f = estimate.unit.to_internal
    if estimate.of is None:
        last = max(map(len, map(_passes, found.instruments))) if found else 1
        place, X = np.array([0.5, last + 0.5]), np.ones((2, 1))
    else:
        low, high = estimate.position_range or ranges.get(estimate.of, (0.0, 100.0))
        place = np.linspace(low, high, 101) if high > low else np.array([low - 1.0, high + 1.0])
        X = polynomial(place, estimate.degree)
    line = X @ estimate.coefficients / f
    C = estimate.covariance + estimate.pass_covariance
    variance = np.einsum("ni,ij,nj->n", X, C, X) + estimate.s_repeat**2
    half = k * np.sqrt(np.clip(variance, 0.0, None)) / f
    panel.fill_between(
        place, line - half, line + half, color=figures.PALE, alpha=0.6, linewidth=0, zorder=1
    )
    panel.plot(place, line, color=figures.INK, zorder=4)


def _title(name: str, says: str) -> str:
    """A component with its meaning, on a line of its own where one line is too short for both."""
    title = f"{name}  {says}".rstrip()
    if len(title) <= TITLE or not says:
        return cut(title, TITLE)
    return f"{cut(name, TITLE)}\n{cut(says, TITLE)}"


def _legend(
    fit: MachineFit, markers: dict[str, dict[int, str]], colours: dict[int, Any], k: float
) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    drawn = {(x.role, key[-1]) for x in _instruments(fit) for key in x.keys_read or ((0, 1, 0),)}
    marks = [
        (marker, WORDS[sign] if len(markers) == 1 else f"{role}, {WORDS[sign]}", figures.GREY)
        for role, own in markers.items()
        for sign, marker in own.items()
        if (role, sign) in drawn
    ]
    if len(colours) > 1:
        marks += [("o", f"pass {n}", colours[n]) for n in (min(colours), max(colours))]
    return [
        *(
            Line2D([], [], marker=marker, linestyle="", color=colour, label=label)
            for marker, label, colour in marks
        ),
        Line2D([], [], color=figures.INK, label="fit"),
        Patch(color=figures.PALE, label=f"one future reading, ± {k:g} u"),
    ]
