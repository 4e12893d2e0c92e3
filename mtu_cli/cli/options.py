"""Every option of the commands, once: `--seed` has the same type and meaning everywhere."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer

from mtu_cli.findings import SUSPICIOUS

REQUIRED = inspect.Parameter.empty


@dataclass(frozen=True)
class Options:
    """The options of one call, by name (None where the command lacks it), and its gates."""

    command: str
    values: dict[str, Any] = field(default_factory=dict)
    gates: tuple[str, ...] = ()

    def __getattr__(self, name: str) -> Any:
        return self.values.get(name)

    @property
    def written(self) -> dict[str, Path]:
        """The files that the call writes: path by name of the option."""
        return {x: path for x in WRITTEN if isinstance(path := self.values.get(x), Path)}


@dataclass(frozen=True, slots=True)
class Option:
    """One option: the type of its value, the word for it in the help, where ``...`` says that it
    may be repeated, and what it means. `shown`: the default that a study or the command chooses;
    `panel`: its group in the help; `bounds` of a number; `choices` of a text; `endings` of the
    name of a file to write.
    """

    kind: type
    metavar: str | None
    text: str
    flags: tuple[str, ...] = ()
    default: Any = None
    argument: bool = False
    shown: str | None = None
    panel: str | None = None
    bounds: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()
    endings: tuple[str, ...] = ()

    @property
    def many(self) -> bool:
        """Whether it may be repeated."""
        return self.metavar is not None and self.metavar.endswith("...")

    def annotation(self, name: str) -> Any:
        """The annotated type of the parameter `name`."""
        kind: Any = list[self.kind] if self.many else self.kind  # type: ignore[name-defined]
        kind = kind | None if self.default is None else kind
        repeatable = "; repeatable" * (self.many and not self.argument)
        common: dict[str, Any] = {
            "metavar": self.metavar and self.metavar.removesuffix("..."),
            "help": f"{self.text}{repeatable}.",
            "show_default": self.shown or self.default not in (None, REQUIRED, False),
            "rich_help_panel": self.panel,
            # The reader of a file reports what is wrong with it.
            "parser": {Path: file_name, int: self.number, float: self.number}.get(self.kind),
        }
        if self.argument:
            return Annotated[kind, typer.Argument(**common)]
        return Annotated[kind, typer.Option(*self.names(name), **common)]

    def number(self, text: str) -> Any:
        """The value of a number; raises BadParameter for other text."""
        try:
            return self.kind(text)
        except ValueError:
            what = "a whole number" if self.kind is int else "a number"
            raise typer.BadParameter(f"not {what}: {text!r}") from None

    def names(self, name: str) -> tuple[str, ...]:
        """Its names on the command line: its flags, and the one of the parameter `name`."""
        return self.flags if self.flags[1:] else (*self.flags, option_name(name))


def option_name(name: str) -> str:
    """The option of a parameter: --sensor-noise-degC of sensor_noise_degc."""
    return f"--{name.rstrip('_').replace('_', '-')}".replace("degc", "degC")


def file_name(text: str) -> Path:
    """A path; an empty name, as of a script's variable that is not set, is none."""
    if not text or (text.endswith("/") and not Path(text).is_dir()):
        raise typer.BadParameter("it names no file")
    return Path(text)


def options_of(names: str) -> dict[str, Option]:
    """The options of a command by the names of their parameters."""
    return {key.partition(":")[0]: OPTIONS[key] for key in names.split()}


def signature(names: str, gates: tuple[str, ...] | None) -> inspect.Signature:
    """The parameters of a command: its options, and `--fail-if` where it has `gates`."""
    options = options_of(names)
    if gates is not None:
        listing = "; ".join([f"{SUSPICIOUS}, data look mistaken", *gates])
        text = f"Exit with 3 if met: {listing}. Several with commas"
        options["fail_if"] = Option(str, "GATE...", text)
    kind: Any = inspect.Parameter.KEYWORD_ONLY
    parameters = []
    for name, option in options.items():
        hint = option.annotation(name)
        parameters.append(inspect.Parameter(name, kind, annotation=hint, default=option.default))
    return inspect.Signature(parameters)


