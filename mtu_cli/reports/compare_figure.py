"""The picture of compare: errors as arrows (Gilsinn & Ling 2004, Fig. 6) above their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.compare import Compared, CompareResult, Verdict
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Maps, Side, draw, sheet
from mtu_cli.reports.figures import Intervals
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

ITEMS = 24
"""Items drawn with their intervals, of both kinds together."""
OPERATIONS = 5
"""Operations drawn as arrows."""
FAR = 40.0
"""From means that differ by more median half-intervals than this the predicted ones are taken."""
SEEN = 0.1
"""Smaller differences of arrows, over the largest error, are drawn in place of both."""
COLOURS: dict[Verdict | None, str] = {
    "consistent": figures.GREY,
    "biased": figures.RED,
    "under-predicted": figures.RED,
    "inconsistent": figures.RED,
    "over-predicted": figures.BLUE,
}
SIDES = (("predicted", figures.BLUE), ("measured", figures.ORANGE))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Listed:
    """Items of one kind that are drawn with their intervals, and which of many these are."""

    kind: str
    found: Compared
    items: list[int]
    chosen: str


@figures.styled
def figure(result: CompareResult) -> Figure:
    """Mean errors predicted and measured as arrows, an operation a map, above means with U item by
    item, the verdict beside each.

    Without errors in x and y there is nothing to draw as arrows.
    """
    most = ITEMS if result.lengths is None else ITEMS // 2
    kinds = [] if result.lengths is None else [_listed("Lengths", result.lengths, most)]
    kinds.append(_listed("Features", result.features, most))
    below = sum(figures.rows_height(len(kind.items)) for kind in kinds) + 0.4
    maps = _maps(result)
    if maps is None:
        page = figures.blank(8.0, below)
        _intervals(page, kinds, result.coverage_factor)
        return page
    drawn = sheet(maps)
    page = figures.blank(drawn.width, drawn.height + below)
    grid = page.add_gridspec(2, 1, height_ratios=[drawn.height, below])
    operations = len(dict.fromkeys(label[0] for label in result.features.labels))
    some = f" (first {OPERATIONS} of {operations} operations)" if operations > OPERATIONS else ""
    what = "actual minus nominal" if len(maps.groups[0][1]) > 1 else "measured minus predicted"
    draw(page.add_subfigure(grid[0]), drawn, f"Mean errors, {what}{some}")
    _intervals(page.add_subfigure(grid[1]), kinds, result.coverage_factor)
    return page


def _listed(kind: str, found: Compared, most: int) -> _Listed:
    """All items, or of many those with a fault, the clearest first, then those that differ most
    for their uncertainty; drawn in their own order.

    Parts that scatter too much may lie where they should in the mean: |E_n| alone leaves them out.
    """
    total = len(found.labels)
    items = found.by_interest()[:most]
    faults = sum(one not in (None, "consistent") for one in found.verdicts)
    rest = len(items) - faults
    if len(items) == total:
        chosen = ""
    elif rest < 0:
        chosen = f": the {len(items)} clearest of {faults} with a fault, of {total}"
    elif faults:
        chosen = f": {faults} with a fault, {rest} with the largest |E_n|, of {total}"
    else:
        chosen = f": the {len(items)} with the largest |E_n| of {total}"
    return _Listed(kind=kind, found=found, items=sorted(items), chosen=chosen)


def _maps(result: CompareResult) -> Maps | None:
    """Predicted below measured, an operation a group, or their differences where these would not
    be seen beside the errors; None without errors in x and y.
    """
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
    shown: Sequence[tuple[str, str]] = SIDES
    difference = np.diff(errors, axis=1)
    if np.nanmax(np.abs(difference)) < SEEN * np.nanmax(np.abs(errors)):
        errors, shown = difference, [("", figures.ORANGE)]
    groups = tuple(
        (
            operation,
            tuple(
                Side(name=name, colour=colour, errors=values)
                for (name, colour), values in zip(shown, pair, strict=True)
            ),
        )
        for operation, pair in zip(operations, errors, strict=True)
    )
    return Maps(ids=result.ids, places=result.places, axes=axes, groups=groups)


def _intervals(page: Figure | SubFigure, kinds: list[_Listed], k: float) -> None:
    """Predicted and measured means with U, one row an item, kind below kind."""
    heights = [figures.rows_height(len(kind.items)) for kind in kinds]
    panels = page.subplots(len(kinds), 1, height_ratios=heights, squeeze=False)[:, 0]
    for panel, kind in zip(panels, kinds, strict=True):
        _rows(panel, kind, k)
        panel.set_title(f"{kind.kind}, mean ± {k:g} u of one part{kind.chosen}")
    figures.legend(page)


def _rows(panel: Axes, kind: _Listed, k: float) -> None:
    """The means themselves; where these differ so much that no interval is seen, less what is
    predicted.
    """
    found, items = kind.found, kind.items
    sides = (found.predicted, found.measured)
    means = [side.mean[items] / UM for side in sides]
    halves = [k * np.nan_to_num(side.u[items]) / UM for side in sides]
    far = float(np.ptp(means)) > FAR * float(np.median(halves))
    bars = [
        Intervals(
            label=name,
            colour=colour,
            value=mean - means[0] if far else mean,
            half=half,
            shift=shift,
        )
        for (name, colour), mean, half, shift in zip(
            SIDES, means, halves, (-0.14, 0.14), strict=True
        )
    ]
    names = [" ".join(word for word in found.labels[i] if word) for i in items]
    figures.intervals(panel, names, bars, [found.stated(i) for i in items])
    panel.set_xlabel("minus the predicted mean, um" if far else "actual minus nominal, um")
    for text, i in zip(panel.texts, items, strict=True):
        text.set_color(COLOURS.get(found.verdicts[i], figures.GREY))
