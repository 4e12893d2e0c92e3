"""The commands of `mtu`: the options, the chapter and the help of each.

A chapter is imported when one of its commands runs, so that --help is quick.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from keyword import iskeyword
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperArgument, TyperOption

from mtu_cli import __version__
from mtu_cli.cli.options import Options, signature

MACHINE, PART, PARTS, ABOUT = (
    "The machine",
    "Predictions for a part",
    "Measured parts",
    "Uncertainty, files and help",
)
READ = "study machine lbb laser"
MODEL = "study machine part components lbb laser drift at k digits correlation"
RANDOM = "seed trials threads"
OUT = "out csv plot report date detail quiet"


# Help has our word for a value alone: no Python type beside arguments and flags, no bounds, which
# are there for slips of the keyboard.
for _kind in (TyperArgument, TyperOption):
    _bare: Any = _kind
    _bare.display_type_rich = lambda self, ctx: self.metavar if self.opts[0][0] == "-" else ""
    _bare._get_number_range_help_str = lambda self: None


class Command(NamedTuple):
    """A command: its chapter, its options, its help, the panel where `mtu --help` lists it, and
    its gates beside that of the checks (None: it reads no data that they look at).
    """

    chapter: str
    options: str
    text: str
    panel: str | None = None
    gates: tuple[str, ...] | None = None


COMMANDS = {
    "fit-components": Command(
        "cli.analyse",
        f"{READ} k digits {OUT}",
        "Readings to coefficients, covariance, repeatability, drift, reversal, per component.",
        MACHINE,
        ("drift",),
    ),
    "thermal-fit": Command(
        "cli.analyse",
        f"study machine drift model zeroed {OUT}",
        "Drift readings with temperatures to a thermal model per component.",
        MACHINE,
        (),
    ),
    "iso230": Command(
        "cli.standards",
        f"study lbb laser before budget standard limit plan pitch k digits seed {OUT}",
        "Positioning figures of ISO 230-2 or VDI/DGQ 3441 with uncertainties, limits, a plan.",
        MACHINE,
        ("nonconforming",),
    ),
    "circular": Command(
        "cli.standards",
        "file:traces direction:traces radius feed pitch:circle plane k digits "
        f"write_components {OUT}",
        "A circular test (ISO 230-4): figures, and its causes by one joint fit.",
        MACHINE,
    ),
    "predict-points": Command(
        "cli.analyse",
        f"{MODEL} {RANDOM} grid covariance {OUT}",
        "Error and uncertainty of every feature of a part.",
        PART,
        ("nonconforming=0.01",),
    ),
    "lengths": Command(
        "cli.analyse",
        f"{MODEL} {RANDOM} {OUT}",
        "Feature-to-feature lengths with uncertainty and probability of conformance.",
        PART,
        ("nonconforming=0.01",),
    ),
    "orthogonality": Command(
        "cli.analyse",
        f"{MODEL} {RANDOM} {OUT}",
        "Right angles between rows and columns of features, by Monte Carlo and first order.",
        PART,
        ("nonconforming=0.01",),
    ),
    "anova": Command(
        "cli.analyse",
        f"study machine part cmm method datum k digits seed {OUT}",
        "Measured parts: part-to-part and CMM scatter of features, lengths and right angles.",
        PARTS,
        ("unusual",),
    ),
    "close-loop": Command(
        "cli.close_loop",
        "study machine part components lbb laser cmm drift at datum alpha max_effects effects "
        f"exclude write_machine write_components seed {OUT}",
        "Measured minus model: effects that the machine does not declare, named and added to it.",
        PARTS,
        ("found", "unexplained"),
    ),
    "compare": Command(
        "cli.analyse",
        f"{MODEL} {RANDOM} cmm datum {OUT}",
        "Predicted against measured parts: means, scatter, ratios, a verdict for each.",
        PARTS,
        ("biased", "under-predicted"),
    ),
    "correct": Command(
        "cli.analyse",
        f"{MODEL} cmm {OUT}",
        "Measured points minus the modelled error; rings and lengths before and after.",
        PARTS,
        (),
    ),
    "compensate": Command(
        "cli.compensate",
        "study machine lbb laser component:table for_ direction:table from_ to:end step reference "
        f"machine_zero reverse_axis current set read verify to_file to_nc feed:moves "
        f"seed trials digits {OUT}",
        "Errors of an axis to the table of a control, read back, with moves that prove it.",
        MACHINE,
        (),
    ),
    "budget": Command(
        "cli.measurement",
        f"file:budget k digits {RANDOM} {OUT}",
        "An uncertainty budget: first and second order, with Monte Carlo.",
        ABOUT,
    ),
    "simulate": Command(
        "cli.simulate",
        # The files say in this order how they were made.
        "study machine part components seed passes one_way positions laser_component parts "
        "repeats cmm_u_um part_offset_um reverse_every minutes first_repeats operation scatter "
        "effect covariate write_lbb write_laser write_cmm write_drift cycles cycle_minutes "
        "soak_minutes interval_min room room_lag_min room_wobble_degc sensor_lag_min "
        "sensor_spread sensor_wobble_degc sensor_noise_degc reading_noise_um reading_noise_arcsec "
        "drift_positions settled_drift most_drift_um most_drift_arcsec twin cmm_room "
        "cmm_wobble_degc quiet",
        "A virtual machine: synthetic readings and points, with any effect, seeded.",
        MACHINE,
    ),
    "graph check": Command(
        "cli.measurement",
        f"file:graph {OUT}",
        "Whether a graph is sound, with all its faults at once; and its firing order.",
    ),
    "graph draw": Command(
        "cli.measurement",
        "file:graph to of:shares",
        "The graph as a picture, or as text for other programs.",
    ),
    "graph simulate": Command(
        "cli.measurement",
        f"file:graph of:many k digits {RANDOM} {OUT}",
        "Uncertainty of the graph's places by Monte Carlo, and where it comes from.",
    ),
    "graph sweep": Command(
        "cli.measurement",
        f"file:graph vary of k digits {RANDOM} {OUT}",
        "Uncertainty of one place over a grid of probing uncertainties, with a formula.",
    ),
    "inspect": Command(
        "cli.instruments",
        "file:instrument decimal out quiet",
        "What an instrument's file is and holds: format, axis, targets, runs, units, decimal sign.",
        ABOUT,
    ),
    "import": Command(
        "cli.instruments",
        "files as_ component:read map unit decimal directions machine out:csv",
        "Instruments' files to the contract's CSV of readings, points or drift.",
        ABOUT,
    ),
    "schema": Command(
        "cli.help", "kind", "The JSON Schema of a YAML contract, for editors.", ABOUT
    ),
    "help": Command(
        "cli.help",
        "topic",
        "Topics, the meaning of a warning or error, and the options of a command.",
        ABOUT,
    ),
}
"""By their names, as a user types them."""


def function_name(name: str) -> str:
    """The name of a command in Python."""
    result = name.replace("-", "_").replace(" ", "_")
    return f"{result}_" if iskeyword(result) else result


def analysis_of(name: str) -> Callable[..., Any]:
    """The function of a command in its chapter, imported now."""
    module = import_module(f"mtu_cli.{COMMANDS[name].chapter}")
    result: Callable[..., Any] = getattr(module, function_name(name))
    return result


def _called(name: str) -> Callable[..., None]:
    """What a call of the command does, with all its options as parameters."""
    command = COMMANDS[name]

    def call(**values: Any) -> None:
        options = Options(name.replace(" ", "-"), values, command.gates or ())
        if command.chapter == "cli.help" or name == "import":
            analysis_of(name)(options)
        else:
            from mtu_cli.cli.emit import execute

            execute(options, analysis_of(name))

    typed = signature(command.options, command.gates)
    call.__signature__ = typed  # type: ignore[attr-defined]  # read by typer
    call.__annotations__ = {key: item.annotation for key, item in typed.parameters.items()}
    return call


def _version(asked: bool) -> None:
    if asked:
        print(f"mtu {__version__}")
        raise typer.Exit


def _global(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


app = typer.Typer(
    name="mtu",
    help="Machine tool uncertainty: from measurements of a machine and of its parts to "
    "statements with uncertainty.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["--help", "-h"]},
    add_completion=False,
    pretty_exceptions_enable=False,
    callback=_global,
)
graph = typer.Typer(
    help="The measurement graph: its soundness, picture, uncertainty, and what that follows.",
    no_args_is_help=True,
)
app.add_typer(graph, name="graph", rich_help_panel=ABOUT)
for _name, _command in COMMANDS.items():
    _group, _, _last = _name.rpartition(" ")
    _place: Any = {"help": _command.text, "rich_help_panel": _command.panel}
    (graph if _group else app).command(_last, **_place)(_called(_name))