KINDS = {"path": Path, "text": str, "int": int, "float": float, "flag": bool}


def entries(text: str) -> list[list[str]]:
    """The parts of lines ``a | b | c``."""
    return [" ".join(line.split()).split(" | ") for line in text.splitlines() if line.strip()]


def declare(text: str, panel: str | None = None) -> dict[str, Option]:
    """Options by name, of lines ``name | kind ... | word for the value | meaning | default``.

    Behind its kind stand a short form or all names, ``argument``, bounds LOW..HIGH, choices A/B or
    endings of a file's name; the default is a value, ``required``, or ``shown:`` what a study or
    the command chooses.

    >>> declare("k | float 0..9 | K... | Factor | shown: 2")["k"].bounds
    (0.0, 9.0)
    """
    result = {}
    for name, kinds, metavar, meaning, *last in entries(text):
        default = "".join(last)
        word, *more = kinds.split()
        kind, number = KINDS[word], int if word == "int" else float
        fields: dict[str, Any] = {"default": False if word == "flag" else None}
        for each in more:
            low, dots, high = each.partition("..")
            if dots:
                fields["bounds"] = number(low), number(high)
            elif "/" in each:
                fields["choices"] = tuple(each.split("/"))
            elif each == "argument":
                fields["argument"] = True
            elif each[0] == "-":
                fields["flags"] = (*fields.get("flags", ()), each)
            else:
                fields["endings"] = (*fields.get("endings", ()), each)
        if default.startswith("shown: "):
            fields["shown"] = default.removeprefix("shown: ")
        elif default:
            fields["default"] = REQUIRED if default == "required" else kind(default)
        placeholder = None if metavar == "-" else metavar
        result[name] = Option(kind, placeholder, meaning, panel=panel, **fields)
    return result


