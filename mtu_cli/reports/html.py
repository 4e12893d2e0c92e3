"""A report to hand on: one HTML file that needs no other, or the same as PDF."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from rich.text import Text

from mtu_cli import __version__
from mtu_cli.findings import Finding, error
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.tables import Sheet, plain_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def report_bytes(
    suffix: str,
    figure: Figure | None,
    tables: Iterable[object],
    warnings: Iterable[Finding],
    settings: Mapping[str, Any],
    **context: Any,
) -> bytes:
    """The file; the same bytes for the same page. `tables` are the renderables of a terminal,
    `context` its title, subject (names of machine and study), inputs and date.

    Raises InputError for a PDF without the package that writes it.
    """
    from jinja2 import Environment
    from markupsafe import Markup

    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    source = (files("mtu_cli.reports") / "report.html.j2").read_text("utf-8")
    svg = ""
    if figure is not None:
        # The picture without the head of an SVG file; nothing in it leaves the page.
        svg = figure_bytes(figure, ".svg").decode()
        svg = re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    blocks: list[Sheet | str] = []
    for item in tables:
        if isinstance(item, Sheet):
            blocks.append(item)
        elif text := (item.plain if isinstance(item, Text) else plain_text([item])).strip():
            blocks.append(text)
    page = environment.from_string(source).render(
        blocks=blocks,
        figure=Markup(svg),
        warnings=list({each.message: each for each in warnings}.values()),
        # Numbers to six significant digits.
        settings={k: f"{x:.6g}" if isinstance(x, float) else x for k, x in settings.items()},
        version=__version__,
        **context,
    )
    if suffix != ".pdf":
        return page.encode()
    try:
        from weasyprint import HTML  # type: ignore[import-not-found,unused-ignore]  # an extra
    except (ImportError, OSError):
        expected = "the extra mtu-cli[pdf] (pip install 'mtu-cli[pdf]'), or a name ending in .html"
        reason = "this installation writes no PDF"
        raise error("output-form", path="--report", reason=reason, expected=expected) from None
    pdf: bytes = HTML(string=page).write_pdf()
    return pdf
