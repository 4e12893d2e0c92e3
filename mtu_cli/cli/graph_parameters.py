"""Options of the graph's commands."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Annotated

import typer

from mtu_cli.cli.parameters import OUTPUT, Parameter

REQUIRED = inspect.Parameter.empty


def _of(kind: object, text: str, default: object = None) -> list[Parameter]:
    """--of, of one place or of several."""
    option = typer.Option("--of", metavar="PLACE", help=text, show_default=False)
    return [("of", Annotated[kind, option], default)]


FILE: list[Parameter] = [
    (
        "file",
        Annotated[Path, typer.Argument(metavar="FILE", help="Graph YAML.", show_default=False)],
        REQUIRED,
    ),
]
TO: list[Parameter] = [
    (
        "to",
        Annotated[
            Path,
            typer.Option(
                "--to",
                metavar="FILE",
                help="Picture .svg, .png or .pdf; or text: .dot, .mmd, .pl (the paper's).",
                show_default=False,
            ),
        ],
        REQUIRED,
    ),
]
OF_ONE = _of(str, "A place with one coordinate, or PLACE.coordinate.", REQUIRED)
OF_SHARES = _of(str | None, "Show where the variance of this place or PLACE.coordinate comes from.")
OF_MANY = _of(
    list[str] | None, "A place or PLACE.coordinate instead of those reported; repeatable."
)
VARY: list[Parameter] = [
    (
        "vary",
        Annotated[
            list[str],
            typer.Option(
                "--vary",
                metavar="NAME=LOW:HIGH:COUNT",
                help="axis_um, probe_um, perpendicular_um or repeats; or NAME=a,b,c; repeatable.",
                show_default=False,
            ),
        ],
        REQUIRED,
    ),
]
WITHOUT_PLOT: list[Parameter] = [x for x in OUTPUT if x[0] not in ("plot", "report", "date")]
