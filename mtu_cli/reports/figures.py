"""What all figures share: the style, the bytes of a file, intervals, bars, legends."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec

import numpy as np

from mtu_cli.reports.numbers import cut, spread
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes  # for modules that draw
    from matplotlib.figure import Figure as Figure
    from matplotlib.figure import SubFigure as SubFigure

P = ParamSpec("P")

DOTS_PER_INCH = 150

INK = "#1b1f24"
GREY = "#8a929c"
BLUE = "#1f5fa8"
ORANGE = "#d9772b"
RED = "#b3261e"
PALE = "#c9dcf0"

LETTER = 0.066
"""Width of a letter of a name, inches."""
WIDTH = 34
"""Characters of a name beside a panel."""
FEW_ROWS, MOST_ROWS = 24, 80
"""More rows of intervals than the first stand closer together; of more than the second some."""

_STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.formatter.offset_threshold": 5,
    "grid.color": "#e6e9ed",
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "text.color": INK,
    # Names and titles of a file are shown sign by sign, pairs of dollars too.
    "text.parse_math": False,
    "lines.linewidth": 1.4,
    "figure.dpi": DOTS_PER_INCH,
    "savefig.dpi": DOTS_PER_INCH,
    "svg.hashsalt": "mtu",
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
}

_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None, "ModDate": None},
}


@contextmanager
def house_style() -> Iterator[None]:
    """Matplotlib's defaults and this style on top, whatever the user's settings file."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        for name, value in _STYLE.items():
            matplotlib.rcParams[name] = value  # type: ignore[index]  # any name of a setting
        yield


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """A function that draws a figure, in the house style."""

    @wraps(draw)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with house_style():
            return draw(*args, **kwargs)

    return wrapper


def blank(width: float, height: float) -> Figure:
    """An empty figure, inches; 8 inches are 1200 pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    layout = ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08)
    figure = Figure(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    return figure


def figure_bytes(figure: Figure, suffix: str) -> bytes:
    """The figure as the bytes of a PNG, SVG or PDF file, without dates."""
    kind = suffix.lower().removeprefix(".")
    out = io.BytesIO()
    with house_style(), warnings.catch_warnings():
        # Names are the user's: a sign that the font lacks is drawn as a box, without a warning.
        warnings.filterwarnings("ignore", r"Glyph .* missing from", UserWarning)
        # Laid out once: with an engine savefig would do it again, and twice.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        figure.savefig(out, format=kind, metadata=_METADATA[kind])
    return out.getvalue()


@dataclass(frozen=True, slots=True)
class Intervals:
    """Values (n,), one a row, with intervals or without, `shift` of a row below its middle."""

    label: str
    colour: str
    value: FloatArray
    half: FloatArray | None = None
    shift: float = 0.0


def listing(
    text: str,
    names: Sequence[str],
    intervals: Sequence[Intervals],
    label: str,
    *,
    limits: Sequence[FloatArray] = (),
    texts: Sequence[str] = (),
) -> Figure:
    """A page of intervals about their values, a row each from top to bottom, of many some evenly
    apart; `limits` (n,) in red, nan where there are none; `texts` beside the rows.
    """
    index = spread(len(names), MOST_ROWS)
    rows = np.arange(len(index))
    page = blank(8.0, (0.36 if len(index) <= FEW_ROWS else 0.25) * len(index) + 1.7)
    title(page, text + f" ({len(index)} of {len(names)})" * (len(index) < len(names)))
    panel = page.subplots()
    panel.axvline(0.0, color=GREY, linewidth=0.9)
    for item in intervals:
        half = None if item.half is None else item.half[index]
        panel.errorbar(
            item.value[index], rows + item.shift, xerr=half, fmt="o", color=item.colour,
            elinewidth=2.0, capsize=2.0, markersize=4.0, label=item.label,
        )  # fmt: skip
    for limit in limits:
        if np.isfinite(limit[index]).any():
            panel.vlines(limit[index], rows - 0.3, rows + 0.4, color=RED, lw=2.0, label="tolerance")
    for row, i in enumerate(index if texts else ()):
        panel.annotate(
            texts[i], (1.01, row), xycoords=panel.get_yaxis_transform(), va="center",
            fontsize=7.5, annotation_clip=False,
        )  # fmt: skip
    panel.set_yticks(rows, [cut(names[i], WIDTH) for i in index])
    panel.set(ylim=(len(index) - 0.4, -0.6), xlabel=label)
    panel.grid(axis="y", visible=False)
    legend(page)
    return page


def bars(
    panel: Axes, names: Sequence[str], values: Sequence[float] | FloatArray, texts: Sequence[str]
) -> None:
    """A bar a row from top to bottom, negative ones in another colour, its text at its end."""
    rows = range(len(values))
    colours = [BLUE if value >= 0 else ORANGE for value in values]
    patches = panel.barh(rows, values, color=colours, height=min(0.66, 0.17 * len(values)))
    panel.bar_label(patches, texts, padding=3, fontsize=7.5)
    panel.set_yticks(rows, names)
    panel.set_ylim(max(len(values), 1) - 0.4, -0.6)
    # Texts of negative bars would reach the names.
    panel.margins(x=0.16 if all(value >= 0 for value in values) else 0.32)
    panel.axvline(0.0, color=GREY, linewidth=0.8)
    panel.grid(axis="y", visible=False)


def shades(count: int) -> list[Any]:
    """Colours from dark to light: early and late passes, one end of an axis and the other."""
    from matplotlib import colormaps

    return [colormaps["viridis"](0.05 + 0.8 * i / max(count - 1, 1)) for i in range(count)]


def panels_of(page: Figure | SubFigure, count: int, columns: int) -> list[Axes]:
    """`count` panels row by row, and blank ones where the last row has more."""
    rows = math.ceil(count / columns)
    panels: list[Axes] = list(page.subplots(rows, columns, squeeze=False).ravel())
    for panel in panels[count:]:
        panel.set_axis_off()
    return panels


def legend(page: Figure | SubFigure, columns: int = 4) -> None:
    """The legend of all panels, below them."""
    key(page, page.axes, loc="outside lower center", ncols=columns)


def key(target: Figure | SubFigure | Axes, panels: Sequence[Axes], **place: Any) -> None:
    """A legend on the `target` of what is in `panels`, each label once."""
    handles: dict[str, Any] = {}
    for panel in panels:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            handles.setdefault(str(label), handle)
    if handles:
        target.legend(list(handles.values()), list(handles), **place)


def title(page: Figure | SubFigure, text: str) -> None:
    """The title of a page, above its panels at the left."""
    page.suptitle(text, x=0.012, ha="left", fontsize=10.5, fontweight="bold")
