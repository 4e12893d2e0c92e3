"""Options of the graph's commands."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Annotated

import typer

from mtu_cli.cli.parameters import OUTPUT, Parameter

FILE: list[Parameter] = [
    (
        "file",
        Annotated[Path, typer.Argument(metavar="FILE", help="Graph YAML.", show_default=False)],
        inspect.Parameter.empty,
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
        inspect.Parameter.empty,
    ),
]
OF_ONE: list[Parameter] = [
    (
        "of",
        Annotated[
            str,
            typer.Option(
                "--of",
                metavar="PLACE",
                help="A place with one coordinate, or PLACE.coordinate.",
                show_default=False,
            ),
        ],
        inspect.Parameter.empty,
    ),
]
OF_SHARES: list[Parameter] = [
    (
        "of",
        Annotated[
            str | None,
            typer.Option(
                "--of",
                metavar="PLACE",
                help="Show where the variance of this place or PLACE.coordinate comes from.",
            ),
        ],
        None,
    ),
]
OF_MANY: list[Parameter] = [
    (
        "of",
        Annotated[
            list[str] | None,
            typer.Option(
                "--of",
                metavar="PLACE",
                help="A place or PLACE.coordinate instead of those reported; repeatable.",
            ),
        ],
        None,
    ),
]
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
        inspect.Parameter.empty,
    ),
]
WITHOUT_PLOT: list[Parameter] = [item for item in OUTPUT if item[0] != "plot"]
