"""Pictures of measured parts: their scatter, as predicted or not, before and after correction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.figures import Intervals
from mtu_cli.reports.labels import cut, spread, words
from mtu_cli.stats.family import FAMILY_RATE
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import ARCSEC, UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mtu_cli.analyses.anova import AnovaResult
    from mtu_cli.analyses.compare import CompareResult
    from mtu_cli.analyses.correct import CorrectResult
    from mtu_cli.analyses.correct.sizes import Size

PANELS, RUNS = 6, 4
"""Features whose parts are drawn, and charts of what has a tolerance."""
PART = 14
"""Characters of a part's name."""
ITEMS, SIZES = 36, 40
"""Items that are compared, and sizes that are corrected, drawn with their intervals."""
COMPARED = (("predicted", figures.BLUE), ("measured", figures.ORANGE))


class Chart(NamedTuple):
    """The mean of each part over the sequence of manufacture, with what the CMM's scatter makes of
    it and the names of outliers; `limits` of the tolerance.
    """

    title: str
    unit: str
    sequence: FloatArray
    values: FloatArray
    half: FloatArray | None
    limits: Sequence[float]
    outliers: dict[int, str]


@figures.styled
def anova(result: AnovaResult) -> Figure:
    """Run charts: mean errors by part (Gilsinn & Ling 2004, Fig. 5), and what has a tolerance."""
    charts = [*_features(result), *islice(_runs(result), RUNS)]
    columns = min(len(charts), 2)
    page = figures.blank(8.5, 1.45 * math.ceil(len(charts) / columns) + 1.0)
    for panel, chart in zip(figures.panels_of(page, len(charts), columns), charts, strict=False):
        order = np.argsort(chart.sequence, kind="stable")
        places = chart.sequence[order]
        half = None if chart.half is None else chart.half[order]
        panel.errorbar(
            places, chart.values[order], half, fmt="o-", color=figures.INK, ms=3,
            lw=0.5, elinewidth=1.0, label="mean of a part ± k s_repeat/√n",
        )  # fmt: skip
        for limit in chart.limits:
            panel.axhline(limit, color=figures.GREEN, lw=1.0, ls="--", label="tolerance")
        for i, name in chart.outliers.items():
            place = chart.sequence[i], chart.values[i]
            panel.plot(*place, "D", color=figures.RED, ms=5, label="outlier among the parts")
            panel.annotate(cut(name, PART), place, (5, 3), textcoords="offset points", fontsize=7)
        panel.set_title(cut(chart.title, 44))
        panel.set_ylabel(chart.unit)
        panel.locator_params(axis="x", integer=True)
    for panel in page.axes[-columns:]:
        panel.set_xlabel("sequence of the parts")
    figures.legend(page, 2)
    count = len({label[:2] for label in result.features.labels})
    some = f"; {PANELS} of {count} features" * (count > PANELS)
    figures.title(page, f"Mean errors by part, actual minus nominal{some}")
    return page


def _features(result: AnovaResult) -> Iterator[Chart]:
    """Clear trends, outliers and the largest errors first."""
    found = result.features
    labels, k = found.tables.labels, found.coverage_factor
    clear = [x.where for x in result.trends if x.p <= FAMILY_RATE and x.where in labels]
    outliers = [label for label, parts in zip(labels, found.unusual, strict=True) if parts]
    most = [*clear, *outliers, *(labels[i] for i in found.order)]
    keys = dict.fromkeys(label[:2] for label in most)
    for key in list(keys)[:PANELS]:
        for i in (i for i, label in enumerate(labels) if label[:2] == key):
            mean, u = (each / UM for each in found.part_means(i))
            out = {p: name for p, name in enumerate(found.tables.parts) if name in found.unusual[i]}
            yield Chart(words(*labels[i]), "um", result.sequence[key[0]], mean, k * u, (), out)


def _runs(result: AnovaResult) -> Iterator[Chart]:
    """What has a tolerance, the least capable first."""
    for item in sorted(result.capabilities, key=lambda x: np.nanmin([x.ppk, x.cpk, np.inf])):
        unit, size = ("arcsec", ARCSEC) if item.kind == "angle" else ("um", UM)
        limits = [item.high] if item.kind == "position" else [item.low, item.high]
        title = f"{words(item.operation, item.id)} {item.kind}: ppk {item.ppk:.2f}"
        ends = [limit / size for limit in limits]
        yield Chart(title, unit, item.sequence, item.values / size, None, ends, {})


@figures.styled
def compare(result: CompareResult) -> Figure:
    """Means measured less those predicted, with U, item by item, the verdict beside each: faults
    and the largest E_n first.
    """
    names: list[str] = []
    verdicts: list[str] = []
    values, k, total = [], result.coverage_factor, 0
    for found in filter(None, (result.lengths, result.features)):
        items = sorted(found.by_interest[: ITEMS // 2])
        names += [words(*found.labels[i]) for i in items]
        verdicts += [found.outcome[i] for i in items]
        zero, total = found.predicted.mean[items], total + len(found.labels)
        sides = (found.predicted, found.measured)
        values.append([(x.mean[items] - zero, k * np.nan_to_num(x.u[items])) for x in sides])
    shown = [
        Intervals(name, colour, value, half, shift)
        for (name, colour), (value, half), shift in zip(
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
    """Errors of diameters (or lengths) before and after with 95 % intervals of one part; without
    either the errors of the points.
    """
    rounds = [*result.of_kind("circle"), *result.of_kind("sphere")]
    kinds = {"diameters": rounds, "lengths": result.of_kind("length")}
    for what, items in kinds.items():
        title = f"Errors of the {what}"
        known = [item for item in items if not np.isnan(item.reference)]
        names = [words(x.id, x.operation, f"part {x.part}", _warmth(x)) for x in known]
        before, after = np.array([x.error for x in known]).reshape(-1, 2).T / UM
        half = np.array([np.ptp(x.error_interval95) for x in known]) / (2 * UM)
        if known:
            break
    else:
        points, at = result.points, [AXES.index(axis) for axis in result.axes]
        before, after = (
            (x - points.nominal)[:, at].ravel() / UM for x in (points.measured, result.corrected)
        )
        names = [words(x, axis) for x in result.feature for axis in result.axes]
        title, half = "Errors of the points", np.full(len(names), np.nan)
    rows = spread(len(names), SIZES)
    some = f" ({len(rows)} of {len(names)})" if len(rows) < len(names) else ""
    shown = [
        Intervals("before", figures.ORANGE, before[rows]),
        Intervals("after, with 95 % interval", figures.BLUE, after[rows], half[rows]),
    ]
    page = figures.listing(
        f"{title} before and after the correction{some}", [names[i] for i in rows],
        shown, "measured minus reference, um",
    )  # fmt: skip
    figures.legend(page)
    return page


def _warmth(item: Size) -> str:
    return "" if np.isnan(item.temperature) else f"at {item.temperature:.1f} °C"
