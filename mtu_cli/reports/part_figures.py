"""Pictures of measured parts: their scatter, as predicted or not, before and after correction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.anova.outliers import FAMILY_RATE
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.figures import Intervals
from mtu_cli.reports.labels import cut, spread, words
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import ARCSEC, UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mtu_cli.analyses.anova import AnovaResult
    from mtu_cli.analyses.compare import CompareResult
    from mtu_cli.analyses.correct import CorrectResult
    from mtu_cli.analyses.correct.sizes import Size

PANELS, RUNS = 6, 2
"""Features whose parts are drawn, and rows of run charts."""
WIDTH, ROW = 8.0, 1.45
"""Of a page and of a row of panels, inches."""
PART, MANY = 14, 300
"""Characters of a part's name; of more parts the CMM's scatter is not drawn."""
ITEMS, SIZES = 36, 40
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
    """The mean of every part with the CMM's scatter, outliers among them, and their limits."""
    found, parts = result.features, result.features.tables.parts
    k, (mean, u) = found.coverage_factor, (each / UM for each in found.part_means(i))
    count, half = len(parts), k * u
    at = np.arange(count) + 1.0
    overall = found.one_way.mean[i] / UM
    panel.axhline(overall, color=figures.BLUE, linewidth=1.0, label="mean of all readings")
    limits = "limits of an outlier (over all parts and features)"
    for limit in result.limits(i) / UM:
        if np.isfinite(limit).any():
            panel.step(at, limit, where="mid", color=figures.RED, lw=1.0, ls="--", label=limits)
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
    """Means measured less those predicted, with U, item by item, the verdict beside each: faults
    and the largest E_n first.
    """
    names: list[str] = []
    verdicts: list[str] = []
    values, k, total = [], result.coverage_factor, 0
    for found in filter(None, (result.lengths, result.features)):
        items = sorted(found.by_interest()[: ITEMS // 2])
        names += [words(*found.labels[i]) for i in items]
        verdicts += [found.stated(i) for i in items]
        zero, total = found.predicted.mean[items], total + len(found.labels)
        sides = (found.predicted, found.measured)
        values.append([(x.mean[items] - zero, k * np.nan_to_num(x.u[items])) for x in sides])
    shown = [
        Intervals(name, colour, *side, shift)
        for (name, colour), side, shift in zip(
            COMPARED, np.concatenate(values, axis=2) / UM, (-0.14, 0.14), strict=True
        )
    ]
    some = f" ({len(names)} of {total})" * (len(names) < total)
    page = figures.listing(
        f"Mean errors predicted and measured ± {k:g} u of one part{some}", names, shown,
        "minus the predicted mean, um", beside=verdicts,
    )  # fmt: skip
    figures.legend(page)
    return page


@figures.styled
def correct(result: CorrectResult) -> Figure:
    """Errors of diameters (or lengths) before and after with 95 % intervals; without either
    the mean errors of the features.
    """
    rounds = [*result.of_kind("circle"), *result.of_kind("sphere")]
    for kind, items, of in (
        ("diameters", rounds, "calibrated diameter"),
        ("lengths", result.of_kind("length"), "nominal length"),
    ):
        known = [item for item in items if not np.isnan(item.reference)]
        if known:
            return _sizes(kind, known, f"measured minus {of}, um")
    found, at = result.by_feature(), [AXES.index(axis) for axis in result.axes]
    names = [f"{name} {axis}" for name in found.features for axis in result.axes]
    rows = spread(len(names), SIZES)
    shown = [
        Intervals(*label, errors[:, at].ravel()[rows] / UM)
        for label, errors in zip(CORRECTED, (found.before, found.after), strict=True)
    ]
    title = "Mean errors of the features before and after the correction"
    chosen = [names[i] for i in rows]
    page = figures.listing(title, chosen, shown, "measured minus nominal, um")
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
