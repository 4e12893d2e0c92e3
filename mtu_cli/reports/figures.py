"""The one set-up of all figures: Matplotlib without a display, the same bytes every time."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from importlib import import_module
from typing import TYPE_CHECKING, Any, ParamSpec

from mtu_cli.findings import error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

P = ParamSpec("P")

SUFFIXES = ("png", "svg", "pdf")
ENDINGS = "a name that ends in .png, .svg or .pdf"
DOTS_PER_INCH = 150

INK = "#1b1f24"
GREY = "#8a929c"
BLUE = "#1f5fa8"
ORANGE = "#d9772b"
RED = "#b3261e"
GREEN = "#3d8b57"
PALE = "#c9dcf0"

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
    "axes.unicode_minus": True,
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
    "path.sketch": None,
}

_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None, "ModDate": None},
}

_BACKENDS = {"png": "agg", "svg": "svg", "pdf": "pdf"}


@contextmanager
def house_style() -> Iterator[None]:
    """Matplotlib's own defaults and the house's on top, whatever the user's settings file."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        for name, value in _STYLE.items():
            matplotlib.rcParams[name] = value  # type: ignore[index]  # any name of a setting
        yield


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """A function that draws a figure, in the house style."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with house_style():
            return draw(*args, **kwargs)

    return drawn


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
    """The figure as the bytes of a PNG, SVG or PDF file, without dates.

    Raises InputError for another suffix.
    """
    kind = suffix.lower().removeprefix(".")
    if kind not in SUFFIXES:
        raise error(
            "wrong-ending", option="--plot", kind="a picture", value=suffix, expected=ENDINGS
        )
    out = io.BytesIO()
    with house_style(), warnings.catch_warnings():
        # Names are the user's: a sign that the font lacks is drawn as a box, without a word.
        warnings.filterwarnings("ignore", r"Glyph .* missing from", UserWarning)
        _printed(figure, kind, out)
    return out.getvalue()


def _printed(figure: Figure, kind: str, out: io.BytesIO) -> None:
    """The bytes of Figure.savefig, but drawn once: it draws another time to lay the figure out,
    which every drawing does by itself.
    """
    canvas, dots = figure.canvas, figure.dpi
    backend = import_module(f"matplotlib.backends.backend_{_BACKENDS[kind]}")
    try:
        getattr(backend.FigureCanvas(figure), f"print_{kind}")(out, metadata=_METADATA[kind])
    finally:
        # Those of vectors leave the figure with 72 dots an inch.
        figure.set_canvas(canvas)
        figure.dpi = dots
