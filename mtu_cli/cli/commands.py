"""The commands of `mtu`: the options, the chapter and the help of each.

A chapter is imported when one of its commands runs, so that --help is quick.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from keyword import iskeyword
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperArgument, TyperOption

from mtu_cli import __version__
from mtu_cli.cli.options import Options, entries, options_of, signature
from mtu_cli.findings import CATALOGUE, error, nearest
from mtu_cli.help import ORDER, paragraph, topic

PANELS = {
    "machine": "The machine",
    "part": "Predictions for a part",
    "parts": "Measured parts",
    "about": "Uncertainty, files and help",
}
"""Where `mtu --help` lists a command."""
READ = "study machine lbb laser"
MODEL = "study machine part components lbb laser drift at k digits correlation"
RANDOM = "seed trials threads"
OUT = "out csv plot report date detail quiet"


# Help shows our word for a value: no Python type with arguments and flags.
for _kind in (TyperArgument, TyperOption):
    _bare: Any = _kind
    _bare.display_type_rich = lambda self, ctx: self.metavar if self.opts[0][0] == "-" else ""


class Command(NamedTuple):
    """A command: its chapter, its options, its help, the panel where `mtu --help` lists it, and
    its gates beside that of the checks (None: it reads no data that they look at).
    """

    chapter: str
    options: str
    text: str
    panel: str | None = None
    gates: tuple[str, ...] | None = None


def declare(text: str) -> dict[str, Command]:
    """Commands by name, of lines ``name | chapter | panel | gates | help | options``; -: none."""
    result = {}
    for name, chapter, panel, gates, says, options in entries(text):
        gate_names = None if gates == "-" else tuple(gates.split()[1:])
        result[name] = Command(chapter, options, says, PANELS.get(panel), gate_names)
    return result


# The files of simulate list its options in this order.
COMMANDS = declare(f"""
    fit-components | analyse | machine | suspicious drift | Readings to coefficients, \
        covariance, repeatability, drift, reversal, per component. \
        | {READ} k digits {OUT}
    thermal-fit | analyse | machine | suspicious | Drift readings with temperatures to a thermal \
        model per component. \
        | study machine drift model zeroed {OUT}
    iso230 | axes | machine | suspicious nonconforming | Positioning figures of ISO 230-2 \
        or VDI/DGQ 3441 with uncertainties, limits, a plan. \
        | study machine lbb laser before budget standard limit plan pitch k digits seed {OUT}
    circular | axes | machine | - | A circular test (ISO 230-4): figures, and its causes by \
        one joint fit. \
        | file:traces direction:traces radius feed pitch:circle plane k digits write_components \
        {OUT}
    predict-points | analyse | part | suspicious nonconforming=0.01 | Error and uncertainty of \
        every feature of a part. \
        | {MODEL} {RANDOM} grid covariance {OUT}
    lengths | analyse | part | suspicious nonconforming=0.01 | Feature-to-feature lengths with \
        uncertainty and probability of conformance. \
        | {MODEL} {RANDOM} {OUT}
    orthogonality | analyse | part | suspicious nonconforming=0.01 | Right angles between rows \
        and columns of features, by Monte Carlo and first order. \
        | {MODEL} {RANDOM} {OUT}
    anova | analyse | parts | suspicious unusual | Measured parts: part-to-part and CMM scatter \
        of features, lengths and right angles. \
        | study machine part cmm method datum k digits seed {OUT}
    close-loop | close_loop | parts | suspicious found unexplained | Measured minus model: \
        effects that the machine does not declare, named and added to it. \
        | study machine part components lbb laser cmm drift at datum alpha max_effects effects \
        exclude write_machine write_components seed {OUT}
    compare | analyse | parts | suspicious biased under-predicted | Predicted against measured \
        parts: means, scatter, ratios, a verdict for each. \
        | {MODEL} {RANDOM} cmm datum {OUT}
    correct | analyse | parts | suspicious | Measured points minus the modelled error; rings and \
        lengths before and after. \
        | {MODEL} cmm {OUT}
    compensate | axes | machine | suspicious | Errors of an axis to the table of a \
        control, read back, with moves that prove it. \
        | {READ} component:table for_ direction:table from_ to:end step reference machine_zero \
        reverse_axis current set read verify to_file to_nc feed:moves seed trials digits {OUT}
    budget | one_file | about | - | An uncertainty budget: first and second order, with Monte \
        Carlo. \
        | file:budget k:budget digits {RANDOM} {OUT}
    simulate | simulate | machine | - | A virtual machine: synthetic readings and points, with \
        any effect, seeded. \
        | study machine part components seed passes positions laser_component parts \
        repeats cmm_u_um reverse_every minutes first_repeats operation scatter effect covariate \
        cmm_room write_lbb write_laser write_cmm write_drift cycles interval_min \
        sensor_noise_degc reading_noise_um reading_noise_arcsec drift_positions settled_drift \
        twin quiet
    graph check | one_file | - | - | Whether a graph is sound, with all its faults at once; \
        and its firing order. \
        | file:graph {OUT}
    graph draw | one_file | - | - | The graph as a picture, or as text for other programs. \
        | file:graph to of:shares
    graph simulate | one_file | - | - | Uncertainty of the graph's places by Monte Carlo, and \
        where it comes from. \
        | file:graph of:many k digits {RANDOM} {OUT}
    graph sweep | one_file | - | - | Uncertainty of one place over a grid of probing \
        uncertainties, with a formula. \
        | file:graph vary of k digits {RANDOM} {OUT}
    inspect | one_file | about | - | What an instrument's file is and holds: format, axis, \
        targets, runs, units, decimal sign. \
        | file:instrument decimal out quiet
    import | one_file | about | - | Instruments' files to the contract's CSV of readings, \
        points or drift. \
        | file:import as_ component:read map unit decimal directions machine to_csv
    schema | commands | about | - | The JSON Schema of a YAML contract, for editors. \
        | kind
    help | commands | about | - | Topics, the meaning of a warning or error, and the options of a \
        command. \
        | topic
