"""The options of `simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mtu_cli.cli.drift_parameters import DRIFT
from mtu_cli.cli.parameters import Parameter

SIMULATE: list[Parameter] = [
    (
        "passes",
        Annotated[int, typer.Option("--passes", metavar="N", help="Passes in each direction.")],
        5,
    ),
    (
        "one_way",
        Annotated[bool, typer.Option("--one-way", help="Read forward only.")],
        False,
    ),
    (
        "positions",
        Annotated[
            str | None,
            typer.Option(
                "--positions",
                metavar="LOW:HIGH:COUNT",
                help="Positions along every axis, mm, or x=0:500:8,y=0:300:8,...",
                show_default="the part's extent, 8 of them",
            ),
        ],
        None,
    ),
    ("parts", Annotated[int, typer.Option("--parts", metavar="N", help="Parts to make.")], 21),
    (
        "repeats",
        Annotated[int, typer.Option("--repeats", metavar="N", help="CMM measurements a feature.")],
        2,
    ),
    (
        "cmm_u_um",
        Annotated[
            float, typer.Option("--cmm-u-um", metavar="UM", help="CMM standard uncertainty, um.")
        ],
        1.0,
    ),
    (
        "part_offset_um",
        Annotated[
            float,
            typer.Option("--part-offset-um", metavar="UM", help="Random offset of each part, um."),
        ],
        0.0,
    ),
    (
        "reverse_every",
        Annotated[
            int,
            typer.Option(
                "--reverse-every", metavar="N", help="Machine every n-th part backwards; 0: none."
            ),
        ],
        0,
    ),
    (
        "minutes",
        Annotated[float, typer.Option("--minutes", metavar="MIN", help="Minutes a feature.")],
        0.5,
    ),
    (
        "first_repeats",
        Annotated[
            str | None,
            typer.Option(
                "--first-repeats",
                metavar="PARTS:REPEATS",
                help="Measurements a feature of the first parts, such as 4:5.",
            ),
        ],
        None,
    ),
    (
        "operation",
        Annotated[
            str | None,
            typer.Option("--operation", metavar="NAME", help="How the features are made."),
        ],
        None,
    ),
    (
        "scatter",
        Annotated[
            list[str] | None,
            typer.Option(
                "--scatter",
                metavar="'Ex: EQUATION'",
                help="Standard deviation of a random error of each feature, mm.  Repeatable.",
            ),
        ],
        None,
    ),
    (
        "effect",
        Annotated[
            list[str] | None,
            typer.Option(
                "--effect",
                metavar="'Ex: EQUATION'",
                help="An undeclared effect, mm; names: x y z, covariates.  Repeatable.",
            ),
        ],
        None,
    ),
    (
        "covariate",
        Annotated[
            list[str] | None,
            typer.Option(
                "--covariate",
                metavar="'NAME: EQUATION'",
                help="A column such as 'T_spindle_degC: 20 + time_min/60'.  Repeatable.",
            ),
        ],
        None,
    ),
    (
        "write_lbb",
        Annotated[
            Path | None, typer.Option("--write-lbb", metavar="FILE", help="Readings CSV to write.")
        ],
        None,
    ),
    (
        "write_cmm",
        Annotated[
            Path | None, typer.Option("--write-cmm", metavar="FILE", help="Points CSV to write.")
        ],
        None,
    ),
    *DRIFT,
]
