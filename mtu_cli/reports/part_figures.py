"""Pictures of measured parts: their scatter, as predicted or not, before and after correction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.anova.outliers import FAMILY_RATE
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Maps, Side, draw, page_of, sheet
from mtu_cli.reports.figures import Intervals
from mtu_cli.reports.labels import cut, spread, words
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import ARCSEC, UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mtu_cli.analyses.anova import AnovaResult
    from mtu_cli.analyses.compare import Compared, CompareResult
    from mtu_cli.analyses.correct import CorrectResult
    from mtu_cli.analyses.correct.sizes import Size

PANELS, RUNS = 6, 2
"""Features whose parts are drawn, and rows of run charts."""
OPERATIONS = 5
"""Operations drawn as arrows."""
WIDTH, ROW = 8.0, 1.45
"""Of a page and of a row of panels, inches."""
PART, MANY = 14, 300
"""Characters of a part's name; of more parts the CMM's scatter is not drawn."""
ITEMS, SIZES = 24, 40
"""Items that are compared, and sizes that are corrected, drawn with their intervals."""
COMPARED = (("predicted", figures.BLUE), ("measured", figures.ORANGE))
CORRECTED = (("before", figures.ORANGE), ("after", figures.BLUE))


@figures.styled
def anova(result: AnovaResult) -> Figure:
    """Mean errors by part (Gilsinn & Ling 2004, Fig. 5) above run charts."""
    of_axes: dict[tuple[str, str], dict[str, int]] = {}
    for i, (operation, feature, axis) in enumerate(result.features.tables.labels):
        of_axes.setdefault((operation, feature), {})[axis] = i
    rows = [of_axes[key] for key in result.shown[:PANELS]]
    axes = sorted({axis for row in rows for axis in row})
    runs = list(_runs(result))[: RUNS * len(axes)]
    heights = [ROW] * len(rows) + [1.4 * ROW] * math.ceil(len(runs) / len(axes))
    page = figures.blank(WIDTH, sum(heights) + 1.2)
    grid = page.add_gridspec(len(heights), len(axes), height_ratios=heights)
    for r, row in enumerate(rows):
        for axis, i in row.items():
            panel = page.add_subplot(grid[r, axes.index(axis)])
            _parts(panel, result, i, WIDTH / len(axes) - 0.8)
            if axis == axes[0]:
                panel.set_ylabel("actual minus\nnominal, um", fontsize=7.5)
            panel.tick_params(labelbottom=r == len(rows) - 1)
            panel.set_xlabel("part" if r == len(rows) - 1 else "")
    for k, (title, unit, sequence, values, limits) in enumerate(runs):
        panel = page.add_subplot(grid[len(rows) + k // len(axes), k % len(axes)])
        order = np.argsort(sequence, kind="stable")
        panel.plot(sequence[order], values[order], "o-", color=figures.INK, ms=3.0, lw=0.7)
        panel.axhline(float(np.nanmean(values)), color=figures.BLUE, linewidth=1.0)
        for limit in limits:
            panel.axhline(limit, color=figures.GREEN, linewidth=1.2, label="tolerance")
        panel.set_title(cut(title, 44))
        panel.set_xlabel("sequence")
        panel.locator_params(axis="x", integer=True)
        panel.set_ylabel(unit, fontsize=7.5)
    figures.legend(page, 2)
    total = len(result.shown)
    some = f": {len(rows)} of {total} features, outliers and the largest first"
    figures.title(page, f"Mean errors by part and feature{some if len(rows) < total else ''}")
    return page


def _runs(result: AnovaResult) -> Iterator[tuple[str, str, FloatArray, FloatArray, list[float]]]:
    """Title, unit, sequence, values and limits of what has a tolerance, then of clear trends."""
    drawn = set()
    for item in sorted(result.capabilities, key=lambda x: np.nanmin([x.ppk, x.cpk, np.inf])):
        unit, size = ("arcsec", ARCSEC) if item.kind == "angle" else ("um", UM)
        indices = (("ppk", item.ppk), ("cpk", item.cpk))
        index = ", ".join(f"{name} {value:.2f}" for name, value in indices if np.isfinite(value))
        limits = [item.high] if item.kind == "position" else [item.low, item.high]
        title = f"{words(item.operation, item.id)} {item.kind}: {index}"
        drawn.add((item.operation, item.id, item.kind))
        yield title, unit, item.sequence, item.values / size, [x / size for x in limits]
    kinds = {label: (kind, i) for kind in result.kinds for i, label in enumerate(kind.labels)}
    for trend in sorted(result.trends, key=lambda item: item.p):
        if trend.p <= FAMILY_RATE and trend.where not in drawn:
            kind, i = kinds[trend.where]
            unit, size = ("arcsec", ARCSEC) if trend.where[2] == "angle" else ("um", UM)
            title = f"{words(*trend.where)}: {trend.slope / size:.2g} {unit} a part"
            yield title, unit, result.sequence[trend.where[0]], kind.part_means(i)[0] / size, []


def _parts(panel: Axes, result: AnovaResult, i: int, width: float) -> None:
    """The mean of every part with the CMM's scatter, and outliers among them."""
    found, parts = result.features, result.features.tables.parts
    k, (mean, u) = found.coverage_factor, (each / UM for each in found.part_means(i))
    count, half = len(parts), k * u
    at = np.arange(count) + 1.0
    overall = found.one_way.mean[i] / UM
    panel.axhline(overall, color=figures.BLUE, linewidth=1.0, label="mean of all readings")
    bars = count <= MANY and np.nanmax(half) > 0
    size = min(4.0, max(0.7, 160.0 / count))
    out = np.array([part in found.unusual[i] for part in parts], dtype=bool)
    label = f"mean of a part ± {k:g} s_repeat/√n" if bars else "mean of a part"
    for chosen, form, colour, name in (
        (~out, "o", figures.INK, label),
        (out, "D", figures.RED, "outlier among the parts"),
    ):
        if chosen.any():
            panel.errorbar(
                at[chosen], mean[chosen], yerr=half[chosen] if bars else None, fmt=form,
                color=colour, markersize=size + 1.5 * (form == "D"), markeredgewidth=0,
                elinewidth=1.0, label=name,
            )  # fmt: skip
    panel.set_title(cut(words(*found.tables.labels[i]), int(width / 0.085)))
    names = [cut(name, PART) for name in parts]
    lines = figures.LETTER * (max(map(len, names)) + 0.8) * count / width
    every = math.ceil(lines if lines <= 2 else 0.11 * count / width)
    panel.set_xticks(at[::every], names[::every], fontsize=7, rotation=90 * (lines > 2))
    panel.set_xlim(0.7 - 0.03 * count, 1.03 * count + 0.3)
    panel.grid(axis="x", visible=False)


