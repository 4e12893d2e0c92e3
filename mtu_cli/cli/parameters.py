"""Options that commands share, declared once and put together into signatures.

Typer reads a command's options from its signature. The groups below are joined into one, so
that `--seed` or `--out` means the same, and is documented the same, everywhere.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from mtu_cli.findings import error

Parameter = tuple[str, Any, Any]
"""(name, annotation, default)."""

STUDY: list[Parameter] = [
    (
        "study",
        Annotated[
            Path | None,
            typer.Argument(
                metavar="STUDY",
                help="Study file; without it and without -m, mtu.yaml here or above.",
                show_default=False,
            ),
        ],
        None,
    ),
    (
        "machine",
        Annotated[
            Path | None, typer.Option("-m", "--machine", metavar="FILE", help="Machine YAML.")
        ],
        None,
    ),
]
PART: list[Parameter] = [
    (
        "part",
        Annotated[Path | None, typer.Option("-p", "--part", metavar="FILE", help="Part YAML.")],
        None,
    ),
]
COMPONENTS: list[Parameter] = [
    (
        "components",
        Annotated[
            list[Path] | None,
            typer.Option(
                "-c",
                "--components",
                metavar="FILE",
                help="A fit-components or thermal-fit report, or both; wins over the machine file.",
            ),
        ],
        None,
    ),
]


def _readings(name: str, what: str) -> Parameter:
    option = typer.Option(f"--{name}", metavar="FILE", help=f"{what} readings CSV; repeatable.")
    return (name, Annotated[list[Path] | None, option], None)


READINGS: list[Parameter] = [_readings("lbb", "Ball-bar"), _readings("laser", "Laser")]
DRIFT: list[Parameter] = [_readings("drift", "Thermal drift")]
CMM: list[Parameter] = [
    (
        "cmm",
        Annotated[
            list[Path] | None,
            typer.Option("--cmm", metavar="FILE", help="Measured points CSV; repeatable."),
        ],
        None,
    ),
]
METHOD: list[Parameter] = [
    (
        "method",
        Annotated[
            str,
            typer.Option(
                "--method",
                metavar="METHOD",
                help="Components of variance: reml, anova (mean squares) or paper.",
            ),
        ],
        "reml",
    ),
]
THERMAL_MODEL: list[Parameter] = [
    (
        "model",
        Annotated[
            str,
            typer.Option(
                "--model",
                metavar="MODEL",
                help="auto (the best on held-out cycles), stepwise, ridge or lagged.",
            ),
        ],
        "auto",
    ),
]
AT: list[Parameter] = [
    (
        "at",
        Annotated[
            list[str] | None,
            typer.Option(
                "--at", metavar="NAME=VALUE", help="A covariate for the prediction; repeatable."
            ),
        ],
        None,
    ),
]
GRID: list[Parameter] = [
    (
        "grid",
        Annotated[
            str | None,
            typer.Option(
                "--grid",
                metavar="N or NX,NY,NZ",
                help="A grid over the machine's travels instead of a part; --plot draws a map.",
            ),
        ],
        None,
    ),
]
COVERAGE: list[Parameter] = [
    (
        "k",
        Annotated[
            float | None,
            typer.Option("--k", metavar="K", help="Coverage factor of U = k u.", show_default="2"),
        ],
        None,
    ),
    (
        "digits",
        Annotated[
            int | None,
            typer.Option(
                "--digits",
                metavar="N",
                help="Significant digits of u that matter.",
                show_default="2",
            ),
        ],
        None,
    ),
]
CORRELATION: list[Parameter] = [
    (
        "correlation",
        Annotated[
            str | None,
            typer.Option(
                "--correlation",
                metavar="HOW",
                help="shared: full covariance; independent: as the papers.",
                show_default="shared",
            ),
        ],
        None,
    ),
]
SEED: list[Parameter] = [
    (
        "seed",
        Annotated[
            int | None, typer.Option("--seed", metavar="N", help="Seed of the random numbers.")
        ],
        None,
    ),
]
MONTE_CARLO: list[Parameter] = [
    *SEED,
    (
        "trials",
        Annotated[
            int | None,
            typer.Option(
                "--trials", metavar="N", help="Monte Carlo trials; without it the count adapts."
            ),
        ],
        None,
    ),
    (
        "threads",
        Annotated[
            int | None,
            typer.Option(
                "--threads", metavar="N", help="Threads; the result does not depend on them."
            ),
        ],
        None,
    ),
]
QUIET: list[Parameter] = [
    ("quiet", Annotated[bool, typer.Option("-q", "--quiet", help="No tables.")], False),
]
OUTPUT: list[Parameter] = [
    (
        "out",
        Annotated[
            Path | None,
            typer.Option(
                "-o",
                "--out",
                metavar="FILE",
                help="JSON report; - is standard output, alone on it.",
            ),
        ],
        None,
    ),
    (
        "csv",
        Annotated[
            Path | None, typer.Option("--csv", metavar="FILE", help="The main table as CSV.")
        ],
        None,
    ),
    (
        "plot",
        Annotated[
            Path | None, typer.Option("--plot", metavar="FILE", help="Picture: .png, .svg or .pdf.")
        ],
        None,
    ),
    (
        "report",
        Annotated[
            Path | None,
            typer.Option(
                "--report",
                metavar="FILE",
                help="A report to hand on, with tables and picture: .html (.pdf with an extra).",
            ),
        ],
        None,
    ),
    (
        "date",
        Annotated[
            str | None,
            typer.Option("--date", metavar="DATE", help="The date that stands on the --report."),
        ],
        None,
    ),
    *QUIET,
]
COVARIANCE: list[Parameter] = [
    (
        "covariance",
        Annotated[bool, typer.Option("--covariance", help="Covariance matrix in the report.")],
        False,
    ),
]
DATUM: list[Parameter] = [
    (
        "datum",
        Annotated[
            str | None,
            typer.Option(
                "--datum",
                metavar="DATUM",
                help="Freedoms of a part's coordinate system: none, offset or offset,rotation.",
                show_default="none",
            ),
        ],
        None,
    ),
]
KIND: list[Parameter] = [
    (
        "kind",
        Annotated[
            str,
            typer.Argument(
                metavar="KIND",
                help="machine, part, study, budget, graph or effects.",
                show_default=False,
            ),
        ],
        inspect.Parameter.empty,
    ),
]
TOPIC: list[Parameter] = [
    (
        "topic",
        Annotated[
            str | None,
            typer.Argument(
                metavar="TOPIC",
                help="A topic, the code of a warning or error, or a command; without: all topics.",
                show_default=False,
            ),
        ],
        None,
    ),
]
FAIL_IF = "fail_if"


def _filled(option: str, metavar: str) -> Callable[[str], str]:
    """The reader of an option of which an empty value, as a variable of a script may be, must not
    pass for none. Empty names of files are told by who reads them.
    """

    def read(text: str) -> str:
        if not text:
            reason = f"option {option!r} has no value"
            raise error("usage", reason=reason, expected=f"{option} {metavar}")
        return text

    return read


SUSPICIOUS = "suspicious"
"""The gate of every command that reads data: a warning of the checks meets it."""


def fail_if(gates: str = "") -> list[Parameter]:
    """`--fail-if`, with the gates that a command knows beside SUSPICIOUS."""
    name, metavar = "--fail-if", "GATE"
    filled = _filled(name, metavar)

    def only_suspicious(text: str) -> str:
        if filled(text) != SUSPICIOUS:
            raise error("unknown-name", what="gate", path=name, value=text, expected=SUSPICIOUS)
        return text

    known = f"{SUSPICIOUS}, data look mistaken{f'; {gates}' if gates else ''}"
    option = typer.Option(
        name, metavar=metavar, parser=filled if gates else only_suspicious,
        help=f"Exit with 3 if met: {known}.",
    )  # fmt: skip
    return [(FAIL_IF, Annotated[str | None, option], None)]
