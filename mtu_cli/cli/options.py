"""Every option of the commands, once: what `--seed` takes and means is the same everywhere.

A command names its options by their keys in OPTIONS; `signature` makes of them the annotated
parameters that typer reads.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import typer

SUSPICIOUS = "suspicious"
"""The gate of every command that reads data: a warning of the checks meets it."""
REQUIRED = inspect.Parameter.empty


@dataclass(frozen=True)
class Options:
    """The options of one call, by name (None where the command lacks it), and its gates."""

    command: str
    values: dict[str, Any] = field(default_factory=dict)
    gates: tuple[str, ...] = ()

    def __getattr__(self, name: str) -> Any:
        return self.values.get(name)


@dataclass(frozen=True, slots=True)
class Option:
    """One option: the type of its value, the word for it in the help, where ``...`` says that it
    may be repeated, and what it means. `shown`: the default that a study or the command chooses;
    `panel`: its group in the help; `bounds` of a number, or of those in a text; `endings` of the
    name of a file to write.
    """

    kind: type
    metavar: str | None
    text: str
    short: str = ""
    default: Any = None
    argument: bool = False
    shown: str | None = None
    panel: str | None = None
    bounds: tuple[float, float] | None = None
    endings: tuple[str, ...] = ()

    @property
    def many(self) -> bool:
        """Whether it may be repeated."""
        return self.metavar is not None and self.metavar.endswith("...")

    def annotation(self, name: str) -> Any:
        """The annotated type of the parameter `name`."""
        kind: Any = list[self.kind] if self.many else self.kind  # type: ignore[name-defined]
        kind = kind | None if self.default is None else kind
        common: dict[str, Any] = {
            "metavar": self.metavar and self.metavar.removesuffix("..."),
            "help": f"{self.text}; repeatable." if self.many else f"{self.text}.",
            "show_default": self.shown or self.default not in (None, REQUIRED, False),
            "rich_help_panel": self.panel,
        }
        if self.kind is Path:
            # Whoever reads the file says what is wrong with it.
            common["parser"] = file_name
        if self.bounds is not None and self.kind is not str:
            common |= dict(zip(("min", "max"), self.bounds, strict=True))
        if self.argument:
            return Annotated[kind, typer.Argument(**common)]
        flags = filter(None, (self.short, option_name(name)))
        return Annotated[kind, typer.Option(*flags, **common)]


def option_name(name: str) -> str:
    """The option of a parameter: --sensor-noise-degC of sensor_noise_degc."""
    return f"--{name.rstrip('_').replace('_', '-')}".replace("degc", "degC")


def file_name(text: str) -> Path:
    """A path; an empty name, as of a script's variable that is not set, is none."""
    if not text or (text.endswith("/") and not Path(text).is_dir()):
        raise typer.BadParameter("it names no file")
    return Path(text)


def signature(names: str, gates: tuple[str, ...] | None) -> inspect.Signature:
    """The parameters of a command: its options, and `--fail-if` where it has `gates`."""
    options = {key.partition(":")[0]: OPTIONS[key] for key in names.split()}
    if gates is not None:
        known = "; ".join([f"{SUSPICIOUS}, data look mistaken", *gates])
        text = f"Exit with 3 if met: {known}. Several with commas"
        options["fail_if"] = Option(str, "GATE...", text)
    kind: Any = inspect.Parameter.KEYWORD_ONLY
    parameters = []
    for name, option in options.items():
        known = option.annotation(name)
        parameters.append(inspect.Parameter(name, kind, annotation=known, default=option.default))
    return inspect.Signature(parameters)


def _file(text: str, short: str = "", metavar: str = "FILE", **more: Any) -> Option:
    return Option(Path, metavar, text, short, **more)


def _output(text: str, endings: str, short: str = "", default: Any = None) -> Option:
    return Option(Path, "FILE", text, short, default, endings=tuple(endings.split()))


def _text(metavar: str, text: str, default: Any = None, **more: Any) -> Option:
    return Option(str, metavar, text, default=default, **more)


def _flag(text: str, short: str = "") -> Option:
    return Option(bool, None, text, short, default=False)


def _count(default: int, text: str, least: int = 1, most: int = 10_000) -> Option:
    return Option(int, "N", text, default=default, bounds=(least, most))


def _number(default: float, metavar: str, text: str, least: float = 0.0) -> Option:
    return Option(float, metavar, text, default=default, bounds=(least, 1e6))