@figures.styled
def compare(result: CompareResult) -> Figure:
    """Mean errors predicted and measured as arrows (Gilsinn & Ling 2004, Fig. 6), an operation a
    map, above the differences of the means with U item by item, the verdict beside each.

    Without errors in x and y there is nothing to draw as arrows.
    """
    most = ITEMS if result.lengths is None else ITEMS // 2
    both = {"Lengths": result.lengths, "Features": result.features}
    kinds = {kind: found for kind, found in both.items() if found is not None}
    heights = [figures.rows_height(min(most, len(found.labels))) for found in kinds.values()]
    below, maps = sum(heights) + 0.4, _compared(result)
    if maps is None:
        lower = page = figures.blank(WIDTH, below)
    else:
        drawn = sheet(maps)
        page = figures.blank(drawn.width, drawn.height + below)
        upper, lower = page.subfigures(2, 1, height_ratios=[drawn.height, below], squeeze=False)[
            :, 0
        ]
        operations = len(dict.fromkeys(label[0] for label in result.features.labels))
        more = f" (first {OPERATIONS} of {operations} operations)"
        some = more if operations > OPERATIONS else ""
        draw(upper, drawn, f"Mean errors, actual minus nominal{some}")
    panels = lower.subplots(len(kinds), 1, height_ratios=heights, squeeze=False)[:, 0]
    for panel, (kind, found) in zip(panels, kinds.items(), strict=True):
        chosen = _differences(panel, found, most, result.coverage_factor)
        panel.set_title(f"{kind}, mean ± {result.coverage_factor:g} u of one part{chosen}")
    figures.legend(lower)
    return page


def _compared(result: CompareResult) -> Maps | None:
    """Predicted below measured, an operation a group; None without errors in x and y."""
    found = result.features
    operations = list(dict.fromkeys(label[0] for label in found.labels))[:OPERATIONS]
    axes = tuple(axis for axis in AXES if any(label[2] == axis for label in found.labels))
    if not {"x", "y"} <= set(axes):
        return None
    errors = np.full((len(operations), 2, len(result.ids), 3), np.nan)
    index = {name: i for i, name in enumerate(result.ids)}
    for i, (operation, name, axis) in enumerate(found.labels):
        if operation in operations:
            pair = found.predicted.mean[i] / UM, found.measured.mean[i] / UM
            errors[operations.index(operation), :, index[name], AXES.index(axis)] = pair
    groups = []
    for operation, means in zip(operations, errors, strict=True):
        sides = zip(COMPARED, means, strict=True)
        groups.append((operation, tuple(Side(*names, errors=e) for names, e in sides)))
    return Maps(result.ids, result.places, axes, tuple(groups))