""")
"""By their names, as a user types them."""


def analysis_of(name: str) -> Callable[..., Any]:
    """The function of a command in its chapter, imported now."""
    module = import_module(f"mtu_cli.cli.{COMMANDS[name].chapter}")
    name = name.replace("-", "_").replace(" ", "_")
    return getattr(module, f"{name}_" if iskeyword(name) else name)


def _call_of(name: str) -> Callable[..., None]:
    """What a call of the command does, with all its options as parameters."""
    command = COMMANDS[name]

    def call(**values: Any) -> None:
        options = Options(name, values, command.gates or ())
        if command.chapter == "commands":
            analysis_of(name)(options)
        else:
            from mtu_cli.cli.emit import execute
            from mtu_cli.cli.values import check_values

            check_values(options_of(command.options), values)
            execute(options, analysis_of(name))

    # Read by typer.
    call.__signature__ = signature(command.options, command.gates)  # type: ignore[attr-defined]
    return call


def _version(version: bool) -> None:
    if version:
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
app.add_typer(graph, name="graph", rich_help_panel=PANELS["about"])
for _name, _command in COMMANDS.items():
    _group, _, _last = _name.rpartition(" ")
    _place: Any = {"help": _command.text, "rich_help_panel": _command.panel}
    (graph if _group else app).command(_last, **_place)(_call_of(_name))


def schema(options: Options) -> None:
    """Prints the JSON Schema of a contract."""
    import json

    from mtu_cli.files.contract import json_schema

    print(json.dumps(json_schema(options.kind), indent=2))


def help(options: Options) -> None:
    """Prints a topic, the paragraph of a finding, or the help of a command."""
    commands = [*COMMANDS, "graph"]
    name = " ".join(options.topic or ())
    if not name:
        titles = {each: topic(each).partition("\n")[0].removeprefix("# ") for each in ORDER}
        lines = [f"- `mtu help {each}` — {title}" for each, title in titles.items()]
        show("\n".join(["# Help", "", *lines, "- `mtu help CODE` — a warning or error", ""]))
    elif name in ORDER:
        show(topic(name))
    elif name in CATALOGUE:
        show(paragraph(name))
    elif name not in commands:
        meant = nearest(name, [*ORDER, *commands, *CATALOGUE])
        expected = "a topic, a command, or the code of a finding (mtu help lists the topics)"
        raise error("unknown-name", what="topic", value=name, expected=expected, meant=meant)
    if name in commands:
        app([*name.split(), "--help"], prog_name="mtu", standalone_mode=False)
        from mtu_cli.reports.document import help_text

        show(help_text(name))


def show(text: str) -> None:
    """Markdown, rendered on a terminal and as it is in a pipe."""
    if not sys.stdout.isatty():
        sys.stdout.write(text)
        return
    from rich.console import Console
    from rich.markdown import Markdown

    Console().print(Markdown(text))
