"""The options of `mtu simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from mtu_cli.cli.parameters import Parameter

UNITS = {"um": "UM", "arcsec": "ARCSEC", "degc": "DEGC", "min": "MIN", "minutes": "MIN"}
"""What is to be given, by the end of an option's name."""


def _number(name: str, default: float, text: str) -> Parameter:
    option = f"--{name.replace('_', '-')}".replace("degc", "degC")
    metavar = UNITS.get(name.rpartition("_")[2], "NUMBER")
    return (name, Annotated[float, typer.Option(option, metavar=metavar, help=text)], default)


def _text(name: str, metavar: str, default: str, text: str) -> Parameter:
    option = typer.Option(f"--{name.replace('_', '-')}", metavar=metavar, help=text)
    return (name, Annotated[str, option], default)


def _texts(name: str, metavar: str, text: str) -> Parameter:
    option: Any = typer.Option(f"--{name.replace('_', '-')}", metavar=metavar, help=text)
    return (name, Annotated[list[str] | None, option], None)


DRIFT: list[Parameter] = [
    (
        "write_drift",
        Annotated[
            Path | None,
            typer.Option(
                "--write-drift",
                metavar="FILE",
                help="Drift readings CSV to write, of the machine's thermal models.",
            ),
        ],
        None,
    ),
    (
        "cycles",
        Annotated[
            int,
            typer.Option(
                "--cycles", metavar="N", help="Warm-ups and cool-downs in turn, each a cycle."
            ),
        ],
        4,
    ),
    _number("cycle_minutes", 190.0, "Minutes of readings a cycle."),
    _number("soak_minutes", 120.0, "Minutes without readings between cycles."),
    _number("interval_min", 1.0, "Minutes from reading to reading."),
    _text("room", "LOW:HIGH", "20:26", "Temperatures that the room is driven to, degC."),
    _number("room_lag_min", 30.0, "Time constant of the room."),
    _number("room_wobble_degc", 0.5, "Swings of the room: standard deviation."),
    _text(
        "sensor_lag_min", "LOW:HIGH", "5:25", "Time constants of the sensors, spread over these."
    ),
    _number("sensor_spread", 0.05, "Sensors see 1 -+ this of the room's rise."),
    _number("sensor_wobble_degc", 0.8, "Draughts at each sensor: standard deviation."),
    _number("sensor_noise_degc", 0.015, "Standard deviation of a sensor's reading."),
    _number("reading_noise_um", 0.25, "Standard deviation of a drift reading."),
    _number("reading_noise_arcsec", 0.05, "The same of an angle."),
    _texts(
        "drift_positions",
        "'NAME: NUMBERS'",
        "Where a component's drift is read, mm; else at the positions of its thermal model.",
    ),
    _texts(
        "settled_drift",
        "'NAME: NUMBERS'",
        "Drift at each position once the room has settled at HIGH; sets the sensors' shares.",
    ),
    _number("most_drift_um", 40.0, "Largest settled drift of the other components."),
    _number("most_drift_arcsec", 40.0, "The same of angles."),
    _texts("twin", "'NAME: SENSOR'", "A second sensor at the place of another.  Repeatable."),
    (
        "cmm_room",
        Annotated[
            list[float] | None,
            typer.Option(
                "--cmm-room",
                metavar="DEGC",
                help="Room while parts are measured, in turn: adds the sensors' columns.",
            ),
        ],
        None,
    ),
    _number("cmm_wobble_degc", 0.1, "Draughts at each sensor then: standard deviation."),
]


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
