"""The options of `mtu budget`."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Annotated

import typer

from mtu_cli.cli.parameters import COVERAGE, Parameter

_DIGITS = [parameter for parameter in COVERAGE if parameter[0] == "digits"]

BUDGET: list[Parameter] = [
    (
        "file",
        Annotated[Path, typer.Argument(metavar="FILE", help="Budget YAML.", show_default=False)],
        inspect.Parameter.empty,
    ),
    (
        "k",
        Annotated[
            float | None,
            typer.Option(
                "--k",
                metavar="K",
                help="Coverage factor of U = k u; wins over the file's coverage.",
            ),
        ],
        None,
    ),
    *_DIGITS,
]