ROOMS = (-50.0, 200.0)
"""Rooms that a machine may stand in."""
READINGS, POINTS, PARTS_ROOM = "Readings", "Points of parts", "Room of the parts"
DRIFT, CLIMATE = "Drift test", "Room and sensors (of a drift test, or of parts with --cmm-room)"
FILES = {
    "study": _file(
        "Study file; without it and without -m, mtu.yaml here or above",
        metavar="STUDY",
        argument=True,
    ),
    "machine": _file("Machine YAML", "-m"),
    "part": _file("Part YAML", "-p"),
    "components": _file(
        "A fit-components or thermal-fit report; wins over the machine file", "-c", "FILE..."
    ),
    "lbb": _file("Laser ball bar readings: CSV, or NAME=FILE of an instrument", metavar="FILE..."),
    "laser": _file("Laser readings: CSV, or NAME=FILE of an instrument", metavar="FILE..."),
    "drift": _file("Thermal drift readings: CSV, or NAME=FILE of an instrument", metavar="FILE..."),
    "cmm": _file("Measured points: CSV, or a file of a CMM", metavar="FILE..."),
    "current": _file("The table that was active while measuring; the new one adds to it"),
    "read": _file("A control's table to print as errors, in place of making one"),
    "verify": _file("Readings of the verification moves: CSV, or a file of an instrument"),
    "effects": _file("Your own effects (YAML), added to the built-in ones", metavar="FILE..."),
    "before": _file("Readings CSV of an earlier test of the same axes", metavar="FILE..."),
    "budget": _file("YAML with the instrument's `budget`, else the study's"),
    "file:traces": _file(
        "Traces CSV: angle_deg, deviation_um; features of a .b5r",
        metavar="FILE...",
        argument=True,
        default=REQUIRED,
    ),
    "file:budget": _file("Budget YAML", argument=True, default=REQUIRED),
    "file:instrument": _file("A file of an instrument", argument=True, default=REQUIRED),
    "files": _file(
        "Files of an instrument, or NAME=FILE with the component that it reads",
        metavar="FILE...",
        argument=True,
        default=REQUIRED,
    ),
    "map": _file("Mapping profile (mtu/import/1) of any table"),
    "file:graph": _file("Graph YAML", argument=True, default=REQUIRED),
}
WRITTEN = {
    "out": _output("JSON report; - is standard output, alone on it", ".json", "-o"),
    "csv": _output("The main table as CSV", ".csv"),
    "plot": _output("Picture: .png, .svg or .pdf", ".png .svg .pdf"),
    "report": _output(
        "A report to hand on, with tables and picture: .html (.pdf with an extra)",
        ".html .htm .pdf",
    ),
    "to": _output(
        "Picture .svg, .png, .pdf; or text .dot, .mmd, .pl (the paper's)",
        ".svg .png .pdf .dot .mmd .pl",
        default=REQUIRED,
    ),
    "to_file": _output("The table for the control", ""),
    "to_nc": _output("The verification moves as G-code", ".nc .ngc .mpf .h .txt"),
    "write_machine": _output("The machine YAML with the found effects added to it", ".yaml .yml"),
    "write_components": _output(
        "Components report (-c) with the effects' joint covariance", ".json"
    ),
    "write_lbb": _output("Readings CSV to write", ".csv"),
    "write_laser": _output("Run of a laser to write, of --laser-component", ".rtl .rta"),
    "write_cmm": _output("Points CSV to write", ".csv"),
    "write_drift": _output("Drift readings CSV to write, of the thermal models", ".csv"),
}
CHOICES = {
    "method": _text(
        "METHOD", "Components of variance: reml, anova (mean squares) or paper", "reml"
    ),
    "model": _text(
        "MODEL", "auto (the best on held-out cycles), stepwise, ridge or lagged", "auto"
    ),
    "zeroed": _text(
        "HOW",
        "Drift probe zeroed in every cycle: cycle (an offset each), never, auto (by the data)",
        shown="auto",
    ),
    "at": _text("NAME=VALUE...", "A covariate for the prediction"),
    "grid": _text("N or NX,NY,NZ", "A grid over the travels instead of a part; --plot draws a map"),
    "datum": _text(
        "DATUM",
        "Best-fit alignment removed from each part: none, offset, offset,rotation or (of a ring) "
        "offset,diameter",
        shown="none",
    ),
    "correlation": _text(
        "HOW", "shared: full covariance; independent: as the papers", shown="shared"
    ),
    "k": Option(float, "K", "Coverage factor of U = k u", shown="2; of a budget, for 95 %"),
    "digits": Option(int, "N", "Significant digits of u that matter", shown="2"),
    "seed": Option(int, "N", "Seed of the random numbers"),
    "trials": Option(int, "N", "Monte Carlo trials; without it the count adapts"),
    "threads": Option(int, "N", "Threads; the result does not depend on them"),
    "alpha": Option(
        float, "P", "Family-wise rate of false alarms, of all tests together", shown="0.05"
    ),
    "max_effects": Option(
        int, "N", "At most so many causes: a growth with its drifts and offsets is one", shown="4"
    ),
    "exclude": _text("NAME...", "An effect or a family not to look for: cyclic-x, cyclic"),
    "of": _text("PLACE", "A place with one coordinate, or PLACE.coordinate", REQUIRED),
    "of:shares": _text("PLACE", "Show where the variance of this place or coordinate comes from"),
    "of:many": _text("PLACE...", "A place or PLACE.coordinate instead of those reported"),
    "vary": _text(
        "NAME=LOW:HIGH:COUNT...",
        "axis_um, probe_um, perpendicular_um or repeats; or NAME=a,b,c",
        REQUIRED,
    ),
    "kind": _text(
        "KIND", "machine, part, study, budget, graph, effects or import", REQUIRED, argument=True
    ),
    "as_": _text("KIND", "What to make: readings, points or drift", REQUIRED),
    "component:read": _text("NAME", "The component that the file reads"),
    "unit": _text("UNIT", "Unit of readings without one"),
    "decimal": _text("SIGN", "Decimal sign . or , where the file leaves it open"),
    "directions": _text(
        "HOW", "Of runs, where the file leaves it open: alternate, forward or reverse"
    ),
    "out:csv": Option(Path, "FILE", "The contract's CSV; without it on standard output", "-o"),
    "topic": _text(
        "TOPIC",
        "A topic, the code of a warning or error, or a command; without: all topics",
        argument=True,
    ),
    "standard": _text("STANDARD", "Figures of the table: iso230-2 or vdi3441", "iso230-2"),
    "limit": _text("NAME=VALUE...", "Limit of a figure in the axis' unit: A=10, dx_x.R=5"),
    "plan": Option(float, "MM", "Propose targets for this travel instead, with --pitch"),
    "pitch": Option(float, "MM", "Pitch of the ball screw or scale, which no target is to meet"),
    "direction:traces": _text("cw|ccw", "Direction of the traces; of several files with commas"),
    "radius": Option(float, "MM", "Nominal radius of the traces, where no column radius_mm has it"),
    "feed": _text("MM/MIN", "Feed along the circle; of several files with commas"),
    "feed:moves": Option(
        float, "MM/MIN", "Feed of the moves of --to-nc: that of the test", shown="1000"
    ),
    "pitch:circle": _text(
        "MM", "Pitch of ball screws or scales for the cyclic error; of each axis with a comma"
    ),
    "plane": _text("PLANE", "XY, YZ or ZX, first to second axis counter-clockwise"),
    "component:table": _text(
        "NAME...", "A component or an effect of the machine; of several along one axis the sum"
    ),
    "for_": _text(
        "CONTROLLER",
        "linuxcnc, siemens-enc, siemens-cec, heidenhain, beckhoff, isg-csv, etalon, aerotech, acs, "
        "pmac, mitsubishi, klipper (skew) or table (for hand entry)",
    ),
    "direction:table": _text(
        "HOW",
        "both, mean (the control's backlash is 0 or applied by halves) or forward (it is applied "
        "as a whole)",
        shown="both where the format has two columns, else mean",
    ),
    "from_": Option(float, "MM", "First point of an interpolated table, machine position"),
    "to:end": Option(float, "MM", "Its last point"),
    "step": Option(float, "MM", "Its step"),
    "reference": Option(
        float, "MM", "Machine position where the table is 0", shown="0 if a target, else the first"
    ),
    "machine_zero": Option(float, "MM", "Machine position of the readings' zero", shown="0"),
    "set": _text(
        "NAME=VALUE...",
        "A parameter of the control: axis table encoder counts_per_mm unit type variant",
    ),
    "reverse_axis": _flag("The machine's axis runs against that of the readings"),
    "covariance": _flag("Covariance matrix in the report"),
    "detail": _flag("Tables with all statistics, beyond u, U, intervals and p"),
    "date": _text("DATE", "The date that stands on the --report"),
    "quiet": _flag("No tables", "-q"),
}
SIMULATED = {
    READINGS: {
        "passes": _count(5, "Passes in each direction"),
        "one_way": _flag("Read forward only"),
        "positions": _text(
            "LOW:HIGH:COUNT",
            "Positions along every axis, mm, or x=0:500:8,y=0:300:8,...",
            shown="the part's extent, 8 of them",
        ),
        "laser_component": _text("NAME", "The component of --write-laser"),
    },
    POINTS: {
        "parts": _count(21, "Parts to make"),
        "repeats": _count(2, "CMM measurements a feature"),
        "cmm_u_um": _number(1.0, "UM", "CMM standard uncertainty, um"),
        "part_offset_um": _number(0.0, "UM", "Random offset of each part, um"),
        "reverse_every": _count(0, "Machine every n-th part backwards; 0: none", 0),
        "minutes": _number(0.5, "MIN", "Minutes a feature"),
        "first_repeats": _text("PARTS:REPEATS", "Measurements of the first parts, such as 4:5"),
        "operation": _text("NAME", "How the features are made"),
        "scatter": _text("'Ex: EQUATION'...", "Standard deviation of each feature's error, mm"),
        "effect": _text("'Ex: EQUATION'...", "Undeclared effect, mm; names: x y z, covariates"),
        "covariate": _text("'NAME: EQUATION'...", "A column, 'T_spindle_degC: 20 + time_min/60'"),
    },
    DRIFT: {
        "cycles": _count(4, "Warm-ups and cool-downs in turn, each a cycle", most=1000),
        "cycle_minutes": _number(190.0, "MIN", "Minutes of readings a cycle"),
        "soak_minutes": _number(120.0, "MIN", "Minutes without readings between cycles"),
        "interval_min": _number(1.0, "MIN", "Minutes from reading to reading", 1e-6),
        "room_lag_min": _number(30.0, "MIN", "Time constant of the room"),
        "room_wobble_degc": _number(0.5, "DEGC", "Swings of the room: standard deviation"),
        "reading_noise_um": _number(0.25, "UM", "Standard deviation of a drift reading"),
        "reading_noise_arcsec": _number(0.05, "ARCSEC", "The same of an angle"),
    },
    CLIMATE: {
        "room": _text("LOW:HIGH", "Room, driven to and fro, degC", "20:26", bounds=ROOMS),
        "sensor_lag_min": _text("LOW:HIGH", "Time constants, spread", "5:25", bounds=(0.0, 1e6)),
        "sensor_spread": _number(0.05, "NUMBER", "Sensors see 1 -+ this of the room's rise"),
        "sensor_wobble_degc": _number(0.8, "DEGC", "Draughts at a sensor: standard deviation"),
        "sensor_noise_degc": _number(0.015, "DEGC", "Standard deviation of a sensor's reading"),
        "drift_positions": _text(
            "'NAME: NUMBERS'...",
            "Where a component's drift is read, mm; else at the positions of its thermal model",
        ),
        "settled_drift": _text(
            "'NAME: NUMBERS'...", "Drift at each position once the room has settled at HIGH"
        ),
        "most_drift_um": _number(40.0, "UM", "Largest settled drift of the other components"),
        "most_drift_arcsec": _number(40.0, "ARCSEC", "The same of angles"),
        "twin": _text("'NAME: SENSOR'...", "A second sensor at the place of another"),
    },
    PARTS_ROOM: {
        "cmm_room": Option(
            float,
            "DEGC...",
            "Room while parts are measured, in turn: adds the sensors' columns",
            bounds=ROOMS,
        ),
        "cmm_wobble_degc": _number(0.1, "DEGC", "Draughts at a sensor then: standard deviation"),
    },
}
"""Of a virtual machine, by panels: each says for which of the files its options matter."""
OPTIONS: dict[str, Option] = {
    **FILES,
    **WRITTEN,
    **CHOICES,
    **{
        name: replace(option, panel=panel)
        for panel, options in SIMULATED.items()
        for name, option in options.items()
    },
}
"""By the name of the parameter; behind a colon which of several of that name it is."""
BESIDE = {"to_file": ".txt"}
"""Ending of a file that may be written beside that of an option."""
ROLES = ("machine", "part", "components", "lbb", "laser", "cmm", "drift", "effects", "before",
         "budget", "file", "current", "read", "verify")  # fmt: skip
"""Options that name files to read."""
MADE: dict[str, dict[str, tuple[str, ...]]] = {
    "simulate": {
        "write_lbb": ("lbb", "laser"),
        "write_laser": ("laser",),
        "write_cmm": ("cmm",),
        "write_drift": ("drift",),
    },
    "fit-components": {"out": ("components",)},
    "thermal-fit": {"out": ("components",)},
}
"""Roles of a study's files that a command is there to make, anew too, by its option."""