READINGS, POINTS = "Readings", "Points of parts"
DRIFT, CLIMATE = "Drift test", "Room and sensors (of a drift test, or of parts with --cmm-room)"
FILES = declare("""
    study | path argument | STUDY | Study file; without it and without -m, mtu.yaml here or above
    machine | path -m | FILE | Machine YAML
    part | path -p | FILE | Part YAML
    components | path -c | FILE... | Report of fit-components or thermal-fit; wins over -m
    lbb | path | FILE... | Laser ball bar readings: CSV, or NAME=FILE of an instrument
    laser | path | FILE... | Laser readings: CSV, or NAME=FILE of an instrument
    drift | path | FILE... | Thermal drift readings: CSV, or NAME=FILE of an instrument
    cmm | path | FILE... | Measured points: CSV, or a file of a CMM
    current | path | FILE | The table that was active while measuring; the new one adds to it
    read | path | FILE | A control's table to print as errors, in place of making one
    verify | path | FILE | Readings of the verification moves: CSV, or a file of an instrument
    effects | path | FILE... | Your own effects (YAML), added to the built-in ones
    before | path | FILE... | Readings CSV of an earlier test of the same axes
    budget | path | FILE | YAML with the instrument's `budget`, else the study's
    file:traces | path argument | FILE... | Traces: CSV, or the features of a .b5r | required
    file:budget | path argument | FILE | Budget YAML | required
    file:instrument | path argument | FILE | A file of an instrument | required
    file:import | path argument | FILE... | Files of an instrument, or COMPONENT=FILE | required
    map | path | FILE | Mapping profile (mtu/import/1) of any table
    file:graph | path argument | FILE | Graph YAML | required
""")
WRITTEN = declare("""
    out | path -o .json | FILE | JSON report; - is standard output, alone on it
    csv | path .csv | FILE | The main table as CSV
    plot | path .png .svg .pdf | FILE | Picture: .png, .svg or .pdf
    report | path .html .htm .pdf | FILE | A report to hand on: .html (.pdf with an extra)
    to | path .svg .png .pdf .dot .mmd .pl | FILE | Picture, or text: .dot, .mmd, .pl | required
    to_file | path | FILE | The table for the control
    to_nc | path .nc .ngc .txt | FILE | The verification moves as G-code (RS-274)
    to_csv | path -o --out .csv | FILE | The contract's CSV; without it on standard output
    write_machine | path .yaml .yml | FILE | The machine YAML with the found effects added to it
    write_components | path .json | FILE | Components report (-c) with the effects' covariance
    write_lbb | path .csv | FILE | Readings CSV to write
    write_laser | path .rtl .rta | FILE | Run of a laser to write, of --laser-component; \
        .rta of angles
    write_cmm | path .csv | FILE | Points CSV to write
    write_drift | path .csv | FILE | Drift readings CSV to write, of the thermal models
""")
CHOICES = declare("""
    method | text reml/anova/paper | METHOD | \
        Components of variance: reml, anova (mean squares) or paper | reml
    model | text auto/stepwise/ridge/lagged | MODEL | \
        auto (the best on held-out cycles), stepwise, ridge or lagged | auto
    zeroed | text | HOW | Drift probe zeroed in each cycle: cycle, never, auto | shown: auto
    at | text | NAME=VALUE... | A covariate for the prediction
    grid | text | N or NX,NY,NZ | A grid over the travels instead of a part; --plot draws a map
    datum | text | DATUM | Best-fit alignment removed from each part: none, offset, \
        offset,rotation or (of a ring) offset,diameter | shown: none
    correlation | text | HOW | shared: full covariance; independent: as the papers | shown: shared
    k | float --k --coverage-factor | K | Coverage factor of U = k u | shown: 2
    k:budget | float --k --coverage-factor | K | Coverage factor of U = k u | shown: that for 95 %
    digits | int | N | Significant digits of u that matter | shown: 2
    seed | int | N | Seed of the random numbers
    trials | int | N | Monte Carlo trials; without it the count adapts
    threads | int | N | Threads; the result does not depend on them
    alpha | float | P | Family-wise rate of false alarms, of all tests together | shown: 0.05
    max_effects | int | N | Most causes: a growth with its drifts and offsets is one | shown: 4
    exclude | text | NAME... | An effect or a family not to look for: cyclic-x, cyclic
    of | text | PLACE | A place with one coordinate, or PLACE.coordinate | required
    of:shares | text | PLACE | Show where the variance of this place or coordinate comes from
    of:many | text | PLACE... | A place or PLACE.coordinate instead of those reported
    vary | text | NAME=LOW:HIGH:COUNT... | axis_um, probe_um, perpendicular_um or repeats; or \
        NAME=a,b,c | required
    kind | text argument | KIND | machine, part, study, budget, graph, effects, import | required
    as_ | text readings/points/drift | KIND | What to make: readings, points or drift | required
    component:read | text | NAME | The component that the file reads
    unit | text | UNIT | Unit of readings without one
    decimal | text ./, | SIGN | Decimal sign . or , where the file leaves it open
    directions | text alternate/forward/reverse | HOW | \
        Of runs, where left open: alternate, forward or reverse
    topic | text argument | TOPIC... | A topic, code or command; without it all topics
    standard | text iso230-2/vdi3441 | STANDARD | \
        Figures of the table: iso230-2 or vdi3441 | iso230-2
    limit | text | NAME=VALUE... | Limit of a figure in the axis' unit: A=10, dx_x.R=5
    plan | float 1e-3..1e6 | MM | Propose targets for this travel instead, with --pitch
    pitch | float 1e-3..1e6 | MM | Pitch of the ball screw or scale, which no target is to meet
    direction:traces | text | cw|ccw | Direction of the traces; of several files with commas
    radius | float | MM | Nominal radius of the traces, where no column radius_mm has it
    feed | text | MM/MIN | Feed along the circle; of several files with commas
    feed:moves | float 1e-3..1e6 | MM/MIN | Feed of the moves of --to-nc: that of the test | 1000
    pitch:circle | text | MM | Pitch of ball screws or scales; of each axis with a comma
    plane | text | PLANE | XY, YZ or ZX, first to second axis counter-clockwise
    component:table | text | NAME... | A component or effect; of several of one axis the sum
    for_ | text | CONTROLLER | linuxcnc, siemens-enc, siemens-cec, heidenhain, beckhoff, isg-csv, \
        etalon, aerotech, acs, pmac, mitsubishi, klipper (skew) or table (for hand entry)
    direction:table | text both/mean/forward | HOW | both, mean (backlash of 0 or by halves), \
        forward (as a whole) | shown: both where the format has two columns, else mean
    from_ | float -1e6..1e6 | MM | First point of an interpolated table, machine position
    to:end | float -1e6..1e6 | MM | Its last point
    step | float 0..1e6 | MM | Its step
    reference | float -1e6..1e6 | MM | Machine position of the 0 | shown: 0 or first target
    machine_zero | float -1e6..1e6 | MM | Machine position of the readings' zero | 0
    set | text | NAME=VALUE... | Of the control: axis table encoder counts_per_mm unit type variant
    reverse_axis | flag | - | The machine's axis runs against that of the readings
    covariance | flag | - | Covariance matrix in the report
    detail | flag | - | Tables with all statistics, beyond u, U, intervals and p
    date | text | DATE | The date that stands on the --report
    quiet | flag -q | - | No tables
""")
SIMULATED = {
    READINGS: """
    passes | int 1..10000 | N | Passes in each direction | 5
    positions | text | LOW:HIGH:COUNT | Positions along every axis, mm, or x=0:500:8,y=0:300:8,... \
        | shown: the part's extent, 8 of them
    laser_component | text | NAME | The component of --write-laser
""",
    POINTS: """
    parts | int 1..10000 | N | Parts to make | 21
    repeats | int 1..10000 | N | CMM measurements a feature | 2
    cmm_u_um | float 0..1e6 | UM | CMM standard uncertainty, um | 1.0
    reverse_every | int 0..10000 | N | Machine every n-th part backwards; 0: none | 0
    minutes | float 0..1e6 | MIN | Minutes a feature | 0.5
    first_repeats | text | PARTS:REPEATS | Measurements of the first parts, such as 4:5
    operation | text | NAME | How the features are made
    scatter | text | 'Ex: EQUATION'... | Standard deviation of each feature's error, mm
    effect | text | 'Ex: EQUATION'... | Undeclared effect, mm, such as \
        'Ey: -0.003*dir_y': would your plan find it? Names: x y z, covariates
    covariate | text | 'NAME: EQUATION'... | A column, 'T_spindle_degC: 20 + time_min/60'
    cmm_room | float -50..200 | DEGC... | Room while parts are measured, in turn: adds the \
        sensors' columns
""",
    DRIFT: """
    cycles | int 1..1000 | N | Warm-ups and cool-downs in turn, each a cycle | 4
    interval_min | float 0.01..1e6 | MIN | Minutes from reading to reading | 1.0
    reading_noise_um | float 0..1e6 | UM | Standard deviation of a drift reading | 0.25
    reading_noise_arcsec | float 0..1e6 | ARCSEC | The same of an angle | 0.05
""",
    CLIMATE: """
    sensor_noise_degc | float 0..1e6 | DEGC | Standard deviation of a sensor's reading | 0.015
    drift_positions | text | 'NAME: NUMBERS'... | Where a component's drift is read, mm; else at \
        the positions of its thermal model
    settled_drift | text | 'NAME: NUMBERS'... | Drift at each position once the room has settled \
        at 26 degC
    twin | text | 'NAME: SENSOR'... | A second sensor at the place of another
""",
}
"""Of a virtual machine, by panels: each says for which of the files its options matter."""
OPTIONS = FILES | WRITTEN | CHOICES
for _panel, _text in SIMULATED.items():
    OPTIONS |= declare(_text, _panel)
"""By the name of the parameter; behind a colon which of several of that name it is."""
BESIDE = {"to_file": (".txt",)}
"""Endings of files that may be written beside that of an option."""
ROLES = tuple(dict.fromkeys(key.partition(":")[0] for key in FILES if key != "study"))
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
