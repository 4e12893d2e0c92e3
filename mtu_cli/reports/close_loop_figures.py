"""The picture of close-loop: errors before and after, each effect over what it depends on, and
the evidence for the candidates.
"""

from __future__ import annotations

from collections.abc import Iterator
from textwrap import shorten
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.analyses.close_loop.estimate import SmoothEffect
from mtu_cli.analyses.close_loop.result import (
    CloseLoopResult,
    FoundEffect,
    TableResult,
)
from mtu_cli.language import names, parse
from mtu_cli.model.basis import TableShape
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Maps, Side, draw, sheet
from mtu_cli.reports.labels import cut
from mtu_cli.reports.numbers import p_value
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, ALONE, HIGH = 12.0, 5.4, 4.1
"""Inches of the page, of one map that is alone, and of the row of panels."""
CANDIDATES, EFFECTS, NAME, TITLE = 12, 2, 24, 110
"""Candidates and effects that are drawn; letters of a name and of the title."""
LEAST = -6.0
"""The bars of the evidence end here: what is less likely is all the same."""
CURVE = 200
"""Places at which the curve of a smooth effect is drawn."""
MM = ", mm"
SIDES = (("before", figures.ORANGE), ("after", figures.BLUE))


class Over(NamedTuple):
    """Errors of axis `a` over the values `x` (P, H) of a column, with the effect they show."""

    label: str
    x: FloatArray
    a: int
    effect: FoundEffect | None


@figures.styled
def figure(result: CloseLoopResult, item: TableResult) -> Figure:
    """Mean errors before and after as arrows where points lie in a plane; errors over what each
    effect depends on (of none: part by part), smooth effects with their band; and the ranking.
    """
    maps = _maps(item)
    drawn = None if maps is None else sheet(maps, WIDTH if len(maps.groups) > 1 else ALONE)
    above = 0.0 if drawn is None else drawn.height
    page = figures.blank(WIDTH, above + HIGH + 0.4)
    lower = page.add_subfigure(page.add_gridspec(1, 1)[0])
    if drawn is not None:
        grid = page.add_gridspec(2, 1, height_ratios=[above, HIGH])
        lower.remove()
        draw(page.add_subfigure(grid[0]), drawn, f"Mean errors of the {item.nouns[1]}s")
        lower = page.add_subfigure(grid[1])
    shown = list(_overs(item))[:EFFECTS] or [_by_row(item)]
    panels = lower.subplots(1, len(shown) + 1, squeeze=False)[0]
    for panel, over in zip(panels, shown, strict=False):
        _errors(panel, item, over)
    figures.legend(lower)
    _ranking(panels[-1], item, result.alpha / len(result.tables))
    names = "; ".join(" or ".join(e.class_names) for e in item.effects) or "none"
    of = "" if item.table.component is None else f" of {item.table.component}"
    text = f"Undeclared effects{of} ({item.verdict}): {names}"
    figures.title(page, shorten(text, TITLE, placeholder=" ..."))
    return page


def _maps(item: TableResult) -> Maps | None:
    """Mean errors before and after, of each operation; None where there is no plane."""
    table = item.table
    if table.component is not None or not {"x", "y"} <= set(table.axes):
        return None
    scale = UNITS[table.unit].to_internal
    at = [AXES.index(axis) for axis in table.axes]
    means = []
    for values in (table.errors, table.errors - item.explained)[: 1 + bool(item.effects)]:
        mean = np.full((len(table.features), len(AXES)), np.nan)
        mean[:, at] = _mean(values, table.there[..., None]) / scale
        means.append(mean)
    groups = []
    for code, operation in enumerate(table.operations):
        off = (table.operation != code)[:, None]
        sides = tuple(
            Side(name=name if item.effects else "", colour=colour, errors=np.where(off, np.nan, m))
            for (name, colour), m in zip(SIDES, means, strict=False)
        )
        groups.append((operation if len(table.operations) > 1 else "", sides))
    return Maps(
        ids=table.features,
        places=_mean(table.places, np.isfinite(table.places)),
        axes=table.axes,
        groups=tuple(groups),
    )


