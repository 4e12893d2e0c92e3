"""The options of `simulate` for drift tests and temperatures."""

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