def _differences(panel: Axes, found: Compared, most: int, k: float) -> str:
    """Both means less the predicted one, with U, of the clearest faults; which, in words."""
    items = sorted(found.by_interest()[:most])
    zero = found.predicted.mean[items]
    shown = []
    for shift, side, (name, colour) in zip(
        (-0.14, 0.14), (found.predicted, found.measured), COMPARED, strict=True
    ):
        value, half = (side.mean[items] - zero) / UM, k * np.nan_to_num(side.u[items]) / UM
        shown.append(Intervals(name, colour, value, half, shift))
    names = [words(*found.labels[i]) for i in items]
    figures.intervals(panel, names, shown, [found.stated(i) for i in items])
    panel.set_xlabel("minus the predicted mean, um")
    colours = {None: figures.GREY, "consistent": figures.GREY, "over-predicted": figures.BLUE}
    for text, i in zip(panel.texts, items, strict=True):
        text.set_color(colours.get(found.verdicts[i], figures.RED))
    total = len(found.labels)
    faults = any(one not in (None, "consistent") for one in found.verdicts)
    chosen = f": {'faults and ' * faults}the largest |E_n|, {len(items)} of {total}"
    return chosen if len(items) < total else ""


@figures.styled
def correct(result: CorrectResult) -> Figure:
    """Errors of diameters (or lengths) before and after with 95 % intervals; without either
    the mean errors of the features as arrows, or row by row where they are not in a plane.
    """
    rounds = [*result.of_kind("circle"), *result.of_kind("sphere")]
    for kind, items, of in (
        ("diameters", rounds, "calibrated diameter"),
        ("lengths", result.of_kind("length"), "nominal length"),
    ):
        known = [item for item in items if not np.isnan(item.reference)]
        if known:
            return _sizes(kind, known, f"measured minus {of}, um")
    found = result.by_feature()
    pair = (found.before / UM, found.after / UM)
    title = "Mean errors of the features, measured minus nominal"
    if {"x", "y"} <= set(result.axes) and np.isfinite(pair[0][:, :2]).all():
        sides = tuple(Side(*names, errors=e) for names, e in zip(CORRECTED, pair, strict=True))
        axes = tuple(a for a in result.axes if np.isfinite(pair[1][:, AXES.index(a)]).any())
        return page_of(Maps(found.features, found.places, axes, (("", sides),)), title)
    at = [AXES.index(axis) for axis in result.axes]
    names = [f"{name} {axis}" for name in found.features for axis in result.axes][:SIZES]
    shown = [
        Intervals(*label, errors[:, at].ravel()[:SIZES])
        for label, errors in zip(CORRECTED, pair, strict=True)
    ]
    page = figures.listing(title, names, shown, "measured minus nominal, um")
    figures.legend(page)
    return page


def _sizes(kind: str, items: Sequence[Size], label: str) -> Figure:
    """A row a size, before and after, the interval of which is that of one part."""
    chosen, names = [items[i] for i in spread(len(items), SIZES)], []
    for item in chosen:
        warm = "" if np.isnan(item.temperature) else f"{item.temperature:.1f} °C"
        of = (item.id, words(item.operation, f"part {item.part}"), warm)
        names.append(", ".join(filter(None, of)))
    (before, after), half = (
        np.array([item.error for item in chosen]).T / UM,
        np.array([np.ptp(item.error_interval95) for item in chosen]) / (2 * UM),
    )
    shown = [
        Intervals(*CORRECTED[0], before),
        Intervals(f"{CORRECTED[1][0]} ± 95 %", CORRECTED[1][1], after, half),
    ]
    title = f"Errors of the {kind} before and after the correction"
    title += f" ({len(chosen)} of {len(items)})" if len(chosen) < len(items) else ""
    page = figures.listing(title, names, shown, label)
    panel, U = page.axes[0], np.array([item.U_reference for item in chosen]) / UM
    rows = np.arange(len(chosen))
    panel.hlines(rows, before, after, color=figures.GREY, linewidth=0.8, zorder=1)
    if (known := np.isfinite(U)).any():
        panel.barh(
            rows[known], 2 * U[known], left=-U[known], height=0.64, color=figures.PALE, zorder=0,
            label="± U of the calibration",
        )  # fmt: skip
    figures.legend(page)
    return page