def _mean(values: FloatArray, there: NDArray[np.bool_]) -> FloatArray:
    """Over the parts, of what is there; nan where nothing is."""
    lacking = ~np.broadcast_to(there, values.shape)
    return np.asarray(np.ma.masked_array(values, lacking).mean(axis=0).filled(np.nan))


def _overs(item: TableResult) -> Iterator[Over]:
    """Of each effect that moves something the column or place that it depends on most."""
    table = item.table
    for effect in item.effects:
        if effect.table is not None:
            used = [effect.table.along]
        else:
            known = {p.name for p in effect.parameters}
            trees = [parse(text) for text in effect.equations.values()]
            # In their order: that of a set differs from run to run.
            used = list(dict.fromkeys(n for tree in trees for n in names(tree) if n not in known))
            used.sort(key=lambda n: n in AXES)
        axis = effect.candidate.axis
        a = table.axes.index(axis) if axis in table.axes else 0
        for name in used[:1]:
            if name in AXES:
                yield Over(f"{name}{MM}", table.places[..., AXES.index(name)], a, effect)
            elif name in table.covariates:
                x = np.broadcast_to(table.covariates[name], table.there.shape)
                yield Over(name, x, a, effect)


def _by_row(item: TableResult) -> Over:
    """Part by part, or pass by pass."""
    P, H = item.table.there.shape
    x = np.broadcast_to(np.arange(1.0, P + 1)[:, None], (P, H))
    return Over(f"{item.nouns[0]}, in order", x, 0, None)


def _errors(panel: Axes, item: TableResult, over: Over) -> None:
    """Each error before and after; the table of a smooth effect with -+ 2 u."""
    table, scale = item.table, UNITS[item.table.unit].to_internal
    there = table.there & np.isfinite(over.x)
    both = (table.errors, table.errors - item.explained)[: 1 + bool(item.effects)]
    for (label, colour), values in zip(SIDES, both, strict=False):
        panel.plot(
            over.x[there], values[..., over.a][there] / scale, ".", color=colour, markersize=3.0,
            alpha=0.45, label=f"error {label}" if len(both) > 1 else None,
        )  # fmt: skip
    panel.axhline(0.0, color=figures.GREY, linewidth=0.9)
    if over.effect is not None and (smooth := over.effect.table) is not None:
        at, mean, u = _curve(smooth)
        low, high = (mean - 2 * u) / scale, (mean + 2 * u) / scale
        panel.fill_between(at, low, high, color=figures.PALE, zorder=3, alpha=0.8)
        name = f"{over.effect.name} \u2213 2 u"
        panel.plot(at, mean / scale, color=figures.INK, zorder=4, label=name)
    panel.set_xlabel(over.label)
    axis = "" if table.component is not None else f" of {table.axes[over.a]}"
    panel.set_ylabel(f"measured minus predicted{axis}, {table.unit}")
    panel.set_title("residuals" if over.effect is None else cut(over.effect.name, NAME))


def _curve(smooth: SmoothEffect) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places of a smooth effect, its values there, and their u, which grows between the table's."""
    shape = TableShape(at=smooth.knots, roughness=smooth.roughness)
    at = np.union1d(smooth.knots, np.linspace(smooth.knots[0], smooth.knots[-1], CURVE))
    W = shape.columns(at)
    variance = np.einsum("ni,ij,nj->n", W, smooth.covariance, W) + np.diag(shape.left_open(at))
    return at, W @ smooth.values, np.sqrt(np.maximum(variance, 0.0))


def _ranking(panel: Axes, item: TableResult, alpha: float) -> None:
    """Log Bayes factors of the likeliest candidates, each added to the known model alone."""
    tested = [x for x in item.candidates if x.log_bayes_factor is not None]
    best = sorted(tested, key=lambda x: -(x.log_bayes_factor or 0.0))[:CANDIDATES]
    marked = {name for effect in item.effects for name in effect.class_names}
    labels = [cut(x.name, NAME) + ("*" if x.name in marked else "") for x in best]
    values = [max(x.log_bayes_factor or 0.0, LEAST) for x in best]
    figures.bars(panel, labels, values, [f"p {p_value(x.p_familywise)}" for x in best])
    panel.set_xlabel(f"natural log of the Bayes factor (gate: p {alpha:.2g})")
    panel.set_title("candidates" + ("; *: found, or in its class" if marked else ""))
