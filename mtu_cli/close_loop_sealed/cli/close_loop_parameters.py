"""Options of close-loop alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mtu_cli.cli.parameters import Parameter

CLOSE_LOOP: list[Parameter] = [
    (
        "alpha",
        Annotated[
            float | None,
            typer.Option(
                "--alpha",
                metavar="P",
                help="Family-wise rate of false alarms, of all tests together.",
                show_default="0.05",
            ),
        ],
        None,
    ),
    (
        "max_effects",
        Annotated[
            int | None,
            typer.Option(
                "--max-effects",
                metavar="N",
                help="At most so many causes: a growth with its drifts and offsets is one.",
                show_default="4",
            ),
        ],
        None,
    ),
    (
        "effects",
        Annotated[
            list[Path] | None,
            typer.Option(
                "--effects",
                metavar="FILE",
                help="Your own effects (YAML) beside the built-in ones; repeatable.",
            ),
        ],
        None,
    ),
    (
        "exclude",
        Annotated[
            list[str] | None,
            typer.Option(
                "--exclude",
                metavar="NAME",
                help="An effect or a family not to look for: cyclic-x, cyclic; repeatable.",
            ),
        ],
        None,
    ),
    (
        "write_machine",
        Annotated[
            Path | None,
            typer.Option(
                "--write-machine",
                metavar="FILE",
                help="The machine YAML with the found effects added to it.",
            ),
        ],
        None,
    ),
    (
        "write_components",
        Annotated[
            Path | None,
            typer.Option(
                "--write-components",
                metavar="FILE",
                help="Components report (-c) with the effects' joint covariance.",
            ),
        ],
        None,
    ),
]
